//! Everything the kernel offers, as functions that a linker sees: `.ci/panic_free` links them with a panic handler that calls
//! a function nobody has. Where the optimiser cannot prove a panic unreachable, linking fails.
//!
//! All arguments come from outside, the kernel's whole state among them: what is proven holds for every state, every sensor
//! value and every byte, not only for those that a run would reach.
#![no_std]

use core::mem::MaybeUninit;
use nalgebra::{Matrix6, Vector3};
use screed_kernel::arm::{Arm, Jacobian};
use screed_kernel::arms::opw::Opw;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::history::{History, HistoryError};
use screed_kernel::base::{self, Base, BaseConfig, BaseError, Excess, Measurement, Output};
use screed_kernel::closed_loop::{ClosedLoop, LoopError, LoopReport};
use screed_kernel::control::Settings;
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::dexterity::Dexterity;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::ekf::replay::{OfferError, Replay, Report, Stamped};
use screed_kernel::ekf::{Ekf, EkfError, State, Verdict};
use screed_kernel::estimator::{Estimator, EstimatorConfig, EstimatorError, Robot, TrackerPose};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, FrameError, FromKernel, MotionLimits, Status, ToKernel};
use screed_kernel::guard::{Motion, Periods, output_least};
use screed_kernel::ik::{self, Answer, Branch, Branches, Family, IkError, Side, Singularity};
use screed_kernel::pid::Gains;
use screed_kernel::pose::Pose;
use screed_kernel::registration::{PointPair, Registration, RegistrationError, register};
use screed_kernel::setpoint::{self, CodeError, Coder, Setpoint};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::{JointJerk, JointPos, JointVel, Nanos};

/// The kernel of an N-joint arm, all of its public functions; the names differ by N.
macro_rules! kernel_roots {
    ($joints:literal, $module:ident) => {
        /// The roots for this count of joints.
        pub mod $module {
            use super::*;

            /// [`Kernel::new`]
            #[unsafe(export_name = concat!("root_new_", $joints))]
            pub fn new(kernel: &mut MaybeUninit<Kernel<$joints, 4096>>, arm: &Arm<$joints>) {
                kernel.write(Kernel::new(arm));
            }

            /// [`Kernel::receive`]: every message, broken and whole.
            #[unsafe(export_name = concat!("root_receive_", $joints))]
            pub fn receive(kernel: &mut Kernel<$joints, 4096>, bytes: &[u8]) -> usize {
                kernel.receive(bytes)
            }

            /// [`Kernel::tick`]: every mode.
            #[unsafe(export_name = concat!("root_tick_", $joints))]
            pub fn tick(
                kernel: &mut Kernel<$joints, 4096>,
                now: Nanos,
                sensors: &Sensors<$joints>,
            ) -> Command<$joints> {
                kernel.tick(now, sensors)
            }

            /// [`Kernel::poll_transmit`]
            #[unsafe(export_name = concat!("root_poll_transmit_", $joints))]
            pub fn poll_transmit(kernel: &mut Kernel<$joints, 4096>, out: &mut [u8]) -> usize {
                kernel.poll_transmit(out)
            }

            /// What happens outside the kernel and is told to it.
            #[unsafe(export_name = concat!("root_events_", $joints))]
            pub fn events(kernel: &mut Kernel<$joints, 4096>, which: u8, fault: Fault) -> (Status, bool, Option<u64>) {
                match which {
                    0 => kernel.host_changed(),
                    1 => kernel.robot_lost(fault),
                    2 => kernel.quit(),
                    _ => kernel.raise(fault),
                }
                (kernel.status(), kernel.may_quit(), kernel.tick_period_ns())
            }

            /// Both ways of the setpoint code.
            #[unsafe(export_name = concat!("root_code_", $joints))]
            pub fn code(
                coder: &mut Coder<$joints>,
                setpoint: &Setpoint<$joints>,
                bytes: &mut [u8],
            ) -> (Result<usize, CodeError>, Result<(Setpoint<$joints>, usize), CodeError>) {
                (coder.encode(setpoint, bytes), coder.decode(bytes))
            }

            /// What a host needs to make a configuration.
            #[unsafe(export_name = concat!("root_limits_", $joints))]
            pub fn limits(
                plan: &Motion<$joints>,
                periods: Periods,
                correction: &CorrectionLimits,
            ) -> (MotionLimits, Motion<$joints>) {
                let least = output_least(plan, periods, correction);
                (MotionLimits::from(&least), least)
            }

            /// [`Ekf::new`], [`Ekf::predict`], [`State::after`]
            #[unsafe(export_name = concat!("root_ekf_predict_", $joints))]
            pub fn ekf_predict(
                ekf: &mut Ekf<$joints>,
                deviation: &State<$joints>,
                density: &[f64; $joints],
                dt: f64,
                jerk: &JointJerk<$joints>,
            ) -> Result<State<$joints>, EkfError> {
                ekf.predict(dt, jerk)?;
                let variance = ekf.covariance().get(dt as usize, dt as usize).ok_or(EkfError::NotFinite)?;
                ekf.predict(variance, jerk)?;
                *ekf = Ekf::new(ekf.state().after(dt, jerk), deviation, density)?;
                Ok(*ekf.state())
            }

            /// [`Ekf::pose`]
            #[unsafe(export_name = concat!("root_ekf_pose_", $joints))]
            pub fn ekf_pose(
                ekf: &mut Ekf<$joints>,
                arm: &Arm<$joints>,
                measured: &TrackedPose,
            ) -> Result<Verdict, EkfError> {
                let once = ekf.pose(arm, measured)?;
                if once.is_taken() { Ok(once) } else { ekf.pose_iterated(arm, measured) }
            }

            /// [`Replay`], all of it.
            #[unsafe(export_name = concat!("root_ekf_replay_", $joints))]
            pub fn ekf_replay(
                filter: &mut Replay<$joints, 24>,
                arm: &Arm<$joints>,
                stamped: &Stamped<$joints>,
                now: Nanos,
                jerk: &JointJerk<$joints>,
            ) -> (Result<(), OfferError>, Result<Report, EkfError>, State<$joints>) {
                let offered = filter.offer(stamped);
                let report = filter.tick(arm, now, jerk);
                let ahead = filter.ahead(now.0 as f64, jerk);
                if report.is_err() {
                    *filter = Replay::new(*filter.ekf(), now);
                }
                (offered, report, ahead)
            }

            /// [`Base::measure`], with encoders out of a [`History`]
            #[unsafe(export_name = concat!("root_base_measure_", $joints))]
            pub fn base_measure(
                base: &mut Base,
                history: &mut History<$joints, 16>,
                arm: &Arm<$joints>,
                measurement: &Measurement<$joints>,
                now: Nanos,
            ) -> (Result<(), HistoryError>, Result<base::Verdict, BaseError>) {
                let pushed = history.push(now, &measurement.joints);
                let joints = match history.at(measurement.at) {
                    Ok(joints) => joints,
                    Err(error) => return (Err(error), Err(BaseError::Late { by: 0 })),
                };
                (pushed, base.measure(arm, &Measurement { joints, ..*measurement }))
            }

            /// [`ClosedLoop::new`], with everything that it is made of.
            #[unsafe(export_name = concat!("root_loop_new_", $joints))]
            pub fn loop_new(
                made: &mut MaybeUninit<Result<ClosedLoop<$joints, 8>, (Option<EstimatorError>, Option<LoopError>)>>,
                arm: &Arm<$joints>,
                estimator: Option<&EstimatorConfig<$joints>>,
                settings: &Settings<$joints>,
                drives: &[Drive; $joints],
                learning: &Learning,
                period: f64,
            ) {
                let estimator = match estimator.map(Estimator::new).transpose() {
                    Ok(estimator) => estimator,
                    Err(error) => {
                        made.write(Err((Some(error), None)));
                        return;
                    }
                };
                let new = ClosedLoop::new(arm, estimator, settings, drives, learning, period);
                made.write(new.map_err(|error| (None, Some(error))));
            }

            /// [`ClosedLoop::tick`]: the whole cycle, from a telegram and poses to a command.
            #[unsafe(export_name = concat!("root_loop_tick_", $joints))]
            pub fn loop_tick(
                closed: &mut ClosedLoop<$joints, 8>,
                kernel: &mut Kernel<$joints, 4096>,
                now: Nanos,
                robot: &Robot<$joints>,
                poses: &[TrackerPose],
            ) -> (Command<$joints>, LoopReport<$joints>, [Drive; $joints]) {
                let (command, report) = closed.tick(kernel, now, robot, poses);
                (command, report, *closed.identification().learnt())
            }

            /// [`ClosedLoop::robot_lost`]
            #[unsafe(export_name = concat!("root_loop_robot_lost_", $joints))]
            pub fn loop_robot_lost(
                closed: &mut ClosedLoop<$joints, 8>,
                kernel: &mut Kernel<$joints, 4096>,
                fault: Fault,
            ) {
                closed.robot_lost(kernel, fault);
            }

            /// [`Gains::for_drive`]
            #[unsafe(export_name = concat!("root_gains_", $joints))]
            pub fn gains(drive: &Drive, crossover: f64, filter_time: f64) -> Gains {
                Gains::for_drive(drive, crossover, filter_time)
            }

            /// [`Ekf::rates`] and [`Ekf::encoders`]
            #[unsafe(export_name = concat!("root_ekf_joints_", $joints))]
            pub fn ekf_joints(
                ekf: &mut Ekf<$joints>,
                rates: &JointVel<$joints>,
                joints: &JointPos<$joints>,
            ) -> (Result<Verdict, EkfError>, Result<Verdict, EkfError>) {
                (ekf.rates(rates, rates), ekf.encoders(joints, joints))
            }
        }
    };
}

kernel_roots!(3, three);
kernel_roots!(6, six);
kernel_roots!(7, seven);
kernel_roots!(9, nine);

/// [`Base::new`]
#[unsafe(no_mangle)]
pub fn root_base_new(config: &BaseConfig) -> Result<Base, BaseError> {
    Base::new(config)
}

/// [`Base::tick`] and what a base tells.
#[unsafe(no_mangle)]
pub fn root_base_tick(base: &mut Base, at: Nanos, clear: bool) -> (Result<Output, Excess>, Pose, Pose, f64) {
    if clear {
        base.clear();
    }
    let output = base.tick(at);
    let certain = base.estimate().map_or(0.0, |estimate| {
        estimate.at().0 as f64
            + estimate.covariance().rows[0][0][0][0]
            + estimate.place().rotation.x
            + estimate.swing().rotation.x
            + estimate.rate().rotation.x
    });
    (output, base.output().nominal_from_base, base.tracker_from_base(at), certain)
}

/// [`frame::encode`] of what the host says.
#[unsafe(no_mangle)]
pub fn root_encode_to(message: &ToKernel, out: &mut [u8]) -> Result<usize, FrameError> {
    frame::encode(message, out)
}

/// [`frame::encode`] of what the kernel says.
#[unsafe(no_mangle)]
pub fn root_encode_from(message: &FromKernel, out: &mut [u8]) -> Result<usize, FrameError> {
    frame::encode(message, out)
}

/// [`frame::decode`] of what the kernel says.
#[unsafe(no_mangle)]
pub fn root_decode_from(bytes: &[u8]) -> Result<FromKernel, FrameError> {
    frame::decode(bytes)
}

/// [`ik::ur::inverse`] of any arm with that table's shape.
#[unsafe(no_mangle)]
pub fn root_inverse(arm: &Arm<6>, pose: &Pose, seed: &JointPos<6>) -> Result<Branches<6>, IkError> {
    ik::ur::inverse(arm, pose, seed)
}

/// [`ik::ur::nearest`]
#[unsafe(no_mangle)]
pub fn root_nearest(arm: Option<&Arm<6>>, pose: &Pose, seed: &JointPos<6>) -> Result<Answer<6>, IkError> {
    ik::ur::nearest(arm.unwrap_or(&UR10E), pose, seed)
}

/// Every function of [`Pose`].
#[unsafe(no_mangle)]
pub fn root_pose(a: &Pose, b: &Pose, v: &Vector3<f64>, w: &Vector3<f64>) -> (Pose, Vector3<f64>, bool) {
    let made = Pose::from_rotation_vector(*v, *w) * Pose::from_roll_pitch_yaw(*v, w.x, w.y, w.z);
    let all = *a * b.inverse() * made * Pose::from_translation(v.x, v.y, v.z) * Pose::identity();
    (all, a.transform_point(v) + all.rotation_vector(), all.is_finite())
}

/// [`register`], with any count of pairs.
#[unsafe(no_mangle)]
pub fn root_register(pairs: &[PointPair]) -> Result<Registration, RegistrationError> {
    register(pairs)
}

/// What a registration tells.
#[unsafe(no_mangle)]
pub fn root_registration(found: &Registration, pair: &PointPair, sigma: f64) -> (Vector3<f64>, f64, Matrix6<f64>) {
    (found.residual(pair), found.sigma(), found.covariance(sigma))
}

/// The grids of the wire.
#[unsafe(no_mangle)]
pub fn root_grids(value: f64) -> (f64, f64) {
    (setpoint::joint_on_grid(value), setpoint::flow_on_grid(value))
}

/// [`Opw::arm`], and ratings of the catalogue's arms.
#[unsafe(no_mangle)]
pub fn root_opw(opw: &Opw, arm: &Arm<6>) -> (Arm<6>, Option<JointVel<6>>, &'static str) {
    (opw.arm("opw"), arm.velocity_max.known(), Singularity::Shoulder.name())
}

/// The words of a fault.
#[unsafe(no_mangle)]
pub fn root_fault(fault: &Fault) -> (&'static str, &'static str, &'static str) {
    (fault.code(), fault.cause(), fault.action())
}

/// Control: an index that nothing bounds.
#[cfg(feature = "control-index")]
#[unsafe(no_mangle)]
pub fn root_control(values: &[u8], i: usize) -> u8 {
    values[i]
}

/// Control: a sum that can overflow; a panic only where overflow is checked.
#[cfg(feature = "control-overflow")]
#[unsafe(no_mangle)]
pub fn root_control(a: u32, b: u32) -> u32 {
    a + b
}

/// Control: a function that calls itself.
#[cfg(feature = "control-recursion")]
#[unsafe(no_mangle)]
#[allow(unconditional_recursion)]
pub fn root_control(values: &mut [u32; 4], n: u32) -> u32 {
    if n == 0 {
        return 0;
    }
    let [first, ..] = values;
    *first = first.wrapping_add(n);
    root_control(core::hint::black_box(values), n - 1).wrapping_mul(n)
}

/// Control: a call through a pointer.
#[cfg(feature = "control-pointer")]
#[unsafe(no_mangle)]
pub fn root_control(call: fn(u32) -> u32, n: u32) -> u32 {
    call(n).wrapping_add(1)
}

/// Control: memory from a heap; without an allocator in any of the crates this does not even compile.
#[cfg(feature = "control-alloc")]
#[unsafe(no_mangle)]
pub fn root_control(byte: u8) -> impl core::ops::Deref<Target = u8> {
    extern crate alloc;
    alloc::boxed::Box::new(byte)
}

#[cfg(all(panic = "abort", not(test)))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    unsafe extern "C" {
        fn a_panic_is_left_in_the_kernel() -> !;
    }
    // SAFETY: never runs: the function does not exist, and a program with this call in it does not link.
    unsafe { a_panic_is_left_in_the_kernel() }
}

/// Kinematics of an arm with so many joints, the inverse of every family.
macro_rules! arm_roots {
    ($joints:literal, $module:ident) => {
        /// The roots for this count of joints.
        pub mod $module {
            use super::*;

            /// [`Arm::points`]
            #[unsafe(export_name = concat!("root_points_", $joints))]
            pub fn points(
                arm: &Arm<$joints>,
                joints: &JointPos<$joints>,
                points: [Vector3<f64>; 2],
            ) -> [Vector3<f64>; 2] {
                arm.points(joints, points)
            }

            /// [`Arm::forward`]
            #[unsafe(export_name = concat!("root_forward_", $joints))]
            pub fn forward(arm: &Arm<$joints>, joints: &JointPos<$joints>) -> Pose {
                arm.forward(joints)
            }

            /// [`Dexterity::of`]
            #[unsafe(export_name = concat!("root_dexterity_", $joints))]
            pub fn dexterity(jacobian: &Jacobian<$joints>) -> (Dexterity, f64) {
                let dexterity = Dexterity::of(jacobian);
                (dexterity, dexterity.condition())
            }

            /// [`Arm::frames`] and [`Arm::jacobian`]
            #[unsafe(export_name = concat!("root_jacobian_", $joints))]
            pub fn jacobian(
                arm: &Arm<$joints>,
                joints: &JointPos<$joints>,
            ) -> ([Pose; $joints], (Pose, Jacobian<$joints>)) {
                (arm.frames(joints), arm.jacobian(joints))
            }

            /// [`Family::of`]; the arm's full turns: [`ik::turns`].
            #[unsafe(export_name = concat!("root_family_", $joints))]
            pub fn family(arm: &Arm<$joints>, joints: &JointPos<$joints>) -> (Family, Option<JointPos<$joints>>) {
                (Family::of(arm), ik::turns(arm, joints).last())
            }

            /// [`Family::inverse`]: every family, also one of another arm. [`Branches::nearest`]
            #[unsafe(export_name = concat!("root_family_inverse_", $joints))]
            pub fn family_inverse(
                family: &Family,
                arm: &Arm<$joints>,
                pose: &Pose,
                seed: &JointPos<$joints>,
            ) -> (Result<Branches<$joints>, IkError>, Option<Answer<$joints>>) {
                let found = family.inverse(arm, pose, seed);
                let nearest = found.as_ref().ok().and_then(|found| found.nearest(seed)).copied();
                (found, nearest)
            }

            /// [`Branches::residual`]
            #[unsafe(export_name = concat!("root_residual_", $joints))]
            pub fn residual(found: &Branches<$joints>, arm: &Arm<$joints>, pose: &Pose) -> f64 {
                found.residual(arm, pose)
            }

            /// [`Family::nearest`], [`Family::track`]
            #[unsafe(export_name = concat!("root_family_nearest_", $joints))]
            pub fn family_nearest(
                family: &Family,
                arm: &Arm<$joints>,
                pose: &Pose,
                seed: &JointPos<$joints>,
            ) -> ([Result<Answer<$joints>, IkError>; 2], &'static str) {
                ([family.nearest(arm, pose, seed), family.track(arm, pose, seed)], family.name())
            }

            /// [`ik::calibrated::Geometry`] and [`ik::numeric::nearest`], whatever the arm.
            #[unsafe(export_name = concat!("root_iterated_", $joints))]
            pub fn iterated(
                calibrated: &ik::calibrated::Geometry,
                arm: &Arm<$joints>,
                pose: &Pose,
                seed: &JointPos<$joints>,
            ) -> (Result<Branches<$joints>, IkError>, [Result<Answer<$joints>, IkError>; 2]) {
                let nearest = [calibrated.nearest(arm, pose, seed), ik::numeric::nearest(arm, pose, seed)];
                (calibrated.inverse(arm, pose, seed), nearest)
            }

            /// [`ik::calibrated::Geometry::near`] and what it tells of joints.
            #[unsafe(export_name = concat!("root_posture_", $joints))]
            pub fn posture(
                arm: &Arm<$joints>,
                joints: &JointPos<$joints>,
            ) -> Option<(Branch, (Singularity, f64), &'static str, f64)> {
                let calibrated = ik::calibrated::Geometry::near(arm)?;
                let (branch, margins) = calibrated.posture(arm, joints);
                let (singularity, margin) = margins.nearest();
                Some((branch, (singularity, margin), calibrated.name(), Side::of(margin).sign()))
            }

            /// [`ik::wrist::inverse`]
            #[unsafe(export_name = concat!("root_wrist_inverse_", $joints))]
            pub fn wrist_inverse(
                arm: &Arm<$joints>,
                pose: &Pose,
                seed: &JointPos<$joints>,
            ) -> Result<Branches<$joints>, IkError> {
                ik::wrist::inverse(arm, pose, seed)
            }

            /// [`ik::wrist::nearest`]
            #[unsafe(export_name = concat!("root_wrist_nearest_", $joints))]
            pub fn wrist_nearest(
                arm: &Arm<$joints>,
                pose: &Pose,
                seed: &JointPos<$joints>,
            ) -> Result<Answer<$joints>, IkError> {
                ik::wrist::nearest(arm, pose, seed)
            }

            /// [`ik::gantry::inverse`], [`ik::gantry::nearest`]
            #[unsafe(export_name = concat!("root_gantry_inverse_", $joints))]
            pub fn gantry_inverse(
                arm: &Arm<$joints>,
                pose: &Pose,
                seed: &JointPos<$joints>,
            ) -> (Result<Branches<$joints>, IkError>, Result<Answer<$joints>, IkError>) {
                (ik::gantry::inverse(arm, pose, seed), ik::gantry::nearest(arm, pose, seed))
            }
        }
    };
}

arm_roots!(3, arm_of_three);
arm_roots!(4, arm_of_four);
arm_roots!(5, arm_of_five);
arm_roots!(6, arm_of_six);
arm_roots!(7, arm_of_seven);
arm_roots!(8, arm_of_eight);
arm_roots!(9, arm_of_nine);
