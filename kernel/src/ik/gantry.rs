//! Closed-form inverse kinematics of gantries: three slides in independent directions carry a nozzle that turns about one axis.
//!
//! The orientation gives the turn, and what is left of the position the slides. The turn is one joint on a circle: between
//! stops at ±360° every orientation has two or three positions ([`super::turns`] lists them), and the answer is the one
//! nearest to the seed. There are no branches and no singularities.

use super::{Answer, Branches, IkError, check, turned};
use crate::arm::{Arm, Jacobian, JointKind};
use crate::pose::Pose;
use crate::units::JointPos;
use nalgebra::{Matrix3, Vector3};

/// How far (rad) the turning axis may lean in the pose: more than rounding is an orientation that the gantry cannot give.
pub const LEAN_TOLERANCE: f64 = 1e-12;
/// The least volume that the unit vectors along the slides may span.
const VOLUME_MIN: f64 = 1e-3;

/// What a table says of a gantry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Direction of each slide in the base frame.
    slides: [Vector3<f64>; 3],
    /// Direction of the turning axis in the base frame.
    axis: Vector3<f64>,
    /// The flange's axes in the base frame with the nozzle at zero.
    base_from_flange: Matrix3<f64>,
}

impl Geometry {
    /// The geometry of an arm with four joints: three slides, then one that turns. `None` for any other, and if the slides
    /// lie close to one plane.
    pub fn of<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let kinds = arm.joints.map(|joint| joint.kind);
        let [JointKind::Prismatic, JointKind::Prismatic, JointKind::Prismatic, JointKind::Revolute] = kinds.as_slice()
        else {
            return None;
        };
        let (flange, jacobian) = arm.jacobian(&JointPos::ZERO);
        let [x, y, z, turn] = [0, 1, 2, 3].map(|joint| column(&jacobian, joint));
        // A coupling that makes a slide turn the nozzle is another machine.
        let turns = [x, y, z].iter().any(|(_, angular)| *angular != Vector3::zeros());
        let volume = x.0.dot(&y.0.cross(&z.0));
        if turns || libm::fabs(volume) < VOLUME_MIN {
            return None;
        }
        Some(Self { slides: [x.0, y.0, z.0], axis: turn.1, base_from_flange: flange.rotation })
    }

    /// As the free function [`nearest`], for a caller that keeps the geometry.
    ///
    /// # Errors
    /// As [`nearest`].
    pub fn nearest<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, IkError> {
        check(base_from_flange, seed)?;
        // From the nozzle's zero to the pose: a turn about the axis, or the gantry cannot give it.
        let turn = base_from_flange.rotation * self.base_from_flange.transpose();
        let leant = turn * self.axis;
        let along = self.axis.dot(&leant);
        let by = libm::atan2(self.axis.cross(&leant).norm(), along);
        if by > LEAN_TOLERANCE {
            return Err(IkError::Orientation { by });
        }
        let skew = Vector3::new(turn[(2, 1)] - turn[(1, 2)], turn[(0, 2)] - turn[(2, 0)], turn[(1, 0)] - turn[(0, 1)]);
        let angle = libm::atan2(self.axis.dot(&skew), turn.trace() - along);
        let mut joints = JointPos::ZERO;
        if let Some(nozzle) = joints.0.get_mut(3) {
            *nozzle = angle;
        }
        let missing = base_from_flange.translation - arm.forward(&joints).translation;
        // Cramer's rule.
        let [x, y, z] = &self.slides;
        let products = [y.cross(z), z.cross(x), x.cross(y)];
        let volume = x.dot(&products[0]);
        for (position, product) in joints.0.iter_mut().zip(&products) {
            *position = missing.dot(product) / volume;
        }
        match turned(arm, &joints, seed) {
            Ok(joints) => Ok(Answer { joints, branch: None, margins: None, free: None }),
            Err(beyond) => Err(IkError::Limit { joint: beyond.joint, position: beyond.position }),
        }
    }
}

/// The one answer, as a list: a gantry has no branches.
///
/// # Errors
/// As [`nearest`].
pub fn inverse<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Branches<N>, IkError> {
    nearest(arm, base_from_flange, seed).map(Branches::one)
}

/// The answer, its turn nearest to the seed inside the stops.
///
/// # Errors
/// [`IkError::OtherShape`] when [`Geometry::of`] knows no geometry; [`IkError::Orientation`] when the pose leans the turning
/// axis; [`IkError::Limit`] when a slide or the nozzle would have to go beyond its limits; a pose or seed that is not finite
/// or no rotation.
pub fn nearest<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Answer<N>, IkError> {
    Geometry::of(arm).ok_or(IkError::OtherShape)?.nearest(arm, base_from_flange, seed)
}

/// How the flange moves and turns with a joint; nothing where there is no such joint.
fn column<const N: usize>(jacobian: &Jacobian<N>, joint: usize) -> (Vector3<f64>, Vector3<f64>) {
    let [x, y, z, turn_x, turn_y, turn_z] = jacobian.data.0.get(joint).copied().unwrap_or_default();
    (Vector3::new(x, y, z), Vector3::new(turn_x, turn_y, turn_z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::{Coupling, Dh, Joint};
    use crate::arms::{gantry::CONTOUR_CRAFTER, ur::UR10E};
    use crate::ik::turns;
    use core::f64::consts::PI;

    fn turn(a: f64, k: usize) -> f64 {
        a * libm::sin(7.0 * k as f64)
    }

    /// A gantry whose slides are not square to each other, whose nozzle leans and stands beside its axis, and one of whose
    /// slides moves another.
    fn crooked() -> Arm<4> {
        let row = |k: usize| {
            let (sin_alpha, cos_alpha) = libm::sincos(1.1 + 0.2 * k as f64);
            Dh { theta: 0.7 + 0.3 * k as f64, d: 0.1, a: 0.2, sin_alpha, cos_alpha }
        };
        let mut joints = CONTOUR_CRAFTER.joints;
        joints[2].coupling = Some(Coupling { joint: 0, factor: 0.3 });
        let flange = Pose::from_roll_pitch_yaw(Vector3::new(0.1, 0.2, 0.3), 0.4, 0.5, 0.6);
        Arm { dh: core::array::from_fn(row), joints, last_from_flange: Some(flange), ..CONTOUR_CRAFTER }
    }

    #[test]
    fn the_inverse_leads_back_to_the_joints_from_every_turn_of_the_seed() {
        for arm in [CONTOUR_CRAFTER, crooked()] {
            for k in 0..10_000 {
                let goal =
                    JointPos([6.0 + turn(5.9, k), 4.0 + turn(3.9, k + 1), 2.0 + turn(1.9, k + 2), turn(6.2, k + 3)]);
                let pose = arm.forward(&goal);
                let answer = nearest(&arm, &pose, &goal).unwrap();
                assert!(super::super::distance(&answer.joints, &goal) < 5e-14, "{goal:?} {answer:?}");
                let back = arm.forward(&answer.joints);
                assert!((back.translation - pose.translation).norm() < 1e-13);
                assert!((back.rotation - pose.rotation).amax() < 1e-14);
                assert_eq!(inverse(&arm, &pose, &goal).unwrap().as_slice(), [answer]);
                // Every other turn between the stops is the answer for a seed there.
                assert_eq!(turns(&arm, &answer.joints).count(), 2);
                for turned in turns(&arm, &answer.joints) {
                    let there = nearest(&arm, &pose, &turned).unwrap();
                    assert!(super::super::distance(&there.joints, &turned) < 1e-14, "{turned:?}");
                }
            }
        }
    }

    #[test]
    fn what_a_gantry_cannot_do_is_named() {
        let arm = &CONTOUR_CRAFTER;
        let seed = JointPos([1.0, 2.0, 3.0, 0.5]);
        let pose = arm.forward(&seed);
        let lean = |angle: f64| Pose { ..pose * Pose::from_roll_pitch_yaw(Vector3::zeros(), angle, 0.0, 0.0) };
        for angle in [1e-11, 1e-3, 2.0, PI] {
            let error = nearest(arm, &lean(angle), &seed);
            assert!(
                matches!(error, Err(IkError::Orientation { by }) if libm::fabs(by - angle) < 1e-14 + 1e-3 * angle),
                "{angle}: {error:?}"
            );
        }
        assert!(nearest(arm, &lean(1e-13), &seed).is_ok());
        let high = Pose::from_translation(0.0, 0.0, 5.0) * pose;
        assert_eq!(nearest(arm, &high, &seed), Err(IkError::Limit { joint: 2, position: 8.0 }));
        let nan = Pose { translation: Vector3::new(f64::NAN, 0.0, 0.0), ..pose };
        assert_eq!(nearest(arm, &nan, &seed), Err(IkError::NotFinite));
        assert_eq!(nearest(&UR10E, &pose, &JointPos::ZERO), Err(IkError::OtherShape));
        let mut flat = CONTOUR_CRAFTER;
        flat.dh[1].cos_alpha = 0.0;
        flat.dh[0] = Dh { sin_alpha: 0.0, cos_alpha: 1.0, ..flat.dh[0] };
        assert_eq!(Geometry::of(&flat), None, "two slides along one line");
        let mut wound = CONTOUR_CRAFTER;
        wound.joints[3] = Joint { coupling: Some(Coupling { joint: 0, factor: 1.0 }), ..wound.joints[3] };
        assert_eq!(Geometry::of(&wound), None, "a slide that turns the nozzle");
    }
}
