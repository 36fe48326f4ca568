//! Strings: ISO 10303-21 clause 6.4.3 writes everything beyond ASCII with control directives.

/// The string that the bytes between the quotes stand for, or what is wrong with them.
///
/// Directives: `''` and `\\` for themselves, `\S\c` for c + 128 of the current page, `\P?\` for the page (only A, Latin-1,
/// is known), `\X\hh` for one Latin-1 byte, `\X2\…\X0\` for UTF-16 and `\X4\…\X0\` for UTF-32, in hexadecimal. Bytes beyond
/// ASCII, which edition 2 forbids and real files have, are UTF-8 where they can be, else Latin-1.
pub(super) fn decode(raw: &[u8]) -> Result<String, String> {
    if !raw.iter().any(|byte| matches!(byte, b'\\' | b'\'' | 0x80..)) {
        return Ok(String::from_utf8_lossy(raw).into_owned());
    }
    let plain = match std::str::from_utf8(raw) {
        Ok(text) => text.to_owned(),
        Err(_) => raw.iter().map(|byte| char::from(*byte)).collect(),
    };
    let mut out = String::with_capacity(plain.len());
    let mut rest = plain.as_str();
    while let Some(at) = rest.find(['\\', '\'']) {
        let (before, directive) = rest.split_at(at);
        out.push_str(before);
        rest = directive_of(directive, &mut out)?;
    }
    out.push_str(rest);
    Ok(out)
}

/// Decodes the directive at the start of `text` and gives what follows it.
fn directive_of<'t>(text: &'t str, out: &mut String) -> Result<&'t str, String> {
    let bad = || format!("the directive '{}'", text.chars().take(12).collect::<String>());
    if let Some(rest) = text.strip_prefix("''") {
        out.push('\'');
        return Ok(rest);
    }
    if let Some(rest) = text.strip_prefix("\\\\") {
        out.push('\\');
        return Ok(rest);
    }
    if let Some(rest) = text.strip_prefix("\\S\\") {
        let mut characters = rest.chars();
        let low = characters.next().filter(char::is_ascii).ok_or_else(bad)?;
        out.push(char::from(low as u8 | 0x80));
        return Ok(characters.as_str());
    }
    if let Some(rest) = text.strip_prefix("\\PA\\") {
        return Ok(rest);
    }
    if let Some(rest) = text.strip_prefix("\\X\\") {
        let (digits, rest) = rest.split_at_checked(2).ok_or_else(bad)?;
        out.push(char::from(u8::try_from(hexadecimal(digits).ok_or_else(bad)?).map_err(|_| bad())?));
        return Ok(rest);
    }
    let (width, rest) = match (text.strip_prefix("\\X2\\"), text.strip_prefix("\\X4\\")) {
        (Some(rest), _) => (4, rest),
        (_, Some(rest)) => (8, rest),
        _ => return Err(bad()),
    };
    let (digits, rest) = rest.split_once("\\X0\\").ok_or_else(bad)?;
    if digits.is_empty() || digits.len() % width != 0 || !digits.is_ascii() {
        return Err(bad());
    }
    let units: Option<Vec<u32>> =
        (0..digits.len()).step_by(width).map(|at| digits.get(at..at + width).and_then(hexadecimal)).collect();
    let units = units.ok_or_else(bad)?;
    if width == 8 {
        for unit in units {
            out.push(char::from_u32(unit).ok_or_else(bad)?);
        }
    } else {
        // Four digits: every unit fits.
        let units = units.into_iter().map(|unit| unit as u16);
        for character in char::decode_utf16(units) {
            out.push(character.map_err(|_| bad())?);
        }
    }
    Ok(rest)
}

fn hexadecimal(digits: &str) -> Option<u32> {
    if digits.starts_with('+') {
        return None;
    }
    u32::from_str_radix(digits, 16).ok()
}

#[cfg(test)]
mod tests {
    use super::decode;

    #[test]
    fn directives_give_the_characters_they_stand_for() {
        for (raw, expected) in [
            (&b"plain"[..], "plain"),
            (b"it''s", "it's"),
            (b"a\\\\b", "a\\b"),
            (b"D\\X2\\0027\\X0\\Urso", "D'Urso"),
            (b"Gr\\S\\|n", "Gr\u{fc}n"),
            (b"\\PA\\Gr\\S\\|n", "Gr\u{fc}n"),
            (b"Gr\\X\\FCn", "Gr\u{fc}n"),
            (b"\\X2\\00C400D6\\X0\\", "\u{c4}\u{d6}"),
            (b"\\X2\\D83DDE00\\X0\\", "\u{1f600}"),
            (b"\\X4\\0001F600\\X0\\", "\u{1f600}"),
            ("Gr\u{fc}n".as_bytes(), "Gr\u{fc}n"),
            (b"Gr\xFCn", "Gr\u{fc}n"),
        ] {
            assert_eq!(decode(raw).as_deref(), Ok(expected), "{}", String::from_utf8_lossy(raw));
        }
    }

    #[test]
    fn broken_directives_are_named() {
        for raw in [&b"\\"[..], b"\\X2\\00", b"\\X2\\\\X0\\", b"\\X2\\D83D\\X0\\", b"\\X\\G0", b"\\PB\\", b"\\S\\"] {
            let message = decode(raw).expect_err("broken");
            assert!(message.starts_with("the directive '\\"), "{message}");
        }
    }
}
