//! The path clock: plays the ring at 0 to 100 %, jerk-limited, and interpolates between samples, so that slowing down and
//! stopping never leave the path.

use crate::ring::Ring;
use crate::setpoint::Setpoint;
use crate::units::JointPos;

/// How fast the rate may change (1/s): a path speed v gains at most 1.5 v of deceleration from the clock.
pub const RATE_SLOPE_MAX: f64 = 1.5;

/// How fast the rate's slope may change (1/s²). From 100 % to rest takes 1/1.5 + 1.5/6 = 0.92 s.
pub const RATE_CURVATURE_MAX: f64 = 6.0;

/// Rate, phase, and the four samples around the phase.
#[derive(Clone, Debug)]
pub struct PathClock<const N: usize> {
    rate: f64,
    slope: f64,
    target: f64,
    /// Where between `window[1]` (0) and `window[2]` (1) the path is.
    phase: f64,
    window: [Sample<N>; 4],
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
    /// Extrusion rate (m³/s), scaled by the clock's rate.
    pub flow: f64,
    /// Whether material is being laid.
    pub deposit: bool,
}

impl<const N: usize> PathClock<N> {
    /// At rest at `at`, target rate 0.
    pub fn at_rest(at: JointPos<N>, seq: u32) -> Self {
        let still = Sample { seq, setpoint: Setpoint { joints: at, flow: 0.0, deposit: false } };
        Self { rate: 0.0, slope: 0.0, target: 0.0, phase: 0.0, window: [still; 4] }
    }

    /// Rate now, 0 to 1.
    pub const fn rate(&self) -> f64 {
        self.rate
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
        self.rate == 0.0 && self.slope == 0.0 && self.target == 0.0
    }

    /// Whether everything taken from the ring has been played: only repeats of the last setpoint are ahead.
    pub fn is_played_out(&self) -> bool {
        let [_, here, _, newest] = &self.window;
        here.seq == newest.seq
    }

    /// The newest three samples taken from the ring, newest first: a batch that replaces what follows must join them.
    pub fn newest_three(&self) -> [JointPos<N>; 3] {
        let [_, b, c, d] = &self.window;
        [d.setpoint.joints, c.setpoint.joints, b.setpoint.joints]
    }

    /// Advances by one period. `samples` is that period in sample periods, in (0, 1].
    pub fn advance<const CAP: usize>(&mut self, ring: &mut Ring<N, CAP>, period: f64, samples: f64) -> Played<N> {
        let before = self.rate;
        self.step_rate(period);
        self.phase += 0.5 * (before + self.rate) * samples;
        if self.phase >= 1.0 {
            self.phase -= 1.0;
            self.shift(ring);
        }
        if self.is_played_out() && ring.is_empty() {
            // All that is ahead is the same place; a phase kept here would only shift the next batch in time.
            self.phase = 0.0;
        }
        self.played()
    }

    /// Goes to the target rate at once if everything taken has been played: the next setpoints start at rest, their own ramp
    /// is the ramp, and they are put out exactly as they came.
    pub fn start(&mut self) {
        if self.is_played_out() && self.phase == 0.0 {
            self.rate = self.target;
            self.slope = 0.0;
        }
    }

    fn shift<const CAP: usize>(&mut self, ring: &mut Ring<N, CAP>) {
        let newest = match ring.consume() {
            Some((seq, setpoint)) => Sample { seq, setpoint },
            None => {
                // Behind the ring's end the last setpoint stands again.
                let [.., last] = self.window;
                Sample { setpoint: Setpoint { flow: 0.0, ..last.setpoint }, ..last }
            }
        };
        let [_, a, b, c] = self.window;
        self.window = [a, b, c, newest];
    }

    /// One step of a time-optimal approach of the target under bounds on slope and curvature. With the slope running
    /// straight from s to s' over the period h, the new slope is the largest from which braking at curvature c still ends at
    /// the target: s'·h/2 + s'²/(2c) = gap − s·h/2. Near the target this lands exactly.
    fn step_rate(&mut self, period: f64) {
        let gap = self.target - self.rate;
        let step = RATE_CURVATURE_MAX * period;
        if libm::fabs(gap) < 1e-12 && libm::fabs(self.slope) <= step {
            (self.rate, self.slope) = (self.target, 0.0);
            return;
        }
        let ahead = gap - 0.5 * self.slope * period;
        let half = 0.5 * step;
        let braking = libm::sqrt(half * half + 2.0 * RATE_CURVATURE_MAX * libm::fabs(ahead)) - half;
        let wanted = libm::copysign(braking.min(RATE_SLOPE_MAX), ahead);
        let slope = self.slope + (wanted - self.slope).max(-step).min(step);
        self.rate = (self.rate + 0.5 * (self.slope + slope) * period).clamp(0.0, 1.0);
        self.slope = slope;
    }

    fn played(&self) -> Played<N> {
        let [before, here, next, after] = &self.window;
        let t = self.phase;
        let joints = if t == 0.0 {
            here.setpoint.joints
        } else {
            JointPos(core::array::from_fn(|j| {
                let at = |sample: &Sample<N>| sample.setpoint.joints.0.get(j).copied().unwrap_or(f64::NAN);
                interpolate([at(before), at(here), at(next), at(after)], t)
            }))
        };
        let flow = here.setpoint.flow + t * (next.setpoint.flow - here.setpoint.flow);
        Played { seq: here.seq, joints, flow: flow * self.rate, deposit: here.setpoint.deposit }
    }
}

/// Quintic Hermite interpolation between the middle two of four equidistant samples, with velocity and acceleration at both
/// taken from central differences: passes through the samples, continuous to the second derivative.
/// The basis is the usual one (e.g. Biagiotti and Melchiorri, "Trajectory Planning for Automatic Machines and Robots", 2.1.7).
fn interpolate(q: [f64; 4], t: f64) -> f64 {
    let [q0, q1, q2, q3] = q;
    let (v1, v2) = (0.5 * (q2 - q0), 0.5 * (q3 - q1));
    let (a1, a2) = (q2 - 2.0 * q1 + q0, q3 - 2.0 * q2 + q1);
    let step = q2 - q1;
    let c3 = 10.0 * step - 6.0 * v1 - 4.0 * v2 - 1.5 * a1 + 0.5 * a2;
    let c4 = -15.0 * step + 8.0 * v1 + 7.0 * v2 + 1.5 * a1 - a2;
    let c5 = 6.0 * step - 3.0 * (v1 + v2) - 0.5 * (a1 - a2);
    q1 + t * (v1 + t * (0.5 * a1 + t * (c3 + t * (c4 + t * c5))))
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
        let (mut ring, mut clock) = moving(500);
        clock.start();
        let expected: Vec<f64> = (1..=500).map(|seq| ring.get(seq).unwrap().joints.0[0]).collect();
        let played: Vec<_> = (0..510).map(|_| clock.advance(&mut ring, PERIOD, 1.0)).collect();
        let first = played.iter().position(|p| p.seq == 1).unwrap();
        for (k, value) in expected.iter().enumerate() {
            assert_eq!((played[first + k].seq, played[first + k].joints.0[0]), (k as u32 + 1, *value));
        }
        assert!(clock.is_played_out());
    }

    #[test]
    fn a_stop_takes_less_than_a_second_and_keeps_its_bounds() {
        let (mut ring, mut clock) = moving(1000);
        clock.start();
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
            assert!((w[1] - w[2]) / PERIOD <= RATE_SLOPE_MAX * 1.001 && w[2] <= w[1]);
            assert!((w[2] - 2.0 * w[1] + w[0]).abs() / (PERIOD * PERIOD) <= RATE_CURVATURE_MAX * 1.05, "{w:?}");
        }
    }

    #[test]
    fn the_flow_laid_down_does_not_depend_on_the_rate() {
        let volume = |target: f64| {
            let (mut ring, mut clock) = moving(500);
            assert!(clock.set_target(target));
            let mut volume = 0.0;
            while !(clock.is_played_out() && ring.is_empty()) {
                volume += clock.advance(&mut ring, PERIOD, 1.0).flow * PERIOD;
            }
            volume
        };
        // ∫30 t²(1−t)² dt = 1, over 500 samples of 2 ms: 1 s.
        assert!((volume(1.0) - 1.0).abs() < 1e-3 && (volume(0.37) - 1.0).abs() < 1e-3);
    }
}
