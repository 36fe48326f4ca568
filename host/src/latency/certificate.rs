//! What a long measurement came to, on which machine and with which programs, signed: a summary that nobody changes unnoticed.
//!
//! The signature is Ed25519 (RFC 8032) over the summary's bytes, in a file of its own. It shows that whoever has the key wrote
//! this; whose key it is, only a person who compares keys knows.

use crate::doctor::Diagnosis;
use crate::latency::Summary;
use crate::run::sensor_wire::Wire;
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use serde::Serialize;

/// What stands in front of the bytes that are signed: a signature for another purpose is none for this.
const PURPOSE: &[u8] = b"screed latency certificate 1\n";

/// The summary.
#[derive(Clone, Debug, Serialize)]
pub struct Certificate {
    /// The program's version and build.
    pub screed: &'static str,
    /// The machine.
    pub machine: Machine,
    /// When it began (s since 1970-01-01 UTC).
    pub began_unix_s: u64,
    /// How long each of the two measurements took (s).
    pub seconds_each: f64,
    /// The programs that took part.
    pub programs: Vec<Program>,
    /// Time between wake-ups (µs).
    pub period_us: u128,
    /// SCHED_FIFO priority.
    pub priority: u8,
    /// The processor, if bound.
    pub cpu: Option<usize>,
    /// "real time" or "NON-RT", and what was refused.
    pub scheduling: &'static str,
    /// What was refused.
    pub scheduling_note: String,
    /// What `screed doctor` says of the machine.
    pub doctor: Diagnosis,
    /// How late the timer-paced loop woke.
    pub wake: Option<Summary>,
    /// How long `screed-rt` took from sensor in to wire out.
    pub sensor_to_wire: Option<Wire>,
}

/// A machine as it calls itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Its name.
    pub name: String,
    /// The kernel.
    pub kernel: String,
    /// The kernel's command line.
    pub command_line: String,
}

/// A program and the SHA-256 of its bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Program {
    /// Its name.
    pub name: String,
    /// In hexadecimal digits.
    pub sha256: String,
}

/// Why a summary is not what was signed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SealError {
    /// The signature's file is none.
    #[error("the signature cannot be read: {what}")]
    Form {
        /// What is missing.
        what: &'static str,
    },
    /// It was signed by somebody else.
    #[error("it is signed by the key {found}, and {trusted} is trusted")]
    Untrusted {
        /// By whom.
        found: String,
        /// Who was expected.
        trusted: String,
    },
    /// Summary or signature were changed.
    #[error("the summary is not what was signed: one of the two files was changed")]
    Changed,
}

/// The signature of a summary, as the text of its file.
pub fn sign(summary: &[u8], key: &SigningKey) -> String {
    let signature = key.sign(&[PURPOSE, summary].concat());
    written(key.verifying_key().as_bytes(), &signature.to_bytes())
}

fn written(key: &[u8; 32], signature: &[u8; 64]) -> String {
    format!("ed25519\nkey {}\nsignature {}\n", hex(key), hex(signature))
}

/// Whether a summary is what was signed; gives the key that signed it, in hexadecimal digits.
///
/// # Errors
/// [`SealError`].
pub fn verify(summary: &[u8], seal: &str, trusted: Option<&str>) -> Result<String, SealError> {
    let mut lines = seal.lines();
    if lines.next() != Some("ed25519") {
        return Err(SealError::Form { what: "its first line is not \"ed25519\"" });
    }
    let mut field = |name: &str| lines.next().and_then(|line| line.strip_prefix(name));
    let key = field("key ").and_then(unhex::<32>).ok_or(SealError::Form { what: "the second line is no key" })?;
    let signature =
        field("signature ").and_then(unhex::<64>).ok_or(SealError::Form { what: "the third line is no signature" })?;
    if seal != written(&key, &signature) {
        return Err(SealError::Form { what: "it is not written as signatures are" });
    }
    let found = hex(&key);
    if let Some(trusted) = trusted.filter(|trusted| !trusted.eq_ignore_ascii_case(&found)) {
        return Err(SealError::Untrusted { found, trusted: trusted.to_owned() });
    }
    let key = VerifyingKey::from_bytes(&key).map_err(|_| SealError::Form { what: "its key is no point" })?;
    let signed = [PURPOSE, summary].concat();
    key.verify_strict(&signed, &Signature::from_bytes(&signature)).map_err(|_| SealError::Changed)?;
    Ok(found)
}

/// In hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// N bytes from exactly as many hexadecimal digits.
pub fn unhex<const N: usize>(text: &str) -> Option<[u8; N]> {
    let digits: Vec<u8> = text.chars().map(|c| c.to_digit(16).map(|digit| digit as u8)).collect::<Option<_>>()?;
    if digits.len() != 2 * N {
        return None;
    }
    let (pairs, _) = digits.as_chunks::<2>();
    let mut bytes = [0; N];
    bytes.iter_mut().zip(pairs).for_each(|(byte, [high, low])| *byte = 16 * high + low);
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(first: u8) -> SigningKey {
        SigningKey::from_bytes(&std::array::from_fn(|index| first.wrapping_add(index as u8)))
    }

    #[test]
    fn the_signature_is_ed25519s() {
        // RFC 8032, section 7.1, test 1: this secret key has this public key.
        let secret = unhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60").unwrap();
        let public = "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a";
        assert_eq!(hex(SigningKey::from_bytes(&secret).verifying_key().as_bytes()), public);
        assert_eq!(verify(b"text", &sign(b"text", &SigningKey::from_bytes(&secret)), Some(public)), Ok(public.into()));
    }

    #[test]
    fn every_changed_bit_of_summary_and_signature_is_noticed() {
        let summary = br#"{"wake": {"max_us": 31}, "host": "cell"}"#;
        let seal = sign(summary, &key(7));
        assert!(verify(summary, &seal, None).is_ok());
        for at in 0..summary.len() * 8 {
            let mut changed = summary.to_vec();
            changed[at / 8] ^= 1 << (at % 8);
            assert_eq!(verify(&changed, &seal, None), Err(SealError::Changed), "bit {at}");
        }
        for longer in [&summary[..summary.len() - 1], &[summary, &b" "[..]].concat(), b""] {
            assert_eq!(verify(longer, &seal, None), Err(SealError::Changed));
        }
        for at in 0..seal.len() * 8 {
            let mut changed = seal.clone().into_bytes();
            changed[at / 8] ^= 1 << (at % 8);
            let Ok(changed) = String::from_utf8(changed) else { continue };
            assert!(verify(summary, &changed, None).is_err(), "bit {at}: {changed}");
        }
        for cut in 0..seal.len() {
            assert!(verify(summary, &seal[..cut], None).is_err(), "{cut}");
        }
        assert!(verify(summary, &(seal + "more\n"), None).is_err());
    }

    #[test]
    fn another_key_is_another_signer() {
        let seal = sign(b"text", &key(7));
        let (own, other) = (hex(key(7).verifying_key().as_bytes()), hex(key(8).verifying_key().as_bytes()));
        assert_eq!(verify(b"text", &seal, Some(&own)), Ok(own.clone()));
        assert_eq!(
            verify(b"text", &seal, Some(&other)),
            Err(SealError::Untrusted { found: own.clone(), trusted: other.clone() })
        );
        // Somebody else's key in its place does not make it theirs.
        assert_eq!(verify(b"text", &seal.replace(&own, &other), None), Err(SealError::Changed));
    }
}
