//! Faults and refusals of the kernel in words for a person.

use screed_kernel::fault::Fault;
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
        Fault::Overrun { missed, limit } => format!(" (counter at {limit}, {missed} slots missed)"),
        Fault::RobotNotReady | Fault::Extruder => String::new(),
    };
    format!("{}: {}{figures}", fault.code(), fault.cause())
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
