//! `docs/faults.md` names every fault, in the words that a person sees, and every refusal.

use screed_kernel::fault::Fault;

/// The text between two marks.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let (_, rest) = text.split_once(from).expect("the beginning");
    rest.split_once(to).expect("the end").0
}

#[test]
fn every_fault_and_every_refusal_is_documented() {
    let docs = include_str!("../../docs/faults.md");
    for fault in Fault::KINDS {
        let debug = format!("{fault:?}");
        let name = debug.split(' ').next().unwrap_or_default();
        let head = format!("| {} | `{name}` | {} |", fault.code(), fault.cause());
        let row = docs.lines().find(|line| line.starts_with(&head));
        let agrees = row.is_some_and(|row| row.ends_with(&format!("| {} |", fault.action())));
        assert!(agrees, "docs/faults.md has no row {head} … | {} |", fault.action());
    }
    let mut codes = Fault::KINDS.map(|fault| fault.code()).to_vec();
    codes.dedup();
    let variants = between(include_str!("../src/fault.rs"), "pub enum Fault {", "\n}");
    assert_eq!((codes.len(), names(variants).len()), (Fault::KINDS.len(), Fault::KINDS.len()), "one of each kind");
    let variants = between(include_str!("../src/frame/message.rs"), "pub enum Refusal {", "\n}");
    let refusals = names(variants);
    assert!(refusals.len() >= 11, "{refusals:?}");
    for name in refusals {
        assert!(docs.contains(&format!("| `{name}` |")), "docs/faults.md has no row for {name}");
    }
}

#[test]
fn every_message_and_every_part_of_one_has_its_number_in_the_documentation() {
    let docs = include_str!("../../docs/frames.md");
    let messages = include_str!("../src/frame/message.rs");
    let faults = include_str!("../src/fault.rs");
    let guard = include_str!("../src/guard.rs");
    // A table of its own, or numbers in a row.
    for (source, head, in_rows) in [
        (messages, "pub enum ToKernel<'a> {", true),
        (messages, "pub enum FromKernel {", true),
        (messages, "pub enum Refusal {", true),
        (faults, "pub enum Fault {", true),
        (messages, "pub enum ModeCode {", false),
        (messages, "pub enum Unsound {", false),
        (guard, "pub enum Quantity {", false),
        (include_str!("../src/control.rs"), "pub enum Bound {", false),
        (faults, "pub enum Unreached {", false),
    ] {
        let names = names(between(source, head, "\n}"));
        assert!(names.len() >= 3, "{head} {names:?}");
        let mut rest = docs;
        for (number, name) in names.iter().enumerate() {
            let entry = if in_rows { format!("\n| {number} | `{name}` |") } else { format!("{number} `{name}`") };
            let place = rest.find(&entry);
            assert!(place.is_some(), "docs/frames.md has no {entry:?} of {head} in its place");
            rest = &rest[place.unwrap_or(0) + entry.len()..];
        }
    }
}

/// The names of an enum's variants, from its source.
fn names(variants: &str) -> Vec<&str> {
    let lines = variants.lines().filter_map(|line| line.strip_prefix("    "));
    let lines = lines.filter(|line| line.starts_with(char::is_uppercase));
    lines.map(|line| line.split([' ', ',', '(']).next().unwrap_or_default()).collect()
}
