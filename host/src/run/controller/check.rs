//! Whether a robot is the cell's, and stands so that a print can begin: a judgement of what the controller told, without sockets.

use super::program::ours;
use super::view::{Standing, View, table};
use crate::config::Cell;
use crate::failure::{Exit, Failure, Problem};
use crate::link::dashboard::remedy;
use crate::link::rtde::look::State;
use crate::link::rtde::program::ProgramState;
use crate::link::rtde::ready::{PAUSED, PLAYING, STOPPED};
use crate::robot::calibration;
use crate::sim::ur::SERIAL_NUMBER;
use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// Most by which the controller's flange, by its table, may be from the cell's at any joints (m): a hundredth of a millimetre is
/// far above what rounding and both kinds of calibration files leave.
pub const KINEMATICS_MAX: f64 = 1e-5;
/// Most by which the controller's tool, by its own pose, may be from the cell's arm at the joints it has now (m, rad).
pub const POSE_MAX: [f64; 2] = [1e-4, 1e-3];
/// Most by which payload (kg) and its centre (m) may differ from the cell's.
pub const PAYLOAD_MAX: f64 = 0.1;
/// See [`PAYLOAD_MAX`].
pub const PAYLOAD_COG_MAX: f64 = 0.01;
/// What the finding on the program is called.
pub const PROGRAM: &str = "program";
/// A tool that differs by more is told of (m, rad).
const TOOL_MAX: [f64; 2] = [1e-3, 0.01];
/// Controllers below this are CB3's and serve 125 Hz.
const MAJOR_E_SERIES: u32 = 5;

/// How one thing stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// As it shall be.
    Good,
    /// To be known, no obstacle; or it could not be compared.
    Note,
    /// No print can begin; what to do, and the exit code's class.
    Bad {
        /// What to do.
        action: String,
        /// The class.
        exit: Exit,
    },
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What.
    pub what: &'static str,
    /// What was found.
    pub text: String,
    /// How it stands.
    pub verdict: Verdict,
}

impl Finding {
    fn good(what: &'static str, text: impl Into<String>) -> Self {
        Self { what, text: text.into(), verdict: Verdict::Good }
    }

    fn note(what: &'static str, text: impl Into<String>) -> Self {
        Self { what, text: text.into(), verdict: Verdict::Note }
    }

    fn bad(what: &'static str, text: impl Into<String>, exit: Exit, action: impl Into<String>) -> Self {
        Self { what, text: text.into(), verdict: Verdict::Bad { action: action.into(), exit } }
    }
}

/// Everything that was looked at, in the order in which a person mends it.
pub fn judge(cell: &Cell, view: &View) -> Vec<Finding> {
    let mut findings = vec![
        model(cell, &view.standing, Some(view.controller.major)),
        serial(cell, &view.standing),
        software(cell, view),
        remote(view),
        safety(view),
        mode(view),
        slider(view),
        kinematics(cell, view),
        pose(cell, view),
        tool(cell, view),
        payload(cell, view),
        payload_cog(cell, view),
        program(view),
    ];
    findings.extend(view.inputs.as_ref().map(inputs));
    findings
}

/// Whether the robot is the cell's, as far as its dashboard tells: before it is powered or its program plays.
pub fn identity(cell: &Cell, standing: &Standing) -> Vec<Finding> {
    let major = standing.software.map(|[major, ..]| major);
    vec![model(cell, standing, major), serial(cell, standing)]
}

/// Whether the robot is the cell's, and serves the rate that it wants.
pub fn is_meant(cell: &Cell, view: &View) -> bool {
    let mut findings = identity(cell, &view.standing);
    findings.push(software(cell, view));
    failure(&findings).is_none()
}

/// Whether the cell's robot is simulated, and its controller shows itself as one of Screed or with the serial number that the cell
/// gives a simulated one: behind a loopback address there may be the forwarded port of a real robot.
pub fn is_simulated(cell: &Cell, standing: &Standing) -> bool {
    let known = [Some(SERIAL_NUMBER), cell.robot.serial.as_deref()];
    cell.robot.simulated && standing.serial.is_some() && known.contains(&standing.serial.as_deref())
}

/// The failure that the bad ones make; none where there are none.
pub fn failure(findings: &[Finding]) -> Option<Failure> {
    let mut bad = findings.iter().filter_map(|finding| match &finding.verdict {
        Verdict::Bad { action, exit } => Some((finding, action, *exit)),
        Verdict::Good | Verdict::Note => None,
    });
    let problem = |(finding, action, _): (&Finding, &String, Exit)| Problem {
        message: format!("{}: {}", finding.what, finding.text),
        excerpt: None,
        remedy: Some(action.clone()),
    };
    let first = bad.next()?;
    Some(Failure { exit: first.2, problems: std::iter::once(first).chain(bad).map(problem).collect() })
}

/// Without spaces, lower case, and without the letter of the e-Series, which the dashboard leaves out.
fn stem(name: &str) -> String {
    let plain: String = name.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_ascii_lowercase();
    plain.trim_end_matches('e').to_owned()
}

/// Of the generation before the e-Series, whose software is below 5; all others need newer software.
const CB3: [&str; 3] = ["ur3", "ur5", "ur10"];

fn model(cell: &Cell, standing: &Standing, major: Option<u32>) -> Finding {
    const WHAT: &str = "robot model";
    let own = &cell.robot.model;
    let Some(found) = &standing.model else {
        return Finding::note(WHAT, format!("{own} in the cell; the controller's software is too old to tell its own"));
    };
    // Successors keep a geometry under another name; which one a controller tells is not known.
    let nominal = ur::ALL.iter().find(|arm| arm.name == own).map(|arm| arm.dh);
    let fits = |arm: &&Arm<6>| Some(arm.dh) == nominal && stem(arm.name) == stem(found);
    let action = "set model in [robot] to the robot that is there, or address in [link] to the robot that is meant";
    let text = format!("expected {own}, found {found}");
    if !ur::ALL.iter().any(|arm| fits(&arm)) {
        return Finding::bad(WHAT, text, Exit::Input, action);
    }
    // The dashboard calls a UR10e and a UR10 the same.
    match major {
        Some(major) if (major < MAJOR_E_SERIES) != CB3.contains(&own.as_str()) => {
            let kind = if major < MAJOR_E_SERIES { "a CB3's" } else { "an e-Series'" };
            Finding::bad(WHAT, format!("{text} with software {major}, {kind}"), Exit::Input, action)
        }
        _ => Finding::good(WHAT, format!("{found}, {own} in the cell")),
    }
}

fn serial(cell: &Cell, standing: &Standing) -> Finding {
    const WHAT: &str = "serial number";
    match (&cell.robot.serial, &standing.serial) {
        (Some(own), Some(found)) if own == found => Finding::good(WHAT, found),
        (Some(own), Some(found)) => {
            let action =
                "set address in [link] to the robot that is meant, or serial in [robot] to the one that is there";
            Finding::bad(WHAT, format!("expected {own}, found {found}"), Exit::Input, action)
        }
        (Some(_), None) => Finding::bad(
            WHAT,
            "the controller's software is too old to tell it",
            Exit::Input,
            "update the software (3.12 or 5.6 and newer tell it)",
        ),
        (None, found) => {
            let found = found.as_deref().unwrap_or("not told");
            if is_simulated(cell, standing) {
                return Finding::good(WHAT, found);
            }
            if cell.robot.simulated {
                let text = format!(
                    "{found}; not the number of a simulated controller of Screed: it may be a real robot, or the cell lacks serial"
                );
                return Finding::note(WHAT, text);
            }
            let action =
                format!("compare it with the plate on the robot's base and add serial = \"{found}\" to [robot]");
            Finding::bad(WHAT, format!("{found}; the cell of a real robot has to name it"), Exit::Input, action)
        }
    }
}

fn software(cell: &Cell, view: &View) -> Finding {
    const WHAT: &str = "software";
    let (version, rate) = (view.controller, cell.link.rate_hz);
    let text = format!("{}.{}.{}.{}, {rate} Hz wanted", version.major, version.minor, version.bugfix, version.build);
    if version.major < MAJOR_E_SERIES && rate > 125 {
        return Finding::bad(WHAT, text + "; it serves at most 125", Exit::Input, "set rate_hz = 125 in [link]");
    }
    Finding::good(WHAT, text)
}

fn remote(view: &View) -> Finding {
    const WHAT: &str = "remote control";
    match view.standing.remote {
        Some(true) => Finding::good(WHAT, "on"),
        None => Finding::good(WHAT, "not known to this software, which needs none"),
        Some(false) => Finding::note(
            WHAT,
            "off: where the robot has a switch for it at the top right of the teach pendant, power, play and upload are refused until it is on",
        ),
    }
}

fn safety(view: &View) -> Finding {
    let safety = view.standing.safety;
    match safety.remedy() {
        None => Finding::good("safety", safety.name()),
        Some(remedy) => Finding::bad("safety", safety.name(), Exit::SafetyStop, remedy.action),
    }
}

fn mode(view: &View) -> Finding {
    let mode = view.standing.mode;
    match mode.remedy() {
        None => Finding::good("robot", mode.name()),
        Some(remedy) => Finding::bad("robot", mode.name(), Exit::Link, remedy.action),
    }
}

/// What to do where the cell's geometry is not the controller's.
fn geometry_action(cell: &Cell) -> &'static str {
    match &cell.robot.calibration {
        None => {
            "set calibration = \"controller\" in [robot], or write the unit's file with screed robot calibration --out and set \
             calibration to it; if the model is another, set model"
        }
        Some(_) => "the calibration is of another unit or model: write this unit's with screed robot calibration --out",
    }
}

/// `servoj` runs in slowed time when the slider stands below 100 %: its lag and the error at corners grow, and setpoints are passed
/// over.
fn slider(view: &View) -> Finding {
    const WHAT: &str = "speed slider";
    match view.state.target_speed_fraction {
        None => Finding::note(WHAT, "the controller's software does not tell it"),
        Some(fraction) if fraction >= 1.0 => Finding::good(WHAT, "at 100 %"),
        Some(fraction) => {
            let action = "set it to 100 % at the teach pendant; Screed slows a print by its own path clock";
            Finding::bad(WHAT, format!("at {:.0} %, and slows servoj", fraction * 1e2), Exit::Link, action)
        }
    }
}

fn kinematics(cell: &Cell, view: &View) -> Finding {
    const WHAT: &str = "kinematics";
    let nominal = ur::ALL.iter().find(|arm| arm.name == cell.robot.model).unwrap_or(&cell.robot.arm);
    let unit = match calibration::of_table(&table(&view.kinematics), nominal) {
        Ok(unit) => unit,
        Err(fault) => {
            return Finding::bad(
                WHAT,
                fault.to_string(),
                Exit::Input,
                "set model in [robot] to the robot that is there",
            );
        }
    };
    let apart = calibration::distance(&cell.robot.arm, &unit.arm);
    let kind = match &cell.robot.calibration {
        None => "nominal",
        Some(_) => "calibrated",
    };
    let text = format!(
        "the controller's flange is up to {:.3} mm from nominal, and {:.3} mm from the cell's ({kind})",
        unit.deviation_max * 1e3,
        apart * 1e3
    );
    if apart <= KINEMATICS_MAX {
        return Finding::good(WHAT, text);
    }
    Finding::bad(WHAT, text, Exit::Input, geometry_action(cell))
}

fn vector([x, y, z, rx, ry, rz]: [f64; 6]) -> Pose {
    Pose::from_rotation_vector(Vector3::new(x, y, z), Vector3::new(rx, ry, rz))
}

/// How far two poses are apart (m, rad).
fn apart(a: &Pose, b: &Pose) -> [f64; 2] {
    let between = a.inverse() * *b;
    [between.translation.norm(), between.rotation_vector().norm()]
}

/// Both come in one package, so they are of one cycle, whether the arm moves or not.
fn pose(cell: &Cell, view: &View) -> Finding {
    const WHAT: &str = "tool pose";
    let state = &view.state;
    let Some(offset) = state.tcp_offset else {
        return Finding::note(WHAT, "not compared: the controller's software does not tell its tool");
    };
    let computed = cell.robot.arm.forward(&JointPos(state.actual_q)) * vector(offset);
    let [distance, angle] = apart(&computed, &vector(state.actual_tcp_pose));
    let text =
        format!("the controller's is {:.4} mm and {:.4} deg from the cell's arm", distance * 1e3, angle.to_degrees());
    if distance <= POSE_MAX[0] && angle <= POSE_MAX[1] {
        return Finding::good(WHAT, text);
    }
    Finding::bad(WHAT, text, Exit::Input, geometry_action(cell))
}

/// Motion does not use the controller's tool: setpoints are joints, and Screed has its own. Its safety planes and its pendant do.
fn tool(cell: &Cell, view: &View) -> Finding {
    const WHAT: &str = "tool";
    let Some(offset) = view.state.tcp_offset else {
        return Finding::note(WHAT, "the controller's software does not tell its tool");
    };
    let [distance, angle] = apart(&vector(offset), &cell.tool.flange_from_tcp);
    if distance <= TOOL_MAX[0] && angle <= TOOL_MAX[1] {
        return Finding::good(WHAT, "the controller's is the cell's");
    }
    let text = format!(
        "the controller's is {:.1} mm and {:.1} deg from the cell's: the print does not use it, but the controller's safety \
         planes and tool speed limits do",
        distance * 1e3,
        angle.to_degrees()
    );
    Finding::note(WHAT, text)
}

const INSTALLATION: &str = "correct the payload in the controller's installation, or in [tool] of the cell file";

fn payload(cell: &Cell, view: &View) -> Finding {
    const WHAT: &str = "payload";
    match (view.state.payload, cell.tool.payload) {
        (None, None) => Finding::note(WHAT, "the controller's software does not tell it"),
        (None, Some(own)) => {
            Finding::note(WHAT, format!("{own} kg in the cell; the controller's software does not tell its own"))
        }
        (Some(found), None) => Finding::note(WHAT, format!("{found} kg; the cell has none to compare it with")),
        (Some(found), Some(own)) if (found - own).abs() <= PAYLOAD_MAX => Finding::good(WHAT, format!("{found} kg")),
        (Some(found), Some(own)) => {
            Finding::bad(WHAT, format!("expected {own} kg, found {found} kg"), Exit::Input, INSTALLATION)
        }
    }
}

fn payload_cog(cell: &Cell, view: &View) -> Finding {
    const WHAT: &str = "payload's centre";
    let millimetres = |cog: [f64; 3]| format!("({})", cog.map(|value| format!("{:.1}", value * 1e3)).join(", "));
    match (view.state.payload_cog, cell.tool.payload_cog) {
        (None, _) => Finding::note(WHAT, "the controller's software does not tell it"),
        (Some(found), None) => {
            Finding::note(WHAT, format!("{} mm; the cell has none to compare it with", millimetres(found)))
        }
        (Some(found), Some(own)) => {
            let text = format!("{} mm, {} mm in the cell", millimetres(found), millimetres(own));
            match (Vector3::from(found) - Vector3::from(own)).norm() {
                apart if apart <= PAYLOAD_COG_MAX => Finding::good(WHAT, text),
                _ => Finding::bad(WHAT, text, Exit::Input, INSTALLATION),
            }
        }
    }
}

/// How far Screed's program is; none where it does not play.
pub fn playing(view: &View) -> Option<ProgramState> {
    let State { runtime_state, program_state, .. } = view.state;
    ours(program_state, view.is_counting).filter(|_| runtime_state == PLAYING)
}

fn inputs(found: &Result<(), String>) -> Finding {
    const WHAT: &str = "registers";
    let Err(text) = found else { return Finding::good(WHAT, "free") };
    let Failure { mut problems, exit } = Failure::told(Exit::Link, text);
    match problems.pop() {
        Some(Problem { message, remedy: Some(action), .. }) => Finding::bad(WHAT, message, exit, action),
        _ => Finding::bad(WHAT, text, Exit::Link, "see the controller's log"),
    }
}

fn program(view: &View) -> Finding {
    const UPLOAD: &str = "screed robot play --upload, or give --upload to screed print";
    let name = &view.standing.program_name;
    if !view.standing.safety.is_well() {
        return Finding::note(PROGRAM, format!("{name}: looked at when the safety system is well"));
    }
    match view.state.runtime_state {
        PLAYING => match playing(view) {
            Some(ProgramState::Following) => Finding::good(PROGRAM, "Screed's plays and follows setpoints"),
            Some(_) => Finding::good(PROGRAM, "Screed's plays and waits for setpoints"),
            None => {
                let text = "one plays whose output registers are not Screed's: another program, or one of an older Screed or \
                            another register_offset";
                Finding::bad(PROGRAM, text, Exit::Link, format!("screed robot stop, then {UPLOAD}"))
            }
        },
        STOPPED => Finding::bad(PROGRAM, format!("none plays (loaded: {name})"), Exit::Link, UPLOAD),
        PAUSED => Finding::bad(PROGRAM, format!("{name}: {}", remedy::PAUSED.cause), Exit::Link, remedy::PAUSED.action),
        state => Finding::bad(
            PROGRAM,
            format!("{name} is on its way to another state (runtime state {state})"),
            Exit::Link,
            "wait a moment, then look again",
        ),
    }
}
