//! `screed calibrate`: from a file of measurements to frames and arms.

use super::args::{CalibrateArgs, CalibrateCommand};
use super::say;
use crate::calibrate::file::{FileError, FrameFile, Source, TcpFile, TrackerFile};
use crate::calibrate::report::{self, Report};
use crate::calibrate::{arm::identify, frame::fit, target::calibrate, tcp::pivot};
use crate::failure::{Exit, Failure};
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use toml::Spanned;

/// The robots whose joints a file can give.
const ARMS: [Arm<6>; 1] = [UR10E];

/// Reads, calibrates, tells.
pub fn run(command: &CalibrateCommand) -> Result<(), Failure> {
    let (CalibrateCommand::Frame(args)
    | CalibrateCommand::Tcp(args)
    | CalibrateCommand::Target(args)
    | CalibrateCommand::Arm(args)) = command;
    let CalibrateArgs { file, json } = args;
    let source = Source::read(file)?;
    let report = match command {
        CalibrateCommand::Frame(_) => frame(&source),
        CalibrateCommand::Tcp(_) => tcp(&source),
        CalibrateCommand::Target(_) => target(&source),
        CalibrateCommand::Arm(_) => arm(&source),
    }?;
    say(&if *json { format!("{:#}\n", report.json) } else { report.words })
}

fn frame(source: &Source) -> Result<Report, Failure> {
    let file: FrameFile = source.parse()?;
    let (pairs, sigma) = file.checked(source)?;
    Ok(report::frame(&fit(&pairs, sigma)?, &file.outer, &file.inner))
}

fn tcp(source: &Source) -> Result<Report, Failure> {
    let file: TcpFile = source.parse()?;
    let arm = file.robot.as_ref().map(|name| named(source, name)).transpose()?;
    let (poses, sigma) = file.checked(source, arm.as_ref())?;
    Ok(report::tcp(&pivot(&poses, sigma)?))
}

fn target(source: &Source) -> Result<Report, Failure> {
    let file: TrackerFile = source.parse()?;
    let arm = file.robot.as_ref().map(|name| named(source, name)).transpose()?;
    let (pairs, noise) = (file.pairs(source, arm.as_ref())?, file.noise(source)?);
    Ok(report::target(&calibrate(&pairs, &noise)?))
}

fn arm(source: &Source) -> Result<Report, Failure> {
    let file: TrackerFile = source.parse()?;
    let Some(name) = &file.robot else {
        let message = "robot is missing: expected the name of the robot whose joints the file has";
        return Err(Failure::new(Exit::Input, message, "add robot = \"…\" at the top of the file"));
    };
    let nominal = named(source, name)?;
    let (measurements, noise) = (file.measurements(source, &nominal)?, file.noise(source)?);
    Ok(report::arm(&identify(&nominal, &measurements, &noise)?))
}

fn named(source: &Source, name: &Spanned<String>) -> Result<Arm<6>, FileError> {
    ARMS.into_iter().find(|arm| arm.name == name.get_ref()).ok_or_else(|| {
        let known: Vec<_> = ARMS.iter().map(|arm| format!("{:?}", arm.name)).collect();
        source.refuse(
            name,
            "robot",
            known.join(" or "),
            format!("{:?}", name.get_ref()),
            "name a robot of the catalogue",
        )
    })
}
