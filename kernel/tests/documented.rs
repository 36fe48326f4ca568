//! `docs/faults.md` names every fault and every refusal.

/// The text between two marks.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let (_, rest) = text.split_once(from).expect("the beginning");
    rest.split_once(to).expect("the end").0
}

#[test]
fn every_fault_and_every_refusal_is_documented() {
    let docs = include_str!("../../docs/faults.md");
    let codes = between(include_str!("../src/fault.rs"), "fn code", "fn cause");
    let faults: Vec<_> = codes
        .lines()
        .filter_map(|line| {
            let (name, code) = line.trim().strip_prefix("Self::")?.split_once(" => ")?;
            let name = name.split(' ').next()?;
            Some(format!("| {} | `{name}` |", code.trim_matches(['"', ','])))
        })
        .collect();
    let variants = between(include_str!("../src/frame/message.rs"), "pub enum Refusal {", "\n}");
    let refusals: Vec<_> = variants
        .lines()
        .filter_map(|line| line.strip_prefix("    ").filter(|line| line.starts_with(char::is_uppercase)))
        .map(|line| format!("| `{}` |", line.split([' ', ',', '(']).next().unwrap_or_default()))
        .collect();
    assert_eq!(faults.len(), screed_kernel::fault::Fault::KINDS.len());
    assert!(refusals.len() >= 11, "{refusals:?}");
    for row in faults.iter().chain(&refusals) {
        assert!(docs.contains(row), "docs/faults.md has no row {row}");
    }
}
