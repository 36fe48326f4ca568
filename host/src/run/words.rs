//! Faults and refusals of the kernel in words for a person.

use screed_kernel::control::Bound;
use screed_kernel::fault::{Fault, Unreached};
use screed_kernel::frame::{Refusal, Unsound};
use screed_kernel::guard::Quantity;

/// A fault: its code, its cause, and its figures.
pub fn fault(fault: &Fault) -> String {
    let figures = match *fault {
        Fault::Following { joint, value, limit } => {
            format!(" (joint {}: {value:.4} rad off, {limit:.4} allowed)", joint + 1)
        }
        Fault::Sensor { joint } => format!(" (joint {})", joint + 1),
        Fault::Deviation { joint, value, limit } => {
            format!(" (joint {}: {value:.4} rad off, {limit:.4} allowed)", joint + 1)
        }
        Fault::Output { quantity, joint, value, limit } | Fault::Correction { quantity, joint, value, limit } => {
            format!(" ({})", found(quantity, joint, value, limit))
        }
        Fault::Saturated { bound: Bound::Shift, value, limit } => {
            format!(" ({:.2} mm asked for, {:.2} mm allowed)", value * 1e3, limit * 1e3)
        }
        Fault::Saturated { bound: Bound::Turn, value, limit } => {
            format!(" ({:.3}° asked for, {:.3}° allowed)", value.to_degrees(), limit.to_degrees())
        }
        Fault::Saturated { bound: Bound::Speed, value, limit } => {
            format!(" (behind for {value:.2} s, {limit:.2} s allowed)")
        }
        Fault::Unreachable { reason, value } => format!(" ({})", unreached(reason, value)),
        Fault::Base { axis, value, limit } => {
            let name = ["x", "y", "z"].get(usize::from(axis % 3)).copied().unwrap_or_default();
            match axis {
                0..3 => format!(" (along {name}: {:.2} mm, {:.2} mm allowed)", value * 1e3, limit * 1e3),
                _ => format!(" (about {name}: {:.3}°, {:.3}° allowed)", value.to_degrees(), limit.to_degrees()),
            }
        }
        Fault::Drive { joint, value, limit } => {
            format!(" (joint {}: a lag of {:.1} ms, bound {:.1} ms)", joint + 1, value * 1e3, limit * 1e3)
        }
        Fault::Lead { joint, value, limit } => {
            format!(" (joint {}: {value:.4} rad behind, {limit:.4} allowed)", joint + 1)
        }
        Fault::Tracker { value, limit } => format!(" ({value:.2} s waited, {limit:.2} s allowed)"),
        Fault::Overrun { missed, limit } => format!(" (counter at {limit}, {missed} slots missed)"),
        Fault::RobotNotReady | Fault::Extruder | Fault::Link => String::new(),
    };
    format!("{}: {}{figures}", fault.code(), fault.cause())
}

/// What a person is told to do, without leaving a fault of a kernel that does not stay: there is nothing to re-arm then.
pub fn possible(action: &str, stays: bool) -> &str {
    if stays { action } else { action.strip_suffix("; then re-arm").unwrap_or(action) }
}

/// Why the arm cannot be where it should.
fn unreached(reason: Unreached, value: f64) -> String {
    match reason {
        Unreached::Reach => format!("{:.1} mm out of reach", value * 1e3),
        Unreached::Orientation => format!("{:.3}° from what its wrist can", value.to_degrees()),
        Unreached::Limit => format!("a joint beyond its limits, at {value:.4} rad"),
        Unreached::Singular => "too near to a singularity".to_owned(),
        Unreached::Unsolved => "the inverse kinematics found nothing".to_owned(),
    }
}

/// Why a message was refused.
pub fn refusal(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Mode => "it does not fit what the kernel is doing".to_owned(),
        Refusal::Configuration(what) => format!("the limits are not usable: {}", unsound(*what)),
        Refusal::NoRoom { quantity, joint, value, limit } => format!(
            "the limits for outputs leave no room for the path clock: joint {}, a {} of {value:.4}, at least {limit:.4} needed",
            joint + 1,
            name(*quantity)
        ),
        Refusal::Full => "the ring is full".to_owned(),
        Refusal::TooLate => "what it was to replace has been played".to_owned(),
        Refusal::Sequence => "its numbers do not continue what the ring holds".to_owned(),
        Refusal::Code => "its setpoints cannot be read".to_owned(),
        Refusal::DoesNotFit { seq, quantity, joint, value, limit } => {
            format!("setpoint {seq}: {}", found(*quantity, *joint, *value, *limit))
        }
        Refusal::NotAtRest => "it does not end at rest".to_owned(),
        Refusal::Rate => "the rate is not in 0 to 1".to_owned(),
        Refusal::Stale => "it speaks of a ring or a fault that is no longer there".to_owned(),
    }
}

fn found(quantity: Quantity, joint: u8, value: f64, limit: f64) -> String {
    match quantity {
        Quantity::Finite => format!("joint {}: a value that is no number", joint + 1),
        Quantity::Workspace => format!("{:.2} mm beyond bound {} of the workspace", (value - limit) * 1e3, joint + 1),
        _ => format!("joint {}: a {} of {value:.4}, {limit:.4} allowed", joint + 1, name(quantity)),
    }
}

const fn name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Finite => "value",
        Quantity::Position => "position",
        Quantity::Velocity => "speed",
        Quantity::Acceleration => "acceleration",
        Quantity::Jerk => "jerk",
        Quantity::Workspace => "place",
    }
}

const fn unsound(what: Unsound) -> &'static str {
    match what {
        Unsound::Joints => "a list has not one value a joint",
        Unsound::Periods => "the periods do not fit each other",
        Unsound::Positions => "the joint positions are beyond the arm's, or leave nothing between them",
        Unsound::Motion => "a speed, acceleration or jerk is not positive, or beyond the arm's",
        Unsound::Errors => "a largest error is not positive",
        Unsound::Correction => "the limits of corrections are neither all positive nor all zero",
        Unsound::Tool => "the tool's pose is not finite",
        Unsound::Workspace => "a plane of the workspace has no unit normal",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_re_armed_where_the_kernel_has_ended() {
        for kind in Fault::KINDS {
            assert!(!possible(kind.action(), false).contains("re-arm"), "{kind:?}");
            assert_eq!(possible(kind.action(), true), kind.action());
        }
    }

    #[test]
    fn each_fault_is_told_with_code_cause_and_its_figures_in_a_persons_units() {
        for kind in Fault::KINDS {
            let text = fault(&kind);
            assert!(text.starts_with(&format!("{}: {}", kind.code(), kind.cause())), "{text}");
            assert!(!kind.action().is_empty() && kind.action().len() > 20, "{text}");
        }
        let turn = 0.02_f64.to_radians();
        for (kind, figures) in [
            (
                Fault::Saturated { bound: Bound::Shift, value: 0.0512, limit: 0.05 },
                "(51.20 mm asked for, 50.00 mm allowed)",
            ),
            (Fault::Saturated { bound: Bound::Turn, value: turn, limit: turn }, "(0.020° asked for, 0.020° allowed)"),
            (Fault::Saturated { bound: Bound::Speed, value: 2.004, limit: 2.0 }, "(behind for 2.00 s, 2.00 s allowed)"),
            (Fault::Unreachable { reason: Unreached::Reach, value: 0.0125 }, "(12.5 mm out of reach)"),
            (Fault::Unreachable { reason: Unreached::Singular, value: 0.0 }, "(too near to a singularity)"),
            (Fault::Base { axis: 1, value: -0.03, limit: 0.02 }, "(along y: -30.00 mm, 20.00 mm allowed)"),
            (Fault::Base { axis: 5, value: turn, limit: turn }, "(about z: 0.020°, 0.020° allowed)"),
            (Fault::Drive { joint: 2, value: 0.45, limit: 0.4 }, "(joint 3: a lag of 450.0 ms, bound 400.0 ms)"),
            (Fault::Lead { joint: 0, value: 0.0123, limit: 0.001 }, "(joint 1: 0.0123 rad behind, 0.0010 allowed)"),
            (Fault::Tracker { value: 10.002, limit: 10.0 }, "(10.00 s waited, 10.00 s allowed)"),
        ] {
            assert!(fault(&kind).ends_with(figures), "{}", fault(&kind));
        }
    }
}
