//! What the host does about a line that spoils bytes: what is not answered is said again.
//!
//! Time is counted in the kernel's ticks, by its statuses. Every message may be said twice: a batch takes its own place, a
//! configuration sets the same limits, and a `Resume` or `Rearm` names what it is about and is refused the second time.

use serde::Serialize;

/// How long something is said again and again before the line is given up (ns of the kernel's time). A batch has no such time:
/// the ring is played to its end before.
const GIVE_UP_NS: u64 = 10_000_000_000;
/// How long an answer may take before it is said again (ns of the kernel's time), besides the time that the line takes for the
/// message.
const PATIENCE_NS: u64 = 1_000_000_000;
/// The same when the kernel has told that a frame came spoilt or a part is missing: until what is behind it has gone by.
const HURRY_NS: u64 = 100_000_000;

/// What happened on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LineFigures {
    /// Frames from the kernel that came spoilt.
    pub spoilt_from_kernel: u64,
    /// Frames that came spoilt to the kernel since this host attached.
    pub spoilt_to_kernel: u32,
    /// Messages said again.
    pub said_again: u64,
}

/// The message under way, and what has happened so far.
#[derive(Clone, Debug)]
pub struct Resend {
    /// Time that the line takes for a byte (ns): ten bits.
    byte_ns: u64,
    /// Its frames; empty when all is answered.
    frames: Vec<u8>,
    /// Tick of the newest status when it was first said, and when it was last.
    first: u64,
    since: u64,
    tries: u32,
    missed: bool,
    /// Spoilt frames that the kernel had counted before this host.
    spoilt_before: Option<u32>,
    figures: LineFigures,
}

impl Resend {
    /// For a line of so many bits a second.
    pub fn new(baud: u32) -> Self {
        let byte_ns = 10_000_000_000 / u64::from(baud.max(1));
        Self {
            byte_ns,
            frames: Vec::new(),
            first: 0,
            since: 0,
            tries: 0,
            missed: false,
            spoilt_before: None,
            figures: LineFigures::default(),
        }
    }

    /// Something was said that will be answered.
    pub fn expect(&mut self, frames: &[u8], tick: u64) {
        self.frames.clear();
        self.frames.extend_from_slice(frames);
        (self.first, self.since, self.tries, self.missed) = (tick, tick, 1, false);
    }

    /// It was answered.
    pub fn answered(&mut self) {
        self.frames.clear();
    }

    /// The kernel has told that a part of it did not come.
    pub const fn part_missed(&mut self) {
        self.missed = true;
    }

    /// Whether it was said more than once: then it may be answered more than once.
    pub const fn is_repeated(&self) -> bool {
        self.tries > 1
    }

    /// A frame from the kernel came spoilt.
    pub const fn spoilt(&mut self) {
        self.figures.spoilt_from_kernel += 1;
    }

    /// A status came, at the kernel's tick; it has counted so many spoilt frames, and ticks every `period_ns`. What is to be
    /// said again, if anything is.
    ///
    /// # Errors
    /// How often it was said, when that was in vain.
    pub fn on_status(&mut self, tick: u64, spoilt: u32, period_ns: u64) -> Result<&[u8], u32> {
        let before = *self.spoilt_before.get_or_insert(spoilt);
        let more = spoilt.saturating_sub(before) > self.figures.spoilt_to_kernel;
        self.figures.spoilt_to_kernel = spoilt.saturating_sub(before);
        self.missed |= more;
        // Sooner it would be said while it is still on its way, and a slow line would carry nothing else.
        let on_its_way = self.byte_ns * self.frames.len() as u64;
        let patience = on_its_way + if self.missed { HURRY_NS } else { PATIENCE_NS };
        let time_since = |then: u64| tick.saturating_sub(then).saturating_mul(period_ns);
        if self.frames.is_empty() || time_since(self.since) < patience {
            return Ok(&[]);
        }
        if time_since(self.first) >= GIVE_UP_NS {
            return Err(self.tries);
        }
        (self.since, self.tries, self.missed) = (tick, self.tries + 1, false);
        self.figures.said_again += 1;
        Ok(&self.frames)
    }

    /// What has happened so far.
    pub const fn figures(&self) -> LineFigures {
        self.figures
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: u64 = 8_000_000;

    #[test]
    fn what_is_not_answered_is_said_again_and_then_given_up() {
        let mut resend = Resend::new(1_000_000);
        assert_eq!(resend.on_status(1_000, 7, PERIOD), Ok(&[][..]));
        resend.expect(&[1, 2], 1_000);
        // Two came spoilt: this one may be among them.
        assert_eq!(resend.on_status(1_001, 9, PERIOD), Ok(&[][..]));
        assert_eq!(resend.on_status(1_013, 9, PERIOD), Ok(&[1, 2][..]));
        resend.expect(&[1, 2], 1_000);
        let mut said = Vec::new();
        let gave_up = (1_001..3_000).find_map(|tick| match resend.on_status(tick, 9, PERIOD) {
            Ok([]) => None,
            Ok(frames) => {
                assert_eq!(frames, [1, 2]);
                said.push(tick);
                None
            }
            Err(tries) => Some((tick, tries)),
        });
        // A second and two bytes are more than 125 ticks.
        assert_eq!(said, [1_126, 1_252, 1_378, 1_504, 1_630, 1_756, 1_882, 2_008, 2_134]);
        assert_eq!(gave_up, Some((2_260, 10)));
        assert_eq!(resend.figures(), LineFigures { spoilt_from_kernel: 0, spoilt_to_kernel: 2, said_again: 10 });
    }

    #[test]
    fn an_answer_ends_it_and_a_missed_part_hurries_it() {
        let mut resend = Resend::new(1_000_000);
        resend.expect(&[1], 10);
        resend.part_missed();
        assert_eq!(resend.on_status(22, 0, PERIOD), Ok(&[][..]));
        assert_eq!(resend.on_status(23, 0, PERIOD), Ok(&[1][..]));
        assert!(resend.is_repeated());
        assert_eq!(resend.on_status(40, 0, PERIOD), Ok(&[][..]), "patient again");
        resend.answered();
        assert_eq!(resend.on_status(4_000, 0, PERIOD), Ok(&[][..]));
    }
}
