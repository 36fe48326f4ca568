//! Faults and refusals of the kernel in words for a person.

use screed_kernel::fault::Fault;
use screed_kernel::frame::Refusal;
use screed_kernel::guard::Quantity;

/// A fault: its code, its cause, and its figures.
pub fn fault(fault: &Fault) -> String {
    let figures = match *fault {
        Fault::Following { joint, value, limit } => {
            format!(" (joint {}: {value:.4} rad off, {limit:.4} allowed)", joint + 1)
        }
        Fault::Sensor { joint } => format!(" (joint {})", joint + 1),
        Fault::Output { joint, value, limit } => format!(" (joint {}: {value:.4}, {limit:.4} allowed)", joint + 1),
        Fault::RobotNotReady | Fault::Extruder => String::new(),
    };
    format!("{}: {}{figures}", fault.code(), fault.cause())
}

/// Why a message was refused.
pub fn refusal(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Mode => "it does not fit what the kernel is doing".to_owned(),
        Refusal::Configuration => "the limits are not usable".to_owned(),
        Refusal::Full => "the ring is full".to_owned(),
        Refusal::TooLate => "what it was to replace has been played".to_owned(),
        Refusal::Sequence => "its numbers do not continue what the ring holds".to_owned(),
        Refusal::Code => "its setpoints cannot be read".to_owned(),
        Refusal::DoesNotFit { seq, quantity, joint, value, limit } => format!(
            "setpoint {seq}, joint {}: a {} of {value:.4}, {limit:.4} allowed",
            joint + 1,
            match quantity {
                Quantity::Finite => "value that is no number",
                Quantity::Position => "position",
                Quantity::Velocity => "speed",
                Quantity::Acceleration => "acceleration",
                Quantity::Jerk => "jerk",
            }
        ),
        Refusal::NotAtRest => "it does not end at rest".to_owned(),
        Refusal::Rate => "the rate is not in 0 to 1".to_owned(),
        Refusal::Stale => "it speaks of a ring or a fault that is no longer there".to_owned(),
    }
}
