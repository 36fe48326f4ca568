//! `screed calibrate`: from a file of measurements to frames and arms.

use super::args::{CalibrateArgs, CalibrateCommand};
use super::say;
use crate::calibrate::file::{FrameFile, Source, TcpFile, TrackerFile};
use crate::calibrate::report::{self, Report};
use crate::calibrate::{arm::identify, frame::fit, target::calibrate, tcp::pivot};
use crate::failure::{Exit, Failure};
use crate::robot::{self, Description};
use screed_kernel::arm::Arm;
use screed_kernel::arms::crane::CRANE_NJ130;
use screed_kernel::arms::gantry::CONTOUR_CRAFTER;
use screed_kernel::arms::{SPHERICAL_WRISTS, ur};
use std::path::Path;
use toml::Spanned;

/// Reads, calibrates, tells.
pub fn run(command: &CalibrateCommand) -> Result<(), Failure> {
    let (CalibrateCommand::Frame(args)
    | CalibrateCommand::Tcp(args)
    | CalibrateCommand::Target(args)
    | CalibrateCommand::Arm(args)) = command;
    let CalibrateArgs { file, json } = args;
    let source = Source::read(file)?;
    let report = match command {
        CalibrateCommand::Frame(_) => frame(&source)?,
        CalibrateCommand::Tcp(_) => of_robot(&source, &Measured::Tcp(source.parse()?))?,
        CalibrateCommand::Target(_) => of_robot(&source, &Measured::Target(source.parse()?))?,
        CalibrateCommand::Arm(_) => of_robot(&source, &Measured::Arm(source.parse()?))?,
    };
    say(&if *json { format!("{:#}\n", report.json) } else { report.words })
}

fn frame(source: &Source) -> Result<Report, Failure> {
    let file: FrameFile = source.parse()?;
    let (pairs, sigma) = file.checked(source)?;
    Ok(report::frame(&fit(&pairs, sigma)?, &file.outer, &file.inner))
}

/// A file of flange poses, and what is sought from it.
enum Measured {
    Tcp(TcpFile),
    Target(TrackerFile),
    Arm(TrackerFile),
}

impl Measured {
    fn robot(&self) -> Option<&Spanned<String>> {
        match self {
            Self::Tcp(file) => file.robot.as_ref(),
            Self::Target(file) | Self::Arm(file) => file.robot.as_ref(),
        }
    }

    fn report<const N: usize>(&self, source: &Source, arm: Option<&Arm<N>>) -> Result<Report, Failure> {
        Ok(match (self, arm) {
            (Self::Tcp(file), arm) => {
                let (poses, sigma) = file.checked(source, arm)?;
                report::tcp(&pivot(&poses, sigma)?)
            }
            (Self::Target(file), arm) => report::target(&calibrate(&file.pairs(source, arm)?, &file.noise(source)?)?),
            (Self::Arm(file), Some(arm)) => {
                let found = identify(arm, &file.measurements(source, arm)?, &file.noise(source)?)?;
                report::arm(&found, file.robot.as_ref().map_or(arm.name, |name| name.get_ref()))
            }
            (Self::Arm(_), None) => {
                let message = "robot is missing: expected the robot whose joints the file has";
                return Err(Failure::new(Exit::Input, message, "add robot = \"…\" at the top of the file"));
            }
        })
    }
}

/// What the kernel calls the file's robot.
const OWN: &str = "own";

/// With the file's robot, of as many joints as it has.
fn of_robot(source: &Source, measured: &Measured) -> Result<Report, Failure> {
    let Some(name) = measured.robot() else { return measured.report::<6>(source, None) };
    let robot = described(source, name)?;
    match robot.links.len() {
        3 => measured.report(source, robot.arm::<3>(OWN).as_ref()),
        4 => measured.report(source, robot.arm::<4>(OWN).as_ref()),
        5 => measured.report(source, robot.arm::<5>(OWN).as_ref()),
        6 => measured.report(source, robot.arm::<6>(OWN).as_ref()),
        7 => measured.report(source, robot.arm::<7>(OWN).as_ref()),
        8 => measured.report(source, robot.arm::<8>(OWN).as_ref()),
        _ => measured.report(source, robot.arm::<9>(OWN).as_ref()),
    }
}

/// A robot of the catalogue by its name, or an arm file by its path, which ends with .toml.
fn described(source: &Source, name: &Spanned<String>) -> Result<Description, Failure> {
    let wanted = name.get_ref().as_str();
    if wanted.ends_with(".toml") {
        return Ok(robot::file::load(Path::new(wanted))?);
    }
    let six = ur::ALL.iter().chain(&SPHERICAL_WRISTS).map(|arm| (arm.name, Description::of(arm, "the catalogue")));
    let others = [
        (CONTOUR_CRAFTER.name, Description::of(&CONTOUR_CRAFTER, "the catalogue")),
        (CRANE_NJ130.name, Description::of(&CRANE_NJ130, "the catalogue")),
    ];
    let all: Vec<_> = six.chain(others).collect();
    let names: Vec<_> = all.iter().map(|(name, _)| *name).collect();
    let found = all.into_iter().find(|(name, _)| *name == wanted).map(|(_, description)| description);
    found.ok_or_else(|| {
        let expected = format!("{} or an arm file.toml", names.join(", "));
        source.refuse(name, "robot", expected, format!("{wanted:?}"), "name the robot whose joints the file has").into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::sample::Random;
    use nalgebra::{Rotation3, UnitQuaternion};
    use screed_kernel::arm::JointKind;
    use screed_kernel::pose::Pose;
    use screed_kernel::units::JointPos;

    /// What a perfect tracker sees of an arm that is as its table says, in a file.
    fn file<const N: usize>(arm: &Arm<N>, robot: &str, key: &str) -> String {
        let mut text =
            format!("robot = {robot:?}\n[noise]\nposition_um = 10\nposition_um_per_m = 5\nrotation_deg = 0.01\n");
        let mut random = Random::new(7);
        let offset = Pose::from_roll_pitch_yaw([0.2, -0.1, 0.3].into(), 0.4, -0.2, 1.0);
        for _ in 0..20 {
            let joints = JointPos(std::array::from_fn(|_| random.between(-1.5, 1.5)));
            let target = offset * arm.forward(&joints) * offset;
            let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(target.rotation));
            let units = joints.0.iter().zip(&arm.joints).map(|(position, joint)| match joint.kind {
                JointKind::Revolute => position.to_degrees(),
                JointKind::Prismatic => position * 1e3,
            });
            text += &format!(
                "[[pose]]\n{key} = {:?}\ntarget = {{ xyz_mm = {:?}, quaternion_wxyz = {:?} }}\n",
                units.collect::<Vec<_>>(),
                (target.translation * 1e3).data.0[0],
                [rotation.w, rotation.i, rotation.j, rotation.k]
            );
        }
        text
    }

    fn noise_ratio(text: &str) -> Result<f64, Failure> {
        let source = Source::new("measured.toml", text);
        let target = of_robot(&source, &Measured::Target(source.parse()?))?;
        let arm = of_robot(&source, &Measured::Arm(source.parse()?))?;
        assert!(target.json["fit"]["noise_ratio"].as_f64().is_some_and(|ratio| ratio < 1e-6));
        Ok(arm.json["fit"]["noise_ratio"].as_f64().unwrap_or(f64::NAN))
    }

    #[test]
    fn every_robot_of_the_catalogue_can_be_calibrated() {
        for arm in ur::ALL.iter().chain(&SPHERICAL_WRISTS) {
            let ratio = noise_ratio(&file(arm, arm.name, "joints_deg")).expect("an arm");
            assert!(ratio < 1e-6, "{}: {ratio}", arm.name);
        }
        let ratio = noise_ratio(&file(&CRANE_NJ130, CRANE_NJ130.name, "joints_deg_mm")).expect("an arm under a crane");
        assert!(ratio < 1e-6, "{ratio}");
    }

    #[test]
    fn a_gantry_whose_nozzle_turns_about_one_axis_holds_no_target() {
        let told = noise_ratio(&file(&CONTOUR_CRAFTER, CONTOUR_CRAFTER.name, "joints_deg_mm")).expect_err("one axis");
        assert!(told.to_string().contains("one axis only"), "{told}");
    }

    #[test]
    fn an_arm_file_names_a_robot_too_and_what_is_none_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("three.toml");
        let joint = |name: &str, alpha: f64| {
            format!(
                "[[joint]]\nname = {name:?}\nkind = \"revolute\"\na_mm = 300\nd_mm = 200\nalpha_deg = {alpha}\n\
                 position_min_deg = -170\nposition_max_deg = 170\n"
            )
        };
        let joints = joint("a", 90.0) + &joint("b", -90.0) + &joint("c", 0.0);
        std::fs::write(&path, format!("name = \"three\"\nsource = \"a test\"\n{joints}")).expect("a file");
        let arm: Arm<3> = robot::file::load(&path).expect("an arm").arm("three").expect("three joints");
        let ratio = noise_ratio(&file(&arm, &path.to_string_lossy(), "joints_deg")).expect("an arm");
        assert!(ratio < 1e-6, "{ratio}");
        let told = noise_ratio(&file(&arm, "ur9", "joints_deg")).expect_err("no such robot").to_string();
        assert!(told.contains("expected ur3, ") && told.contains("measured.toml:1:9"), "{told}");
        let nameless = file(&arm, "x", "joints_deg").replacen("robot = \"x\"\n", "", 1);
        let source = Source::new("measured.toml", &nameless);
        let told = of_robot(&source, &Measured::Arm(source.parse().expect("laid out well"))).expect_err("no robot");
        assert!(told.to_string().contains("robot is missing"), "{told}");
    }
}
