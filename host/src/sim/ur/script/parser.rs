//! Tokens to instructions: recursive descent, in one pass after the names of all routines are known.

mod expression;

use super::ScriptError;
use super::code::{Code, Name, Op, Routine, Scope, Script, Value};
use super::lexer::{Token, tokens};

const TOKENS_MAX: usize = 200_000;
const ROUTINES_MAX: usize = 512;
/// Depth of nested expressions and blocks; bounds the parser's own stack.
const DEPTH_MAX: usize = 32;

/// Words that are no variables.
const KEYWORDS: [&str; 22] = [
    "and",
    "break",
    "continue",
    "def",
    "elif",
    "else",
    "end",
    "enter_critical",
    "exit_critical",
    "global",
    "halt",
    "if",
    "join",
    "kill",
    "local",
    "not",
    "or",
    "return",
    "run",
    "thread",
    "while",
    "xor",
];

/// Loads a program: one `def name(): … end`, or `sec`.
///
/// # Errors
/// [`ScriptError`] names the first line that is not understood.
pub fn parse(text: &str) -> Result<Script, ScriptError> {
    let tokens = tokens(text)?;
    if tokens.len() > TOKENS_MAX {
        return Err(ScriptError::TooMuch { line: 1, what: "words", limit: TOKENS_MAX });
    }
    let mut parser =
        Parser { tokens: &tokens, at: 0, depth: 0, names: Vec::new(), routines: Vec::new(), loops: Vec::new() };
    parser.declare_routines()?;
    let secondary = parser.is_word("sec");
    if !secondary && !parser.is_word("def") {
        return Err(parser.expected("'def'"));
    }
    parser.routine()?;
    if parser.at < tokens.len() {
        return Err(parser.expected("nothing behind the program"));
    }
    Ok(Script { names: parser.names, routines: parser.routines, secondary })
}

struct Parser<'a> {
    tokens: &'a [(usize, Token)],
    at: usize,
    depth: usize,
    names: Vec<String>,
    routines: Vec<Routine>,
    /// Of each loop that is open its start and the jumps that leave it, still without target.
    loops: Vec<(usize, Vec<usize>)>,
}

impl Parser<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.at).map(|(_, token)| token)
    }

    fn ahead(&self, by: usize) -> Option<&Token> {
        self.tokens.get(self.at + by).map(|(_, token)| token)
    }

    /// The line of the next token, or of the last one.
    fn line(&self) -> usize {
        self.tokens.get(self.at).or_else(|| self.tokens.last()).map_or(1, |(line, _)| *line)
    }

    fn expected(&self, expected: &'static str) -> ScriptError {
        let found = self.peek().map_or_else(|| "the end of the script".to_owned(), ToString::to_string);
        ScriptError::Syntax { line: self.line(), expected, found }
    }

    fn is_word(&self, word: &str) -> bool {
        matches!(self.peek(), Some(Token::Word(found)) if found == word)
    }

    fn accept_word(&mut self, word: &str) -> bool {
        let found = self.is_word(word);
        self.at += usize::from(found);
        found
    }

    fn is_symbol(&self, symbol: &str) -> bool {
        matches!(self.peek(), Some(Token::Symbol(found)) if *found == symbol)
    }

    fn accept(&mut self, symbol: &str) -> bool {
        let found = self.is_symbol(symbol);
        self.at += usize::from(found);
        found
    }

    fn symbol(&mut self, symbol: &'static str) -> Result<(), ScriptError> {
        if self.accept(symbol) {
            return Ok(());
        }
        // What is missing at the end of a line is missed there, not where the next line begins.
        let before = self.at.checked_sub(1).and_then(|at| self.tokens.get(at)).map(|(line, _)| *line);
        match before {
            Some(line) if line < self.line() => {
                Err(ScriptError::Syntax { line, expected: symbol, found: "the end of the line".to_owned() })
            }
            _ => Err(self.expected(symbol)),
        }
    }

    fn name(&mut self, expected: &'static str) -> Result<String, ScriptError> {
        match self.peek() {
            Some(Token::Word(word)) if !KEYWORDS.contains(&word.as_str()) => {
                let word = word.clone();
                self.at += 1;
                Ok(word)
            }
            _ => Err(self.expected(expected)),
        }
    }

    fn intern(&mut self, word: String) -> Name {
        if let Some(place) = self.names.iter().position(|known| *known == word) {
            return place;
        }
        self.names.push(word);
        self.names.len() - 1
    }

    fn enter(&mut self) -> Result<(), ScriptError> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            let what = "levels of nested blocks and expressions";
            return Err(ScriptError::TooMuch { line: self.line(), what, limit: DEPTH_MAX });
        }
        Ok(())
    }

    /// Finds every routine's name first, so that calls need not stand behind definitions.
    fn declare_routines(&mut self) -> Result<(), ScriptError> {
        for pair in self.tokens.windows(2) {
            let [(line, Token::Word(opener)), (_, Token::Word(name))] = pair else { continue };
            if !matches!(opener.as_str(), "def" | "sec" | "thread") {
                continue;
            }
            if self.routines.len() >= ROUTINES_MAX {
                return Err(ScriptError::TooMuch { line: *line, what: "functions and threads", limit: ROUTINES_MAX });
            }
            if self.routines.iter().any(|known| known.name == *name) {
                return Err(ScriptError::Syntax { line: *line, expected: "a name not yet taken", found: name.clone() });
            }
            let is_thread = opener == "thread";
            self.routines.push(Routine { name: name.clone(), parameters: Vec::new(), is_thread, code: Code::new() });
        }
        Ok(())
    }

    /// From `def`, `sec` or `thread` to its `end`.
    fn routine(&mut self) -> Result<(), ScriptError> {
        self.enter()?;
        self.at += 1;
        let name = self.name("name")?;
        let place = self.find(&name).ok_or_else(|| self.expected("name"))?;
        self.symbol("(")?;
        let mut parameters = Vec::new();
        while !self.accept(")") {
            let parameter = self.name("parameter")?;
            parameters.push(self.intern(parameter));
            if !self.accept(",") && !self.is_symbol(")") {
                return Err(self.expected("',' or ')'"));
            }
        }
        self.symbol(":")?;
        let loops = std::mem::take(&mut self.loops);
        let mut code = Code::new();
        self.block(&mut code)?;
        self.loops = loops;
        let line = self.line();
        if !self.accept_word("end") {
            return Err(self.expected("'end'"));
        }
        code.push((line, Op::Push(Value::Nothing)));
        code.push((line, Op::Return));
        if let Some(routine) = self.routines.get_mut(place) {
            routine.parameters = parameters;
            routine.code = code;
        }
        self.depth -= 1;
        Ok(())
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.routines.iter().position(|routine| routine.name == name)
    }

    /// Statements up to a word that ends them.
    fn block(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        loop {
            match self.peek() {
                None => return Err(self.expected("'end'")),
                Some(Token::Word(word)) if matches!(word.as_str(), "end" | "else" | "elif") => return Ok(()),
                Some(_) => self.statement(code)?,
            }
        }
    }

    fn statement(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        let word = match self.peek() {
            Some(Token::Word(word)) => word.clone(),
            _ => return Err(self.expected("statement")),
        };
        match word.as_str() {
            "def" | "thread" => return self.routine(),
            "if" => return self.condition(code),
            "while" => return self.repeat(code),
            "global" | "local" => {
                self.at += 1;
                let scope = if word == "global" { Scope::Global } else { Scope::Local };
                return self.assignment(code, scope);
            }
            _ => {}
        }
        let one_word = match word.as_str() {
            "enter_critical" => Some(Op::EnterCritical),
            "exit_critical" => Some(Op::ExitCritical),
            "halt" => Some(Op::Halt),
            _ => None,
        };
        if let Some(op) = one_word {
            self.at += 1;
            code.push((line, op));
            return Ok(());
        }
        match word.as_str() {
            "break" | "continue" => self.leave(code, line, word == "break"),
            "return" => {
                self.at += 1;
                let has_value = self.line() == line && self.peek().is_some() && !self.is_word("end");
                if has_value {
                    self.expression(code)?
                } else {
                    code.push((line, Op::Push(Value::Nothing)))
                }
                code.push((line, Op::Return));
                Ok(())
            }
            "kill" | "join" => {
                self.at += 1;
                self.expression(code)?;
                code.push((line, if word == "kill" { Op::Kill } else { Op::Join }));
                Ok(())
            }
            _ if matches!(self.ahead(1), Some(Token::Symbol("="))) => self.assignment(code, Scope::Nearest),
            _ if matches!(self.ahead(1), Some(Token::Symbol("["))) => self.element_assignment(code),
            _ => {
                self.expression(code)?;
                code.push((line, Op::Drop));
                Ok(())
            }
        }
    }

    fn assignment(&mut self, code: &mut Code, scope: Scope) -> Result<(), ScriptError> {
        let line = self.line();
        let name = self.name("variable")?;
        let name = self.intern(name);
        self.symbol("=")?;
        self.expression(code)?;
        code.push((line, Op::Store(scope, name)));
        Ok(())
    }

    fn element_assignment(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        let name = self.name("variable")?;
        let name = self.intern(name);
        self.symbol("[")?;
        self.expression(code)?;
        self.symbol("]")?;
        self.symbol("=")?;
        self.expression(code)?;
        code.push((line, Op::StoreElement(name)));
        Ok(())
    }

    fn condition(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        self.enter()?;
        let mut to_end = Vec::new();
        loop {
            let line = self.line();
            self.at += 1;
            self.expression(code)?;
            self.symbol(":")?;
            let skip = push(code, line, Op::JumpUnless(usize::MAX));
            self.block(code)?;
            let another = self.is_word("elif");
            let last = self.accept_word("else");
            if another || last {
                to_end.push(push(code, line, Op::Jump(usize::MAX)));
            }
            land(code, skip);
            if last {
                self.symbol(":")?;
                self.block(code)?;
            }
            if !another {
                break;
            }
        }
        if !self.accept_word("end") {
            return Err(self.expected("'end'"));
        }
        for jump in to_end {
            land(code, jump);
        }
        self.depth -= 1;
        Ok(())
    }

    fn repeat(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        self.enter()?;
        let line = self.line();
        self.at += 1;
        let start = code.len();
        self.expression(code)?;
        self.symbol(":")?;
        let leave = push(code, line, Op::JumpUnless(usize::MAX));
        self.loops.push((start, vec![leave]));
        self.block(code)?;
        if !self.accept_word("end") {
            return Err(self.expected("'end'"));
        }
        push(code, line, Op::Jump(start));
        for jump in self.loops.pop().map(|(_, leave)| leave).unwrap_or_default() {
            land(code, jump);
        }
        self.depth -= 1;
        Ok(())
    }

    fn leave(&mut self, code: &mut Code, line: usize, out: bool) -> Result<(), ScriptError> {
        let Some((start, leave)) = self.loops.last_mut() else { return Err(self.expected("statement")) };
        let jump = push(code, line, Op::Jump(*start));
        if out {
            leave.push(jump);
        }
        self.at += 1;
        Ok(())
    }
}

fn push(code: &mut Code, line: usize, op: Op) -> usize {
    code.push((line, op));
    code.len() - 1
}

/// Lets the jump at `place` go to what comes next.
fn land(code: &mut Code, place: usize) {
    let next = code.len();
    if let Some((_, Op::Jump(target) | Op::JumpUnless(target))) = code.get_mut(place) {
        *target = next;
    }
}
