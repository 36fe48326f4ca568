//! A simulated UR controller: RTDE for many clients, a robot program, a model of `servoj`. A state machine: bytes are
//! arguments, and [`Controller::step`] is one control cycle, so that it runs in real time and in virtual time alike.
//!
//! What is modelled and what is not is said where it happens: [`servo`] for the motion, [`script`] for the program,
//! [`session`] for the protocol. 500 cycles per second as the
//! e-Series has them, whatever the arm.

mod fields;
mod machine;
pub mod record;
pub mod script;
pub mod server;
pub mod servo;
pub mod session;
#[cfg(test)]
mod tests;

pub use session::ClientId;

use crate::config::Cell;
use crate::link::rtde::TextLevel;
use crate::link::rtde::program::WatchdogAction;
use fields::{InputValues, REGISTERS, Snapshot};
use machine::{Machine, Surroundings, WatchdogRequest};
use screed_kernel::arm::Arm;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use script::ScriptError;
use servo::Servo;
use session::{Exchange, Session};
use std::collections::BTreeMap;

/// Control cycles per second (Hz).
pub const CYCLE_RATE: u32 = 500;
/// The timestamp before the first cycle, in cycles: 41 s, because clients wait for a controller that runs less than 40 s.
const CYCLES_AT_START: u64 = 41 * CYCLE_RATE as u64;

/// How a controller is made.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where the joints are when it is switched on (rad).
    pub start_q: JointPos<6>,
    /// The tool centre point set in the installation.
    pub flange_from_tcp: Pose,
    /// First register of [`CycleRecord::seq`] and [`CycleRecord::registers`]: 0 or 24.
    pub register_offset: u8,
    /// The robot program, URScript.
    pub program: String,
    /// Whether it starts with the controller.
    pub autoplay: bool,
}

impl Options {
    /// As a cell file has it, with a program that starts with the controller.
    pub const fn of(cell: &Cell, program: String) -> Self {
        Self {
            start_q: cell.robot.start,
            flange_from_tcp: cell.tool.flange_from_tcp,
            register_offset: cell.link.register_offset,
            program,
            autoplay: true,
        }
    }
}

/// Why there is no controller.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// An arm whose data sheet gives no speeds, and none were set.
    #[error(
        "no source gives the joint speeds of {model}; give a cell file with this model and joint_velocity_max_deg_s in [robot]"
    )]
    NoSpeeds {
        /// The arm.
        model: &'static str,
    },
    /// A start that the arm cannot have.
    #[error(
        "start position of joint {joint}, {value} rad, is outside the arm's range of {min} to {max} rad; choose another start"
    )]
    StartOutOfRange {
        /// Which joint (0 is the base).
        joint: usize,
        /// As asked for (rad).
        value: f64,
        /// Least possible (rad).
        min: f64,
        /// Most possible (rad).
        max: f64,
    },
    /// A register offset that RTDE does not have.
    #[error("register offset {offset}; use 0 or 24")]
    BadOffset {
        /// As asked for.
        offset: u8,
    },
}

/// The state of the robot program, as `runtime_state` tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RuntimeState {
    /// Not running.
    Stopped,
    /// Running.
    Playing,
    /// Held.
    Paused,
}

impl RuntimeState {
    /// The number on the wire.
    pub const fn code(self) -> u32 {
        match self {
            Self::Stopped => 1,
            Self::Playing => 2,
            Self::Paused => 4,
        }
    }
}

/// What happened in one cycle: the bytes the robot received and what it made of them, for independent judging.
#[derive(Clone, Debug, PartialEq)]
pub struct CycleRecord {
    /// Cycles since it was switched on.
    pub cycle: u64,
    /// Its time (s).
    pub timestamp: f64,
    /// Whether an input package arrived since the cycle before.
    pub received: bool,
    /// How many.
    pub packages: u32,
    /// The sequence register.
    pub seq: i32,
    /// The six setpoint registers (rad).
    pub registers: [f64; 6],
    /// Where the controller wants the joints (rad).
    pub target_q: JointPos<6>,
    /// Where they are (rad).
    pub actual_q: JointPos<6>,
    /// The program.
    pub runtime_state: RuntimeState,
}

#[derive(Clone, Debug)]
struct Watchdog {
    request: WatchdogRequest,
    /// Last cycle with an update, or the cycle in which it was set.
    last_update: u64,
}

/// The controller.
#[derive(Clone, Debug)]
pub struct Controller {
    arm: Arm<6>,
    options: Options,
    exchange: Exchange,
    sessions: BTreeMap<ClientId, Session>,
    clients: u64,
    machine: Option<Machine>,
    runtime: RuntimeState,
    fault: Option<String>,
    protective_stop: bool,
    servo: Servo,
    watchdogs: Vec<Watchdog>,
    output_int: [i32; REGISTERS],
    digital: [u8; 3],
    tcp: Pose,
    record: CycleRecord,
}

impl Controller {
    /// Switches a controller on, for any UR arm with known speeds. A program that cannot be loaded does not prevent that:
    /// [`Self::program_fault`] tells, and so does a text message to every client.
    ///
    /// # Errors
    /// [`ControllerError`].
    pub fn new(arm: &Arm<6>, options: Options) -> Result<Self, ControllerError> {
        let arm = *arm;
        let speed_max = arm.velocity_max.known().ok_or(ControllerError::NoSpeeds { model: arm.name })?;
        if !matches!(options.register_offset, 0 | 24) {
            return Err(ControllerError::BadOffset { offset: options.register_offset });
        }
        let limits = arm.position_min.0.into_iter().zip(arm.position_max.0);
        for (joint, (&value, (min, max))) in options.start_q.0.iter().zip(limits).enumerate() {
            if !(min..=max).contains(&value) {
                return Err(ControllerError::StartOutOfRange { joint, value, min, max });
            }
        }
        let inputs = InputValues::new();
        let (owners, updated) = (vec![None; inputs.len()], vec![false; inputs.len()]);
        let start_q = options.start_q;
        let tcp = arm.forward(&start_q) * options.flange_from_tcp;
        let autoplay = options.autoplay;
        let mut controller = Self {
            arm,
            options,
            exchange: Exchange { inputs, owners, updated, packages: 0, rate: CYCLE_RATE },
            sessions: BTreeMap::new(),
            clients: 0,
            machine: None,
            runtime: RuntimeState::Stopped,
            fault: None,
            protective_stop: false,
            servo: Servo::new(speed_max, start_q, 1.0 / f64::from(CYCLE_RATE)),
            watchdogs: Vec::new(),
            output_int: [0; REGISTERS],
            digital: [0; 3],
            tcp,
            record: CycleRecord {
                cycle: 0,
                timestamp: timestamp(0),
                received: false,
                packages: 0,
                seq: 0,
                registers: [0.0; 6],
                target_q: start_q,
                actual_q: start_q,
                runtime_state: RuntimeState::Stopped,
            },
        };
        if autoplay {
            controller.play();
        }
        Ok(controller)
    }

    /// Loads the program afresh and starts it. Not possible in a protective stop.
    pub fn play(&mut self) {
        if self.protective_stop {
            return self.announce("play refused: the robot is in a protective stop".to_owned());
        }
        match script::parse(&self.options.program) {
            Ok(script) => {
                self.fault = None;
                self.machine = Some(Machine::new(script));
                self.runtime = RuntimeState::Playing;
            }
            Err(error) => self.stop_program(Some(&error)),
        }
    }

    /// A client has connected.
    pub fn connect(&mut self) -> ClientId {
        self.clients += 1;
        let id = ClientId(self.clients);
        self.sessions.insert(id, Session::new(id));
        id
    }

    /// A client has gone: its inputs are free for others and keep their values.
    pub fn disconnect(&mut self, client: ClientId) {
        self.sessions.remove(&client);
        for owner in &mut self.exchange.owners {
            if *owner == Some(client) {
                *owner = None;
            }
        }
    }

    /// Whether the controller still wants this connection: not after a broken header, and not when the client does not read.
    pub fn is_connected(&self, client: ClientId) -> bool {
        self.sessions.get(&client).is_some_and(Session::is_open)
    }

    /// Takes bytes of a client, split anywhere; input data is in force from the next cycle on.
    pub fn handle_bytes(&mut self, client: ClientId, bytes: &[u8]) {
        if let Some(session) = self.sessions.get_mut(&client) {
            let was_started = session.is_started();
            session.handle_bytes(bytes, &mut self.exchange);
            if let (false, true, Some(fault)) = (was_started, session.is_started(), &self.fault) {
                session.send_text(TextLevel::Error, fault);
            }
        }
    }

    /// Moves bytes for a client into `out`; how many. Call it until it gives 0.
    pub fn poll_transmit(&mut self, client: ClientId, out: &mut [u8]) -> usize {
        self.sessions.get_mut(&client).map_or(0, |session| session.poll_transmit(out))
    }

    /// What happened in the last cycle.
    pub const fn last_cycle(&self) -> &CycleRecord {
        &self.record
    }

    /// Why the program does not run, or no longer.
    pub fn program_fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Whether the robot stands in a protective stop.
    pub const fn is_protective_stop(&self) -> bool {
        self.protective_stop
    }

    /// One control cycle: inputs, watchdogs, program, motion, outputs.
    pub fn step(&mut self) {
        let cycle = self.record.cycle + 1;
        let packages = std::mem::take(&mut self.exchange.packages);
        self.apply_digital_outputs();
        self.check_watchdogs(cycle);
        let motion = self.run_program(cycle);
        self.move_joints(motion);
        let first = usize::from(self.options.register_offset);
        let mut registers = [0.0; 6];
        for (register, value) in (first..).zip(&mut registers) {
            *value = self.exchange.inputs.double(register);
        }
        self.record = CycleRecord {
            cycle,
            timestamp: timestamp(cycle),
            received: packages > 0,
            packages,
            seq: self.exchange.inputs.int(first),
            registers,
            target_q: self.servo.q,
            actual_q: self.servo.q,
            runtime_state: self.runtime,
        };
        let snapshot = self.snapshot();
        for session in self.sessions.values_mut() {
            session.send_state(&snapshot, &self.exchange.inputs);
        }
    }

    fn apply_digital_outputs(&mut self) {
        let groups = ["standard_digital_output", "configurable_digital_output", "tool_digital_output"];
        for (bits, group) in self.digital.iter_mut().zip(groups) {
            *bits = self.exchange.inputs.digital(group, *bits);
        }
    }

    fn check_watchdogs(&mut self, cycle: u64) {
        let mut barked = None;
        for watchdog in &mut self.watchdogs {
            if self.exchange.updated.get(watchdog.request.input) == Some(&true) {
                watchdog.last_update = cycle;
            }
            let silent = (cycle - watchdog.last_update) as f64 / f64::from(CYCLE_RATE);
            if silent > watchdog.request.period {
                barked = Some(watchdog.request.clone());
            }
        }
        self.exchange.updated.fill(false);
        let Some(WatchdogRequest { period, action, .. }) = barked else { return };
        let because = format!("RTDE watchdog: no update within {period} s, action {action}");
        match action {
            WatchdogAction::Ignore => {}
            WatchdogAction::Pause if self.runtime == RuntimeState::Playing => {
                self.runtime = RuntimeState::Paused;
                self.announce(because);
            }
            WatchdogAction::Pause => {}
            WatchdogAction::Stop => {
                self.end_program();
                self.announce(because);
            }
        }
    }

    fn run_program(&mut self, cycle: u64) -> Option<servo::ServoCommand> {
        let machine = self.machine.as_mut().filter(|_| self.runtime == RuntimeState::Playing)?;
        let mut motion = None;
        let mut requests = Vec::new();
        let ran = machine.step(&mut Surroundings {
            cycle,
            cycles_per_second: f64::from(CYCLE_RATE),
            inputs: &self.exchange.inputs,
            output_int: &mut self.output_int,
            actual_q: self.servo.q.0,
            motion: &mut motion,
            watchdogs: &mut requests,
        });
        for request in requests {
            self.watchdogs.retain(|watchdog| watchdog.request.input != request.input);
            self.watchdogs.push(Watchdog { request, last_update: cycle });
        }
        match ran {
            Ok(true) => motion,
            Ok(false) => {
                self.end_program();
                None
            }
            Err(error) => {
                self.stop_program(Some(&error));
                None
            }
        }
    }

    fn move_joints(&mut self, motion: Option<servo::ServoCommand>) {
        if self.protective_stop {
            self.servo.freeze();
        } else if self.runtime != RuntimeState::Playing {
            self.servo.stop();
        } else if let Err(refused) = self.servo.step(motion) {
            self.protective_stop = true;
            self.runtime = RuntimeState::Paused;
            self.announce(refused.to_string());
        }
    }

    /// The program ends: its watchdogs go with it.
    fn end_program(&mut self) {
        self.machine = None;
        self.watchdogs.clear();
        self.runtime = RuntimeState::Stopped;
    }

    fn stop_program(&mut self, error: Option<&ScriptError>) {
        self.end_program();
        if let Some(error) = error {
            self.announce(format!("robot program stopped: {error}"));
        }
    }

    /// Keeps why the program does not run, and tells every client that has started.
    fn announce(&mut self, fault: String) {
        for session in self.sessions.values_mut().filter(|session| session.is_started()) {
            session.send_text(TextLevel::Error, &fault);
        }
        self.fault = Some(fault);
    }

    fn snapshot(&mut self) -> Snapshot {
        let before = self.tcp;
        self.tcp = self.arm.forward(&self.servo.q) * self.options.flange_from_tcp;
        let turned = Pose { rotation: self.tcp.rotation * before.rotation.transpose(), ..Pose::identity() };
        let rate = f64::from(CYCLE_RATE);
        let speed = (self.tcp.translation - before.translation) * rate;
        let turn = turned.rotation_vector() * rate;
        let playing = self.runtime == RuntimeState::Playing;
        let [standard, configurable, tool] = self.digital.map(u64::from);
        Snapshot {
            timestamp: self.record.timestamp,
            cycle: self.record.cycle,
            target_q: self.servo.q.0,
            target_qd: self.servo.qd.0,
            target_qdd: self.servo.qdd.0,
            tcp_pose: numbers(&self.tcp),
            tcp_speed: [speed.x, speed.y, speed.z, turn.x, turn.y, turn.z],
            tcp_offset: numbers(&self.options.flange_from_tcp),
            target_speed_fraction: self.exchange.inputs.speed_slider(),
            runtime_state: self.runtime.code(),
            // 7: running.
            robot_mode: 7,
            // Bit 0: power on; bit 1: program running.
            robot_status_bits: 1 | u32::from(playing) << 1,
            // 1: normal; 3: protective stop.
            safety_mode: if self.protective_stop { 3 } else { 1 },
            // Bit 0: normal; bit 2: protective stop; bit 10: stopped due to safety.
            safety_status_bits: if self.protective_stop { 1 << 2 | 1 << 10 } else { 1 },
            digital_outputs: standard | configurable << 8 | tool << 16,
            output_int: self.output_int,
        }
    }
}

/// Cycle counts are exact, so stamps are the nearest doubles to a multiple of the period and nothing adds up.
fn timestamp(cycle: u64) -> f64 {
    (CYCLES_AT_START + cycle) as f64 / f64::from(CYCLE_RATE)
}

fn numbers(pose: &Pose) -> [f64; 6] {
    let (t, r) = (pose.translation, pose.rotation_vector());
    [t.x, t.y, t.z, r.x, r.y, r.z]
}
