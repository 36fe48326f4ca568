//! Whether an answer is late: more of them are on their way than usual.

/// How many answers are usually on their way when a telegram comes: none on a quick line, one or more where a round trip
/// takes longer than a cycle. The usual is the least of the last one to two hundred telegrams.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Depth {
    before: Option<u32>,
    now: Option<u32>,
    telegrams: u32,
}

impl Depth {
    const WINDOW: u32 = 100;

    /// Whether more answers are on their way than usual.
    pub(super) fn is_deeper(&mut self, depth: u32) -> bool {
        self.now = Some(self.now.map_or(depth, |least| least.min(depth)));
        self.telegrams += 1;
        let usual = self.before.into_iter().chain(self.now).min();
        if self.telegrams == Self::WINDOW {
            (self.before, self.now, self.telegrams) = (self.now, None, 0);
        }
        usual.is_some_and(|usual| depth > usual)
    }
}
