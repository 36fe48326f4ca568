//! An arm that a person describes by its DH table: the arm file, TOML. `docs/robots.md` is its manual.

use super::description::{JOINTS, Link};
use super::{Description, RobotError};
use crate::config::keys::{self, DEG, DEG_S, DEG_S2, MM, MM_S, MM_S2, NONE, Number, number};
use crate::config::read::{Document, Section};
use nalgebra::Vector3;
use screed_kernel::arm::{Coupling, Dh, Joint, JointKind};
use screed_kernel::pose::Pose;
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

const THETA: Number = number("theta_deg", DEG, -360.0, 360.0);
const D: Number = number("d_mm", MM, -1_000_000.0, 1_000_000.0);
const A: Number = number("a_mm", MM, -100_000.0, 100_000.0);
const ALPHA: Number = number("alpha_deg", DEG, -360.0, 360.0);
const COUPLING: Number = number("coupling_factor", NONE, -1_000.0, 1_000.0);

/// The numbers that differ between a joint that turns and one that slides: lowest and highest position, speed, acceleration.
const TURNING: [Number; 4] = [
    number("position_min_deg", DEG, -36_000.0, 36_000.0),
    number("position_max_deg", DEG, -36_000.0, 36_000.0),
    number("velocity_max_deg_s", DEG_S, 0.01, 10_000.0),
    number("acceleration_max_deg_s2", DEG_S2, 0.1, 1_000_000.0),
];
const SLIDING: [Number; 4] = [
    number("position_min_mm", MM, -1_000_000.0, 1_000_000.0),
    number("position_max_mm", MM, -1_000_000.0, 1_000_000.0),
    number("velocity_max_mm_s", MM_S, 0.01, 100_000.0),
    number("acceleration_max_mm_s2", MM_S2, 0.1, 1_000_000.0),
];

/// Reads an arm file.
///
/// # Errors
/// [`RobotError::Read`], and [`RobotError::File`] with everything that is wrong.
pub fn load(path: &Path) -> Result<Description, RobotError> {
    let text = super::read(path)?;
    parse(&path.to_string_lossy(), &text)
}

/// Reads the text of an arm file; `name` is the file's name for messages.
fn parse(name: &str, text: &str) -> Result<Description, RobotError> {
    let mut document = Document::new(name, text);
    let description = if document.is_broken() { None } else { description(&mut document) };
    match description {
        Some(description) if !document.is_broken() => Ok(description),
        _ => Err(RobotError::File { findings: document.into_findings() }),
    }
}

fn description(document: &mut Document<'_>) -> Option<Description> {
    let count = document.count("joint");
    let rated = [2, 3].map(|key: usize| document.any_has("joint", &[TURNING[key].name, SLIDING[key].name]));
    let mut top = document.top(&["base", "flange", "joint"]);
    let name = top.text("name").map(str::to_owned);
    let source = top.text("source").map(str::to_owned);
    if !JOINTS.contains(&count) {
        top.impossible::<()>("joint", "3 to 9 sections [[joint]]", &format!("{count} of them"));
    }
    top.finish();
    let base_from_zero = pose(document, "base");
    let last_from_flange = pose(document, "flange");
    let mut links: Vec<Link> = Vec::new();
    let mut complete = true;
    for index in 0..count {
        match link(document.nth("joint", index), &links, rated) {
            Some(link) => links.push(link),
            None => complete = false,
        }
    }
    Some(Description {
        name: name?,
        origin: source?,
        base_from_zero: base_from_zero?,
        links: complete.then_some(links)?,
        last_from_flange: last_from_flange?,
        notes: Vec::new(),
    })
}

/// May be left out: then both frames are one.
fn pose(document: &mut Document<'_>, name: &'static str) -> Option<Option<Pose>> {
    if !document.has(name) {
        return Some(None);
    }
    let mut section = document.section(name);
    let xyz = section.numbers(&keys::XYZ);
    let rpy = section.numbers(&keys::RPY);
    section.finish();
    let [roll, pitch, yaw] = rpy?;
    Some(Some(Pose::from_roll_pitch_yaw(Vector3::from(xyz?), roll, pitch, yaw)))
}

/// One joint; `before` are the links between it and the base, `rated` says whether any joint of the file has a speed and an
/// acceleration, because then all must have one.
fn link(mut section: Section<'_, '_>, before: &[Link], rated: [bool; 2]) -> Option<Link> {
    let name = name(&mut section, before);
    let kind = kind(&mut section);
    let theta = section.number_or(&THETA, 0.0);
    let d = section.number_or(&D, 0.0);
    let a = section.number_or(&A, 0.0);
    let alpha = section.number_or(&ALPHA, 0.0);
    let coupling = coupling(&mut section, before);
    let numbers = if kind == Some(JointKind::Prismatic) { &SLIDING } else { &TURNING };
    let range = range(&mut section, numbers, kind);
    let [velocity_max, acceleration_max] = [(&numbers[2], rated[0]), (&numbers[3], rated[1])]
        .map(|(key, all)| if all { section.number(key).map(Some) } else { Some(None) });
    section.finish();
    let (sin_alpha, cos_alpha) = exact_sin_cos(alpha?);
    let [position_min, position_max] = range?;
    Some(Link {
        name: name?,
        dh: Dh { theta: theta?, d: d?, a: a?, sin_alpha, cos_alpha },
        joint: Joint { kind: kind?, coupling: coupling? },
        position_min,
        position_max,
        velocity_max: velocity_max?,
        acceleration_max: acceleration_max?,
    })
}

fn name(section: &mut Section<'_, '_>, before: &[Link]) -> Option<String> {
    let name = section.text("name")?;
    if before.iter().any(|link| link.name == name) {
        return section.impossible("name", "a name that no other joint has", &format!("{name:?}"));
    }
    Some(name.to_owned())
}

fn kind(section: &mut Section<'_, '_>) -> Option<JointKind> {
    match section.text("kind")? {
        "revolute" => Some(JointKind::Revolute),
        "prismatic" => Some(JointKind::Prismatic),
        other => section.impossible("kind", "\"revolute\" or \"prismatic\"", &format!("{other:?}")),
    }
}

/// Without the key, no coupling.
fn coupling(section: &mut Section<'_, '_>, before: &[Link]) -> Option<Option<Coupling>> {
    let Some(other) = section.text_if_given("coupled_to")? else {
        return match section.number_if_given(&COUPLING)? {
            None => Some(None),
            Some(factor) => section.impossible(COUPLING.name, "coupled_to beside it", &factor.to_string()),
        };
    };
    let factor = section.number(&COUPLING);
    let Some(joint) = before.iter().position(|link| link.name == other) else {
        let names: Vec<_> = before.iter().map(|link| link.name.as_str()).collect();
        return section.impossible(
            "coupled_to",
            &format!("an earlier joint ({})", names.join(", ")),
            &format!("{other:?}"),
        );
    };
    Some(Some(Coupling { joint, factor: factor? }))
}

/// Lowest and highest position, or `endless = true` for a joint that turns without end.
fn range(section: &mut Section<'_, '_>, numbers: &'static [Number; 4], kind: Option<JointKind>) -> Option<[f64; 2]> {
    let [low, high, ..] = numbers;
    if section.flag("endless")? {
        if kind == Some(JointKind::Prismatic) {
            return section.impossible("endless", "false for a joint that slides", "true");
        }
        if section.number_if_given(low)?.is_some() || section.number_if_given(high)?.is_some() {
            return section.impossible("endless", "no lowest and highest position beside it", "true");
        }
        return Some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    let (least, most) = (section.number(low), section.number(high));
    let (least, most) = (least?, most?);
    if least < most {
        return Some([least, most]);
    }
    let shown = |value: f64| if kind == Some(JointKind::Prismatic) { value * 1e3 } else { value.to_degrees() };
    section.impossible(high.name, &format!("more than {} = {}", low.name, shown(least)), &shown(most).to_string())
}

/// Right angles exactly, so that a table of them keeps its shape.
fn exact_sin_cos(angle: f64) -> (f64, f64) {
    let quarters = (angle / FRAC_PI_2).round();
    if (angle - quarters * FRAC_PI_2).abs() > 1e-15 * angle.abs() {
        return angle.sin_cos();
    }
    match quarters.rem_euclid(4.0) {
        1.0 => (1.0, 0.0),
        2.0 => (0.0, -1.0),
        3.0 => (-1.0, 0.0),
        _ => (0.0, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Failure;
    use screed_kernel::arms::comau::NJ130;
    use screed_kernel::arms::gantry::CONTOUR_CRAFTER;
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::units::JointPos;

    fn example(name: &str) -> Description {
        load(&screed_fixtures::data("robots").join(name)).unwrap_or_else(|error| panic!("{error}"))
    }

    #[test]
    fn an_arm_file_says_what_the_catalogue_says() {
        let description = example("ur10e.toml");
        let arm = description.arm::<6>("ur10e").expect("six joints");
        assert_eq!(arm, UR10E);
        let gantry = example("gantry.toml").arm::<4>("contour-crafter").expect("four joints");
        for k in 0..50 {
            let joints = JointPos([0.2, 0.1, 0.07, -0.11].map(|step| step * f64::from(k)));
            let (found, expected) = (gantry.forward(&joints), CONTOUR_CRAFTER.forward(&joints));
            assert!((found.translation - expected.translation).norm() < 1e-14);
            assert!((found.rotation - expected.rotation).amax() < 1e-14);
        }
    }

    #[test]
    fn a_coupling_names_an_earlier_joint() {
        let text = std::fs::read_to_string(screed_fixtures::data("robots/ur10e.toml")).expect("the fixture");
        let coupled =
            text.replacen("name = \"elbow\"\n", "name = \"elbow\"\ncoupled_to = \"lift\"\ncoupling_factor = 1\n", 1);
        let arm = parse("arm.toml", &coupled).expect("sound").arm::<6>("").expect("six joints");
        assert_eq!(arm.joints.map(|joint| joint.coupling), NJ130.joints.map(|joint| joint.coupling));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let text = std::fs::read_to_string(screed_fixtures::data("robots/ur10e.toml")).expect("the fixture");
        let elbow = "name = \"elbow\"\n";
        let cases = [
            ("a_mm = -612.7", "a_m = -0.6127", "a_m has the wrong unit: expected a_mm, in millimetres"),
            ("alpha_deg = 90", "alpha_rad = 1.57", "alpha_rad has the wrong unit: expected alpha_deg, in degrees"),
            (elbow, "name = \"lift\"\n", "name: expected a name that no other joint has, found \"lift\""),
            (
                elbow,
                "name = \"elbow\"\ncoupled_to = \"wrist 1\"\ncoupling_factor = 1\n",
                "coupled_to: expected an earlier joint (pan, lift), found \"wrist 1\"",
            ),
            (
                elbow,
                "name = \"elbow\"\ncoupling_factor = 1\n",
                "coupling_factor: expected coupled_to beside it, found 1",
            ),
            (
                elbow,
                "name = \"elbow\"\nendless = true\n",
                "endless: expected no lowest and highest position beside it, found true",
            ),
            (elbow, "name = \"elbow\"\nweight_kg = 4\n", "weight_kg is not a key of [joint]"),
            (
                "kind = \"revolute\"\n",
                "kind = \"hinge\"\n",
                "kind: expected \"revolute\" or \"prismatic\", found \"hinge\"",
            ),
            (
                "position_max_deg = 360\n",
                "position_max_deg = -360\n",
                "position_max_deg: expected more than position_min_deg = -360, found -360",
            ),
            (
                "velocity_max_deg_s = 120\n",
                "",
                "[joint] lacks velocity_max_deg_s: expected a number from 0.01 to 10000",
            ),
            ("source = ", "sauce = ", "sauce is not a key of the top of the file"),
            (
                "theta_deg = 0\n",
                "theta_deg = nan\n",
                "theta_deg: expected a number from -360 to 360 (degrees), found NaN",
            ),
        ];
        for (from, to, expected) in cases {
            assert!(text.contains(from), "{from}");
            let error = parse("arm.toml", &text.replacen(from, to, 1)).expect_err(expected);
            let told = Failure::from(error).to_string();
            assert!(
                told.contains(expected) && told.contains("--> arm.toml:") && told.contains("remedy: "),
                "{told}\n{expected}"
            );
        }
        let two = text.split("[[joint]]").take(3).collect::<Vec<_>>().join("[[joint]]");
        let error = parse("arm.toml", &two).expect_err("two joints").to_string();
        assert!(error.contains("joint: expected 3 to 9 sections [[joint]], found 2 of them"), "{error}");
        assert!(parse("arm.toml", "[[joint]\n").is_err() && parse("arm.toml", "").is_err());
    }

    #[test]
    fn the_manual_lists_every_key_with_its_range() {
        let manual = include_str!("../../../docs/robots.md");
        for key in [&THETA, &D, &A, &ALPHA, &COUPLING].into_iter().chain(&TURNING).chain(&SLIDING) {
            let range = format!("{} … {}", key.low, key.high);
            let row = manual.lines().find(|line| line.contains(&format!("`{}`", key.name)) && line.contains(&range));
            assert!(row.is_some(), "docs/robots.md has no row with {} and {range}", key.name);
        }
    }
}
