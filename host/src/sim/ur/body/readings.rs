//! What the robot tells of its tool and its elbow.

use super::Body;
use nalgebra::{Vector3, Vector6};
use screed_kernel::units::{JointPos, JointVel};

impl Body {
    /// The tool's velocity from the joints' (m/s, rad/s, base frame).
    pub(in crate::sim::ur) fn tool_speed(&self) -> [f64; 6] {
        self.tool_speed_at(&self.servo.q, &self.servo.qd)
    }

    fn tool_speed_at(&self, q: &JointPos<6>, qd: &JointVel<6>) -> [f64; 6] {
        let (base_from_flange, jacobian) = self.arm.jacobian(q);
        let flange = jacobian * Vector6::from(qd.0);
        let lever = (base_from_flange * self.flange_from_tcp).translation - base_from_flange.translation;
        let turning = Vector3::new(flange[3], flange[4], flange[5]);
        let at_tool = Vector3::new(flange[0], flange[1], flange[2]) + turning.cross(&lever);
        [at_tool.x, at_tool.y, at_tool.z, turning.x, turning.y, turning.z]
    }

    /// The tool's acceleration over the last cycle (m/s², rad/s², base frame).
    pub(in crate::sim::ur) fn tool_acceleration(&self) -> [f64; 6] {
        let (q, qd) = &self.before;
        let mut change = self.tool_speed();
        for (change, before) in change.iter_mut().zip(self.tool_speed_at(q, qd)) {
            *change = (*change - before) / self.dt;
        }
        change
    }

    /// What an accelerometer in the tool shows (m/s², the tool's frame): at rest what opposes gravity.
    pub(in crate::sim::ur) fn accelerometer(&self) -> [f64; 3] {
        let [x, y, z, ..] = self.tool_acceleration();
        let felt = Vector3::new(x, y, z) + Vector3::from(self.gravity);
        (self.base_from_tcp().rotation.transpose() * felt).into()
    }

    /// Where the elbow is (m, base frame), and how it moved over the last cycle (m/s).
    pub(in crate::sim::ur) fn elbow(&self) -> ([f64; 3], [f64; 3]) {
        let place = |q| {
            let [_, elbow, ..] = self.arm.frames(q);
            elbow.translation
        };
        let (now, before) = (place(&self.servo.q), place(&self.before.0));
        (now.into(), ((now - before) / self.dt).into())
    }
}
