//! A line that spoils what it carries: one package of the robot, in a chosen way.

/// How a package is spoilt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spoil {
    /// One bit of the low byte of its size is flipped.
    Size,
    /// One bit of its type is flipped.
    Type,
    /// Its last byte is missing.
    Short,
    /// The first received joint position is not a number.
    NotANumber,
    /// The first received joint position is 100 rad.
    Impossible,
}

/// Which package is spoilt, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineFault {
    /// In which way.
    pub spoil: Spoil,
    /// Data packages that pass before it.
    pub after: u64,
}

impl std::str::FromStr for Spoil {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "size" => Ok(Self::Size),
            "type" => Ok(Self::Type),
            "short" => Ok(Self::Short),
            "nan" => Ok(Self::NotANumber),
            "impossible" => Ok(Self::Impossible),
            _ => Err(format!("expected size, type, short, nan or impossible, found {text:?}")),
        }
    }
}

impl std::str::FromStr for LineFault {
    type Err = String;

    /// `KIND@COUNT`, for example `short@1000`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, after) = text.split_once('@').ok_or_else(|| format!("expected KIND@COUNT, found {text:?}"))?;
        let spoil = kind.parse()?;
        let after = after.parse().map_err(|_| format!("expected a count of packages, found {after:?}"))?;
        Ok(Self { spoil, after })
    }
}

/// RTDE's header: size (2 bytes, big-endian) and type; a data package of protocol 2 then has the recipe's number.
const HEADER: usize = 3;
const DATA_PACKAGE: u8 = b'U';
/// Behind header and recipe number comes the time stamp, behind it the actual joint positions: the order that
/// [`crate::link::rtde`] asks for.
const FIRST_JOINT: usize = HEADER + 1 + 8;

/// The line. It carries whole packages, as the controller puts them out.
#[derive(Clone, Debug, Default)]
pub struct BadLine {
    fault: Option<LineFault>,
    packages: u64,
    out: Vec<u8>,
}

impl BadLine {
    /// A line with a fault, or without.
    pub fn new(fault: Option<LineFault>) -> Self {
        Self { fault, packages: 0, out: Vec::new() }
    }

    /// What arrives of `bytes`.
    pub fn pass(&mut self, bytes: &[u8]) -> &[u8] {
        self.out.clear();
        let mut rest = bytes;
        while let &[high, low, kind, ..] = rest {
            let size = usize::from(u16::from_be_bytes([high, low])).clamp(HEADER, rest.len());
            let (package, behind) = rest.split_at(size);
            rest = behind;
            let start = self.out.len();
            self.out.extend_from_slice(package);
            if kind == DATA_PACKAGE {
                if let Some(fault) = self.fault.take_if(|fault| fault.after == self.packages) {
                    spoil(&mut self.out, start, fault.spoil);
                }
                self.packages += 1;
            }
        }
        self.out.extend_from_slice(rest);
        &self.out
    }
}

/// Spoils the data package that begins at `start` and ends `out`.
pub fn spoil(out: &mut Vec<u8>, start: usize, spoil: Spoil) {
    let value = match spoil {
        Spoil::Size => return out.get_mut(start + 1).into_iter().for_each(|byte| *byte ^= 1),
        Spoil::Type => return out.get_mut(start + 2).into_iter().for_each(|byte| *byte ^= 1),
        Spoil::Short => return out.truncate(out.len().saturating_sub(1)),
        Spoil::NotANumber => f64::NAN,
        Spoil::Impossible => 100.0,
    };
    if let Some(joint) = out.get_mut(start + FIRST_JOINT..start + FIRST_JOINT + 8) {
        joint.copy_from_slice(&value.to_be_bytes());
    }
}
