//! What waits for the host: whole frames, in memory that was allocated at the start.

use screed_kernel::frame::{self, FromKernel, NOTE_MAX};
use std::fmt::Display;

/// Room while the host is busy; what does not fit is dropped.
const TELEMETRY_MAX: usize = 1 << 20;

/// Frames that are not on the wire yet.
pub(super) struct ToHost {
    waiting: Vec<u8>,
}

/// A copy has as much room.
impl Clone for ToHost {
    fn clone(&self) -> Self {
        let mut copy = Self::new();
        copy.queue(&self.waiting);
        copy
    }
}

impl ToHost {
    pub(super) fn new() -> Self {
        Self { waiting: Vec::with_capacity(TELEMETRY_MAX) }
    }

    pub(super) fn waiting(&self) -> &[u8] {
        &self.waiting
    }

    /// So many bytes are on the wire.
    pub(super) fn sent(&mut self, count: usize) {
        self.waiting.drain(..count.min(self.waiting.len()));
    }

    /// Another host has come: what it hears begins with a whole frame.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Cause and action, in words for a person; `fatal` where the process ends.
    pub(super) fn alarm(&mut self, fatal: bool, text: &dyn Display) {
        self.say(&FromKernel::Alarm { fatal, note: shorten(text) });
    }

    pub(super) fn say(&mut self, message: &FromKernel) {
        let mut out = [0; 1024];
        // Every message is far shorter than this.
        if let Ok(used) = frame::encode(message, &mut out) {
            self.queue(out.get(..used).unwrap_or(&[]));
        }
    }

    /// Whole frames.
    pub(super) fn queue(&mut self, bytes: &[u8]) {
        // Never beyond what was allocated at start. A host that does not read misses whole messages, and sees by the ticks of
        // the cycles how many.
        if self.waiting.len() + bytes.len() <= TELEMETRY_MAX {
            self.waiting.extend_from_slice(bytes);
        }
    }
}

/// The text as far as a note has room for it.
pub(super) fn shorten(text: impl Display) -> heapless::String<NOTE_MAX> {
    use std::fmt::Write;
    let mut note = heapless::String::new();
    // A full note refuses the next character: its beginning is what counts.
    struct Cut<'a>(&'a mut heapless::String<NOTE_MAX>);
    impl Write for Cut<'_> {
        fn write_str(&mut self, text: &str) -> std::fmt::Result {
            text.chars().try_for_each(|c| self.0.push(c).map_err(|_| std::fmt::Error))
        }
    }
    let _ = write!(Cut(&mut note), "{text}");
    note
}
