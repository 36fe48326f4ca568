//! A model of `servoj`. The controller's real law is not published; this one is a statement of ours, made so that what users
//! measured on real robots comes out: a lag on ramps of the look-ahead time plus some milliseconds of transport, and ringing
//! for a short look-ahead with a low gain.
//!
//! Per joint, with r the target, q the position, K the gain (1/s²) and L the look-ahead time (s):
//!
//! q̈ = K·(r − q − L·q̇)
//!
//! which is a second-order low-pass with natural frequency √K and damping L·√K/2; on a ramp r − q settles at L·ṙ. Around
//! it: two cycles of transport, a limit on acceleration, the arm's limit on speed, and a protective stop on targets that
//! no arm can follow. With the speed slider below 1 the law runs in slowed time: its lag and its highest speed change with
//! the slider. The joints follow the controller's target exactly: target_q and actual_q are the same.

use screed_kernel::units::{JointAcc, JointPos, JointVel};

/// Cycles from a command to its first effect.
pub const TRANSPORT_CYCLES: usize = 2;
/// Highest joint acceleration (rad/s²); not published by the maker, guessed from configuration screens by users.
pub const ACCELERATION_MAX: f64 = 60.0;
/// Deceleration when a program ends or stops asking (rad/s²). A choice of this model.
pub const BRAKING: f64 = 15.0;
/// Targets may run this much faster than the arm before it stops. A choice of this model.
const SPEED_MARGIN: f64 = 1.1;
/// A pause in the targets allows no larger step than this time at full speed (s). A choice of this model.
const STEP_TIME_MAX: f64 = 0.1;
/// Integration steps in a cycle: fine enough that the implicit Euler method's own damping stays under 1 %.
const SUBSTEPS: u32 = 8;

/// One call of `servoj`.
#[derive(Clone, Debug, PartialEq)]
pub struct ServoCommand {
    /// Joint target (rad).
    pub target: [f64; 6],
    /// Until the next target (s).
    pub time: f64,
    /// Look-ahead time L (s).
    pub lookahead: f64,
    /// Gain K (1/s²).
    pub gain: f64,
}

/// A target that the arm refuses.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("protective stop: joint {joint} asked to step {step} rad within {within} s, its limit is {speed_max} rad/s")]
pub struct TargetRefused {
    /// Which joint (0 is the base).
    pub joint: usize,
    /// From the target before, or from where the joint was (rad).
    pub step: f64,
    /// Time for it (s).
    pub within: f64,
    /// The joint's limit (rad/s).
    pub speed_max: f64,
}

/// The six joints.
#[derive(Clone, Debug)]
pub(super) struct Servo {
    dt: f64,
    speed_max: JointVel<6>,
    pub(super) q: JointPos<6>,
    pub(super) qd: JointVel<6>,
    pub(super) qdd: JointAcc<6>,
    /// Commands on their way, oldest first.
    transport: [Option<ServoCommand>; TRANSPORT_CYCLES],
    /// The joints' speeds in slowed time, while the law runs.
    slowed: Option<[f64; 6]>,
    /// The last target accepted and the seconds since it changed.
    last_target: Option<([f64; 6], f64)>,
}

impl Servo {
    pub(super) const fn new(speed_max: JointVel<6>, start: JointPos<6>, dt: f64) -> Self {
        Self {
            dt,
            speed_max,
            q: start,
            qd: JointVel::ZERO,
            qdd: JointAcc::ZERO,
            transport: [const { None }; TRANSPORT_CYCLES],
            slowed: None,
            last_target: None,
        }
    }

    /// Checks and queues what the program asks for in this cycle, and moves the joints by one cycle, in which so much of a
    /// cycle's time passes for them (`pace`, 0 to 1). No command: they brake.
    pub(super) fn step(&mut self, command: Option<ServoCommand>, pace: f64) -> Result<(), TargetRefused> {
        let checked = self.check(command.as_ref());
        let accepted = if checked.is_ok() { command } else { None };
        self.transport.rotate_left(1);
        let effective = match self.transport.last_mut() {
            Some(newest) => std::mem::replace(newest, accepted),
            None => accepted,
        };
        match effective {
            Some(command) if checked.is_ok() => self.follow(&command, pace),
            _ => self.brake(BRAKING),
        }
        checked
    }

    /// Forgets every command and brakes as hard as the model can.
    pub(super) fn freeze(&mut self) {
        self.forget();
        self.brake(ACCELERATION_MAX);
    }

    /// Forgets every command and brakes.
    pub(super) fn stop(&mut self) {
        self.forget();
        self.brake(BRAKING);
    }

    /// Drops commands that are on their way.
    pub(super) fn forget(&mut self) {
        self.transport.fill(None);
        self.last_target = None;
    }

    fn check(&mut self, command: Option<&ServoCommand>) -> Result<(), TargetRefused> {
        let Some(command) = command else {
            self.last_target = None;
            return Ok(());
        };
        let (before, since) = self.last_target.unwrap_or((self.q.0, 0.0));
        let since = since + self.dt;
        if before == command.target {
            self.last_target = Some((before, since));
            return Ok(());
        }
        let within = since.clamp(command.time, STEP_TIME_MAX.max(command.time));
        for (joint, ((target, before), limit)) in command.target.iter().zip(&before).zip(&self.speed_max.0).enumerate()
        {
            let step = target - before;
            // Written so that a step that is not a number fails.
            let followable = step.abs() <= limit * SPEED_MARGIN * within;
            if !followable {
                return Err(TargetRefused { joint, step, within, speed_max: *limit });
            }
        }
        self.last_target = Some((command.target, 0.0));
        Ok(())
    }

    /// Implicit Euler, stable for every gain and look-ahead: with the step's end values q' = q + h·q̇', q̇' = q̇ + h·q̈ in
    /// the law, q̈ = K·(r − q − (h + L)·q̇) / (1 + K·h·(h + L)).
    fn follow(&mut self, command: &ServoCommand, pace: f64) {
        let (gain, lookahead) = (command.gain, command.lookahead);
        let h = self.dt * pace / f64::from(SUBSTEPS);
        let mut slowed =
            self.slowed.unwrap_or_else(|| self.qd.0.map(|speed| if pace > 0.0 { speed / pace } else { 0.0 }));
        for (joint, speed) in slowed.iter_mut().enumerate() {
            let (mut q, mut qd, before) = (self.q.0[joint], *speed, self.qd.0[joint]);
            for _ in 0..SUBSTEPS {
                let wanted = gain * (command.target[joint] - q - (h + lookahead) * qd);
                let qdd = (wanted / (1.0 + gain * h * (h + lookahead))).clamp(-ACCELERATION_MAX, ACCELERATION_MAX);
                qd = (qd + h * qdd).clamp(-self.speed_max.0[joint], self.speed_max.0[joint]);
                q += h * qd;
            }
            *speed = qd;
            let qd = qd * pace;
            (self.q.0[joint], self.qd.0[joint], self.qdd.0[joint]) = (q, qd, (qd - before) / self.dt);
        }
        self.slowed = Some(slowed);
    }

    /// Puts the joints where another model says they are.
    pub(super) fn set(&mut self, joints: [f64; 6], speeds: [f64; 6]) {
        for ((qdd, next), now) in self.qdd.0.iter_mut().zip(speeds).zip(self.qd.0) {
            *qdd = (next - now) / self.dt;
        }
        (self.q.0, self.qd.0, self.slowed) = (joints, speeds, None);
    }

    /// The joints stand still where they are.
    pub(super) fn rest(&mut self) {
        (self.qd, self.qdd, self.slowed) = (JointVel::ZERO, JointAcc::ZERO, None);
    }

    /// One cycle of braking, each joint by itself.
    pub(super) fn brake(&mut self, deceleration: f64) {
        self.slowed = None;
        for joint in 0..6 {
            let before = self.qd.0[joint];
            let qd = before.signum() * (before.abs() - deceleration * self.dt).max(0.0);
            self.q.0[joint] += 0.5 * (before + qd) * self.dt;
            self.qd.0[joint] = qd;
            self.qdd.0[joint] = (qd - before) / self.dt;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_kernel::arms::ur::UR10E;

    const RATED: JointVel<6> = UR10E.velocity_max.known().unwrap();

    const DT: f64 = 0.002;

    fn command(target: f64, lookahead: f64, gain: f64) -> ServoCommand {
        ServoCommand { target: [target; 6], time: DT, lookahead, gain }
    }

    /// The step response against the closed form of a second-order low-pass, x = 1 − e^(−ζωt)·(cos ω_d t + ζω/ω_d·sin ω_d t)
    /// (any textbook of control, for example Ogata, "Modern Control Engineering", 5.3).
    #[test]
    fn a_small_step_is_answered_as_the_stated_law_answers_it() {
        for (lookahead, gain) in [(0.1, 300.0), (0.03, 100.0), (0.03, 2000.0)] {
            let mut servo = Servo::new(RATED, JointPos::ZERO, DT);
            let (natural, damping) = (f64::sqrt(gain), 0.5 * lookahead * f64::sqrt(gain));
            let damped = natural * (1.0 - damping * damping).sqrt();
            let step = 0.003;
            let mut highest: f64 = 0.0;
            for cycle in 1..=1500_u32 {
                servo.step(Some(command(step, lookahead, gain)), 1.0).expect("a small step");
                let t = f64::from(cycle.saturating_sub(TRANSPORT_CYCLES as u32)) * DT;
                let swing = (damped * t).cos() + damping * natural / damped * (damped * t).sin();
                let expected = step * (1.0 - (-damping * natural * t).exp() * swing);
                assert!((servo.q.0[2] - expected).abs() < 0.01 * step, "gain {gain}, {t} s: {}", servo.q.0[2]);
                highest = highest.max(servo.q.0[2] / step);
            }
            if gain == 100.0 {
                // ζ = 0.15: the known ringing of a short look-ahead with a low gain.
                assert!((1.6..1.65).contains(&highest), "{highest}");
            }
        }
    }

    /// Slowed time is the same motion, later.
    #[test]
    fn at_half_the_pace_the_law_takes_twice_as_long() {
        let path = |pace: f64, cycles: usize| {
            let mut servo = Servo::new(RATED, JointPos::ZERO, DT);
            let places = (0..cycles).map(|_| {
                servo.step(Some(command(0.003, 0.1, 300.0)), pace).expect("a small step");
                (servo.q.0[2], servo.qd.0[2])
            });
            places.collect::<Vec<_>>()
        };
        let (full, half) = (path(1.0, 300), path(0.5, 598));
        for (cycle, (q, qd)) in full.iter().enumerate().skip(TRANSPORT_CYCLES) {
            let (late_q, late_qd) = half[TRANSPORT_CYCLES + 2 * (cycle - TRANSPORT_CYCLES) + 1];
            assert!((q - late_q).abs() < 5e-6 && (qd - 2.0 * late_qd).abs() < 1e-4, "cycle {cycle}: {q} and {late_q}");
        }
        let rest = path(0.0, 100);
        assert!(rest.iter().all(|(q, qd)| (*q, *qd) == (0.0, 0.0)));
        // On a ramp it lags by the look-ahead in slowed time.
        let mut servo = Servo::new(RATED, JointPos::ZERO, DT);
        for cycle in 1..=2000_u32 {
            let target = 0.2 * f64::from(cycle) * DT;
            servo.step(Some(command(target, 0.1, 300.0)), 0.5).expect("followable");
            let lag = (target - servo.q.0[0]) / 0.2;
            let expected = 0.1 / 0.5 + TRANSPORT_CYCLES as f64 * DT;
            assert!(cycle < 1500 || (lag - expected).abs() < DT, "{lag} s, expected {expected} s");
        }
    }

    #[test]
    fn acceleration_and_speed_stay_within_the_limits() {
        let mut servo = Servo::new(RATED, JointPos::ZERO, DT);
        let mut speed = [0.0; 6];
        let mut reached: f64 = 0.0;
        for cycle in 1..=1000_u32 {
            // The arm's speed in joints 3 to 6, nearly the margin's too much in joints 1 and 2.
            let target = f64::from(cycle) * DT * 2.2;
            servo.step(Some(command(target, 0.03, 2000.0)), 1.0).expect("just followable");
            for ((now, before), limit) in servo.qd.0.iter().zip(&speed).zip(&RATED.0) {
                assert!((now - before).abs() <= ACCELERATION_MAX * DT * (1.0 + 1e-9));
                assert!(now.abs() <= *limit);
            }
            speed = servo.qd.0;
            reached = reached.max(speed[0]);
        }
        assert_eq!(reached, RATED.0[0]);
        let cycles = (0..).take_while(|_| {
            servo.stop();
            servo.qd.0[0] != 0.0
        });
        let expected = RATED.0[0] / BRAKING / DT;
        assert!((cycles.count() as f64 - expected).abs() < 1.0);
    }

    #[test]
    fn what_no_arm_can_follow_is_refused() {
        let refused = |targets: &[f64]| {
            let mut servo = Servo::new(RATED, JointPos::ZERO, DT);
            targets.iter().find_map(|target| servo.step(Some(command(*target, 0.1, 300.0)), 1.0).err())
        };
        assert_eq!(refused(&[0.004, 0.008, 0.012]), None);
        assert!(refused(&[0.004, 0.008, 0.02]).is_some());
        assert!(refused(&[f64::NAN]).is_some());
        assert!(refused(&[f64::INFINITY]).is_some());
        // A long pause allows a longer step, but not any.
        let paused = |step| {
            let mut targets = vec![0.001; 500];
            targets.push(0.001 + step);
            refused(&targets)
        };
        assert_eq!(paused(0.2), None);
        assert!(paused(0.25).is_some());
    }
}
