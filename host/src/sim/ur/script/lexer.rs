//! Script to tokens. A line break is a blank like any other: real programs break lines in the middle of a statement and put
//! two statements on one line.

use super::ScriptError;
use std::fmt;

/// The smallest pieces of a script.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    Number(f64),
    Text(String),
    Word(String),
    /// One of [`SYMBOLS`].
    Symbol(&'static str),
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(value) => write!(f, "{value}"),
            Self::Text(text) => write!(f, "\"{text}\""),
            Self::Word(word) => f.write_str(word),
            Self::Symbol(symbol) => write!(f, "'{symbol}'"),
        }
    }
}

/// Longer ones first, so that `==` is not two `=`.
const SYMBOLS: [&str; 18] =
    ["==", "!=", "<=", ">=", "(", ")", "[", "]", ",", ":", "=", "-", "<", ">", "+", "*", "/", "%"];

/// The tokens of a script with their lines, which count from 1; `#` starts a comment.
pub(super) fn tokens(text: &str) -> Result<Vec<(usize, Token)>, ScriptError> {
    let mut found = Vec::new();
    for (line, content) in (1..).zip(text.lines()) {
        tokens_of_line(line, content, &mut found)?;
    }
    Ok(found)
}

fn tokens_of_line(line: usize, text: &str, found: &mut Vec<(usize, Token)>) -> Result<(), ScriptError> {
    let mut rest = text.trim_start();
    // A line that names what the teach pendant highlights, in programs that it has saved.
    if rest.starts_with('$') {
        return Ok(());
    }
    while let Some(first) = rest.chars().next() {
        if first == '#' {
            break;
        }
        let (token, tail) = token(line, first, rest)?;
        found.push((line, token));
        rest = tail.trim_start();
    }
    Ok(())
}

/// By how much a line opens more blocks than it closes.
pub(super) fn depth_change(text: &str) -> Result<i32, ScriptError> {
    let mut found = Vec::new();
    tokens_of_line(1, text, &mut found)?;
    let change = |token: &Token| match token {
        Token::Word(word) if matches!(word.as_str(), "def" | "sec" | "thread" | "while" | "if") => 1,
        Token::Word(word) if word == "end" => -1,
        _ => 0,
    };
    Ok(found.iter().map(|(_, token)| change(token)).sum())
}

fn token(line: usize, first: char, rest: &str) -> Result<(Token, &str), ScriptError> {
    let syntax = |expected, found: &str| ScriptError::Syntax { line, expected, found: found.to_owned() };
    if first == '"' {
        let (text, tail) = rest.get(1..).and_then(|tail| tail.split_once('"')).ok_or(syntax("closing quote", rest))?;
        return Ok((Token::Text(text.to_owned()), tail));
    }
    if first.is_ascii_digit() || first == '.' {
        let (digits, tail) = number(rest);
        let value = digits.parse().map_err(|_| syntax("number", digits))?;
        return Ok((Token::Number(value), tail));
    }
    if first.is_ascii_alphabetic() || first == '_' {
        let (word, tail) = split_while(rest, |c| c.is_ascii_alphanumeric() || c == '_');
        return Ok((Token::Word(word.to_owned()), tail));
    }
    let symbol = SYMBOLS.into_iter().find_map(|symbol| Some((symbol, rest.strip_prefix(symbol)?)));
    let (symbol, tail) = symbol.ok_or(syntax("name, number, string or operator", &first.to_string()))?;
    Ok((Token::Symbol(symbol), tail))
}

/// Digits, point and exponent, whose sign belongs to the number.
fn number(rest: &str) -> (&str, &str) {
    let (mantissa, tail) = split_while(rest, |c| c.is_ascii_digit() || c == '.');
    let Some(exponent) = tail.strip_prefix(['e', 'E']) else { return (mantissa, tail) };
    let exponent = exponent.strip_prefix(['-', '+']).unwrap_or(exponent);
    let (_, tail) = split_while(exponent, |c| c.is_ascii_digit());
    rest.split_at_checked(rest.len() - tail.len()).unwrap_or((rest, ""))
}

fn split_while(text: &str, accept: impl Fn(char) -> bool) -> (&str, &str) {
    let end = text.find(|c| !accept(c)).unwrap_or(text.len());
    text.split_at_checked(end).unwrap_or((text, ""))
}
