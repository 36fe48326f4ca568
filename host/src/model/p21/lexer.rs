//! Tokens: the only code that moves through the bytes.

use super::{File, Instance, Value};
use crate::model::error::ModelError;
use std::ops::Range;

/// Lists in IFC nest at most three deep; a bound keeps hostile text from exhausting the stack.
const NESTING_MAX: usize = 64;

/// How much of the text a message shows.
const SHOWN_MAX: usize = 40;

pub(super) struct Lexer<'f, 'a> {
    pub(super) file: &'f File<'a>,
    pub(super) at: usize,
}

impl<'a> Lexer<'_, 'a> {
    pub(super) fn peek(&self) -> Option<u8> {
        self.file.text.get(self.at).copied()
    }

    fn rest(&self) -> &'a [u8] {
        self.file.text.get(self.at..).unwrap_or_default()
    }

    /// Skips white space and comments.
    pub(super) fn blank(&mut self) -> Result<(), ModelError> {
        loop {
            match self.peek() {
                Some(byte) if byte.is_ascii_whitespace() || byte == 0x0B => self.at += 1,
                Some(b'/') if self.rest().starts_with(b"/*") => self.skip_comment()?,
                _ => return Ok(()),
            }
        }
    }

    fn skip_comment(&mut self) -> Result<(), ModelError> {
        match memchr::memmem::find(self.rest(), b"*/") {
            Some(length) => {
                self.at += length + 2;
                Ok(())
            }
            None => Err(self.cut_short(self.at..self.at + 2, "a comment", "*/")),
        }
    }

    /// Reads a run of the bytes that names and section words are made of; empty when there is none.
    pub(super) fn word(&mut self) -> &'a str {
        let part_of_word = |byte: &u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || b"_-!".contains(byte);
        self.take_while(part_of_word)
    }

    fn take_while(&mut self, belongs: impl Fn(&u8) -> bool) -> &'a str {
        let rest = self.rest();
        let length = rest.iter().position(|byte| !belongs(byte)).unwrap_or(rest.len());
        self.at += length;
        // The callers take ASCII only.
        rest.get(..length).and_then(|bytes| std::str::from_utf8(bytes).ok()).unwrap_or_default()
    }

    pub(super) fn end_of_statement(&mut self) -> Result<(), ModelError> {
        self.blank()?;
        match self.peek() {
            Some(b';') => {
                self.at += 1;
                Ok(())
            }
            None => Err(self.cut_short(self.at..self.at, "the statement", ";")),
            Some(_) => Err(self.unexpected(self.at, "';'")),
        }
    }

    /// Indexes `#id = KEYWORD(…);` or `#id = (…);`, attributes unread.
    pub(super) fn instance(&mut self) -> Result<Instance, ModelError> {
        let start = self.at;
        self.at += 1;
        let id = self.number_of_entity(start)?;
        self.blank()?;
        match self.peek() {
            Some(b'=') => self.at += 1,
            None => return Err(self.cut_short(start..self.at, &format!("entity #{id}"), "=")),
            Some(_) => return Err(self.unexpected(self.at, "'='")),
        }
        self.blank()?;
        let keyword_start = self.at;
        let keyword = self.word();
        let keyword_range = keyword_start..self.at;
        let rest = self.blank().and_then(|()| self.skip_arguments()).and_then(|()| self.end_of_statement());
        rest.map_err(|error| self.name_statement(error, start, &format!("entity #{id} {keyword}")))?;
        Ok(Instance { id, span: start..self.at, keyword: keyword_range })
    }

    fn number_of_entity(&mut self, start: usize) -> Result<u64, ModelError> {
        let digits = self.take_while(u8::is_ascii_digit);
        match digits.parse() {
            Ok(id) => Ok(id),
            Err(_) if self.peek().is_none() => Err(self.cut_short(start..self.at, "an entity's number", "digits")),
            Err(_) => Err(self.unexpected(start, "an entity's number below 2^64")),
        }
    }

    /// From `(` past its `)`; strings and comments may hold anything.
    pub(super) fn skip_arguments(&mut self) -> Result<(), ModelError> {
        let start = self.at;
        match self.peek() {
            Some(b'(') => {}
            None => return Err(self.cut_short(start..start, "the type", "(")),
            Some(_) => return Err(self.unexpected(start, "'('")),
        }
        let mut depth = 0_usize;
        while let Some(byte) = self.peek() {
            match byte {
                b'(' => depth += 1,
                b')' => {
                    depth -= 1;
                    if depth == 0 {
                        self.at += 1;
                        return Ok(());
                    }
                }
                b'\'' => {
                    self.string()?;
                    continue;
                }
                b'/' if self.rest().starts_with(b"/*") => {
                    self.skip_comment()?;
                    continue;
                }
                b';' => return Err(self.unexpected(self.at, "')' before the statement's end")),
                _ => {}
            }
            self.at += 1;
        }
        Err(self.cut_short(start..self.at, "the attributes", ")"))
    }

    /// Past the section's `ENDSEC`, whatever it holds.
    pub(super) fn skip_section(&mut self) -> Result<(), ModelError> {
        match memchr::memmem::find(self.rest(), b"ENDSEC") {
            Some(length) => {
                self.at += length + "ENDSEC".len();
                Ok(())
            }
            None => Err(self.cut_short(self.at..self.at, "a section", "ENDSEC;")),
        }
    }

    /// From quote past the closing quote; a doubled quote is part of the string.
    fn string(&mut self) -> Result<&'a [u8], ModelError> {
        let start = self.at;
        self.at += 1;
        loop {
            let Some(length) = memchr::memchr(b'\'', self.rest()) else {
                return Err(self.cut_short(start..start + 1, "a string", "'"));
            };
            self.at += length + 1;
            if self.peek() != Some(b'\'') {
                return Ok(self.file.text.get(start + 1..self.at - 1).unwrap_or_default());
            }
            self.at += 1;
        }
    }

    /// `KEYWORD(attributes)`.
    pub(super) fn simple(&mut self) -> Result<(&'a str, Vec<Value<'a>>), ModelError> {
        let start = self.at;
        let keyword = self.word();
        if keyword.is_empty() {
            return Err(self.unexpected(start, "an entity's type in capitals"));
        }
        self.blank()?;
        Ok((keyword, self.list(0)?))
    }

    /// `(value, value, …)`, the parenthesis ahead.
    fn list(&mut self, depth: usize) -> Result<Vec<Value<'a>>, ModelError> {
        if self.peek() != Some(b'(') {
            return Err(self.unexpected(self.at, "'('"));
        }
        self.at += 1;
        let mut values = Vec::new();
        self.blank()?;
        if self.peek() == Some(b')') {
            self.at += 1;
            return Ok(values);
        }
        loop {
            self.blank()?;
            values.push(self.value(depth)?);
            self.blank()?;
            match self.peek() {
                Some(b',') => self.at += 1,
                Some(b')') => {
                    self.at += 1;
                    return Ok(values);
                }
                _ => return Err(self.unexpected(self.at, "',' or ')'")),
            }
        }
    }

    fn value(&mut self, depth: usize) -> Result<Value<'a>, ModelError> {
        if depth >= NESTING_MAX {
            return Err(self.unexpected(self.at, "lists nested at most 64 deep"));
        }
        let start = self.at;
        match self.peek() {
            Some(b'$') => {
                self.at += 1;
                Ok(Value::Null)
            }
            Some(b'*') => {
                self.at += 1;
                Ok(Value::Derived)
            }
            Some(b'\'') => Ok(Value::Text(self.string()?)),
            Some(b'(') => Ok(Value::List(self.list(depth + 1)?)),
            Some(b'#') => {
                self.at += 1;
                Ok(Value::Ref(self.number_of_entity(start)?))
            }
            Some(b'"') => self.delimited(b'"', "binary digits and '\"'", u8::is_ascii_hexdigit).map(Value::Binary),
            Some(b'.') if !self.rest().get(1).is_some_and(u8::is_ascii_digit) => {
                let in_enum = |byte: &u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || *byte == b'_';
                self.delimited(b'.', "an enumeration value in capitals and '.'", in_enum).map(Value::Enum)
            }
            Some(b'0'..=b'9' | b'+' | b'-' | b'.') => self.number(),
            Some(b'A'..=b'Z' | b'!') => {
                let name = self.word();
                self.blank()?;
                Ok(Value::Typed(name, self.list(depth + 1)?))
            }
            _ => Err(self.unexpected(start, "a value")),
        }
    }

    fn delimited(
        &mut self,
        delimiter: u8,
        expected: &str,
        belongs: impl Fn(&u8) -> bool,
    ) -> Result<&'a str, ModelError> {
        let start = self.at;
        self.at += 1;
        let inner = self.take_while(belongs);
        if inner.is_empty() || self.peek() != Some(delimiter) {
            return Err(self.unexpected(start, expected));
        }
        self.at += 1;
        Ok(inner)
    }

    fn number(&mut self) -> Result<Value<'a>, ModelError> {
        let start = self.at;
        let token = self.take_while(|byte| byte.is_ascii_digit() || b"+-.eE".contains(byte));
        if !token.contains(['.', 'e', 'E']) {
            return token.parse().map(Value::Integer).map_err(|_| self.unexpected(start, "a whole number below 2^63"));
        }
        match token.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Value::Real(number)),
            _ => Err(self.unexpected(start, "a finite number")),
        }
    }

    pub(super) fn cut_short(&self, span: Range<usize>, inside: &str, expected: &str) -> ModelError {
        ModelError::Truncated {
            place: self.file.place(span),
            inside: inside.to_owned(),
            expected: format!("'{expected}'"),
        }
    }

    /// What the text shows at `start` is not `expected`.
    pub(super) fn unexpected(&self, start: usize, expected: &str) -> ModelError {
        let rest = self.file.text.get(start..).unwrap_or_default();
        let line = rest.split(|byte| *byte == b'\n' || *byte == b'\r').next().unwrap_or_default();
        let shown = String::from_utf8_lossy(line.get(..SHOWN_MAX).unwrap_or(line)).into_owned();
        let found = if rest.is_empty() { "the end of the file".to_owned() } else { format!("'{shown}'") };
        let span = start..start + line.len().min(SHOWN_MAX);
        ModelError::Syntax { place: self.file.place(span), expected: expected.to_owned(), found }
    }

    pub(super) fn not_part_21(&self) -> ModelError {
        let expected = match self.file.text.first_chunk::<4>() {
            Some(b"PK\x03\x04") => "'ISO-10303-21;' (this is a zip archive: unpack it first)",
            Some(b"<?xm") => "'ISO-10303-21;' (this is XML: export as IFC-SPF instead)",
            _ => "'ISO-10303-21;', the first line of every IFC-SPF file",
        };
        self.unexpected(0, expected)
    }

    /// A statement that is cut short is named, and shown from its begin.
    pub(super) fn name_statement(&self, error: ModelError, start: usize, name: &str) -> ModelError {
        match error {
            ModelError::Truncated { inside, expected, .. } => {
                let place = self.file.place(start..self.at);
                ModelError::Truncated { place, inside: format!("{inside} of {}", name.trim_end()), expected }
            }
            other => other,
        }
    }
}
