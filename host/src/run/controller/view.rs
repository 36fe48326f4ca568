//! What a controller tells of itself, read once: dashboard, RTDE, primary interface. Nothing is written.

use super::{ControllerError, DashboardLine, Line, Place};
use crate::link::dashboard::{self, ProgramState, RobotMode, Safety, Version};
use crate::link::primary::{Kinematics, Primary};
use crate::link::rtde::look::{Outputs, State};
use crate::link::rtde::reader::RtdeReader;
use crate::link::rtde::wire::PackageKind;
use crate::link::rtde::{ControllerVersion, LinkError, TextMessage};
use crate::robot::calibration::ControllerTable;
use screed_kernel::units::Nanos;
use std::time::{Duration, Instant};

/// How long a state may take to come.
const PATIENCE: Duration = Duration::from_secs(5);
/// By then (s, the controller's time) Screed's program has counted on: it counts every cycle, of 8 ms at most.
const COUNTED_AFTER: f64 = 0.2;

/// States a second that are looked at; with protocol 1 the controller sends as many as it does.
const RATE_HZ: u32 = 25;

/// What was told.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// What the dashboard tells.
    pub standing: Standing,
    /// The controller's software, as RTDE tells it.
    pub controller: ControllerVersion,
    /// Position, program, tool and payload.
    pub state: State,
    /// Whether the program register is counted on: one of Screed's plays.
    pub is_counting: bool,
    /// Its table.
    pub kinematics: Kinematics,
    /// Whether the registers that Screed writes are free, or why not; none where it was not asked ([`super::inputs`]).
    pub inputs: Option<Result<(), String>>,
}

/// What the dashboard tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Standing {
    /// The arm's model; old software does not tell.
    pub model: Option<String>,
    /// Its serial number; old software does not tell.
    pub serial: Option<String>,
    /// The dashboard's software.
    pub software: Option<Version>,
    /// Whether it takes commands from the network; controllers before the e-Series do not tell, and take them.
    pub remote: Option<bool>,
    /// Power and brakes.
    pub mode: RobotMode,
    /// The safety system.
    pub safety: Safety,
    /// The program.
    pub program: ProgramState,
    /// Its name.
    pub program_name: String,
}

/// Looks at a controller whose program uses registers from `register_offset` on.
///
/// # Errors
/// [`ControllerError`].
pub fn view(place: &Place, register_offset: u8) -> Result<View, ControllerError> {
    let standing = standing(&mut DashboardLine::connect(place)?)?;
    let kinematics = kinematics(place)?;
    let mut look = LookLine::connect(place, register_offset)?;
    let (first, controller) = look.next()?;
    let until = Instant::now() + PATIENCE;
    loop {
        let (state, _) = look.next()?;
        let is_counting = state.program_count != first.program_count;
        if is_counting || state.timestamp - first.timestamp > COUNTED_AFTER || Instant::now() > until {
            return Ok(View { standing, controller, state, is_counting, kinematics, inputs: None });
        }
    }
}

/// Asks the dashboard for everything it has to tell.
///
/// # Errors
/// [`ControllerError`].
pub fn standing(line: &mut DashboardLine) -> Result<Standing, ControllerError> {
    let safety = match line.ask_if_known(&dashboard::SAFETY_STATUS)? {
        Some(safety) => safety,
        None => line.ask(&dashboard::SAFETY_MODE)?,
    };
    let (program, program_name) = line.ask(&dashboard::PROGRAM_STATE)?;
    Ok(Standing {
        model: line.ask_if_known(&dashboard::MODEL)?,
        serial: line.ask_if_known(&dashboard::SERIAL)?,
        software: line.ask_if_known(&dashboard::VERSION)?,
        remote: line.ask_if_known(&dashboard::REMOTE_CONTROL)?,
        mode: line.ask(&dashboard::ROBOT_MODE)?,
        safety,
        program,
        program_name,
    })
}

/// The arm's table, which the controller sends to whom connects.
///
/// # Errors
/// [`ControllerError`].
pub fn kinematics(place: &Place) -> Result<Kinematics, ControllerError> {
    let mut line = Line::connect("the primary interface", &place.host, place.primary)?;
    let (mut reader, until, mut bytes) = (Primary::default(), Instant::now() + PATIENCE, [0; 4096]);
    loop {
        match line.receive(&mut bytes, until)? {
            None => return Err(line.silent(PATIENCE)),
            Some(0) => return Err(line.closed()),
            Some(count) => reader.handle_bytes(bytes.get(..count).unwrap_or(&[]))?,
        }
        if let Some(kinematics) = reader.kinematics() {
            return Ok(*kinematics);
        }
    }
}

/// Row by row.
pub fn table(kinematics: &Kinematics) -> ControllerTable {
    let Kinematics { theta, a, d, alpha, .. } = kinematics;
    std::array::from_fn(|joint| [theta[joint], a[joint], d[joint], alpha[joint]])
}

/// A connection that looks at states.
pub(super) struct LookLine<'a> {
    place: &'a Place,
    line: Line,
    outputs: Outputs,
    reader: RtdeReader,
    began: Instant,
}

impl<'a> LookLine<'a> {
    pub(super) fn connect(place: &'a Place, register_offset: u8) -> Result<Self, ControllerError> {
        Self::with(place, Outputs::all(register_offset))
    }

    fn with(place: &'a Place, outputs: Outputs) -> Result<Self, ControllerError> {
        let reader = RtdeReader::of(outputs.names(), RATE_HZ, PATIENCE.as_nanos() as u64)?;
        Ok(Self {
            place,
            line: Line::connect("RTDE", &place.host, place.rtde)?,
            outputs,
            reader,
            began: Instant::now(),
        })
    }

    /// The next state.
    pub(super) fn next(&mut self) -> Result<(State, ControllerVersion), ControllerError> {
        self.by(Instant::now() + PATIENCE)?.ok_or_else(|| self.line.silent(PATIENCE))
    }

    /// The newest state, should one come until then. Of a controller that lacks newer fields it is asked for without them, on
    /// a fresh connection.
    pub(super) fn by(&mut self, until: Instant) -> Result<Option<(State, ControllerVersion)>, ControllerError> {
        let mut bytes = [0; 4096];
        loop {
            let now = Nanos(self.began.elapsed().as_nanos() as u64);
            let count = self.reader.poll_transmit(now, &mut bytes);
            self.line.send(bytes.get(..count).unwrap_or(&[]))?;
            let count = match self.line.receive(&mut bytes, until)? {
                None => return Ok(None),
                Some(0) => return Err(self.reader.handle_closed().into()),
                Some(count) => count,
            };
            let (mut seen, mut broken) = (None, false);
            let result = self.reader.handle_bytes(now, bytes.get(..count).unwrap_or(&[]), |values| {
                seen = self.outputs.decode(values);
                broken |= seen.is_none();
            });
            match result {
                Err(error) if self.outputs.leave_out(&error) => *self = Self::with(self.place, self.outputs.clone())?,
                Ok(()) if broken => return Err(LinkError::Malformed { kind: PackageKind::Data }.into()),
                _ => result?,
            }
            if let (Some(state), Some(controller)) = (seen, self.reader.controller()) {
                return Ok(Some((state, controller)));
            }
        }
    }

    /// The next text of the controller, oldest first.
    pub(super) fn poll_text(&mut self) -> Option<TextMessage> {
        self.reader.poll_text().map(|(text, _)| text)
    }
}
