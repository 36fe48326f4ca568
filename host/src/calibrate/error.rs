//! Why a calibration is refused.

use crate::failure::{Exit, Failure};
use nalgebra::Vector3;
use screed_kernel::registration::RegistrationError;

/// Why there is no estimate. Behind the last semicolon of each message stands what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// Not enough measurements.
    #[error("{found} {what} do not determine the result; at least {least} are needed")]
    TooFew {
        /// What there is too little of: "poses", "touches".
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        least: usize,
    },
    /// A number that is none.
    #[error("measurement {} has a number that is not finite; measure it again or leave it out", measurement + 1)]
    NotFinite {
        /// The measurement (0 is the first).
        measurement: usize,
    },
    /// A standard deviation that is none.
    #[error("a standard deviation of {found} cannot be; give one above 0")]
    Noise {
        /// What was given (SI).
        found: f64,
    },
    /// The flange hardly turns.
    #[error(
        "the flange is never turned, so nothing beyond it is determined; add poses turned about two axes by 30° and more"
    )]
    NoTurn,
    /// The flange turns about one axis only.
    #[error(
        "the flange is turned about one axis only ({}), so what lies along it is not determined; add poses turned about another \
         axis by 30° and more",
        direction(axis_in_flange)
    )]
    OneAxis {
        /// The axis, in the flange frame.
        axis_in_flange: Vector3<f64>,
        /// How far the axis itself is turned (root mean square, about rad), less than 0.05.
        swing: f64,
    },
    /// Parameters that the measurements do not determine.
    #[error("the measurements do not determine {}; add poses that move what they leave still", parameters.join(", "))]
    Undetermined {
        /// Their names.
        parameters: Vec<String>,
    },
    /// The iteration did not come to rest.
    #[error(
        "no geometry fits: after {iterations} steps residuals are {noise_ratio:.3e} times the noise; check which joints and which \
         measured pose belong together, and their units"
    )]
    NotConverged {
        /// Steps made.
        iterations: usize,
        /// Size of the residuals in units of the noise.
        noise_ratio: f64,
    },
    /// Point pairs of a right-handed and a left-handed frame.
    #[error(
        "the points fit a mirror image ({:.3} mm rms) far better than any turn ({:.3} mm rms); check the signs of one frame's \
         axes, and whether points are swapped",
        mirrored_rms * 1e3,
        residual_rms * 1e3
    )]
    Mirrored {
        /// What the best turn leaves (m).
        residual_rms: f64,
        /// What the best mirror image leaves (m).
        mirrored_rms: f64,
    },
    /// Point pairs that hold no frame.
    #[error("{}", registration(.0))]
    Registration(RegistrationError),
}

impl From<RegistrationError> for CalibrateError {
    fn from(error: RegistrationError) -> Self {
        Self::Registration(error)
    }
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        Self::told(Exit::Input, error.to_string())
    }
}

fn direction(axis: &Vector3<f64>) -> String {
    format!("{:.2} {:.2} {:.2} in the flange frame", axis.x, axis.y, axis.z)
}

fn registration(error: &RegistrationError) -> String {
    match error {
        RegistrationError::TooFew { found } => {
            format!("{found} pairs of points do not hold a frame; at least 3 are needed, not on a line")
        }
        RegistrationError::Coordinate { pair } => {
            format!("pair {} has a coordinate that is not finite or farther than 1000 km; measure it again", pair + 1)
        }
        RegistrationError::Coincident { spread } => {
            format!("all points are in one place, within {spread:e} m; measure points that are far apart")
        }
        RegistrationError::Collinear { axis_in_outer: axis, lever } => format!(
            "all points lie on a line along {:.2} {:.2} {:.2} (outer frame), within {:.3} mm, so nothing holds the turn about it; add \
             points beside the line",
            axis.x,
            axis.y,
            axis.z,
            lever * 1e3
        ),
        RegistrationError::Ambiguous { .. } => {
            "several turns fit the points equally well; check that both points of each pair are the \
             same, and that both frames are right-handed"
                .to_owned()
        }
    }
}
