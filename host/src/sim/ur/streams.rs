//! What the controller sends on ports 30001 to 30003 without being asked: the robot's state, and on 30001 its kinematics.
//! Everything is big-endian.
//!
//! Layouts after the maker's "Client interfaces" (5.10 and 3.15) and the primary client of the
//! Universal_Robots_Client_Library (`src/primary`): robot mode, joints, Cartesian, main board, tool, force mode, additional
//! information, on an e-Series communication and modes of the tool, and once for each client kinematics, calibration and
//! configuration, in the order of the state that the library's `tests/test_primary_parser.cpp` has from a controller (which
//! has the maker's own safety data beside them, not documented); messages on 30001 as they come. A client that does not
//! read misses whole packages; programs that only upload never do, and must not be cut for it.

use super::RuntimeState;
use super::fields::{Snapshot, TEMPERATURE, VOLTAGE};
use super::messages::Mailbox;
use super::robot::{Generation, Robot, Safety};
use super::servo::ACCELERATION_MAX;
use screed_kernel::arm::Arm;

/// Robot states per second on 30001 and 30002 (Hz).
const STATE_RATE: u32 = 10;
/// Doubles in a package of 30003, its size field apart.
const REALTIME_DOUBLES: usize = 152;
/// Types of messages.
const ROBOT_STATE: u8 = 16;
pub(super) const ROBOT_MESSAGE: u8 = 20;
/// The type of a version message, and the source that robot messages name: none.
const VERSION: u8 = 3;
const NO_SOURCE: u8 = 254;
/// A checksum over each joint's row: the controller's own is not published.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// Defaults of `movej` and `movel` in the URScript manual: joint speed and acceleration, tool speed and acceleration.
const MOVE_DEFAULTS: [f64; 4] = [1.05, 1.4, 0.25, 1.2];

/// Which of the three ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// 30001: robot states, version, configuration and kinematics.
    Primary,
    /// 30002: robot states and version.
    Secondary,
    /// 30003: all numbers of every cycle.
    Realtime,
}

/// What a client of one of the ports gets.
#[derive(Clone, Debug)]
pub struct Stream {
    port: Port,
    greeted: bool,
    /// The number of the next message.
    next: u64,
    outbox: Vec<u8>,
}

/// What a stream tells of.
pub(super) struct Scene<'a> {
    pub snapshot: &'a Snapshot<'a>,
    pub robot: &'a Robot,
    pub runtime: RuntimeState,
    pub arm: &'a Arm<6>,
    pub generation: Generation,
    pub mailbox: &'a Mailbox,
}

impl Stream {
    /// A client that has just connected.
    pub const fn new(port: Port) -> Self {
        Self { port, greeted: false, next: 0, outbox: Vec::new() }
    }

    /// One cycle has passed. Packages are whole or not there.
    pub(super) fn handle_cycle(&mut self, scene: &Scene<'_>) {
        if !self.outbox.is_empty() {
            return;
        }
        if self.port == Port::Realtime {
            self.outbox = realtime(scene);
            return;
        }
        let with_kinematics = self.port == Port::Primary && !self.greeted;
        let mut told = false;
        if !self.greeted {
            self.outbox.extend(version(scene));
        } else if self.port == Port::Primary {
            (self.outbox, told) = scene.mailbox.since(self.next);
        }
        self.next = scene.mailbox.count();
        let every = u64::from(scene.generation.cycle_rate() / STATE_RATE).max(1);
        // Behind a message that the robot's state has changed that state, so that clients which wait for both find no older one.
        if !self.greeted || told || scene.snapshot.cycle.is_multiple_of(every) {
            self.outbox.extend(robot_state(scene, with_kinematics));
        }
        self.greeted = true;
    }

    /// Moves bytes for the client into `out`; how many.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let count = self.outbox.len().min(out.len());
        for (to, from) in out.iter_mut().zip(self.outbox.drain(..count)) {
            *to = from;
        }
        count
    }
}

/// A package: its size with the size field, its type, its content.
pub(super) fn package(kind: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = ((content.len() + 5) as u32).to_be_bytes().to_vec();
    bytes.push(kind);
    bytes.extend(content);
    bytes
}

fn put(out: &mut Vec<u8>, values: &[f64]) {
    out.extend(values.iter().flat_map(|value| value.to_be_bytes()));
}

fn put_single(out: &mut Vec<u8>, values: &[f32]) {
    out.extend(values.iter().flat_map(|value| value.to_be_bytes()));
}

fn microseconds(scene: &Scene<'_>) -> [u8; 8] {
    // Far below what a u64 holds: a controller runs for years at most.
    ((scene.snapshot.timestamp * 1e6).round() as u64).to_be_bytes()
}

fn version(scene: &Scene<'_>) -> Vec<u8> {
    let [major, minor, bugfix, build] = scene.generation.software();
    let (project, date) = ("URControl", "01-03-2022, 00:00:00");
    let mut content = microseconds(scene).to_vec();
    content.extend([NO_SOURCE, VERSION, project.len() as u8]);
    content.extend(project.bytes());
    content.extend([major as u8, minor as u8]);
    content.extend(bugfix.to_be_bytes());
    content.extend(build.to_be_bytes());
    content.extend(date.bytes());
    package(ROBOT_MESSAGE, &content)
}

fn robot_state(scene: &Scene<'_>, with_kinematics: bool) -> Vec<u8> {
    let mut content = package(0, &robot_mode(scene));
    content.extend(package(1, &joints(scene)));
    content.extend(package(4, &cartesian(scene)));
    if with_kinematics {
        content.extend(package(5, &kinematics(scene.arm)));
        // The force sensor's calibration: there is no sensor.
        content.extend(package(9, &[0; 6 * 8]));
    }
    content.extend(package(3, &main_board(scene)));
    content.extend(package(2, &tool(scene)));
    if with_kinematics {
        content.extend(package(6, &configuration(scene)));
    }
    // Wrench of the force mode and dexterity, which the simulation has not.
    content.extend(package(7, &[0; 7 * 8]));
    // Teach pendant's button, freedrive by button and by input: none.
    content.extend(package(8, &[0; 4]));
    if scene.generation == Generation::ESeries {
        content.extend(package(11, &tool_communication()));
        // The output of the tool: sinking by pins (0), both of them (1).
        content.extend(package(12, &[0, 1, 1]));
    }
    package(ROBOT_STATE, &content)
}

/// The tool's serial line, not in use, with its defaults: 115,200 baud, no parity, 1 stop bit, idle for 1.5 and 3.5 characters.
fn tool_communication() -> Vec<u8> {
    let mut out = vec![0];
    out.extend([115_200_u32, 0, 1].iter().flat_map(|number| number.to_be_bytes()));
    put_single(&mut out, &[1.5, 3.5]);
    out
}

fn robot_mode(scene: &Scene<'_>) -> Vec<u8> {
    let mut out = microseconds(scene).to_vec();
    let powered = scene.snapshot.robot_status_bits & 1 == 1;
    out.extend([true, true, powered].map(u8::from));
    out.push(u8::from(scene.robot.is_emergency()));
    out.push(u8::from(matches!(scene.robot.safety(), Safety::ProtectiveStop { .. })));
    out.push(u8::from(scene.runtime == RuntimeState::Playing));
    out.push(u8::from(scene.runtime == RuntimeState::Paused));
    // Control mode 0: position.
    out.extend([scene.snapshot.robot_mode as u8, 0]);
    put(&mut out, &[scene.snapshot.target_speed_fraction, scene.snapshot.speed_scaling, 1.0]);
    out.push(0);
    out
}

fn joints(scene: &Scene<'_>) -> Vec<u8> {
    let mut out = Vec::new();
    for (q, qd) in scene.snapshot.target_q.iter().zip(scene.snapshot.target_qd) {
        put(&mut out, &[*q, *q, qd]);
        // Current, which is not simulated, voltage, temperatures of motor and electronics.
        put_single(&mut out, &[0.0, VOLTAGE as f32, TEMPERATURE as f32, TEMPERATURE as f32]);
        out.push(scene.snapshot.joint_mode as u8);
    }
    out
}

fn tool(scene: &Scene<'_>) -> Vec<u8> {
    let [.., first, second] = scene.snapshot.cell.analog;
    // Both inputs from 0 to 10 V.
    let mut out = vec![1, 1];
    put(&mut out, &[first, second]);
    put_single(&mut out, &[VOLTAGE as f32]);
    // Output voltage: none.
    out.push(0);
    put_single(&mut out, &[0.0, TEMPERATURE as f32]);
    out.push(scene.snapshot.joint_mode as u8);
    out
}

fn main_board(scene: &Scene<'_>) -> Vec<u8> {
    let state = scene.snapshot;
    let mut out = (state.cell.digital as u32).to_be_bytes().to_vec();
    out.extend((state.digital_outputs as u32).to_be_bytes());
    let [first, second, ..] = state.cell.analog;
    // Both inputs from 0 to 10 V.
    out.extend([1, 1]);
    put(&mut out, &[first, second]);
    let [(first_is_voltage, first), (second_is_voltage, second)] = state.outputs.analog;
    out.extend([first_is_voltage, second_is_voltage].map(u8::from));
    put(&mut out, &[first, second]);
    // Currents are not simulated.
    put_single(&mut out, &[TEMPERATURE as f32, VOLTAGE as f32, 0.0, 0.0]);
    out.push(state.safety_mode as u8);
    out.push(u8::from(scene.robot.inputs.reduced));
    // No Euromap interface; four bytes not used.
    out.extend([0; 1 + 4]);
    if scene.generation == Generation::ESeries {
        // Operational mode selector, three-position switch, one not used.
        out.extend([0, u8::from(scene.robot.inputs.enabling), 0]);
    }
    out
}

fn cartesian(scene: &Scene<'_>) -> Vec<u8> {
    let mut out = Vec::new();
    put(&mut out, &scene.snapshot.tcp_pose);
    put(&mut out, &scene.snapshot.tcp_offset);
    out
}

/// The table as the controller lists it, column by column: a, d, α, θ.
fn table(arm: &Arm<6>) -> [[f64; 6]; 4] {
    [
        arm.dh.map(|row| row.a),
        arm.dh.map(|row| row.d),
        arm.dh.map(|row| row.sin_alpha.atan2(row.cos_alpha)),
        arm.dh.map(|row| row.theta),
    ]
}

fn kinematics(arm: &Arm<6>) -> Vec<u8> {
    let [a, d, alpha, theta] = table(arm);
    let mut out = Vec::new();
    for row in &arm.dh {
        let mut bytes = Vec::new();
        put(&mut bytes, &[row.a, row.d, row.sin_alpha, row.cos_alpha, row.theta]);
        out.extend(CRC.checksum(&bytes).to_be_bytes());
    }
    for column in [theta, a, d, alpha] {
        put(&mut out, &column);
    }
    // Calibration status 0: calibrated, or the model's own table.
    out.extend(0_u32.to_be_bytes());
    out
}

fn configuration(scene: &Scene<'_>) -> Vec<u8> {
    let arm = scene.arm;
    let mut out = Vec::new();
    for (min, max) in arm.position_min.0.iter().zip(arm.position_max.0) {
        put(&mut out, &[*min, max]);
    }
    for speed in arm.velocity_max.known().map_or([f64::NAN; 6], |speeds| speeds.0) {
        put(&mut out, &[speed, ACCELERATION_MAX]);
    }
    put(&mut out, &MOVE_DEFAULTS);
    // The radius that turns count with: not modelled.
    put(&mut out, &[0.0]);
    for column in table(arm) {
        put(&mut out, &column);
    }
    let (robot, control_box) = (robot_type(arm.name), u32::from(scene.generation == Generation::ESeries) + 2);
    for number in [1, control_box, robot, 0] {
        out.extend(number.to_be_bytes());
    }
    out
}

/// The maker's numbers of the models; 0 where we know none.
fn robot_type(name: &str) -> u32 {
    match name {
        "ur5" | "ur5e" | "ur7e" => 1,
        "ur10" | "ur10e" | "ur12e" => 2,
        "ur3" | "ur3e" => 3,
        "ur16e" => 4,
        "ur18" => 5,
        "ur8long" => 6,
        "ur20" => 7,
        "ur30" => 8,
        "ur15" => 9,
        _ => 0,
    }
}

fn realtime(scene: &Scene<'_>) -> Vec<u8> {
    let state = scene.snapshot;
    let mut doubles = Vec::with_capacity(REALTIME_DOUBLES);
    doubles.push(state.timestamp);
    for vector in [state.target_q, state.target_qd, state.target_qdd, [0.0; 6], [0.0; 6]] {
        doubles.extend(vector);
    }
    for vector in [state.target_q, state.target_qd, [0.0; 6], [0.0; 6]] {
        doubles.extend(vector);
    }
    // Pose, speed and force of the tool, then its targets.
    for vector in [state.tcp_pose, state.tcp_speed, [0.0; 6], state.tcp_pose, state.tcp_speed] {
        doubles.extend(vector);
    }
    doubles.push(state.cell.digital as f64);
    doubles.extend([TEMPERATURE; 6]);
    // Controller's timer and a test value.
    doubles.extend([0.0; 2]);
    doubles.push(f64::from(state.robot_mode));
    doubles.extend([f64::from(state.joint_mode); 6]);
    doubles.push(f64::from(state.safety_mode));
    doubles.extend([0.0; 6]);
    doubles.extend(state.body.accelerometer());
    doubles.extend([0.0; 6]);
    doubles.push(state.speed_scaling);
    // Momentum, not used; main voltage, robot's voltage and current; joint voltages.
    doubles.extend([state.momentum(), 0.0, 0.0, VOLTAGE, VOLTAGE, 0.0]);
    doubles.extend([VOLTAGE; 6]);
    doubles.push(state.digital_outputs as f64);
    doubles.push(f64::from(state.runtime_state));
    let (elbow, elbow_speed) = state.body.elbow();
    doubles.extend(elbow);
    doubles.extend(elbow_speed);
    doubles.push(f64::from(state.safety_status));
    doubles.extend([0.0; 3]);
    let payload = state.body.payload;
    doubles.push(payload.mass);
    doubles.extend(payload.centre);
    doubles.extend(payload.inertia);
    let mut bytes = ((4 + 8 * doubles.len()) as u32).to_be_bytes().to_vec();
    put(&mut bytes, &doubles);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::ur::{Controller, Options};
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::pose::Pose;
    use screed_kernel::units::JointPos;

    const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

    fn controller(powered: bool) -> Controller {
        let options = Options {
            start_q: START,
            flange_from_tcp: Pose::from_translation(0.0, 0.0, 0.2),
            register_offset: 0,
            program: "def test():\n  while True:\n    sync()\n  end\nend\n".to_owned(),
            autoplay: true,
            generation: Generation::ESeries,
            powered,
        };
        Controller::new(&UR10E, options).expect("legal")
    }

    fn taken(stream: &mut Stream) -> Vec<u8> {
        let mut out = vec![0; 100_000];
        let count = stream.poll_transmit(&mut out);
        out.truncate(count);
        out
    }

    fn double(bytes: &[u8], at: usize) -> f64 {
        f64::from_be_bytes(bytes[at..at + 8].try_into().expect("eight bytes"))
    }

    /// Offsets as users of the port publish them.
    #[test]
    fn the_realtime_package_has_its_numbers_where_clients_look_for_them() {
        let mut robot = controller(true);
        let mut stream = Stream::new(Port::Realtime);
        robot.step();
        robot.feed(&mut stream);
        let bytes = taken(&mut stream);
        assert_eq!((bytes.len(), &bytes[..4]), (1220, &1220_u32.to_be_bytes()[..]));
        assert_eq!(double(&bytes, 4), robot.last_cycle().timestamp);
        for (joint, value) in START.0.iter().enumerate() {
            assert_eq!(double(&bytes, 12 + 8 * joint), *value, "target");
            assert_eq!(double(&bytes, 252 + 8 * joint), *value, "actual");
        }
        let pose = UR10E.forward(&START) * Pose::from_translation(0.0, 0.0, 0.2);
        for (axis, value) in pose.translation.iter().enumerate() {
            assert!((double(&bytes, 444 + 8 * axis) - value).abs() < 1e-12);
        }
        assert_eq!([756, 812, 1052].map(|at| double(&bytes, at)), [7.0, 1.0, 2.0]);
        // Nobody reads: whole packages are missed.
        robot.feed(&mut stream);
        stream.poll_transmit(&mut [0; 100]);
        robot.step();
        robot.feed(&mut stream);
        assert_eq!(taken(&mut stream).len(), 1120);
    }

    /// The type and content of each package in a row of them.
    fn packages(mut bytes: &[u8]) -> Vec<(u8, &[u8])> {
        let mut found = Vec::new();
        while let [a, b, c, d, kind, ..] = *bytes {
            let (package, rest) = bytes.split_at(u32::from_be_bytes([a, b, c, d]) as usize);
            found.push((kind, &package[5..]));
            bytes = rest;
        }
        assert!(bytes.is_empty());
        found
    }

    #[test]
    fn the_primary_port_greets_with_version_and_kinematics_and_then_sends_ten_states_a_second() {
        let mut robot = controller(false);
        let mut stream = Stream::new(Port::Primary);
        let mut seen = Vec::new();
        for _ in 0..500 {
            robot.step();
            robot.feed(&mut stream);
            seen.push(taken(&mut stream));
        }
        seen.retain(|bytes| !bytes.is_empty());
        // The first at once.
        assert_eq!(seen.len(), 11);
        let first = packages(&seen[0]);
        assert_eq!(first.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [ROBOT_MESSAGE, ROBOT_STATE]);
        assert_eq!(first[0].1[9..20], *b"\x03\x09URControl");
        let parts = packages(first[1].1);
        assert_eq!(parts.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [0, 1, 4, 5, 9, 3, 2, 6, 7, 8, 11, 12]);
        // Sizes with the header of 5, as on the client interface's page and of the maker's own dump of a state.
        let sizes: Vec<usize> = parts.iter().map(|(_, content)| content.len() + 5).collect();
        assert_eq!(sizes, [47, 251, 101, 225, 53, 75, 37, 445, 61, 9, 26, 8]);
        let communication =
            [&[0, 0, 1, 0xc2, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0x3f, 0xc0, 0, 0, 0x40, 0x60, 0, 0][..], &[0, 1, 1]];
        assert_eq!([parts[10].1, parts[11].1], communication);
        // Power off.
        assert_eq!(parts[0].1[8 + 7], 3);
        let kinematics = parts[3].1;
        assert_eq!(double(kinematics, 24 + 48 + 8), UR10E.dh[1].a);
        assert_eq!(double(kinematics, 24 + 96), UR10E.dh[0].d);
        assert!((double(kinematics, 24 + 144) - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        let later = packages(&seen[9]);
        assert_eq!(packages(later[0].1).len(), 9);
    }
}
