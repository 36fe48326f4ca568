//! The fixed ring of setpoints, always ending at rest.
//!
//! A batch is written into free slots while the setpoints it will replace stay playable; committing it only cuts the list of
//! extents and appends one entry. So a batch that turns out bad costs nothing but its own slots.

use crate::setpoint::Setpoint;
use heapless::Deque;

/// Most batches that may wait in the ring.
pub const EXTENTS_MAX: usize = 16;

/// A run of setpoints with consecutive sequence numbers in consecutive slots.
#[derive(Clone, Copy, Debug)]
struct Extent {
    first_seq: u32,
    len: u32,
    slot: u32,
}

impl Extent {
    /// Sequence number of the setpoint so far behind the first. It does not wrap: [`Ring::push`] refuses before.
    const fn seq(&self, behind: u32) -> u32 {
        self.first_seq.wrapping_add(behind)
    }

    /// Slot of the setpoint so far behind the first, in a ring of `CAP`.
    const fn slot<const CAP: usize>(&self, behind: u32) -> usize {
        self.slot.wrapping_add(behind) as usize % CAP
    }
}

/// A batch being written.
#[derive(Clone, Copy, Debug)]
struct Staged {
    extent: Extent,
    after: Option<u32>,
}

/// Why the ring does not take a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RingError {
    /// No free slot, or as many batches as the ring can list: wait for credits.
    Full,
    /// The setpoint to replace after has been consumed.
    TooLate,
    /// Sequence numbers do not continue: neither behind the ring's end nor behind a setpoint it still holds.
    Sequence,
}

/// `CAP` setpoints of an N-joint arm.
#[derive(Clone, Debug)]
pub struct Ring<const N: usize, const CAP: usize> {
    slots: [Setpoint<N>; CAP],
    extents: Deque<Extent, EXTENTS_MAX>,
    staged: Option<Staged>,
    /// The slot behind the last committed setpoint.
    end_slot: u32,
    /// Slots between the oldest setpoint not consumed and `end_slot`, replaced tails included.
    held: u32,
    /// Sequence number consumed last; 0 before the first.
    consumed: u32,
}

impl<const N: usize, const CAP: usize> Ring<N, CAP> {
    /// An empty ring whose next setpoint has sequence number 1.
    pub const fn new() -> Self {
        Self { slots: [Setpoint::ZERO; CAP], extents: Deque::new(), staged: None, end_slot: 0, held: 0, consumed: 0 }
    }

    /// Drops everything that waits. The next setpoint must follow the one consumed last.
    pub fn clear(&mut self) {
        self.extents.clear();
        self.staged = None;
        self.held = 0;
    }

    /// Drops everything and counts from 1 again.
    pub fn restart(&mut self) {
        self.clear();
        self.consumed = 0;
    }

    /// Sequence number consumed last, 0 before the first.
    pub const fn consumed(&self) -> u32 {
        self.consumed
    }

    /// Sequence number of the last setpoint held, or of the one consumed last when none is held.
    pub fn end_seq(&self) -> u32 {
        self.extents.back().map_or(self.consumed, |extent| extent.seq(extent.len.saturating_sub(1)))
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.extents.is_empty()
    }

    /// Setpoints the ring can take now.
    pub fn credits(&self) -> u32 {
        if self.extents.is_full() { 0 } else { (CAP as u32).saturating_sub(self.held) }
    }

    /// A setpoint that waits, by sequence number.
    pub fn get(&self, seq: u32) -> Option<&Setpoint<N>> {
        let extent = self.extents.iter().find(|e| seq >= e.first_seq && seq - e.first_seq < e.len)?;
        self.slots.get(extent.slot::<CAP>(seq - extent.first_seq))
    }

    /// Opens a batch whose first setpoint has `first_seq`. With `after`, it replaces what follows that setpoint; without, it
    /// follows the ring's end.
    ///
    /// # Errors
    /// See [`RingError`]; what was staged before is dropped in any case.
    pub fn stage(&mut self, first_seq: u32, after: Option<u32>) -> Result<(), RingError> {
        self.staged = None;
        let predecessor = match after {
            Some(seq) if seq < self.consumed => return Err(RingError::TooLate),
            Some(seq) if seq > self.end_seq() => return Err(RingError::Sequence),
            Some(seq) => seq,
            None => self.end_seq(),
        };
        if predecessor.checked_add(1) != Some(first_seq) {
            return Err(RingError::Sequence);
        }
        if self.extents.is_full() {
            return Err(RingError::Full);
        }
        self.staged = Some(Staged { extent: Extent { first_seq, len: 0, slot: self.end_slot }, after });
        Ok(())
    }

    /// Adds one setpoint to the open batch.
    ///
    /// # Errors
    /// [`RingError::Sequence`] when no batch is open or sequence numbers run out, [`RingError::Full`] when no slot is free; the
    /// open batch is dropped.
    pub fn push(&mut self, setpoint: &Setpoint<N>) -> Result<(), RingError> {
        let Some(mut staged) = self.staged.take() else { return Err(RingError::Sequence) };
        let extent = &mut staged.extent;
        if self.held.saturating_add(extent.len) >= CAP as u32 {
            return Err(RingError::Full);
        }
        let len = extent.len.saturating_add(1);
        if extent.first_seq.checked_add(len).is_none() {
            return Err(RingError::Sequence);
        }
        *self.slots.get_mut(extent.slot::<CAP>(extent.len)).ok_or(RingError::Full)? = *setpoint;
        extent.len = len;
        self.staged = Some(staged);
        Ok(())
    }

    /// Drops the open batch.
    pub fn abandon(&mut self) {
        self.staged = None;
    }

    /// Sequence number that the open batch's next setpoint will have.
    pub fn staged_next(&self) -> Option<u32> {
        self.staged.map(|staged| staged.extent.seq(staged.extent.len))
    }

    /// Makes the open batch part of what will be played.
    ///
    /// # Errors
    /// [`RingError::TooLate`] when the setpoint to replace after was consumed while the batch came in,
    /// [`RingError::Sequence`] when no batch is open or it is empty.
    pub fn commit(&mut self) -> Result<(), RingError> {
        let Some(Staged { extent, after }) = self.staged.take() else { return Err(RingError::Sequence) };
        if extent.len == 0 {
            return Err(RingError::Sequence);
        }
        if let Some(seq) = after {
            if seq < self.consumed {
                return Err(RingError::TooLate);
            }
            self.cut_after(seq);
        }
        self.extents.push_back(extent).map_err(|_| RingError::Full)?;
        self.held = self.held.saturating_add(extent.len);
        self.end_slot = extent.slot::<CAP>(extent.len) as u32;
        Ok(())
    }

    /// Takes the next setpoint out, with its sequence number.
    pub fn consume(&mut self) -> Option<(u32, Setpoint<N>)> {
        let extent = self.extents.front_mut()?;
        let (seq, slot) = (extent.first_seq, extent.slot);
        let len = extent.len.saturating_sub(1);
        *extent = Extent { first_seq: extent.seq(1), slot: extent.slot::<CAP>(1) as u32, len };
        if len == 0 {
            self.extents.pop_front();
        }
        self.consumed = seq;
        // A replaced tail lies between this extent and the next: its slots become free with the extent's last.
        self.held = match self.extents.front() {
            Some(front) => distance::<CAP>(front.slot, self.end_slot),
            None => 0,
        };
        self.slots.get(slot as usize).map(|setpoint| (seq, *setpoint))
    }

    fn cut_after(&mut self, seq: u32) {
        for _ in 0..EXTENTS_MAX {
            let Some(back) = self.extents.back_mut() else { break };
            if back.first_seq > seq {
                self.extents.pop_back();
            } else {
                back.len = back.len.min((seq - back.first_seq).saturating_add(1));
                break;
            }
        }
        if self.extents.is_empty() {
            // Nothing waits before the new batch: all slots behind it are free again once it is counted.
            self.held = 0;
        }
    }
}

impl<const N: usize, const CAP: usize> Default for Ring<N, CAP> {
    fn default() -> Self {
        Self::new()
    }
}

/// Slots from `from` up to but without `to`; a full ring when they are the same, as the caller knows it is not empty.
const fn distance<const CAP: usize>(from: u32, to: u32) -> u32 {
    let cap = CAP as u32;
    let slots = to.wrapping_add(cap).wrapping_sub(from) % cap;
    if slots == 0 { cap } else { slots }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_do_not_wrap_they_run_out() {
        let mut ring = Ring::<1, 16>::new();
        ring.consumed = u32::MAX - 4;
        let behind = ring.end_seq() + 1;
        ring.stage(behind, None).unwrap();
        for _ in 0..3 {
            ring.push(&Setpoint::ZERO).unwrap();
        }
        assert_eq!(ring.push(&Setpoint::ZERO), Err(RingError::Sequence), "the last number is never given");
        assert_eq!(ring.commit(), Err(RingError::Sequence), "and the batch that asked for it is dropped");
        ring.stage(behind, None).unwrap();
        for _ in 0..3 {
            ring.push(&Setpoint::ZERO).unwrap();
        }
        ring.commit().unwrap();
        assert_eq!((ring.end_seq(), ring.credits()), (u32::MAX - 1, 13));
        ring.stage(u32::MAX, Some(u32::MAX - 1)).unwrap();
        assert_eq!(ring.push(&Setpoint::ZERO), Err(RingError::Sequence));
        assert_eq!(ring.stage(0, Some(u32::MAX)), Err(RingError::Sequence));
        while ring.consume().is_some() {}
        assert_eq!((ring.consumed(), ring.credits()), (u32::MAX - 1, 16));
        ring.restart();
        assert_eq!(ring.stage(1, None), Ok(()));
    }
}
