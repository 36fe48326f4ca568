//! The sections of a cell file that are about leading and correcting: [lead], and with a tracker [tracker], [shift], [swing], [estimator] and
//! [control] with a section for each process. Together they are all that the kernel's loop is made of.

use super::keys;
use super::read::{Document, Section};
use super::{Lead, Link, Tracked};
use nalgebra::Vector3;
use screed_kernel::base::swing::{Swing, SwingMode};
use screed_kernel::base::{BaseConfig, BaseLimits, Drift};
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::State;
use screed_kernel::estimator::EstimatorConfig;
use screed_kernel::pid::{ByProcess, Gains, Process};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointPos, JointVel};

/// The sections that come with a tracker, all of them or none; of these only [swing] may be left out.
pub(super) const TRACKED: [&str; 8] =
    ["tracker", "shift", "swing", "estimator", "control", "control_deposit", "control_travel", "control_mill"];

/// May be left out where there is no tracker; then nothing is led. The drive that is assumed is by default what servoj is told to be.
pub(super) fn lead(document: &mut Document<'_>, link: Option<&Link>) -> Option<Option<Lead>> {
    if !document.has("lead") && !is_tracked(document) {
        return Some(None);
    }
    let mut section = document.section("lead");
    let limits = [&keys::LEAD_SIZE, &keys::LEAD_VELOCITY, &keys::LEAD_ACCELERATION].map(|key| section.number(key));
    let dead_time = section.number(&keys::DEAD_TIME);
    let patience = section.number_or(&keys::PATIENCE, Lead::PATIENCE);
    // Where the link is wrong, that is reported there.
    let [lookahead, gain] = link.map_or([0.1, 300.0], |link| [link.servoj_lookahead, link.servoj_gain]);
    let usual = Lead::of(CorrectionLimits::NONE, 0.0, [lookahead, gain]);
    let Learning { filter_time, velocity_min, memory, noise, adoption, .. } = usual.learning;
    let lag = [(&keys::LAG, lookahead), (&keys::LAG_MIN, Lead::LAG[0]), (&keys::LAG_MAX, Lead::LAG[1])]
        .map(|(key, default)| section.number_or(key, default));
    let gain =
        [(&keys::DRIVE_GAIN, gain), (&keys::DRIVE_GAIN_MIN, Lead::GAIN[0]), (&keys::DRIVE_GAIN_MAX, Lead::GAIN[1])]
            .map(|(key, default)| section.number_or(key, default));
    between(&mut section, &keys::LAG, lag, 1e3);
    between(&mut section, &keys::DRIVE_GAIN, gain, 1.0);
    let filter_time = section.number_or(&keys::FILTER_TIME, filter_time);
    let velocity_min = section.number_or(&keys::LEARN_ABOVE, velocity_min);
    let memory = section.number_or(&keys::LEARN_MEMORY, memory);
    let noise = section.number_or(&keys::LEARN_NOISE, noise);
    let adoption = section.number_or(&keys::LEARN_ADOPTION, adoption);
    section.finish();
    let ([size_max, velocity_max, acceleration_max], [lag, lag_min, lag_max], [gain, gain_min, gain_max]) =
        (limits, lag, gain);
    Some(Some(Lead {
        limits: CorrectionLimits {
            size_max: size_max?,
            velocity_max: velocity_max?,
            acceleration_max: acceleration_max?,
        },
        patience: patience?,
        drive: Drive { lag: lag?, inverse_gain: 1.0 / gain? },
        learning: Learning {
            lag: [lag_min?, lag_max?],
            inverse_gain: [1.0 / gain_max?, 1.0 / gain_min?],
            dead_time: dead_time?,
            filter_time: filter_time?,
            velocity_min: velocity_min?,
            memory: memory?,
            noise: noise?,
            adoption: adoption?,
        },
    }))
}

fn is_tracked(document: &Document<'_>) -> bool {
    TRACKED.iter().any(|name| document.has(name))
}

/// The value lies between its bounds, and these are in order; `scale` makes the key's unit of SI.
fn between(
    section: &mut Section<'_, '_>,
    key: &'static keys::Number,
    [value, low, high]: [Option<f64>; 3],
    scale: f64,
) {
    if let (Some(value), Some(low), Some(high)) = (value, low, high)
        && !(low < high && (low..=high).contains(&value))
    {
        let expected = format!("a number between its bounds, here {} and {}", low * scale, high * scale);
        section.impossible::<()>(key.name, &expected, &format!("{}", value * scale));
    }
}

/// Where any of its sections is there, all are read.
pub(super) fn tracked(
    document: &mut Document<'_>,
    flange_from_tcp: Option<Pose>,
    link: Option<&Link>,
) -> Option<Option<Tracked>> {
    if !is_tracked(document) {
        return Some(None);
    }
    let base = base(document, link);
    let estimator = estimator(document, base);
    let (works, dead_time) = control(document);
    let [deposit, travel, mill] =
        ["control_deposit", "control_travel", "control_mill"].map(|name| process(document, name));
    let (deposit, travel, mill) = (deposit?, travel?, mill?);
    let settings = Settings {
        gains: ByProcess { deposit: deposit.0, travel: travel.0, mill: mill.0 },
        bounds: ByProcess { deposit: deposit.1, travel: travel.1, mill: mill.1 },
        works: works?,
        flange_from_tcp: flange_from_tcp?,
        dead_time: dead_time?,
    };
    Some(Some(Tracked { estimator: estimator?, settings }))
}

/// Where tracker and target are, and how the base moves.
fn base(document: &mut Document<'_>, link: Option<&Link>) -> Option<BaseConfig> {
    let (tracker, shift, swing) = (tracker(document), shift(document), swing(document));
    let (tracker, (pivot, drift, limits)) = (tracker?, shift?);
    Some(BaseConfig {
        tracker_from_nominal: tracker.from_base,
        flange_from_target: tracker.flange_from_target,
        pivot,
        drift,
        swing: swing?,
        hold: tracker.hold,
        agreeing: tracker.agreeing,
        limits,
        period: 1.0 / f64::from(link?.rate_hz),
    })
}

/// How tracker and target are mounted, and how far the tracker is trusted.
struct Tracker {
    from_base: Pose,
    flange_from_target: Pose,
    hold: f64,
    agreeing: u32,
}

fn tracker(document: &mut Document<'_>) -> Option<Tracker> {
    let mut section = document.section("tracker");
    let base = [section.numbers(&keys::XYZ), section.numbers(&keys::RPY)];
    let target = [section.numbers(&keys::TARGET_XYZ), section.numbers(&keys::TARGET_RPY)];
    let hold = section.number(&keys::HOLD);
    let agreeing = section.integer_or("agreeing", 2..=1000, 20);
    section.finish();
    let pose = |[xyz, rpy]: [Option<[f64; 3]>; 2]| {
        let [roll, pitch, yaw] = rpy?;
        Some(Pose::from_roll_pitch_yaw(Vector3::from(xyz?), roll, pitch, yaw))
    };
    Some(Tracker {
        from_base: pose(base)?,
        flange_from_target: pose(target)?,
        hold: hold?,
        agreeing: u32::try_from(agreeing?).ok()?,
    })
}

fn shift(document: &mut Document<'_>) -> Option<(Vector3<f64>, Drift, BaseLimits)> {
    let mut section = document.section("shift");
    let pivot = section.numbers(&keys::PIVOT);
    let drift = [&keys::DRIFT_SPEED, &keys::DRIFT_TURN, &keys::DRIFT_TIME].map(|key| section.number(key));
    let translation = [&keys::TRANSLATION, &keys::VELOCITY, &keys::ACCELERATION].map(|key| section.number(key));
    let rotation = [&keys::ROTATION, &keys::TURN_RATE, &keys::TURN_ACCELERATION].map(|key| section.number(key));
    section.finish();
    let [speed, turn_rate, time] = drift;
    let [translation_max, velocity_max, acceleration_max] = translation;
    let [rotation_max, turn_rate_max, turn_acceleration_max] = rotation;
    let limits = BaseLimits {
        translation_max: translation_max?,
        velocity_max: velocity_max?,
        acceleration_max: acceleration_max?,
        rotation_max: rotation_max?,
        turn_rate_max: turn_rate_max?,
        turn_acceleration_max: turn_acceleration_max?,
    };
    Some((Vector3::from(pivot?), Drift { speed: speed?, turn_rate: turn_rate?, time: time? }, limits))
}

/// Without the section the base does not swing.
fn swing(document: &mut Document<'_>) -> Option<Swing> {
    if !document.has("swing") {
        return Some(Swing::NONE);
    }
    let mut section = document.section("swing");
    let centre = section.numbers(&keys::CENTRE);
    let [frequency, damping] = [&keys::FREQUENCY, &keys::DAMPING].map(|key| section.numbers::<6>(key));
    let deviations = [&keys::SWING_SHIFT, &keys::SWING_TURN].map(|key| section.numbers::<3>(key));
    section.finish();
    let [[x, y, z], [about_x, about_y, about_z]] = [deviations[0]?, deviations[1]?];
    let (frequency, damping, deviation) = (frequency?, damping?, [x, y, z, about_x, about_y, about_z]);
    let mode = |k| SwingMode { frequency: frequency[k], damping: damping[k], deviation: deviation[k] };
    Some(Swing { centre: Vector3::from(centre?), modes: std::array::from_fn(mode) })
}

fn estimator(document: &mut Document<'_>, base: Option<BaseConfig>) -> Option<EstimatorConfig<6>> {
    let mut section = document.section("estimator");
    let jerk_density = section.numbers(&keys::JERK_DENSITY);
    let [encoder, joint] = [&keys::ENCODER_DEVIATION, &keys::JOINT_DEVIATION].map(|key| section.numbers(key));
    let rate = section.numbers(&keys::RATE_DEVIATION);
    let start =
        [&keys::START_POSITION, &keys::START_VELOCITY, &keys::START_ACCELERATION].map(|key| section.numbers(key));
    let mut dead_time = section.number(&keys::DEAD_TIME);
    if let (Some(base), Some(late)) = (&base, dead_time)
        && late >= base.hold
    {
        let expected = format!("less than `hold_ms` of [tracker], here {}", base.hold * 1e3);
        dead_time = section.impossible(keys::DEAD_TIME.name, &expected, &format!("{}", late * 1e3));
    }
    section.finish();
    let [position, velocity, acceleration] = start;
    Some(EstimatorConfig {
        base: base?,
        jerk_density: jerk_density?,
        encoder_deviation: JointPos(encoder?),
        joint_deviation: JointPos(joint?),
        rate_deviation: JointVel(rate?),
        start_deviation: State {
            position: JointPos(position?),
            velocity: JointVel(velocity?),
            acceleration: JointAcc(acceleration?),
        },
        dead_time: dead_time?,
    })
}

fn control(document: &mut Document<'_>) -> (Option<Process>, Option<f64>) {
    let mut section = document.section("control");
    let works = match section.text("works") {
        Some("deposit") => Some(Process::Deposit),
        Some("mill") => Some(Process::Mill),
        Some(other) => section.impossible("works", "\"deposit\" or \"mill\"", &format!("{other:?}")),
        None => None,
    };
    let dead_time = section.number(&keys::DEAD_TIME);
    section.finish();
    (works, dead_time)
}

/// Gains of the joints, and bounds at the tool.
fn process(document: &mut Document<'_>, name: &'static str) -> Option<([Gains; 6], Bounds)> {
    let mut section = document.section(name);
    let [proportional, integral, derivative] =
        [&keys::PROPORTIONAL, &keys::INTEGRAL, &keys::DERIVATIVE].map(|key| section.numbers::<6>(key));
    let [filter_time, tracking_time] = [&keys::FILTER_TIME, &keys::TRACKING_TIME].map(|key| section.number(key));
    let shift = [&keys::SHIFT, &keys::SHIFT_SPEED, &keys::SHIFT_ACCELERATION].map(|key| section.number(key));
    let turn = [&keys::TURN, &keys::TURN_SPEED, &keys::TURN_ACCELERATION].map(|key| section.number(key));
    let patience = section.number(&keys::PATIENCE);
    section.finish();
    let (proportional, integral, derivative) = (proportional?, integral?, derivative?);
    let (filter_time, tracking_time) = (filter_time?, tracking_time?);
    let gains = std::array::from_fn(|joint| Gains {
        proportional: proportional[joint],
        integral: integral[joint],
        derivative: derivative[joint],
        filter_time,
        tracking_time,
    });
    let ([shift_max, shift_speed_max, shift_acceleration_max], [turn_max, turn_speed_max, turn_acceleration_max]) =
        (shift, turn);
    let bounds = Bounds {
        shift_max: shift_max?,
        turn_max: turn_max?,
        shift_speed_max: shift_speed_max?,
        shift_acceleration_max: shift_acceleration_max?,
        turn_speed_max: turn_speed_max?,
        turn_acceleration_max: turn_acceleration_max?,
        patience: patience?,
    };
    Some((gains, bounds))
}

#[cfg(test)]
mod tests;
