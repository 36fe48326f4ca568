//! One joint: a second-order drive, backlash behind it, and a link on a spring behind that.

use super::params::JointParams;
use super::{SUBSTEP, mode::Mode};

/// Where it is.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    /// q̈ = K·(r − q) − K·L·q̇ of the drive.
    drive: Mode,
    /// The link beside the far side of the backlash: ë = −ω²·e − 2ζω·ė − (that side's acceleration) + ω²·compliance·moment.
    link: Mode,
    gain: f64,
    stiffness_gain: f64,
    half_play: f64,
    /// Far side of the backlash (rad), and its mean speed over the last substep (rad/s).
    far: f64,
    far_speed: f64,
}

impl Joint {
    /// At rest there under this moment, in the middle of its backlash.
    pub fn new(params: &JointParams, position: f64, moment: f64) -> Self {
        let JointParams { gain, look_ahead, elastic_frequency, elastic_damping, compliance, play } = *params;
        let frequency = libm::sqrt(gain);
        Self {
            drive: Mode::at(frequency, 0.5 * look_ahead * frequency, position),
            link: Mode::at(elastic_frequency, elastic_damping, compliance * moment),
            gain,
            stiffness_gain: elastic_frequency * elastic_frequency * compliance,
            half_play: 0.5 * play,
            far: position,
            far_speed: 0.0,
        }
    }

    /// One substep with this reference (rad) and moment on the link (N·m).
    pub fn step(&mut self, reference: f64, moment: f64) {
        self.drive.step(self.gain * reference);
        let far = self.far.max(self.drive.value - self.half_play).min(self.drive.value + self.half_play);
        let speed = (far - self.far) / SUBSTEP;
        let acceleration = (speed - self.far_speed) / SUBSTEP;
        (self.far, self.far_speed) = (far, speed);
        self.link.step(self.stiffness_gain * moment - acceleration);
    }

    /// What an encoder sees (rad).
    pub const fn motor(&self) -> f64 {
        self.drive.value
    }

    /// rad/s
    pub const fn motor_rate(&self) -> f64 {
        self.drive.rate
    }

    /// Where the link is (rad).
    pub fn link(&self) -> f64 {
        self.far + self.link.value
    }

    /// rad/s
    pub fn link_rate(&self) -> f64 {
        self.far_speed + self.link.rate
    }
}
