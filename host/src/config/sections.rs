//! The sections of a cell file, one function each. Each asks for all its keys before it gives up on any, so that one run
//! reports everything that is wrong.

use super::control;
use super::keys;
use super::read::{Document, Section};
use super::{Bound, Cell, Extruder, Limits, Link, LinkKind, Pacing, Part, Realtime, Robot, Tool, Travel};
use crate::link::rtde::file::{self, FileError, RecipeFile};
use crate::robot::calibration::{self, Calibrated};
use nalgebra::Vector3;
use screed_kernel::arm::{Arm, Rating};
use screed_kernel::arms::ur;
use screed_kernel::guard::Plane;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};
use std::path::{Path, PathBuf};

/// The rates that RTDE setpoints can have here (Hz).
pub(super) const RATES_HZ: [i64; 2] = [125, 500];
/// First register of the two ranges that RTDE clients may write.
const REGISTER_OFFSETS: [i64; 2] = [0, 24];
/// What `calibration` says when it is to be read from the controller.
const OF_CONTROLLER: &str = "controller";
const SECTIONS: [&str; 11] =
    ["robot", "tool", "base", "part", "workspace", "limits", "travel", "link", "lead", "extruder", "realtime"];

/// The whole cell; `None` when anything was wrong, which the document then knows.
pub(super) fn cell(document: &mut Document<'_>) -> Option<Cell> {
    let mut top = document.top(&[&SECTIONS[..], &control::TRACKED].concat());
    let name = top.text("name").map(str::to_owned);
    top.finish();
    let robot = robot(document);
    let tool = tool(document);
    let base = pose(document, "base");
    let part = pose(document, "part");
    let workspace = workspace(document);
    let limits = limits(document);
    let travel = travel(document);
    let link = link(document, robot.as_ref().map(|robot| robot.simulated));
    let lead = control::lead(document, link.as_ref());
    let tracked = control::tracked(document, tool.map(|tool| tool.flange_from_tcp), link.as_ref());
    let extruder = extruder(document);
    let realtime = realtime(document);
    Some(Cell {
        name: name?,
        robot: robot?,
        tool: tool?,
        part: Part { base_from_part: base?.inverse() * part? },
        workspace: workspace?,
        limits: limits?,
        travel: travel?,
        link: link?,
        lead: lead?,
        tracked: tracked?,
        extruder: extruder?,
        realtime: realtime?,
    })
}

fn robot(document: &mut Document<'_>) -> Option<Robot> {
    let folder = document.folder();
    let mut section = document.section("robot");
    let arm = arm(&mut section);
    let calibration = calibration(&mut section, folder, arm.as_ref());
    let simulated = section.boolean("simulated");
    let start = section.numbers(&keys::START);
    let velocity = velocity(&mut section, arm.as_ref());
    let acceleration = section.numbers(&keys::JOINT_ACCELERATION);
    let jerk = section.numbers(&keys::JOINT_JERK);
    let following_error_max = section.number(&keys::FOLLOWING_ERROR);
    let deviation_max = section.number_if_given(&keys::DEVIATION);
    let serial = section.text_if_given("serial").map(|serial| serial.map(str::to_owned));
    let first_layer_rate = section.number_or(&keys::FIRST_LAYER_RATE, 0.5);
    section.finish();
    let (nominal, velocity, calibration) = (arm?, JointVel(velocity?), calibration?);
    let (calibration, calibration_of_controller) = calibration;
    let mut arm = calibration.map_or(nominal, |unit| unit.arm);
    if arm.velocity_max == Rating::Unknown {
        arm.velocity_max = Rating::Known(velocity);
    }
    Some(Robot {
        model: arm.name.to_owned(),
        arm,
        calibration,
        calibration_of_controller,
        serial: serial?,
        simulated: simulated?,
        start: JointPos(start?),
        joint_velocity_max: velocity,
        joint_acceleration_max: JointAcc(acceleration?),
        joint_jerk_max: JointJerk(jerk?),
        following_error_max: following_error_max?,
        // An estimate lags as the robot's own word does.
        deviation_max: deviation_max?.or(following_error_max)?,
        first_layer_rate: first_layer_rate?,
    })
}

fn arm(section: &mut Section<'_, '_>) -> Option<Arm<6>> {
    let model = section.text("model")?;
    if let Some(arm) = ur::ALL.iter().find(|arm| arm.name == model) {
        return Some(*arm);
    }
    let names: Vec<_> = ur::ALL.iter().map(|arm| arm.name).collect();
    section.impossible("model", &format!("one of {}", names.join(", ")), &format!("{model:?}"))
}

/// The unit's calibration, and whether it is the controller's, which is read before a print. Without the key the arm is nominal.
fn calibration(
    section: &mut Section<'_, '_>,
    folder: &Path,
    arm: Option<&Arm<6>>,
) -> Option<(Option<Calibrated>, bool)> {
    let Some(file) = section.text_if_given("calibration")? else { return Some((None, false)) };
    if file == OF_CONTROLLER {
        return Some((None, true));
    }
    match calibration::load(&folder.join(file), arm?) {
        Ok(unit) => Some((Some(unit), false)),
        Err(error) => {
            let expected = format!("the calibration of a unit of {}", arm?.name);
            section.impossible("calibration", &expected, &error.to_string())
        }
    }
}

/// Where a data sheet gives speeds, at most those, and those when the key is absent; where none does, the key must be there.
fn velocity(section: &mut Section<'_, '_>, arm: Option<&Arm<6>>) -> Option<[f64; 6]> {
    match arm.map(|arm| arm.velocity_max) {
        Some(Rating::Known(data_sheet)) => {
            let wanted = section.numbers_or(&keys::JOINT_VELOCITY, data_sheet.0)?;
            within_data_sheet(section, wanted, &data_sheet)
        }
        Some(Rating::Unknown) => section.numbers(&keys::JOINT_VELOCITY),
        None => section.numbers_or(&keys::JOINT_VELOCITY, [0.0; 6]),
    }
}

fn within_data_sheet(section: &mut Section<'_, '_>, wanted: [f64; 6], data_sheet: &JointVel<6>) -> Option<[f64; 6]> {
    let above = (0..).zip(wanted.iter().zip(&data_sheet.0)).find(|(_, (wanted, sheet))| wanted > sheet);
    let Some((joint, (wanted, sheet))) = above.map(|(joint, pair): (usize, _)| (joint + 1, pair)) else {
        return Some(wanted);
    };
    let expected = format!("no more than the data sheet's {:.1} deg/s for joint {joint}", sheet.to_degrees());
    section.impossible(keys::JOINT_VELOCITY.name, &expected, &format!("{:.1} deg/s", wanted.to_degrees()))
}

fn pose(document: &mut Document<'_>, name: &'static str) -> Option<Pose> {
    let mut section = document.section(name);
    let pose = pose_keys(&mut section);
    section.finish();
    pose
}

fn pose_keys(section: &mut Section<'_, '_>) -> Option<Pose> {
    let xyz = section.numbers(&keys::XYZ);
    let rpy = section.numbers(&keys::RPY);
    let [roll, pitch, yaw] = rpy?;
    Some(Pose::from_roll_pitch_yaw(Vector3::from(xyz?), roll, pitch, yaw))
}

fn tool(document: &mut Document<'_>) -> Option<Tool> {
    let mut section = document.section("tool");
    let pose = pose_keys(&mut section);
    let payload = section.number_if_given(&keys::PAYLOAD);
    let cog = section.numbers_if_given(&keys::PAYLOAD_COG);
    section.finish();
    Some(Tool { flange_from_tcp: pose?, payload: payload?, payload_cog: cog? })
}

/// May be left out, as may each of its keys.
fn workspace(document: &mut Document<'_>) -> Option<Vec<Bound>> {
    if !document.has("workspace") {
        return Some(Vec::new());
    }
    let mut section = document.section("workspace");
    let given: Vec<_> = keys::BOUNDS.iter().map(|key| section.number_if_given(key)).collect();
    for pair in given.chunks_exact(2).zip(keys::BOUNDS.chunks_exact(2)) {
        if let ([Some(Some(low)), Some(Some(high))], [_, key]) = pair
            && low >= high
        {
            let expected = format!("more than {} mm, where the workspace begins", low * 1e3);
            section.impossible::<()>(key.name, &expected, &format!("{}", high * 1e3));
        }
    }
    section.finish();
    let mut bounds = Vec::new();
    for (index, (offset, key)) in given.into_iter().zip(&keys::BOUNDS).enumerate() {
        let mut normal_in_base = [0.0; 3];
        let outward = if index % 2 == 0 { -1.0 } else { 1.0 };
        normal_in_base[index / 2] = outward;
        if let Some(offset) = offset? {
            bounds.push(Bound { key: key.name, plane: Plane { normal_in_base, offset: outward * offset } });
        }
    }
    Some(bounds)
}

fn limits(document: &mut Document<'_>) -> Option<Limits> {
    let mut section = document.section("limits");
    let velocity = section.number(&keys::VELOCITY);
    let acceleration = section.number(&keys::ACCELERATION);
    let jerk = section.number(&keys::JERK);
    section.finish();
    Some(Limits { path_velocity_max: velocity?, path_acceleration_max: acceleration?, path_jerk_max: jerk? })
}

fn travel(document: &mut Document<'_>) -> Option<Travel> {
    let mut section = document.section("travel");
    let lift = section.number(&keys::LIFT);
    let settle = section.number_or(&keys::SETTLE, 0.0);
    let velocity = section.number(&keys::VELOCITY);
    let acceleration = section.number(&keys::ACCELERATION);
    let jerk = section.number(&keys::JERK);
    let share = section.number(&keys::JOINT_SHARE);
    section.finish();
    Some(Travel {
        lift: lift?,
        settle: settle?,
        velocity_max: velocity?,
        acceleration_max: acceleration?,
        jerk_max: jerk?,
        approach_joint_share: share?,
    })
}

fn link(document: &mut Document<'_>, simulated: Option<bool>) -> Option<Link> {
    let folder = document.folder();
    let mut section = document.section("link");
    let kind = kind(&mut section);
    let address = section.text("address");
    let address = address.and_then(|address| host(&mut section, address, simulated));
    let port = section.integer_or("port", 1..=65_535, 30_004);
    let dashboard_port = section.integer_if_given("dashboard_port", 1..=65_535);
    let primary_port = section.integer_if_given("primary_port", 1..=65_535);
    let rate = section.either("rate_hz", RATES_HZ);
    let recipes = recipes(&mut section, folder);
    let register_offset = register_offset(&mut section, recipes.as_ref().and_then(Option::as_ref));
    let timeout = section.number_or(&keys::TIMEOUT, 0.1);
    let watchdog = section.number_or(&keys::WATCHDOG, 0.1);
    let lookahead = section.number_or(&keys::LOOKAHEAD, 0.1);
    let gain = section.number_or(&keys::GAIN, 300.0);
    for (key, duration) in [(&keys::TIMEOUT, timeout), (&keys::WATCHDOG, watchdog)] {
        if let (Some(rate), Some(duration)) = (rate, duration) {
            at_least_two_cycles(&mut section, key.name, rate, duration);
        }
    }
    section.finish();
    Some(Link {
        kind: kind?,
        address: address?,
        port: u16::try_from(port?).ok()?,
        dashboard_port: dashboard_port?.map(u16::try_from).transpose().ok()?,
        primary_port: primary_port?.map(u16::try_from).transpose().ok()?,
        rate_hz: u32::try_from(rate?).ok()?,
        register_offset: register_offset?,
        recipes: recipes?,
        timeout: timeout?,
        watchdog: watchdog?,
        servoj_lookahead: lookahead?,
        servoj_gain: gain?,
    })
}

fn kind(section: &mut Section<'_, '_>) -> Option<LinkKind> {
    match section.text("kind")? {
        "rtde" => Some(LinkKind::Rtde),
        other => section.impossible("kind", "\"rtde\"", &format!("{other:?}")),
    }
}

/// Without the key, Screed's own recipes alone.
fn recipes(section: &mut Section<'_, '_>, folder: &Path) -> Option<Option<RecipeFile>> {
    let Some(name) = section.text_if_given("recipes")? else { return Some(None) };
    match file::load(&folder.join(name)) {
        Ok(recipes) => Some(Some(recipes)),
        Err(FileError::Read { file, source }) => {
            let found = format!("{}: {source}", file.display());
            section.impossible("recipes", "a file that can be read", &found)
        }
        Err(error) => section.impossible("recipes", "a sound file of RTDE recipes", &error.to_string()),
    }
}

/// Where a recipe file says which registers are written, those.
fn register_offset(section: &mut Section<'_, '_>, recipes: Option<&RecipeFile>) -> Option<u8> {
    let possible = recipes.and_then(RecipeFile::register_offsets);
    let usual = possible.as_ref().and_then(|offsets| offsets.first()).copied().unwrap_or(0);
    let offset = section.either_or("register_offset", REGISTER_OFFSETS, usual.into());
    let offset = u8::try_from(offset?).ok()?;
    match (possible.as_deref(), recipes) {
        (Some([]), Some(file)) => {
            let expected =
                "input_double_register_N to _N+5 and input_int_register_N in its recipes of inputs, N 0 or 24";
            section.impossible("recipes", expected, &format!("other registers in {}", file.name))
        }
        (Some(offsets), Some(file)) if !offsets.contains(&offset) => {
            let expected = format!("{usual}, as the recipes of {} have it (or leave the key out)", file.name);
            section.impossible("register_offset", &expected, &offset.to_string())
        }
        _ => Some(offset),
    }
}

/// A host alone; and for a simulated robot this machine, so that a slip cannot make a real robot pass for a simulated one.
fn host(section: &mut Section<'_, '_>, address: &str, simulated: Option<bool>) -> Option<String> {
    let found = format!("{address:?}");
    let is_ipv6 = address.parse::<std::net::Ipv6Addr>().is_ok();
    if address.contains(|c: char| c.is_whitespace() || c == '/') || (address.contains(':') && !is_ipv6) {
        return section.impossible("address", "a host name or IP address alone (the port is a key of its own)", &found);
    }
    let loopback = address == "localhost" || address.parse().is_ok_and(|ip: std::net::IpAddr| ip.is_loopback());
    if simulated == Some(true) && !loopback {
        let expected = "\"127.0.0.1\" for a simulated robot (or [robot] simulated = false)";
        return section.impossible("address", expected, &found);
    }
    Some(address.to_owned())
}

/// A silence shorter than two cycles would be none.
fn at_least_two_cycles(section: &mut Section<'_, '_>, name: &str, rate_hz: i64, duration: f64) {
    let (cycles_ms, found_ms) = (2.0 * 1e3 / rate_hz as f64, duration * 1e3);
    if found_ms < cycles_ms {
        let expected = format!("at least {cycles_ms}, two cycles at {rate_hz} Hz");
        section.impossible::<()>(name, &expected, &found_ms.to_string());
    }
}

fn extruder(document: &mut Document<'_>) -> Option<Extruder> {
    let mut section = document.section("extruder");
    let device = section.text("device").map(PathBuf::from);
    let baud = section.integer_or("baud", 9600..=4_000_000, 115_200);
    let flow_max = section.number(&keys::FLOW);
    section.finish();
    Some(Extruder { device: device?, baud: u32::try_from(baud?).ok()?, flow_max: flow_max? })
}

/// May be left out.
fn realtime(document: &mut Document<'_>) -> Option<Realtime> {
    let usual = Realtime::default();
    if !document.has("realtime") {
        return Some(usual);
    }
    let mut section = document.section("realtime");
    let priority = section.integer_or("priority", 1..=99, usual.priority.into());
    let cpu = section.integer_if_given("cpu", 0..=1023);
    let pacing = match section.text_if_given("pace") {
        Some(None) => Some(usual.pacing),
        Some(Some("robot")) => Some(Pacing::Robot),
        Some(Some("timer")) => Some(Pacing::Timer),
        Some(Some(other)) => section.impossible("pace", "\"robot\" or \"timer\"", &format!("{other:?}")),
        None => None,
    };
    let overruns_max = section.integer_or("overruns_max", 1..=100_000, usual.overruns_max.into());
    section.finish();
    Some(Realtime {
        priority: u8::try_from(priority?).ok()?,
        cpu: cpu?.map(usize::try_from).transpose().ok()?,
        pacing: pacing?,
        overruns_max: u32::try_from(overruns_max?).ok()?,
    })
}
