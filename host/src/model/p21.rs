//! Reader of ISO 10303-21 clear text ("STEP physical file", the text form of IFC).
//!
//! One pass over the bytes finds every entity's number, type and span and checks that strings, comments, parentheses and
//! statements close; attributes are parsed when asked for. Nothing is copied: all spans point into the caller's text, so
//! that a file can be written back with every original line untouched.
//!
//! Real files differ from the standard; what is accepted on purpose: any white space and comments between tokens, also in
//! the header; CRLF; a byte order mark; a section that lacks its `ENDSEC;`; integers where reals belong; strings in UTF-8
//! or, failing that, Latin-1. Nothing is refused for what the header says. A file without its `END-ISO-10303-21;` is cut
//! short, and refused.

mod lexer;
mod record;
mod text;

pub use record::{Record, describe};

use crate::model::error::{Entity, ModelError, Place};
use lexer::Lexer;
use std::ops::Range;

/// One attribute value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<'a> {
    /// `$`: not given.
    Null,
    /// `*`: derived elsewhere.
    Derived,
    /// A whole number.
    Integer(i64),
    /// A finite real number.
    Real(f64),
    /// A string, still encoded: see [`Record::text`].
    Text(&'a [u8]),
    /// An enumeration value or a logical, without its dots.
    Enum(&'a str),
    /// Binary: the digits between the quotes.
    Binary(&'a str),
    /// The number of another entity.
    Ref(u64),
    /// A list.
    List(Vec<Value<'a>>),
    /// A value that names its type: `IFCTIMEMEASURE(70.)`.
    Typed(&'a str, Vec<Value<'a>>),
}

/// One statement: a header entity, or `#id=…` of the data section.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    /// The number behind the `#`; 0 in the header.
    pub id: u64,
    /// The whole statement in the file, from `#` through `;`.
    pub span: Range<usize>,
    /// The type's name; empty for a complex instance (several types in one, `#1=(A(…)B(…));`).
    keyword: Range<usize>,
}

/// A file, indexed.
#[derive(Debug)]
pub struct File<'a> {
    name: &'a str,
    text: &'a [u8],
    header: Vec<Instance>,
    /// In order of their numbers.
    instances: Vec<Instance>,
}

impl<'a> File<'a> {
    /// Indexes `text`; `name` is for messages.
    pub fn parse(name: &'a str, text: &'a [u8]) -> Result<Self, ModelError> {
        let mut file = Self { name, text, header: Vec::new(), instances: Vec::new() };
        file.scan()?;
        // Stable, and nearly free on the ascending numbers of real files.
        file.instances.sort_by_key(|instance| instance.id);
        for (first, second) in file.instances.iter().zip(file.instances.iter().skip(1)) {
            if first.id == second.id {
                let first_line = file.place(first.span.clone()).line;
                return Err(ModelError::DuplicateId { entity: Box::new(file.name_of(second)), first_line });
            }
        }
        Ok(file)
    }

    /// The file's name, as given.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// The schema names of the header's `FILE_SCHEMA`; empty when the header has none that can be read, as it decides
    /// nothing.
    pub fn schemas(&self) -> Vec<String> {
        let Some(instance) = self.header.iter().find(|instance| self.keyword(instance) == "FILE_SCHEMA") else {
            return Vec::new();
        };
        let Ok(record) = self.record_of(instance) else { return Vec::new() };
        let names = record.list(0, "schema_identifiers").unwrap_or_default();
        names.iter().filter_map(|name| record.decode(name, "schema_identifiers").ok()).collect()
    }

    /// All entities of the data sections, in order of their numbers.
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// The entity with this number.
    pub fn get(&self, id: u64) -> Option<&Instance> {
        let index = self.instances.binary_search_by_key(&id, |instance| instance.id).ok()?;
        self.instances.get(index)
    }

    /// The entity's type name; empty for a complex instance.
    pub fn keyword(&self, instance: &Instance) -> &'a str {
        self.text.get(instance.keyword.clone()).and_then(|bytes| std::str::from_utf8(bytes).ok()).unwrap_or_default()
    }

    /// All entities of exactly this type, parsed, in order of their numbers.
    pub fn all<'f>(&'f self, keyword: &'f str) -> impl Iterator<Item = Result<Record<'f>, ModelError>> {
        let of_type = self.instances.iter().filter(move |instance| self.keyword(instance) == keyword);
        of_type.map(|instance| self.record_of(instance))
    }

    /// Parses one entity's attributes.
    pub fn record_of<'f>(&'f self, instance: &'f Instance) -> Result<Record<'f>, ModelError> {
        let mut parts = self.parts(instance)?;
        match (parts.pop(), parts.is_empty()) {
            (Some((keyword, attributes)), true) => Ok(Record { file: self, instance, keyword, attributes }),
            _ => Err(ModelError::Unsupported {
                entity: Box::new(self.name_of(instance)),
                what: "complex instance",
                of: String::new(),
                instead: "an entity of one type, as IFC does",
            }),
        }
    }

    /// The type names and attributes of an entity: one pair, or several for a complex instance.
    pub fn parts(&self, instance: &Instance) -> Result<Vec<(&'a str, Vec<Value<'a>>)>, ModelError> {
        let mut lexer = Lexer { file: self, at: instance.keyword.start };
        if !instance.keyword.is_empty() {
            return Ok(vec![lexer.simple()?]);
        }
        lexer.at += 1; // the parenthesis that the scan saw
        let mut parts = Vec::new();
        loop {
            lexer.blank()?;
            if lexer.peek() == Some(b')') {
                return Ok(parts);
            }
            parts.push(lexer.simple()?);
        }
    }

    /// Line and column of a span. Counts lines from the start of the file: for messages only.
    pub fn place(&self, span: Range<usize>) -> Place {
        let before = self.text.get(..span.start).unwrap_or(self.text);
        let line = memchr::memchr_iter(b'\n', before).count() + 1;
        let column = before.len() - memchr::memrchr(b'\n', before).map_or(0, |newline| newline + 1) + 1;
        Place { file: self.name.to_owned(), line, column, span }
    }

    /// The entity as a message names it.
    pub fn name_of(&self, instance: &Instance) -> Entity {
        let keyword = match self.keyword(instance) {
            "" => "complex instance",
            keyword => keyword,
        };
        Entity { place: self.place(instance.span.clone()), id: instance.id, keyword: keyword.to_owned() }
    }

    /// The one pass: header, data sections, and the sections of edition 3 that IFC does not use.
    fn scan(&mut self) -> Result<(), ModelError> {
        #[derive(PartialEq)]
        enum Section {
            None,
            Header,
            Data,
        }
        let mut at = if self.text.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 };
        let mut section = Section::None;
        let (mut header, mut instances) = (Vec::new(), Vec::new());
        let mut lexer = Lexer { file: self, at };
        lexer.blank()?;
        if lexer.word() != "ISO-10303-21" {
            return Err(lexer.not_part_21());
        }
        lexer.end_of_statement()?;
        loop {
            lexer.blank()?;
            at = lexer.at;
            match lexer.peek() {
                None => return Err(lexer.cut_short(at..at, "the exchange structure", "END-ISO-10303-21;")),
                Some(b'#') if section == Section::Data => {
                    instances.push(lexer.instance()?);
                    continue;
                }
                Some(_) => {}
            }
            match lexer.word() {
                "HEADER" => section = Section::Header,
                "DATA" => {
                    section = Section::Data;
                    lexer.blank()?;
                    if lexer.peek() == Some(b'(') {
                        lexer.skip_arguments()?;
                    }
                }
                "ANCHOR" | "REFERENCE" | "SIGNATURE" => {
                    lexer.skip_section()?;
                    section = Section::None;
                }
                "ENDSEC" => section = Section::None,
                "END-ISO-10303-21" => {
                    lexer.end_of_statement()?;
                    break;
                }
                word if section == Section::Header && !word.is_empty() => {
                    let keyword = at..lexer.at;
                    lexer.blank()?;
                    lexer.skip_arguments()?;
                    lexer.end_of_statement()?;
                    header.push(Instance { id: 0, span: at..lexer.at, keyword });
                    continue;
                }
                _ if lexer.peek().is_none() => {
                    return Err(lexer.cut_short(at..lexer.at, "the exchange structure", "END-ISO-10303-21;"));
                }
                _ => return Err(lexer.unexpected(at, "an entity '#…=' of a DATA section or a section's begin or end")),
            }
            lexer.end_of_statement()?;
        }
        self.header = header;
        self.instances = instances;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
