//! Walks a TOML document key by key, remembers which keys a section has, and collects everything that is wrong.

use super::error::{Fault, Finding};
use super::keys::{Number, UNIT_SUFFIXES, Unit};
use crate::failure::Excerpt;
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Two words less alike than this are not taken for a slip of the pen (Jaro–Winkler, 1 is equal).
const SIMILAR: f64 = 0.8;

type Value<'a> = Spanned<DeValue<'a>>;

/// A document, and what was found wrong in it so far.
pub(crate) struct Document<'a> {
    file: &'a str,
    text: &'a str,
    root: DeTable<'a>,
    findings: Vec<(Range<usize>, Fault)>,
}

impl<'a> Document<'a> {
    /// Reads the TOML. A text that is none leaves findings, see [`Document::is_broken`].
    pub fn new(file: &'a str, text: &'a str) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        let finding = |error: toml::de::Error| {
            (error.span().unwrap_or(0..0), Fault::Syntax { message: error.message().to_owned() })
        };
        Self { file, text, root: root.into_inner(), findings: errors.into_iter().map(finding).collect() }
    }

    /// The folder of the file, for paths in it.
    pub fn folder(&self) -> &'a Path {
        Path::new(self.file).parent().unwrap_or(Path::new(""))
    }

    /// Whether anything was found wrong so far.
    pub fn is_broken(&self) -> bool {
        !self.findings.is_empty()
    }

    /// The keys outside every section; the names of the sections count as known.
    pub fn top(&mut self, sections: &[&'static str]) -> Section<'_, 'a> {
        let known = sections.iter().map(|name| Known { name, unit: None }).collect();
        let (table, findings) = (Some(&self.root), &mut self.findings);
        Section { name: "", header: 0..0, table, reported: false, known, absent: Vec::new(), findings }
    }

    /// The section of that name. If it is missing, its keys read as `None` and one finding says so at the end.
    pub fn section(&mut self, name: &'static str) -> Section<'_, 'a> {
        let end = self.text.len();
        let (mut header, mut table, mut reported) = (end..end, None, false);
        if let Some((key, value)) = self.root.get_key_value(name) {
            header = key.span();
            table = value.get_ref().as_table();
            if table.is_none() {
                let expected = format!("a section, written [{name}]");
                let (key, found) = (name.to_owned(), describe(value.get_ref()));
                self.findings.push((value.span(), Fault::WrongType { key, expected, found, suggestion: None }));
                reported = true;
            }
        }
        let findings = &mut self.findings;
        Section { name, header, table, reported, known: Vec::new(), absent: Vec::new(), findings }
    }

    /// How many sections of a list there are, written `[[name]]`; 0 when it is none.
    pub fn count(&self, name: &str) -> usize {
        self.list(name).map_or(0, |list| list.len())
    }

    /// One section of a list.
    pub fn nth(&mut self, name: &'static str, index: usize) -> Section<'_, 'a> {
        let end = self.text.len();
        let value = self.root.get(name).and_then(|value| value.get_ref().as_array()).and_then(|list| list.get(index));
        let (header, table) = value.map_or((end..end, None), |value| (value.span(), value.get_ref().as_table()));
        let findings = &mut self.findings;
        Section { name, header, table, reported: false, known: Vec::new(), absent: Vec::new(), findings }
    }

    /// Whether any section of a list has one of these keys.
    pub fn any_has(&self, name: &str, keys: &[&str]) -> bool {
        let tables =
            self.list(name).into_iter().flat_map(|list| list.iter()).filter_map(|value| value.get_ref().as_table());
        tables.into_iter().any(|table| keys.iter().any(|key| table.contains_key(*key)))
    }

    fn list(&self, name: &str) -> Option<&toml::de::DeArray<'a>> {
        self.root.get(name).and_then(|value| value.get_ref().as_array())
    }

    /// Whether there is something of that name at the top.
    pub fn has(&self, name: &str) -> bool {
        self.root.contains_key(name)
    }

    /// Everything that was found wrong, in the order of the file.
    pub fn into_findings(mut self) -> Vec<Finding> {
        self.findings.sort_by_key(|(span, _)| span.start);
        let Self { file, text, findings, .. } = self;
        let place = |span| Excerpt::new(file, text.as_bytes(), span);
        findings.into_iter().map(|(span, fault)| Finding { place: place(span), fault }).collect()
    }
}

#[derive(Clone, Copy)]
struct Known {
    name: &'static str,
    unit: Option<&'static Unit>,
}

/// One section while it is being read: ask for its keys, then [`Section::finish`].
pub(crate) struct Section<'r, 'a> {
    /// Empty for the top of the file.
    name: &'static str,
    header: Range<usize>,
    table: Option<&'r DeTable<'a>>,
    /// The section itself has been found wrong; do not add that it is missing.
    reported: bool,
    known: Vec<Known>,
    /// Required keys that are not there, with what they take.
    absent: Vec<(&'static str, String)>,
    findings: &'r mut Vec<(Range<usize>, Fault)>,
}

impl<'r, 'a> Section<'r, 'a> {
    /// A number in the key's unit, returned in SI.
    pub fn number(&mut self, key: &'static Number) -> Option<f64> {
        let value = self.required(key.name, Some(&key.unit), &expected_number(key))?;
        self.one_number(key, value)
    }

    /// As [`Section::number`]; `default` (SI) where the key is absent.
    pub fn number_or(&mut self, key: &'static Number, default: f64) -> Option<f64> {
        match self.optional(key.name, Some(&key.unit)) {
            None => Some(default),
            Some(value) => self.one_number(key, value),
        }
    }

    /// A number where the key may be absent: the outer `None` is an error, the inner an absent key.
    pub fn number_if_given(&mut self, key: &'static Number) -> Option<Option<f64>> {
        match self.optional(key.name, Some(&key.unit)) {
            None => Some(None),
            Some(value) => self.one_number(key, value).map(Some),
        }
    }

    /// N numbers in the key's unit, returned in SI.
    pub fn numbers<const N: usize>(&mut self, key: &'static Number) -> Option<[f64; N]> {
        let value = self.required(key.name, Some(&key.unit), &expected_numbers(key, N))?;
        self.many_numbers(key, value)
    }

    /// As [`Section::numbers`]; `default` (SI) where the key is absent.
    pub fn numbers_or<const N: usize>(&mut self, key: &'static Number, default: [f64; N]) -> Option<[f64; N]> {
        match self.optional(key.name, Some(&key.unit)) {
            None => Some(default),
            Some(value) => self.many_numbers(key, value),
        }
    }

    /// As [`Section::numbers`], where the key may be absent: the outer `None` is an error, the inner an absent key.
    pub fn numbers_if_given<const N: usize>(&mut self, key: &'static Number) -> Option<Option<[f64; N]>> {
        match self.optional(key.name, Some(&key.unit)) {
            None => Some(None),
            Some(value) => self.many_numbers(key, value).map(Some),
        }
    }

    /// A text that is not empty.
    pub fn text(&mut self, name: &'static str) -> Option<&'r str> {
        let expected = "a text in quotes, not empty";
        let value = self.required(name, None, expected)?;
        match value.get_ref().as_str() {
            None => self.wrong_type(name, expected, value, None),
            Some(text) if text.trim().is_empty() => self.impossible(name, expected, &format!("{text:?}")),
            Some(text) => Some(text),
        }
    }

    /// A text that is not empty, where the key may be absent: the outer `None` is an error, the inner an absent key.
    pub fn text_if_given(&mut self, name: &'static str) -> Option<Option<&'r str>> {
        match self.optional(name, None) {
            None => Some(None),
            Some(_) => self.text(name).map(Some),
        }
    }

    /// true or false; false where the key is absent.
    pub fn flag(&mut self, name: &'static str) -> Option<bool> {
        match self.optional(name, None) {
            None => Some(false),
            Some(_) => self.boolean(name),
        }
    }

    /// true or false.
    pub fn boolean(&mut self, name: &'static str) -> Option<bool> {
        let expected = "true or false";
        let value = self.required(name, None, expected)?;
        match value.get_ref().as_bool() {
            None => self.wrong_type(name, expected, value, None),
            found => found,
        }
    }

    /// A whole number of the range; `default` where the key is absent.
    pub fn integer_or(&mut self, name: &'static str, allowed: RangeInclusive<i64>, default: i64) -> Option<i64> {
        self.integer_if_given(name, allowed).map(|given| given.unwrap_or(default))
    }

    /// A whole number of the range, where the key may be absent: the outer `None` is an error, the inner an absent key.
    pub fn integer_if_given(&mut self, name: &'static str, allowed: RangeInclusive<i64>) -> Option<Option<i64>> {
        let expected = format!("a whole number from {} to {}", allowed.start(), allowed.end());
        match self.optional(name, None) {
            None => Some(None),
            Some(value) => self.one_integer(name, &expected, value, |found| allowed.contains(&found)).map(Some),
        }
    }

    /// One of two whole numbers.
    pub fn either(&mut self, name: &'static str, allowed: [i64; 2]) -> Option<i64> {
        let expected = format!("{} or {}", allowed[0], allowed[1]);
        let value = self.required(name, None, &expected)?;
        self.one_integer(name, &expected, value, |found| allowed.contains(&found))
    }

    /// As [`Section::either`]; `default` where the key is absent.
    pub fn either_or(&mut self, name: &'static str, allowed: [i64; 2], default: i64) -> Option<i64> {
        match self.optional(name, None) {
            None => Some(default),
            Some(_) => self.either(name, allowed),
        }
    }

    /// Records that the value of a key of this section cannot be.
    pub fn impossible<T>(&mut self, name: &str, expected: &str, found: &str) -> Option<T> {
        let span = self.table.and_then(|table| table.get(name)).map_or(self.header.clone(), Spanned::span);
        let (key, expected, found) = (name.to_owned(), expected.to_owned(), found.to_owned());
        self.findings.push((span, Fault::Impossible { key, expected, found }));
        None
    }

    /// Reports what is missing and what does not belong here.
    pub fn finish(mut self) {
        let Some(table) = self.table else {
            if !self.reported {
                let keys = self.absent.iter().map(|(name, _)| *name).collect();
                self.findings.push((self.header, Fault::MissingSection { section: self.name, keys }));
            }
            return;
        };
        for key in table.keys() {
            let written = key.get_ref().as_ref();
            if !self.known.iter().any(|known| known.name == written) {
                let (fault, meant) = self.stranger(table, written);
                self.absent.retain(|(name, _)| Some(*name) != meant);
                self.findings.push((key.span(), fault));
            }
        }
        let section = self.label();
        for (key, expected) in self.absent {
            self.findings.push((self.header.clone(), Fault::Missing { section: section.clone(), key, expected }));
        }
    }

    fn label(&self) -> String {
        if self.name.is_empty() { "the top of the file".to_owned() } else { format!("[{}]", self.name) }
    }

    fn optional(&mut self, name: &'static str, unit: Option<&'static Unit>) -> Option<&'r Value<'a>> {
        if !self.known.iter().any(|known| known.name == name) {
            self.known.push(Known { name, unit });
        }
        self.table.and_then(|table| table.get(name))
    }

    fn required(&mut self, name: &'static str, unit: Option<&'static Unit>, expected: &str) -> Option<&'r Value<'a>> {
        let value = self.optional(name, unit);
        if value.is_none() {
            self.absent.push((name, expected.to_owned()));
        }
        value
    }

    fn one_number(&mut self, key: &'static Number, value: &Value<'a>) -> Option<f64> {
        let Some(found) = as_f64(value.get_ref()) else {
            let suggestion = number_in_text(value.get_ref()).map(|number| format!("{} = {number}", key.name));
            return self.wrong_type(key.name, &expected_number(key), value, suggestion);
        };
        // A comparison with NaN is false: NaN is outside every range.
        if (key.low..=key.high).contains(&found) {
            return Some(key.unit.si(found));
        }
        let fault =
            Fault::Impossible { key: key.name.to_owned(), expected: expected_number(key), found: found.to_string() };
        self.findings.push((value.span(), fault));
        None
    }

    fn many_numbers<const N: usize>(&mut self, key: &'static Number, value: &Value<'a>) -> Option<[f64; N]> {
        let Some(array) = value.get_ref().as_array() else {
            return self.wrong_type(key.name, &expected_numbers(key, N), value, None);
        };
        if array.len() != N {
            let found = format!("{} values", array.len());
            return self.impossible(key.name, &expected_numbers(key, N), &found);
        }
        let mut numbers = [0.0; N];
        let mut complete = true;
        for (number, value) in numbers.iter_mut().zip(array.iter()) {
            match self.one_number(key, value) {
                Some(found) => *number = found,
                None => complete = false,
            }
        }
        complete.then_some(numbers)
    }

    fn one_integer(
        &mut self,
        name: &'static str,
        expected: &str,
        value: &Value<'a>,
        allowed: impl Fn(i64) -> bool,
    ) -> Option<i64> {
        let DeValue::Integer(integer) = value.get_ref() else {
            let suggestion = number_in_text(value.get_ref()).map(|number| format!("{name} = {number}"));
            return self.wrong_type(name, expected, value, suggestion);
        };
        match i64::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(found) if allowed(found) => Some(found),
            _ => self.impossible(name, expected, &integer.to_string()),
        }
    }

    fn wrong_type<T>(
        &mut self,
        name: &str,
        expected: &str,
        value: &Value<'a>,
        suggestion: Option<String>,
    ) -> Option<T> {
        let (key, expected, found) = (name.to_owned(), expected.to_owned(), describe(value.get_ref()));
        self.findings.push((value.span(), Fault::WrongType { key, expected, found, suggestion }));
        None
    }

    /// What to say about a key that this section does not have, and which absent key was probably meant.
    fn stranger(&self, table: &DeTable<'a>, written: &str) -> (Fault, Option<&'static str>) {
        let free = || self.known.iter().filter(|known| !table.contains_key(known.name));
        let same_stem = |known: &&Known| {
            known.unit.is_some_and(|unit| known.name.strip_suffix(unit.suffix) == Some(without_unit(written)))
        };
        if let Some(Known { name, unit: Some(unit) }) = free().find(same_stem) {
            let fault = Fault::WrongUnit { found: written.to_owned(), expected: name, unit: unit.words };
            return (fault, Some(name));
        }
        let alike = |known: &&Known| strsim::jaro_winkler(known.name, written);
        let suggestion = free()
            .filter(|known| alike(known) >= SIMILAR)
            .max_by(|a, b| alike(a).total_cmp(&alike(b)))
            .map(|known| known.name);
        let kind = if table.get(written).is_some_and(|value| value.get_ref().is_table()) { "section" } else { "key" };
        (Fault::Unknown { kind, key: written.to_owned(), section: self.label(), suggestion }, suggestion)
    }
}

/// A key as a person wrote it, without its unit.
fn without_unit(key: &str) -> &str {
    UNIT_SUFFIXES.iter().find_map(|suffix| key.strip_suffix(suffix)).unwrap_or(key)
}

fn expected_number(key: &Number) -> String {
    format!("a number from {} to {} ({})", key.low, key.high, key.unit.words)
}

fn expected_numbers(key: &Number, count: usize) -> String {
    format!("{count} numbers from {} to {} ({})", key.low, key.high, key.unit.words)
}

fn as_f64(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        // Whole numbers beyond 2^53 lose digits here, far outside every range.
        DeValue::Integer(integer) => {
            i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|whole| whole as f64)
        }
        _ => None,
    }
}

/// The number in a text such as "20 mm", for the suggestion.
fn number_in_text(value: &DeValue<'_>) -> Option<f64> {
    let text = value.as_str()?.trim();
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+'))).unwrap_or(text.len());
    text.get(..end)?.parse().ok()
}

/// The value in words, for messages.
fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text {text:?}"),
        DeValue::Integer(integer) => format!("the whole number {integer}"),
        DeValue::Float(float) => format!("the number {float}"),
        DeValue::Boolean(boolean) => boolean.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Array(array) => format!("a list of {} values", array.len()),
        DeValue::Table(_) => "a section".to_owned(),
    }
}
