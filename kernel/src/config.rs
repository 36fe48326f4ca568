//! A [`Configure`] that has been found sound, in the forms that a tick needs.

use crate::arm::Arm;
use crate::correction::CorrectionLimits;
use crate::frame::{Configure, Refusal, Unsound};
use crate::guard::{Limits, Motion, Periods, Quantity, Workspace, output_least, plan_limits};
use crate::pose::Pose;
use nalgebra::Vector3;

/// Limits, periods, tool and workspace of an arm with N joints.
#[derive(Clone, Debug)]
pub struct Config<const N: usize> {
    /// For setpoints, at the sample period.
    pub plan: Limits<N>,
    /// For outputs, at the tick period.
    pub output: Limits<N>,
    /// Time between setpoints and between ticks.
    pub periods: Periods,
    /// Time between ticks (ns).
    pub tick_period_ns: u64,
    /// Farthest that an actual joint may be from its target (rad or m).
    pub following_error_max: f64,
    /// Farthest that an estimated joint may be from its target (rad or m).
    pub deviation_max: f64,
    /// For corrections, at the tick period.
    pub correction: CorrectionLimits,
    /// The tool.
    pub flange_from_tcp: Pose,
    /// Where the tool may be.
    pub workspace: Workspace,
}

/// Most ticks in a sample period.
const TICKS_MAX: u64 = 100;

/// Least and greatest tick period (ns).
const TICK_PERIODS_NS: core::ops::RangeInclusive<u64> = 100_000..=100_000_000;

/// How far a tool may reach from the flange (m) and be turned (rad): as far as a joint may. Within it no product with a plane's
/// normal overflows, so that what a workspace refuses is always a number.
const TOOL_MAX: f64 = 1024.0;

/// How far a plane's normal may be from length 1.
const NORMAL_ROUNDING: f64 = 1e-9;

/// What least output limits may differ by when another machine rounds otherwise.
const SUM_ROUNDING: f64 = 1e-9;

impl<const N: usize> Config<N> {
    /// Checks a configuration for an arm.
    ///
    /// # Errors
    /// [`Refusal::Configuration`] or [`Refusal::NoRoom`].
    pub fn new(configure: &Configure, arm: &Arm<N>) -> Result<Self, Refusal> {
        let unsound = |what| move || Refusal::Configuration(what);
        let sound = |sound: bool, what| if sound { Ok(()) } else { Err(Refusal::Configuration(what)) };
        let periods = periods(configure).ok_or_else(unsound(Unsound::Periods))?;
        let [position_min, position_max] = configure.positions::<N>().ok_or_else(unsound(Unsound::Joints))?;
        let plan = configure.plan.motion::<N>().ok_or_else(unsound(Unsound::Joints))?;
        let motion = configure.output.motion::<N>().ok_or_else(unsound(Unsound::Joints))?;
        sound(is_positive(&plan) && is_positive(&motion), Unsound::Motion)?;
        let within = |value: &f64, limit: &f64| value <= limit;
        let speeds = arm.velocity_max.known().map(|rated| plan.velocity_max.0.into_iter().zip(rated.0));
        sound(speeds.into_iter().flatten().all(|(v, rated)| v <= rated), Unsound::Motion)?;
        let errors = [configure.following_error_max, configure.deviation_max];
        sound(errors.iter().all(positive), Unsound::Errors)?;
        let correction = configure.correction;
        sound(correction.is_valid(), Unsound::Correction)?;
        let output = Limits { position_min, position_max, motion };
        let inside = plan_limits(&output, &plan, periods, &correction);
        let arms = arm.position_min.0.iter().zip(&arm.position_max.0);
        let low_high = position_min.0.iter().zip(&position_max.0).zip(arms);
        let inner = inside.position_min.0.iter().zip(&inside.position_max.0);
        // An arm's own may be infinite, for a joint that turns without end.
        sound(position_min.is_finite() && position_max.is_finite(), Unsound::Positions)?;
        sound(
            low_high.into_iter().all(|((low, high), (least, most))| within(least, low) && within(high, most))
                && inner.into_iter().all(|(low, high)| low < high),
            Unsound::Positions,
        )?;
        has_room(&motion, &output_least(&plan, periods, &correction))?;
        sound(configure.flange_from_tcp.iter().all(|value| within(&libm::fabs(*value), &TOOL_MAX)), Unsound::Tool)?;
        let [x, y, z, rx, ry, rz] = configure.flange_from_tcp;
        let flange_from_tcp = Pose::from_rotation_vector(Vector3::new(x, y, z), Vector3::new(rx, ry, rz));
        let planes = configure.workspace.clone();
        sound(
            planes.iter().all(|plane| {
                let length = Vector3::from(plane.normal_in_base).norm();
                plane.offset.is_finite() && within(&libm::fabs(length - 1.0), &NORMAL_ROUNDING)
            }),
            Unsound::Workspace,
        )?;
        Ok(Self {
            plan: inside,
            output,
            periods,
            tick_period_ns: configure.tick_period_ns,
            following_error_max: configure.following_error_max,
            deviation_max: configure.deviation_max,
            correction,
            flange_from_tcp,
            workspace: Workspace { tcp_in_flange: flange_from_tcp.translation, planes },
        })
    }
}

fn periods(configure: &Configure) -> Option<Periods> {
    let (sample, tick) = (configure.sample_period_ns, configure.tick_period_ns);
    let sound =
        TICK_PERIODS_NS.contains(&tick) && sample.is_multiple_of(tick) && (1..=TICKS_MAX).contains(&(sample / tick));
    sound.then_some(Periods { sample: sample as f64 * 1e-9, tick: tick as f64 * 1e-9 })
}

fn positive(value: &f64) -> bool {
    value.is_finite() && *value > 0.0
}

fn is_positive<const N: usize>(motion: &Motion<N>) -> bool {
    let all = motion.velocity_max.0.iter().chain(&motion.acceleration_max.0).chain(&motion.jerk_max.0);
    all.into_iter().all(positive)
}

/// Whether every limit of `given` is at least `least`.
fn has_room<const N: usize>(given: &Motion<N>, least: &Motion<N>) -> Result<(), Refusal> {
    for (quantity, given, least) in [
        (Quantity::Velocity, &given.velocity_max.0, &least.velocity_max.0),
        (Quantity::Acceleration, &given.acceleration_max.0, &least.acceleration_max.0),
        (Quantity::Jerk, &given.jerk_max.0, &least.jerk_max.0),
    ] {
        let short = given.iter().zip(least).position(|(given, least)| *given < least * (1.0 - SUM_ROUNDING));
        if let Some(joint) = short {
            let at = |values: &[f64; N]| values.get(joint).copied().unwrap_or(0.0);
            return Err(Refusal::NoRoom { quantity, joint: joint as u8, value: at(given), limit: at(least) });
        }
    }
    Ok(())
}
