//! The kernel as a C library. The meaning of every function and field is told in `screed_kernel.h`; a test compares both.
//!
//! All that is here is the border: pointers become references or a refusal, enums become numbers. As a static library it needs
//! a panic handler, and that handler calls a function nobody has: a library in which a panic is left cannot be linked.
#![no_std]

use core::mem::{align_of, size_of};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::fault::Fault;
use screed_kernel::mode::Mode;
use screed_kernel::tick::{Kernel, RECEIVE_MAX};
use screed_kernel::units::{JointPos, Nanos};

/// Joints of the arm.
pub const JOINTS: usize = 6;

/// Setpoints that the ring holds.
pub const RING: usize = 4096;

/// The kernel behind the opaque `screed_kernel`.
pub type CKernel = Kernel<JOINTS, RING>;

/// `screed_sensors`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Sensors {
    /// Actual joint positions (rad).
    pub actual: [f64; JOINTS],
    /// Estimated joint positions (rad).
    pub estimate: [f64; JOINTS],
    /// Joint offsets to add to the path (rad).
    pub correction: [f64; JOINTS],
    /// Not 0: the robot takes setpoints now.
    pub ready: u8,
    /// Not 0: there is an estimate.
    pub has_estimate: u8,
    /// Not 0: there is a correction.
    pub has_correction: u8,
}

/// `screed_command`
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Joint targets (rad).
    pub joints: [f64; JOINTS],
    /// The correction in the targets (rad).
    pub correction: [f64; JOINTS],
    /// Extrusion rate (m³/s).
    pub flow: f64,
    /// Path clock rate, 0 to 1.
    pub rate: f64,
    /// The setpoint that the targets stand for.
    pub seq: u32,
    /// 0: the robot's position is not known.
    pub known: u8,
    /// Not 0: material is being laid.
    pub deposit: u8,
    /// Mode.
    pub mode: u8,
    /// Fault, 0 for none.
    pub fault: u8,
}

/// `screed_status`
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    /// Ticks since the beginning.
    pub tick: u64,
    /// Tick of the present fault; 0 without.
    pub fault_tick: u64,
    /// Time lost by late ticks (ns).
    pub time_lost_ns: u64,
    /// Path clock rate, 0 to 1.
    pub rate: f64,
    /// Counts configurations, dropped rings, and holds and resumes obeyed.
    pub epoch: u32,
    /// Setpoint consumed last.
    pub consumed: u32,
    /// Last setpoint held.
    pub end_seq: u32,
    /// Setpoints that the ring can take.
    pub credits: u32,
    /// Number of the present fault; 0 without.
    pub fault_number: u32,
    /// Frames dropped as broken.
    pub frames_broken: u32,
    /// Whole frames whose message is not known here.
    pub frames_unknown: u32,
    /// Ticks that came late.
    pub ticks_late: u32,
    /// Mode.
    pub mode: u8,
    /// Fault, 0 for none.
    pub fault: u8,
}

/// Number of a fault in C.
pub const fn fault_number(fault: Option<Fault>) -> u8 {
    match fault {
        None => 0,
        Some(Fault::Following { .. }) => 1,
        Some(Fault::Sensor { .. }) => 2,
        Some(Fault::RobotNotReady) => 3,
        Some(Fault::Output { .. }) => 4,
        Some(Fault::Extruder) => 5,
        Some(Fault::Deviation { .. }) => 6,
        Some(Fault::Correction { .. }) => 7,
        Some(Fault::Saturated { .. }) => 8,
        Some(Fault::Unreachable { .. }) => 9,
        Some(Fault::Base { .. }) => 10,
        Some(Fault::Drive { .. }) => 11,
        Some(Fault::Lead { .. }) => 12,
        Some(Fault::Tracker { .. }) => 13,
        Some(Fault::Overrun { .. }) => 14,
        Some(Fault::Link) => 15,
    }
}

/// Number of a mode in C.
pub const fn mode_number(mode: &Mode) -> u8 {
    mode.code() as u8
}

/// Bytes that a kernel needs.
#[unsafe(no_mangle)]
pub extern "C" fn screed_kernel_size() -> usize {
    size_of::<CKernel>()
}

/// What their address must be a multiple of.
#[unsafe(no_mangle)]
pub extern "C" fn screed_kernel_align() -> usize {
    align_of::<CKernel>()
}

/// Makes a kernel in the caller's memory, or answers null.
///
/// # Safety
/// `memory` is null or points to `size` writable bytes that nothing else uses while the kernel is in use.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_init(memory: *mut u8, size: usize) -> *mut CKernel {
    let kernel = memory.cast::<CKernel>();
    if kernel.is_null() || !kernel.is_aligned() || size < size_of::<CKernel>() {
        return core::ptr::null_mut();
    }
    // SAFETY: not null, aligned, large enough, and by the contract ours.
    unsafe { kernel.write(Kernel::new(&UR10E)) };
    kernel
}

/// Takes bytes from the host.
///
/// # Safety
/// `kernel` is null or from [`screed_kernel_init`] and used by nobody else now; `bytes` is null or points to `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_receive(kernel: *mut CKernel, bytes: *const u8, len: usize) -> usize {
    // SAFETY: by the contract.
    let Some(kernel) = (unsafe { kernel.as_mut() }) else { return 0 };
    if bytes.is_null() || len == 0 {
        return 0;
    }
    // No more than this is taken anyway, and so no length can be too large for a slice.
    let len = len.min(RECEIVE_MAX);
    // SAFETY: not null, and by the contract `len` bytes are there.
    kernel.receive(unsafe { core::slice::from_raw_parts(bytes, len) })
}

/// Most bytes taken between two ticks.
#[unsafe(no_mangle)]
pub extern "C" fn screed_kernel_receive_max() -> usize {
    RECEIVE_MAX
}

/// One cycle.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`]; `sensors` is null or points to sensors, `command` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_tick(
    kernel: *mut CKernel,
    now_ns: u64,
    sensors: *const Sensors,
    command: *mut Command,
) -> i32 {
    // SAFETY: by the contract.
    let (Some(kernel), Some(sensors)) = (unsafe { (kernel.as_mut(), sensors.as_ref()) }) else { return 0 };
    if command.is_null() {
        return 0;
    }
    let sensors = screed_kernel::tick::Sensors {
        actual: JointPos(sensors.actual),
        estimate: (sensors.has_estimate != 0).then_some(JointPos(sensors.estimate)),
        correction: (sensors.has_correction != 0).then_some(JointPos(sensors.correction)),
        ready: sensors.ready != 0,
    };
    let done = kernel.tick(Nanos(now_ns), &sensors);
    // SAFETY: not null, and by the contract ours to write.
    unsafe {
        command.write(Command {
            joints: done.joints.unwrap_or(JointPos::ZERO).0,
            correction: done.correction.0,
            flow: done.flow,
            rate: done.rate,
            seq: done.seq,
            known: u8::from(done.joints.is_some()),
            deposit: u8::from(done.deposit),
            mode: mode_number(&done.mode),
            fault: fault_number(done.mode.fault()),
        });
    }
    1
}

/// Copies answers for the host.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`]; `out` is null or points to `len` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_poll_transmit(kernel: *mut CKernel, out: *mut u8, len: usize) -> usize {
    // SAFETY: by the contract.
    let Some(kernel) = (unsafe { kernel.as_mut() }) else { return 0 };
    if out.is_null() || len == 0 {
        return 0;
    }
    let len = len.min(isize::MAX as usize);
    // SAFETY: not null, and by the contract `len` bytes are ours to write; a byte has no invalid value.
    kernel.poll_transmit(unsafe { core::slice::from_raw_parts_mut(out, len) })
}

/// Where the kernel stands.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`]; `status` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_status(kernel: *const CKernel, status: *mut Status) -> i32 {
    // SAFETY: by the contract.
    let Some(kernel) = (unsafe { kernel.as_ref() }) else { return 0 };
    if status.is_null() {
        return 0;
    }
    let now = kernel.status();
    // SAFETY: not null, and by the contract ours to write.
    unsafe {
        status.write(Status {
            tick: now.tick,
            fault_tick: now.fault.map_or(0, |report| report.tick),
            time_lost_ns: now.time_lost_ns,
            rate: now.rate,
            epoch: now.epoch,
            consumed: now.consumed,
            end_seq: now.end_seq,
            credits: now.credits,
            fault_number: now.fault.map_or(0, |report| report.number),
            frames_broken: now.frames_broken,
            frames_unknown: now.frames_unknown,
            ticks_late: now.ticks_late,
            mode: now.mode as u8,
            fault: fault_number(now.fault.map(|report| report.fault)),
        });
    }
    1
}

/// Another host speaks from here on.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_host_changed(kernel: *mut CKernel) {
    // SAFETY: by the contract.
    if let Some(kernel) = unsafe { kernel.as_mut() } {
        kernel.host_changed();
    }
}

/// The link to the robot is gone.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_robot_lost(kernel: *mut CKernel) {
    // SAFETY: by the contract.
    if let Some(kernel) = unsafe { kernel.as_mut() } {
        kernel.robot_lost(Fault::Link);
    }
}

/// The extruder failed.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_extruder_failed(kernel: *mut CKernel) {
    // SAFETY: by the contract.
    if let Some(kernel) = unsafe { kernel.as_mut() } {
        kernel.raise(Fault::Extruder);
    }
}

/// Comes to rest, then may quit.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_quit(kernel: *mut CKernel) {
    // SAFETY: by the contract.
    if let Some(kernel) = unsafe { kernel.as_mut() } {
        kernel.quit();
    }
}

/// Whether the host asked to end, and the arm is at rest; 0 for null.
///
/// # Safety
/// `kernel` as for [`screed_kernel_receive`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_kernel_may_quit(kernel: *const CKernel) -> i32 {
    // SAFETY: by the contract.
    unsafe { kernel.as_ref() }.map_or(0, |kernel| i32::from(kernel.may_quit()))
}

/// Forward kinematics.
///
/// # Safety
/// `joints` is null or points to [`JOINTS`] numbers, `base_from_flange` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn screed_forward(joints: *const [f64; JOINTS], base_from_flange: *mut [f64; 12]) -> i32 {
    // SAFETY: by the contract.
    let Some(joints) = (unsafe { joints.as_ref() }) else { return 0 };
    if base_from_flange.is_null() {
        return 0;
    }
    let pose = UR10E.forward(&JointPos(*joints));
    let (r, t) = (&pose.rotation, &pose.translation);
    let rows = [[r.m11, r.m12, r.m13, t.x], [r.m21, r.m22, r.m23, t.y], [r.m31, r.m32, r.m33, t.z]];
    let [[a, b, c, d], [e, f, g, h], [i, j, k, l]] = rows;
    // SAFETY: not null, and by the contract ours to write.
    unsafe { base_from_flange.write([a, b, c, d, e, f, g, h, i, j, k, l]) };
    1
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
