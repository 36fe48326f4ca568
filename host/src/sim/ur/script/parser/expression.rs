//! Expressions: what leaves one value on the stack.

use super::super::ScriptError;
use super::super::builtins::Builtin;
use super::super::code::{Code, Op, Operator, Value};
use super::super::lexer::Token;
use super::Parser;

/// Elements that a list can be written with, and arguments of a call.
const ITEMS_MAX: usize = 64;

impl Parser<'_> {
    /// `or` and `xor` bind least; both sides are always computed.
    pub(super) fn expression(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        const LEVELS: &[&[(&str, Operator)]] = &[
            &[("or", Operator::Or), ("xor", Operator::Xor)],
            &[("and", Operator::And)],
            &[
                ("==", Operator::Equal),
                ("!=", Operator::NotEqual),
                ("<=", Operator::LessOrEqual),
                (">=", Operator::GreaterOrEqual),
                ("<", Operator::Less),
                (">", Operator::Greater),
            ],
            &[("+", Operator::Add), ("-", Operator::Subtract)],
            &[("*", Operator::Multiply), ("/", Operator::Divide), ("%", Operator::Remainder)],
        ];
        self.enter()?;
        self.binary(code, LEVELS)?;
        self.depth -= 1;
        Ok(())
    }

    fn binary(&mut self, code: &mut Code, levels: &[&[(&str, Operator)]]) -> Result<(), ScriptError> {
        let Some((level, tighter)) = levels.split_first() else { return self.operand(code) };
        self.binary(code, tighter)?;
        while let Some(operator) = self.operator(level) {
            let line = self.line();
            self.at += 1;
            self.binary(code, tighter)?;
            code.push((line, Op::Binary(operator)));
        }
        Ok(())
    }

    fn operator(&self, level: &[(&str, Operator)]) -> Option<Operator> {
        let found = match self.peek()? {
            Token::Symbol(symbol) => *symbol,
            Token::Word(word) => word.as_str(),
            _ => return None,
        };
        level.iter().find(|(known, _)| *known == found).map(|(_, operator)| *operator)
    }

    /// A value with what stands before and behind it.
    fn operand(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        for (prefix, op) in [("-", Op::Negate), ("not", Op::Not)] {
            if self.accept(prefix) || self.accept_word(prefix) {
                self.enter()?;
                // `not` binds less than a comparison, but scripts write it before names and brackets.
                self.operand(code)?;
                self.depth -= 1;
                code.push((line, op));
                return Ok(());
            }
        }
        self.primary(code)?;
        while self.accept("[") {
            self.expression(code)?;
            self.symbol("]")?;
            code.push((line, Op::Element));
        }
        Ok(())
    }

    fn primary(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        let Some(token) = self.peek().cloned() else { return Err(self.expected("value")) };
        match token {
            Token::Number(value) => code.push((line, Op::Push(Value::Number(value)))),
            Token::Text(text) => code.push((line, Op::Push(Value::Text(text)))),
            Token::Symbol("(") => {
                self.at += 1;
                self.expression(code)?;
                return self.symbol(")");
            }
            Token::Symbol("[") => {
                self.at += 1;
                let count = self.items(code, "]")?;
                code.push((line, Op::List(count)));
                return Ok(());
            }
            Token::Symbol(_) => return Err(self.expected("value")),
            Token::Word(word) => match word.as_str() {
                "True" | "False" => code.push((line, Op::Push(Value::Boolean(word == "True")))),
                "run" => {
                    self.at += 1;
                    return self.run(code);
                }
                "p" if matches!(self.ahead(1), Some(Token::Symbol("["))) => return self.pose_or_element(code),
                _ => return self.variable_or_call(code),
            },
        }
        self.at += 1;
        Ok(())
    }

    /// `p[…]` is a pose with six numbers, and an element of the variable `p` with one.
    fn pose_or_element(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        self.at += 2;
        let mut inner = Code::new();
        match self.items(&mut inner, "]")? {
            6 => {
                code.append(&mut inner);
                code.push((line, Op::Pose));
            }
            1 => {
                let name = self.intern("p".to_owned());
                code.push((line, Op::Load(name)));
                code.append(&mut inner);
                code.push((line, Op::Element));
            }
            count => {
                let found = format!("{count}");
                return Err(ScriptError::Syntax { line, expected: "six numbers of a pose", found });
            }
        }
        Ok(())
    }

    fn run(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        let name = self.name("thread")?;
        self.symbol("(")?;
        self.symbol(")")?;
        let place = self.find(&name).filter(|place| self.routines.get(*place).is_some_and(|found| found.is_thread));
        let place = place.ok_or(ScriptError::UnknownThread { line, name })?;
        code.push((line, Op::Run(place)));
        Ok(())
    }

    fn variable_or_call(&mut self, code: &mut Code) -> Result<(), ScriptError> {
        let line = self.line();
        let name = self.name("value")?;
        if !self.accept("(") {
            let name = self.intern(name);
            code.push((line, Op::Load(name)));
            return Ok(());
        }
        if let Some(place) = self.find(&name) {
            let count = self.items(code, ")")?;
            code.push((line, Op::Call(place, count)));
            return Ok(());
        }
        if let Some(name) = Builtin::missing(&name) {
            self.arguments(code, &[])?;
            code.push((line, Op::Missing(name)));
            return Ok(());
        }
        let (builtin, parameters) =
            Builtin::find(&name).ok_or(ScriptError::UnknownFunction { line, name: name.clone() })?;
        let given = self.arguments(code, parameters)?;
        let places = places(line, &name, parameters, &given)?;
        code.push((line, Op::Builtin(builtin, places)));
        Ok(())
    }

    /// Values up to the closing symbol; how many.
    fn items(&mut self, code: &mut Code, close: &'static str) -> Result<usize, ScriptError> {
        let mut count = 0;
        while !self.accept(close) {
            if count >= ITEMS_MAX {
                return Err(ScriptError::TooMuch { line: self.line(), what: "elements of a list", limit: ITEMS_MAX });
            }
            self.expression(code)?;
            count += 1;
            if !self.accept(",") && !self.is_symbol(close) {
                return Err(self.expected("',' or the closing bracket"));
            }
        }
        Ok(count)
    }

    /// Arguments of a function of the controller up to the bracket; of each the parameter that it names.
    fn arguments(&mut self, code: &mut Code, parameters: &[(&str, bool)]) -> Result<Vec<Option<usize>>, ScriptError> {
        let mut given = Vec::new();
        while !self.accept(")") {
            if given.len() >= ITEMS_MAX {
                return Err(ScriptError::TooMuch { line: self.line(), what: "arguments", limit: ITEMS_MAX });
            }
            let named = matches!(self.ahead(1), Some(Token::Symbol("=")));
            let mut parameter = None;
            if named {
                let place = parameters.iter().position(|(known, _)| self.is_word(known));
                // A function that is not simulated has no list of parameters to look at.
                if place.is_none() && !parameters.is_empty() {
                    return Err(self.expected("name of a parameter"));
                }
                parameter = place;
                self.at += 2;
            }
            given.push(parameter);
            self.expression(code)?;
            if !self.accept(",") && !self.is_symbol(")") {
                return Err(self.expected("',' or the closing bracket"));
            }
        }
        Ok(given)
    }
}

/// For each parameter the argument that it has.
fn places(
    line: usize,
    name: &str,
    parameters: &[(&str, bool)],
    given: &[Option<usize>],
) -> Result<Vec<Option<usize>>, ScriptError> {
    let wrong =
        || ScriptError::ArgumentCount { line, name: name.to_owned(), expected: parameters.len(), found: given.len() };
    let mut places = vec![None; parameters.len()];
    for (argument, parameter) in given.iter().enumerate() {
        let place = places.get_mut(parameter.unwrap_or(argument)).ok_or_else(wrong)?;
        if place.replace(argument).is_some() {
            return Err(wrong());
        }
    }
    let complete = places.iter().zip(parameters).all(|(place, (_, optional))| place.is_some() || *optional);
    if complete { Ok(places) } else { Err(wrong()) }
}
