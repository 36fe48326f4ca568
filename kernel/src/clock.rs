//! The path clock: plays the ring at 0 to 100 %, jerk-limited, and interpolates between samples, so that slowing down and
//! stopping never leave the path.
//!
//! Path time θ runs at the rate θ̇ in 0 to 1, with |θ̈| ≤ [`RATE_SLOPE_MAX`] and |θ⃛| ≤ [`RATE_CURVATURE_MAX`] at every rate
//! profile; [`crate::guard`] says what that adds to the path's own speed, acceleration and jerk. A tick advances the clock by
//! one tick period, also when it comes late: the time lost stays lost.

use crate::interpolate::{interpolate, slopes};
use crate::ramp::{Ramp, RampLimits};
use crate::ring::Ring;
use crate::setpoint::Setpoint;
use crate::units::{JointAcc, JointPos, JointVel};

/// How fast the rate may change (1/s): a path speed v gains at most 1.5 v of deceleration from the clock.
pub const RATE_SLOPE_MAX: f64 = 1.5;

/// How fast the rate's slope may change (1/s²). From 100 % to rest takes 1/1.5 + 1.5/6 = 0.92 s.
pub const RATE_CURVATURE_MAX: f64 = 6.0;

const RATE_LIMITS: RampLimits = RampLimits { slope_max: RATE_SLOPE_MAX, curvature_max: RATE_CURVATURE_MAX };

/// Samples that the interpolation looks at.
const WINDOW: usize = 6;

/// A phase this near to the next sample is that sample: n ticks of 1/n sample each may miss it by rounding.
const PHASE_ROUNDING: f64 = 1e-12;

/// Rate, phase, and the samples around the phase.
#[derive(Clone, Debug)]
pub struct PathClock<const N: usize> {
    rate: Ramp,
    target: f64,
    /// Where between `window[2]` (0) and `window[3]` (1) the path is.
    phase: f64,
    window: [Sample<N>; WINDOW],
}

#[derive(Clone, Copy, Debug)]
struct Sample<const N: usize> {
    seq: u32,
    setpoint: Setpoint<N>,
}

/// What the clock puts out at one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Played<const N: usize> {
    /// The setpoint the path stands at, or has just passed.
    pub seq: u32,
    /// Joint targets (rad or m).
    pub joints: JointPos<N>,
    /// Extrusion rate (m³/s): the mean over this tick, such that what is laid down between two places of the path is the
    /// same at any rate. A setpoint's flow is that of the interval which ends at it.
    pub flow: f64,
    /// Whether material is being laid.
    pub deposit: bool,
}

impl<const N: usize> PathClock<N> {
    /// At rest at `at`, target rate 0.
    pub const fn at_rest(at: JointPos<N>, seq: u32) -> Self {
        let still = Sample { seq, setpoint: Setpoint { joints: at, flow: 0.0, deposit: false } };
        Self { rate: Ramp::at(0.0), target: 0.0, phase: 0.0, window: [still; WINDOW] }
    }

    /// Rate now, 0 to 1.
    pub const fn rate(&self) -> f64 {
        self.rate.value
    }

    /// Sets the rate to reach; false (and no change) when it is not in 0 to 1.
    pub fn set_target(&mut self, target: f64) -> bool {
        let valid = (0.0..=1.0).contains(&target);
        if valid {
            self.target = target;
        }
        valid
    }

    /// Whether the clock stands and is to stand.
    pub fn is_stopped(&self) -> bool {
        self.rate == Ramp::at(0.0) && self.target == 0.0
    }

    /// Whether everything taken from the ring has been played: the path stands.
    pub const fn is_played_out(&self) -> bool {
        let [oldest, .., newest] = &self.window;
        oldest.seq == newest.seq
    }

    /// The newest three samples taken from the ring, newest first: a batch that replaces what follows must join them.
    pub const fn newest_three(&self) -> [JointPos<N>; 3] {
        let [_, _, _, a, b, c] = &self.window;
        [c.setpoint.joints, b.setpoint.joints, a.setpoint.joints]
    }

    /// Advances by one tick of `period` s, which is `samples` sample periods, in (0, 1].
    ///
    /// From a rest the clock is at its target at once: the next setpoints start at rest, their own ramp is the ramp, and they
    /// are put out exactly as they came. That is decided here and not when the target is set, so that a resume which is taken
    /// back before the next tick moves nothing.
    pub fn advance<const CAP: usize>(&mut self, ring: &mut Ring<N, CAP>, period: f64, samples: f64) -> Played<N> {
        if self.is_played_out() && self.phase == 0.0 {
            self.rate = Ramp::at(self.target);
        }
        let mean = self.rate.step(self.target, &RATE_LIMITS, period);
        // The ramp stays between its targets but for rounding, and 0 and 1 are no place for that: nothing is played backwards.
        self.rate.value = self.rate.value.clamp(0.0, 1.0);
        let moved = samples * mean.clamp(0.0, 1.0);
        let phase = self.phase + moved;
        let mut flow = self.next_flow();
        if phase >= 1.0 - PHASE_ROUNDING {
            let (left, over) = (1.0 - self.phase, (phase - 1.0).max(0.0));
            self.shift(ring);
            self.phase = over;
            flow = (left * flow + over * self.next_flow()) / samples;
        } else {
            self.phase = phase;
            flow *= moved / samples;
        }
        if self.is_played_out() && ring.is_empty() {
            // All that is ahead is the same place; a phase kept here would only shift the next batch in time.
            self.phase = 0.0;
        }
        self.played(flow)
    }

    /// How the path moves where the clock is, samples being `sample` s apart: with q(θ) the path over its own time,
    /// q̇ = q′·θ̇ and q̈ = q″·θ̇² + q′·θ̈ (rad/s, rad/s², or m). The derivatives are those of the interpolation.
    #[inline(always)]
    pub fn motion(&self, sample: f64) -> (JointVel<N>, JointAcc<N>) {
        let (mut velocity, mut acceleration) = (JointVel::ZERO, JointAcc::ZERO);
        let Ramp { value: rate, slope } = self.rate;
        let joints = velocity.0.iter_mut().zip(&mut acceleration.0).zip(0..);
        for ((v, a), j) in joints {
            let at = |sample: &Sample<N>| sample.setpoint.joints.0.get(j).copied().unwrap_or(0.0);
            let [q0, q1, q2, q3, q4, q5] = &self.window;
            let [first, second] = slopes([at(q0), at(q1), at(q2), at(q3), at(q4), at(q5)], self.phase);
            let (first, second) = (first / sample, second / (sample * sample));
            *v = first * rate;
            *a = second * rate * rate + first * slope;
        }
        (velocity, acceleration)
    }

    /// Flow of the interval that the phase is in.
    const fn next_flow(&self) -> f64 {
        let [_, _, _, next, ..] = &self.window;
        next.setpoint.flow
    }

    fn shift<const CAP: usize>(&mut self, ring: &mut Ring<N, CAP>) {
        let [_, a, b, c, d, e] = self.window;
        let newest = match ring.consume() {
            Some((seq, setpoint)) => Sample { seq, setpoint },
            // Behind the ring's end the last setpoint stands again.
            None => Sample { setpoint: Setpoint { flow: 0.0, ..e.setpoint }, ..e },
        };
        self.window = [a, b, c, d, e, newest];
    }

    fn played(&self, flow: f64) -> Played<N> {
        let [q0, q1, here, next, q4, q5] = &self.window;
        let (joints, deposit) = if self.phase == 0.0 {
            (here.setpoint.joints, here.setpoint.deposit)
        } else {
            let at = |sample: &Sample<N>, j: usize| sample.setpoint.joints.0.get(j).copied().unwrap_or(0.0);
            let joint = |j| interpolate([q0, q1, here, next, q4, q5].map(|sample| at(sample, j)), self.phase);
            (JointPos(core::array::from_fn(joint)), next.setpoint.deposit)
        };
        Played { seq: here.seq, joints, flow, deposit }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;

    const PERIOD: f64 = 0.002;

    fn moving(len: u32) -> (Ring<1, 1024>, PathClock<1>) {
        let mut ring = Ring::new();
        ring.stage(1, None).unwrap();
        for k in 1..=len {
            let t = f64::from(k) / f64::from(len);
            let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            let flow = 30.0 * t * t * (1.0 - t) * (1.0 - t);
            ring.push(&Setpoint { joints: JointPos([s]), flow, deposit: true }).unwrap();
        }
        ring.commit().unwrap();
        let mut clock = PathClock::at_rest(JointPos([0.0]), 0);
        assert!(clock.set_target(1.0));
        (ring, clock)
    }

    #[test]
    fn at_full_rate_every_setpoint_is_put_out_as_it_came() {
        // 3 and 10 are no powers of two: a third of a sample three times over is still the next sample.
        for ticks in [1, 2, 3, 4, 8, 10] {
            let (mut ring, mut clock) = moving(500);
            let expected: Vec<_> = (1..=500).map(|seq| *ring.get(seq).unwrap()).collect();
            let samples = 1.0 / ticks as f64;
            let played: Vec<_> =
                (0..510 * ticks).map(|_| clock.advance(&mut ring, PERIOD * samples, samples)).collect();
            let first = played.iter().position(|p| p.seq == 1).unwrap();
            for (k, setpoint) in expected.iter().enumerate() {
                let played = played[first + k * ticks];
                assert_eq!((played.seq, played.joints), (k as u32 + 1, setpoint.joints), "{ticks} ticks a sample");
                assert!(played.flow == setpoint.flow || ticks == 3 || ticks == 10);
                assert!((played.flow - setpoint.flow).abs() < 1e-12);
            }
            assert!(clock.is_played_out());
        }
    }

    #[test]
    fn a_stop_takes_less_than_a_second_and_keeps_its_bounds() {
        let (mut ring, mut clock) = moving(1000);
        for _ in 0..300 {
            clock.advance(&mut ring, PERIOD, 1.0);
        }
        assert!(clock.set_target(0.0));
        let mut rates = std::vec![1.0, 1.0];
        let mut ticks = 0;
        while !clock.is_stopped() {
            clock.advance(&mut ring, PERIOD, 1.0);
            rates.push(clock.rate());
            ticks += 1;
            assert!(ticks < 500, "not at rest after a second");
        }
        for w in rates.windows(3) {
            assert!((w[1] - w[2]) / PERIOD <= RATE_SLOPE_MAX * 1.000_001 && w[2] <= w[1]);
            assert!((w[2] - 2.0 * w[1] + w[0]).abs() / (PERIOD * PERIOD) <= RATE_CURVATURE_MAX * 1.000_001, "{w:?}");
        }
    }

    #[test]
    fn whatever_the_targets_are_nothing_is_played_backwards_or_faster_than_planned() {
        let mut seed = 1_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / (1_u64 << 31) as f64
        };
        for period in [0.001, 0.002, 0.004, 0.007, 0.008] {
            let (mut ring, mut clock) = moving(500);
            for _ in 0..20_000 {
                assert!(clock.set_target([0.0, 1.0, random()][(random() * 3.0) as usize]));
                for _ in 0..(random() * random() * 1.5 / period) as usize {
                    let played = clock.advance(&mut ring, period, 1e-6);
                    assert!((0.0..=1.0).contains(&clock.rate()) && played.flow >= 0.0, "{} {played:?}", clock.rate());
                }
            }
        }
    }

    #[test]
    fn the_motion_is_what_differences_of_what_is_put_out_tell() {
        let (mut ring, mut clock) = moving(1000);
        let (mut last, mut fastest) = ([0.0; 2], 0.0_f64);
        // A tenth of a sample each, so that differences are fine; at full rate, then slowing down.
        for k in 0..12_000_u32 {
            assert!(clock.set_target(if k < 5000 { 1.0 } else { 0.2 }));
            let (before, (v, a)) = (last, clock.motion(PERIOD));
            let q = clock.advance(&mut ring, 0.1 * PERIOD, 0.1).joints.0[0];
            if k > 2 {
                let dt = 0.1 * PERIOD;
                let (velocity, acceleration) =
                    ((q - before[1]) / (2.0 * dt), (q - 2.0 * before[0] + before[1]) / (dt * dt));
                assert!((v.0[0] - velocity).abs() < 1e-4, "{k}: {v:?} {velocity}");
                assert!((a.0[0] - acceleration).abs() < 0.02, "{k}: {a:?} {acceleration}");
                fastest = fastest.max(velocity);
            }
            last = [q, before[0]];
        }
        // 15/8 over 2 s.
        assert!((fastest - 0.9375).abs() < 1e-3, "{fastest}");
    }

    #[test]
    fn the_flow_laid_down_up_to_a_place_does_not_depend_on_the_rate() {
        // Volume at each sample of the path, at rates that change all the time.
        let volumes = |samples: f64, target: fn(u32) -> f64| {
            let (mut ring, mut clock) = moving(500);
            let (mut volume, mut tick, mut volumes) = (0.0, 0, Vec::new());
            while !(clock.is_played_out() && ring.is_empty() && tick > 0) {
                assert!(clock.set_target(target(tick)));
                let played = clock.advance(&mut ring, PERIOD * samples, samples);
                // What this tick laid down behind the sample it passed belongs to the next interval.
                let beyond = clock.phase * clock.next_flow() * PERIOD;
                volume += played.flow * PERIOD * samples;
                volumes.resize(played.seq as usize + 1, volume - beyond);
                tick += 1;
            }
            volumes
        };
        let full = volumes(1.0, |_| 1.0);
        let changing = |tick: u32| [0.9, 0.05, 1.0, 0.3][tick as usize / 150 % 4];
        for other in [volumes(1.0, |_| 0.37), volumes(1.0, changing), volumes(0.25, changing), volumes(0.5, |_| 1.0)] {
            assert_eq!(other.len(), 501);
            for (a, b) in full.iter().zip(&other) {
                assert!((a - b).abs() < 1e-12, "{a} and {b}");
            }
        }
        // ∫30 t²(1−t)² dt = 1, over 500 samples of 2 ms: 1 s.
        assert!((full[500] - 1.0).abs() < 1e-5);
    }
}
