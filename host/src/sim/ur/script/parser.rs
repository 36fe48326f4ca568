//! Lines to instructions: recursive descent for expressions, a stack of open blocks for the rest.

use super::lexer::{Token, tokens};
use super::{Code, Comparison, Expression, Function, Instruction, Scope, Script, ScriptError};

const LINES_MAX: usize = 20_000;
const THREADS_MAX: usize = 16;
/// Depth of nested expressions and blocks; bounds the parser's own stack.
const DEPTH_MAX: usize = 32;

/// Loads a script.
///
/// # Errors
/// [`ScriptError`] names the first line that is not understood.
pub fn parse(text: &str) -> Result<Script, ScriptError> {
    let mut parser = Parser { name: None, ended: false, main: Code::new(), threads: Vec::new(), blocks: Vec::new() };
    let mut last = 0;
    for (index, content) in text.lines().enumerate() {
        last = index + 1;
        if last > LINES_MAX {
            return Err(ScriptError::TooMuch { line: last, what: "lines", limit: LINES_MAX });
        }
        let tokens = tokens(last, content)?;
        if !tokens.is_empty() {
            parser.statement(Line { number: last, tokens: &tokens, at: 0, depth: 0 })?;
        }
    }
    if !parser.ended {
        return Err(syntax(last, "'end'", "the end of the script"));
    }
    parser.finish()
}

fn syntax(line: usize, expected: &'static str, found: &str) -> ScriptError {
    ScriptError::Syntax { line, expected, found: found.to_owned() }
}

/// A block that waits for its `end`.
enum Block {
    Program,
    Thread,
    /// Where its condition is, and the jump that leaves it.
    While {
        condition: usize,
    },
    /// The jump over it, still without target.
    If {
        jump: usize,
    },
}

struct Parser {
    name: Option<String>,
    ended: bool,
    main: Code,
    threads: Vec<(String, Code)>,
    blocks: Vec<Block>,
}

impl Parser {
    fn statement(&mut self, mut line: Line<'_>) -> Result<(), ScriptError> {
        let number = line.number;
        let first = match line.tokens {
            [Token::Word(word), ..] => word.as_str(),
            [other, ..] => return Err(syntax(number, "statement", &other.to_string())),
            [] => return Ok(()),
        };
        if self.ended || (self.name.is_none() && first != "def") {
            let expected = if self.ended { "nothing behind the program" } else { "'def'" };
            return Err(syntax(number, expected, first));
        }
        if self.blocks.len() >= DEPTH_MAX {
            return Err(ScriptError::TooMuch { line: number, what: "nested blocks", limit: DEPTH_MAX });
        }
        match first {
            "def" | "thread" => self.open_routine(&mut line, first == "thread"),
            "while" | "if" => self.open_condition(&mut line, first == "while"),
            "else" => self.turn_to_else(&mut line),
            "end" => {
                line.skip();
                line.finish()?;
                self.close(number)
            }
            _ => {
                let instruction = self.simple(&mut line)?;
                line.finish()?;
                self.push(number, instruction);
                Ok(())
            }
        }
    }

    fn open_routine(&mut self, line: &mut Line<'_>, thread: bool) -> Result<(), ScriptError> {
        let opener = if thread { "thread" } else { "def" };
        line.skip();
        let name = line.word("name")?;
        line.symbols(&["(", ")", ":"])?;
        line.finish()?;
        match (thread, self.blocks.as_slice()) {
            (false, []) => {
                self.name = Some(name);
                self.blocks.push(Block::Program);
            }
            (true, [Block::Program]) => {
                if self.threads.len() >= THREADS_MAX {
                    let limit = THREADS_MAX;
                    return Err(ScriptError::TooMuch { line: line.number, what: "threads", limit });
                }
                self.threads.push((name, Code::new()));
                self.blocks.push(Block::Thread);
            }
            _ => return Err(syntax(line.number, "statement", opener)),
        }
        Ok(())
    }

    fn open_condition(&mut self, line: &mut Line<'_>, repeat: bool) -> Result<(), ScriptError> {
        line.skip();
        let condition = line.expression(&self.threads)?;
        line.symbols(&[":"])?;
        line.finish()?;
        let place = self.code().len();
        self.push(line.number, Instruction::JumpUnless(condition, usize::MAX));
        self.blocks.push(if repeat { Block::While { condition: place } } else { Block::If { jump: place } });
        Ok(())
    }

    fn turn_to_else(&mut self, line: &mut Line<'_>) -> Result<(), ScriptError> {
        line.skip();
        line.symbols(&[":"])?;
        line.finish()?;
        let Some(Block::If { jump }) = self.blocks.pop() else {
            return Err(syntax(line.number, "statement", "else"));
        };
        let over = self.code().len();
        self.push(line.number, Instruction::Jump(usize::MAX));
        self.set_target(jump);
        self.blocks.push(Block::If { jump: over });
        Ok(())
    }

    fn close(&mut self, number: usize) -> Result<(), ScriptError> {
        match self.blocks.pop() {
            Some(Block::Program) => self.ended = true,
            Some(Block::Thread) => {}
            Some(Block::While { condition }) => {
                self.push(number, Instruction::Jump(condition));
                self.set_target(condition);
            }
            Some(Block::If { jump }) => self.set_target(jump),
            None => return Err(syntax(number, "statement", "end")),
        }
        Ok(())
    }

    /// Assignment or call.
    fn simple(&self, line: &mut Line<'_>) -> Result<Instruction, ScriptError> {
        let scope = match line.peek() {
            Some(Token::Word(word)) if word == "global" => Scope::Global,
            Some(Token::Word(word)) if word == "local" => Scope::Local,
            _ => Scope::Nearest,
        };
        if scope != Scope::Nearest {
            line.skip();
        }
        let assigns = matches!(line.tokens.get(line.at..), Some([Token::Word(_), Token::Symbol("="), ..]));
        if !assigns && scope == Scope::Nearest {
            return Ok(Instruction::Evaluate(line.expression(&self.threads)?));
        }
        let name = line.word("variable")?;
        line.symbols(&["="])?;
        Ok(Instruction::Assign(scope, name, line.expression(&self.threads)?))
    }

    fn code(&mut self) -> &mut Code {
        let in_thread = self.blocks.iter().any(|block| matches!(block, Block::Thread));
        match self.threads.last_mut() {
            Some((_, code)) if in_thread => code,
            _ => &mut self.main,
        }
    }

    fn push(&mut self, line: usize, instruction: Instruction) {
        self.code().push((line, instruction));
    }

    /// Lets the jump at `place` go to what comes next.
    fn set_target(&mut self, place: usize) {
        let code = self.code();
        let next = code.len();
        if let Some((_, Instruction::Jump(target) | Instruction::JumpUnless(_, target))) = code.get_mut(place) {
            *target = next;
        }
    }

    fn finish(self) -> Result<Script, ScriptError> {
        let threads = self.threads.into_iter().map(|(_, code)| code).collect();
        Ok(Script { name: self.name.unwrap_or_default(), main: self.main, threads })
    }
}

/// The tokens of a line and how far they are read.
struct Line<'a> {
    number: usize,
    tokens: &'a [Token],
    at: usize,
    depth: usize,
}

impl Line<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.at)
    }

    fn skip(&mut self) {
        self.at += 1;
    }

    fn expected(&self, expected: &'static str) -> ScriptError {
        let found = self.peek().map_or_else(|| "the end of the line".to_owned(), ToString::to_string);
        ScriptError::Syntax { line: self.number, expected, found }
    }

    fn finish(&self) -> Result<(), ScriptError> {
        if self.at < self.tokens.len() { Err(self.expected("the end of the line")) } else { Ok(()) }
    }

    fn word(&mut self, expected: &'static str) -> Result<String, ScriptError> {
        let Some(Token::Word(word)) = self.peek() else { return Err(self.expected(expected)) };
        let word = word.clone();
        self.skip();
        Ok(word)
    }

    fn accept(&mut self, symbol: &str) -> bool {
        let found = matches!(self.peek(), Some(Token::Symbol(found)) if *found == symbol);
        self.at += usize::from(found);
        found
    }

    fn symbols(&mut self, symbols: &[&'static str]) -> Result<(), ScriptError> {
        for symbol in symbols {
            if !self.accept(symbol) {
                return Err(self.expected(symbol));
            }
        }
        Ok(())
    }

    /// A comparison, or one of its sides alone.
    fn expression(&mut self, threads: &[(String, Code)]) -> Result<Expression, ScriptError> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return Err(ScriptError::TooMuch { line: self.number, what: "nested expressions", limit: DEPTH_MAX });
        }
        let left = self.operand(threads)?;
        let comparison = match self.peek() {
            Some(Token::Symbol("==")) => Comparison::Equal,
            Some(Token::Symbol("!=")) => Comparison::NotEqual,
            Some(Token::Symbol("<")) => Comparison::Less,
            Some(Token::Symbol("<=")) => Comparison::LessOrEqual,
            Some(Token::Symbol(">")) => Comparison::Greater,
            Some(Token::Symbol(">=")) => Comparison::GreaterOrEqual,
            _ => {
                self.depth -= 1;
                return Ok(left);
            }
        };
        self.skip();
        let right = self.operand(threads)?;
        self.depth -= 1;
        Ok(Expression::Compare(comparison, Box::new(left), Box::new(right)))
    }

    fn operand(&mut self, threads: &[(String, Code)]) -> Result<Expression, ScriptError> {
        let Some(token) = self.peek().cloned() else { return Err(self.expected("value")) };
        let here = self.expected("value");
        self.skip();
        match token {
            Token::Number(value) => Ok(Expression::Number(value)),
            Token::Text(text) => Ok(Expression::Text(text)),
            Token::Symbol("-") => Ok(Expression::Negate(Box::new(self.nested(threads)?))),
            Token::Symbol("(") => {
                let inner = self.expression(threads)?;
                self.symbols(&[")"])?;
                Ok(inner)
            }
            Token::Symbol("[") => Ok(Expression::List(self.items(threads, "]")?)),
            Token::Symbol(_) => Err(here),
            Token::Word(word) => match word.as_str() {
                "True" => Ok(Expression::Boolean(true)),
                "False" => Ok(Expression::Boolean(false)),
                "not" => Ok(Expression::Not(Box::new(self.nested(threads)?))),
                "run" => self.run(threads),
                _ if self.accept("(") => self.call(threads, word),
                _ => Ok(Expression::Variable(word)),
            },
        }
    }

    /// The operand of a prefix, one level deeper.
    fn nested(&mut self, threads: &[(String, Code)]) -> Result<Expression, ScriptError> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return Err(ScriptError::TooMuch { line: self.number, what: "nested expressions", limit: DEPTH_MAX });
        }
        let inner = self.operand(threads)?;
        self.depth -= 1;
        Ok(inner)
    }

    fn run(&mut self, threads: &[(String, Code)]) -> Result<Expression, ScriptError> {
        let line = self.number;
        let name = self.word("thread")?;
        self.symbols(&["(", ")"])?;
        let index = threads.iter().position(|(known, _)| *known == name);
        index.map(Expression::Run).ok_or(ScriptError::UnknownThread { line, name })
    }

    fn call(&mut self, threads: &[(String, Code)], name: String) -> Result<Expression, ScriptError> {
        let line = self.number;
        let arguments = self.items(threads, ")")?;
        let (function, name, expected) = Function::find(&name).ok_or(ScriptError::UnknownFunction { line, name })?;
        if arguments.len() != expected {
            return Err(ScriptError::ArgumentCount { line, name, expected, found: arguments.len() });
        }
        Ok(Expression::Call(function, arguments))
    }

    /// Comma-separated values up to the closing symbol.
    fn items(&mut self, threads: &[(String, Code)], close: &'static str) -> Result<Vec<Expression>, ScriptError> {
        let mut items = Vec::new();
        if self.accept(close) {
            return Ok(items);
        }
        loop {
            items.push(self.expression(threads)?);
            if self.accept(close) {
                return Ok(items);
            }
            if !self.accept(",") {
                return Err(self.expected("',' or the closing bracket"));
            }
        }
    }
}
