//! A simulated UR controller: RTDE and the dashboard for many clients, uploaded scripts, a model of the arm's motion. A state
//! machine: bytes are arguments, and [`Controller::step`] is one control cycle, so that it runs in real time and in virtual
//! time alike.
//!
//! What is modelled and what is not is said where it happens: [`servo`] and [`body`] for the motion, [`script`] for the
//! program, [`session`] for RTDE, [`dashboard`] for its commands, [`robot`] for power and safety, [`act`] for what goes wrong on
//! demand.

pub mod act;
pub mod body;
mod cell;
mod cycle;
pub mod dashboard;
mod fields;
pub mod inputs;
mod machine;
mod messages;
mod outputs;
mod panel;
mod properties;
pub mod record;
pub mod robot;
pub mod script;
pub mod server;
pub mod servo;
pub mod session;
pub mod streams;
#[cfg(test)]
mod tests;

pub use session::ClientId;

use crate::config::Cell;
use crate::link::rtde::wire::Protocol;
use body::Body;
use cell::CellInputs;
use dashboard::Desk;
use inputs::Fieldbus;
use machine::{Machine, WatchdogRequest};
use messages::{Mailbox, Message};
use outputs::Outputs;
use robot::{Generation, Power, Robot, Safety};
use screed_kernel::arm::Arm;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use session::{Exchange, Session};
use std::collections::{BTreeMap, VecDeque};

/// Control cycles per second of the e-Series (Hz).
pub const CYCLE_RATE: u32 = Generation::ESeries.cycle_rate();
/// The time before the first cycle (s): clients wait for a controller that runs less than 40 s.
const SECONDS_AT_START: u64 = 41;
/// Secondary programs that run at once.
const SECONDARY_MAX: usize = 8;
/// Lines of the log that are kept.
const LOG_MAX: usize = 1000;
/// Longest line of the log, message and popup (bytes): a string of URScript has at most 1,023 characters.
const LINE_MAX: usize = 1023;
/// Reasons that wait to be said on the controller's own output.
const ANNOUNCED_MAX: usize = 64;
/// The programs on the controller's disk, but for the installed one.
const PROGRAMS: [(&str, &str); 2] = [("wait_program.urp", WAIT_PROGRAM), ("rtde_control_loop.urp", CONTROL_LOOP)];
/// The installed one's name.
const INSTALLED: &str = "screed.urp";
/// Waits, for trying the dashboard.
const WAIT_PROGRAM: &str = "def wait_program():\n  while (True):\n    sleep(1)\n  end\nend\n";
/// What UR's example_control_loop.py talks to: it asks for a pose with output register 0 at 1, goes there along a line once input
/// register 0 is 1, and confirms with 0 until the client does.
const CONTROL_LOOP: &str = "def rtde_control_loop():
  global wanted = p[0, 0, 0, 0, 0, 0]
  rtde_set_watchdog(\"input_int_register_0\", 1, \"PAUSE\")
  thread read():
    while True:
      pose = p[0, 0, 0, 0, 0, 0]
      axis = 0
      while axis < 6:
        pose[axis] = read_input_float_register(axis)
        axis = axis + 1
      end
      wanted = pose
      sync()
    end
  end
  reader = run read()
  write_output_integer_register(0, 1)
  while True:
    if read_input_integer_register(0) == 1 and wanted != p[0, 0, 0, 0, 0, 0]:
      movel(wanted, a=1.2, v=0.08)
      write_output_integer_register(0, 0)
      while read_input_integer_register(0) == 1:
        sync()
      end
      write_output_integer_register(0, 1)
    end
    sync()
  end
end
";
/// What the controller says its serial number is; a real one is of the same form.
pub const SERIAL_NUMBER: &str = "20220000000";

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
    /// Which controller.
    pub generation: Generation,
    /// Whether motors have power and brakes are open when it is switched on.
    pub powered: bool,
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
            generation: Generation::ESeries,
            powered: true,
        }
    }
}

/// Joint speeds of the UR15 (°/s), whose base and wrist have the lengths of the UR8 Long's and the UR18's.
const SPEEDS_OF_KIN: &str = "180,180,240,300,300,300";

/// Why there is no controller.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// An arm whose data sheet gives no speeds, and none were set.
    #[error(
        "no source gives the joint speeds of {model}; say them, for example those of the ur15, its next of kin (screed sim ur \
         --model {model} --joint-speeds-deg-s {SPEEDS_OF_KIN}), or give a cell file with this model and \
         joint_velocity_max_deg_s in [robot]"
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
    options: Options,
    exchange: Exchange,
    sessions: BTreeMap<ClientId, Session>,
    clients: u64,
    machine: Option<Machine>,
    /// The name of the program that runs or is held.
    running: Option<String>,
    mailbox: Mailbox,
    /// The safety mode that was told last.
    safety_told: i32,
    secondary: Vec<Machine>,
    runtime: RuntimeState,
    fault: Option<String>,
    /// A client has been told of it.
    fault_told: bool,
    /// Why programs stopped or were refused, until somebody takes it.
    announced: VecDeque<String>,
    robot: Robot,
    body: Body,
    watchdogs: Vec<Watchdog>,
    outputs: Outputs,
    popup: Option<String>,
    /// The program waits for the popup to be closed.
    popup_holds: bool,
    log: VecDeque<String>,
    record: CycleRecord,
    /// The time of cycle 0 (s).
    first_second: u64,
    /// The program that is loaded: its name, and its text where it is not the installed one.
    loaded: (&'static str, Option<&'static str>),
    desk: Desk,
    cell: CellInputs,
    fieldbus: Fieldbus,
    /// Where the speed slider stands, 0 to 1.
    speed_slider: f64,
    /// First cycle in which RTDE sends again.
    silent_until: u64,
    /// First cycle in which there is time for data packages again.
    skip_until: u64,
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
        let (generation, rate) = (options.generation, options.generation.cycle_rate());
        let (start_q, tool, autoplay) = (options.start_q, options.flange_from_tcp, options.autoplay && options.powered);
        let power = if options.powered { Power::Running } else { Power::Off };
        let mut controller = Self {
            options,
            exchange: Exchange::new(generation),
            sessions: BTreeMap::new(),
            clients: 0,
            machine: None,
            running: None,
            mailbox: Mailbox::default(),
            safety_told: 1,
            secondary: Vec::new(),
            runtime: RuntimeState::Stopped,
            fault: None,
            fault_told: false,
            announced: VecDeque::new(),
            robot: Robot::new(power),
            body: Body::new(arm, speed_max, start_q, tool, 1.0 / f64::from(rate)),
            watchdogs: Vec::new(),
            outputs: Outputs::new(),
            popup: None,
            popup_holds: false,
            log: VecDeque::new(),
            record: CycleRecord {
                cycle: 0,
                timestamp: timestamp(SECONDS_AT_START, 0, rate),
                received: false,
                packages: 0,
                seq: 0,
                registers: [0.0; 6],
                target_q: start_q,
                actual_q: start_q,
                runtime_state: RuntimeState::Stopped,
            },
            first_second: SECONDS_AT_START,
            loaded: (INSTALLED, None),
            desk: Desk::default(),
            cell: CellInputs::default(),
            fieldbus: Fieldbus::Off,
            speed_slider: 1.0,
            silent_until: 0,
            skip_until: 0,
        };
        if autoplay {
            // Why not is kept, and told to every client.
            let _ = controller.play();
        }
        Ok(controller)
    }

    /// Accepts no newer protocol of RTDE than this from now on.
    pub const fn limit_protocol(&mut self, newest: Protocol) {
        self.exchange.protocol = newest;
    }

    /// A client of RTDE has connected.
    pub fn connect(&mut self) -> ClientId {
        self.clients += 1;
        let id = ClientId(self.clients);
        let mut session = Session::new(id);
        session.silent_until = self.silent_until;
        session.begin(self.record.cycle, self.exchange.rate);
        self.sessions.insert(id, session);
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
        let Some(session) = self.sessions.get_mut(&client) else { return };
        let was_streaming = session.is_streaming();
        session.handle_bytes(bytes, &mut self.exchange);
        if let (false, true, false, Some(fault)) = (was_streaming, session.is_streaming(), self.fault_told, &self.fault)
        {
            session.greet(fault);
            self.fault_told = true;
        }
        for complaint in session.take_complaints() {
            self.log(&complaint);
        }
    }

    /// Moves bytes for a client into `out`; how many. Call it until it gives 0.
    pub fn poll_transmit(&mut self, client: ClientId, out: &mut [u8]) -> usize {
        self.sessions.get_mut(&client).map_or(0, |session| session.poll_transmit(out))
    }

    /// Takes a program or a command that came over one of the script ports: a program replaces the one that runs, or with `sec` runs beside it.
    /// One that cannot be loaded, or not be run in this state, is announced and changes nothing else.
    pub fn upload(&mut self, text: &str) {
        if self.obey(text) {
            return;
        }
        let script = match script::parse(text) {
            Ok(script) => script,
            Err(error) => {
                self.tell(&Message::of_error(&error, text));
                return self.announce(format!("script refused: {error}"));
            }
        };
        if !self.robot.is_ready() {
            return self.announce("script refused: the robot is not ready to move".to_owned());
        }
        let machine = Machine::new(script.clone());
        self.log(&format!("script {} taken", machine.name()));
        if !script.secondary {
            self.begin_program(machine);
        } else if self.secondary.len() < SECONDARY_MAX {
            self.secondary.push(machine);
        } else {
            self.announce(format!("script refused: more than {SECONDARY_MAX} secondary programs"));
        }
    }

    fn begin_program(&mut self, machine: Machine) {
        self.end_program();
        self.fault = None;
        let name = machine.name().to_owned();
        self.tell(&Message::Program { name: name.clone(), started: true });
        self.running = Some(name);
        self.machine = Some(machine);
        self.runtime = RuntimeState::Playing;
    }

    /// Power, brakes, safety.
    pub const fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The program's state.
    pub const fn runtime_state(&self) -> RuntimeState {
        self.runtime
    }

    /// Which controller it is.
    pub const fn generation(&self) -> Generation {
        self.options.generation
    }

    /// The robot's serial number.
    pub const fn serial_number(&self) -> &'static str {
        SERIAL_NUMBER
    }

    /// The arm's model as the dashboard names it: the e-Series' without its e.
    pub fn model_name(&self) -> String {
        self.body.arm.name.trim_end_matches('e').to_uppercase()
    }

    /// What happened in the last cycle.
    pub const fn last_cycle(&self) -> &CycleRecord {
        &self.record
    }

    /// Why the program does not run, or no longer.
    pub fn program_fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Why programs stopped or were refused since this was last asked, oldest first.
    pub fn take_announced(&mut self) -> VecDeque<String> {
        std::mem::take(&mut self.announced)
    }

    /// Whether the robot stands in a protective stop.
    pub const fn is_protective_stop(&self) -> bool {
        matches!(self.robot.safety(), Safety::ProtectiveStop { .. })
    }
}

/// Cycle counts are exact, so stamps are the nearest doubles to a multiple of the period and nothing adds up.
fn timestamp(first_second: u64, cycle: u64, rate: u32) -> f64 {
    (first_second * u64::from(rate) + cycle) as f64 / f64::from(rate)
}

/// The start of a text, cut between characters to so many bytes.
fn shorten(text: &str, most: usize) -> &str {
    let mut end = text.len().min(most);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or("")
}

fn numbers(pose: &Pose) -> [f64; 6] {
    let (t, r) = (pose.translation, pose.rotation_vector());
    [t.x, t.y, t.z, r.x, r.y, r.z]
}
