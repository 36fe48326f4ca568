//! What the host asks for: each message is obeyed whole or refused with a reason, and then nothing has changed.

use super::State;
use crate::clock::PathClock;
use crate::config::Config;
use crate::frame::{BatchPart, Configure, FromKernel, Refusal, ToKernel};
use crate::guard::{Differences, Violation, exceeds};
use crate::mode::{Event, Mode, StopCause};
use crate::ring::RingError;
use crate::setpoint::{Coder, Setpoint};

/// A batch whose last part has not come.
#[derive(Clone, Copy, Debug)]
pub(super) struct Incoming<const N: usize> {
    batch: u32,
    coder: Coder<N>,
    differences: Differences<N>,
    flow: f64,
}

impl<const N: usize, const CAP: usize> State<N, CAP> {
    pub(super) fn obey(&mut self, message: &ToKernel) {
        match message {
            ToKernel::Hello => {
                self.drop_incoming();
                self.said = None;
            }
            ToKernel::Configure(configure) => self.answer(0, |state| state.configure(configure)),
            ToKernel::Batch(part) => self.batch(part),
            ToKernel::Rate(rate) => self.answer(0, |state| state.set_rate(*rate)),
            ToKernel::Resume { epoch } => self.answer(0, |state| state.resume(*epoch)),
            ToKernel::Hold => self.answer(0, |state| state.request(Event::Hold)),
            ToKernel::Stop => self.answer(0, |state| state.request(Event::Stop)),
            ToKernel::Rearm { fault } => self.answer(0, |state| state.rearm(*fault)),
            ToKernel::Quit => {
                self.quit = true;
                self.change(Event::Stop);
            }
        }
    }

    fn answer(&mut self, batch: u32, act: impl FnOnce(&mut Self) -> Result<(), Refusal>) {
        if let Err(reason) = act(self) {
            self.say(&FromKernel::Refused { batch, reason });
        }
    }

    fn request(&mut self, event: Event) -> Result<(), Refusal> {
        if self.change(event) { Ok(()) } else { Err(Refusal::Mode) }
    }

    fn resume(&mut self, epoch: u32) -> Result<(), Refusal> {
        if epoch != self.epoch {
            return Err(Refusal::Stale);
        }
        if self.is_played_out() {
            return Err(Refusal::Mode);
        }
        self.request(Event::Resume)
    }

    fn rearm(&mut self, fault: u32) -> Result<(), Refusal> {
        if fault == self.faults { self.request(Event::Rearm) } else { Err(Refusal::Stale) }
    }

    fn set_rate(&mut self, rate: f64) -> Result<(), Refusal> {
        if !(0.0..=1.0).contains(&rate) {
            return Err(Refusal::Rate);
        }
        self.rate = rate;
        if self.mode == Mode::Moving {
            self.clock.set_target(self.target());
        }
        Ok(())
    }

    fn configure(&mut self, configure: &Configure) -> Result<(), Refusal> {
        let holding = self.mode == Mode::Holding && self.is_played_out() && self.correction.is_none();
        if !holding && self.mode != Mode::Unready {
            return Err(Refusal::Mode);
        }
        self.config = Some(Config::new(configure, &self.arm)?);
        // Holding, the arm stands where it was last told to: that stays its target. It is only counted anew.
        self.begin();
        Ok(())
    }

    fn batch(&mut self, part: &BatchPart) {
        match self.take_part(part) {
            Ok(false) => {}
            Ok(true) => {
                self.say(&FromKernel::Accepted { batch: part.batch });
                // The credits have changed.
                self.said = None;
            }
            Err(reason) => {
                // A stray part of another batch does no harm to the one under way.
                if part.opens || self.incoming.is_some_and(|incoming| incoming.batch == part.batch) {
                    self.drop_incoming();
                }
                self.say(&FromKernel::Refused { batch: part.batch, reason });
            }
        }
    }

    /// Decodes, checks and stages one part; true when the batch is committed.
    fn take_part(&mut self, part: &BatchPart) -> Result<bool, Refusal> {
        // A hold keeps the ring, and what follows it may come in; after a stop or a fault there will be no ring.
        let taking = matches!(self.mode, Mode::Holding | Mode::Moving | Mode::Stopping { cause: StopCause::Hold });
        let (Some(config), true) = (&self.config, taking) else { return Err(Refusal::Mode) };
        if part.opens {
            self.incoming = None;
            self.ring.stage(part.first_seq, part.after)?;
            let differences = differences_before(&self.ring, &self.clock, part.first_seq);
            self.incoming = Some(Incoming { batch: part.batch, coder: Coder::new(), differences, flow: 0.0 });
        }
        let Some(mut incoming) = self.incoming.filter(|incoming| incoming.batch == part.batch) else {
            return Err(Refusal::Sequence);
        };
        if self.ring.staged_next() != Some(part.first_seq) {
            return Err(Refusal::Sequence);
        }
        let mut seq = part.first_seq;
        let mut code = part.code;
        while !code.is_empty() {
            #[cfg(test)]
            crate::steps::count();
            let (setpoint, used) = incoming.coder.decode(code).map_err(|_| Refusal::Code)?;
            code = code.get(used..).unwrap_or(&[]);
            let fits = incoming.differences.push(&setpoint.joints, &config.plan, config.periods.sample);
            let fits = fits.and_then(|()| config.workspace.check(&self.arm, &setpoint.joints));
            fits.map_err(|violation| does_not_fit(seq, violation))?;
            if exceeds(0.0, setpoint.flow) {
                return Err(Refusal::Code);
            }
            incoming.flow = setpoint.flow;
            self.ring.push(&setpoint)?;
            seq = seq.saturating_add(1);
        }
        if part.commits {
            if !incoming.differences.is_at_rest() || incoming.flow != 0.0 {
                return Err(Refusal::NotAtRest);
            }
            self.ring.commit()?;
            self.incoming = None;
        } else {
            self.incoming = Some(incoming);
        }
        Ok(part.commits)
    }
}

/// The three samples before the one with sequence number `first_seq`: from the ring as far as they wait there, from what
/// the clock has taken as far as they do not.
fn differences_before<const N: usize, const CAP: usize>(
    ring: &crate::ring::Ring<N, CAP>,
    clock: &PathClock<N>,
    first_seq: u32,
) -> Differences<N> {
    let [newest, middle, oldest] = clock.newest_three();
    let [a, b, c] = [1_u32, 2, 3].map(|back| {
        let seq = first_seq.saturating_sub(back);
        match (ring.get(seq), ring.consumed().saturating_sub(seq)) {
            (Some(Setpoint { joints, .. }), _) => *joints,
            (None, 0) => newest,
            (None, 1) => middle,
            (None, _) => oldest,
        }
    });
    Differences::after(a, b, c)
}

const fn does_not_fit(seq: u32, Violation { quantity, joint, value, limit }: Violation) -> Refusal {
    Refusal::DoesNotFit { seq, quantity, joint, value, limit }
}

impl From<RingError> for Refusal {
    fn from(error: RingError) -> Self {
        match error {
            RingError::Full => Self::Full,
            RingError::TooLate => Self::TooLate,
            RingError::Sequence => Self::Sequence,
        }
    }
}
