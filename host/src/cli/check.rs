//! `screed check`: says whether a file is sound, and what was looked at to say so.

use super::args::CheckArgs;
use super::{read_model, say};
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure};
use crate::model::fim::{FimModel, Layer};
use crate::plan::{Options, Plan};
use screed_kernel::correction::CorrectionLimits;

/// Looks at a cell file or a model, by the file's ending.
pub fn run(args: &CheckArgs) -> Result<(), Failure> {
    let ending = args.file.extension().map(|ending| ending.to_ascii_lowercase());
    match ending.as_ref().and_then(|ending| ending.to_str()) {
        Some("toml") => {
            if args.cell.is_some() {
                let message = "--cell goes with a model: expected a file that ends with .ifc";
                return Err(Failure::new(Exit::Usage, message, "leave --cell out, or give a FIM model to check"));
            }
            say(&describe_cell(&config::load(&args.file)?))
        }
        Some("ifc") => {
            let (model, _) = read_model(&args.file)?;
            say(&describe_model(&model))?;
            args.cell.as_deref().map_or(Ok(()), |cell| check_plan(&model, &config::load(cell)?))
        }
        _ => {
            let message = format!("{}: expected a file that ends with .toml or .ifc", args.file.display());
            Err(Failure::new(Exit::Usage, message, "give a cell file or a FIM model"))
        }
    }
}

/// Plans the whole model from the cell's start joints: reach, joint limits, layer times, flow.
fn check_plan(model: &FimModel, cell: &Cell) -> Result<(), Failure> {
    let plan = Plan::new(model, cell, &Options::default(), &cell.robot.start)?;
    let minutes = f64::from(plan.last_seq()) / plan.rate() / 60.0;
    say(&format!(
        "in cell {}: sound\nverified: each of {} setpoints is within reach, joint limits, layer time and flow; it takes {:.1} \
         minutes.\n",
        cell.name,
        plan.last_seq(),
        minutes
    ))
}

fn describe_cell(cell: &Cell) -> String {
    let millimetres = |metres: f64| metres * 1e3;
    let tcp = cell.robot.arm.forward(&cell.robot.start) * cell.tool.flange_from_tcp;
    let part = cell.part.base_from_part.translation;
    let kind = if cell.robot.simulated { "simulated" } else { "real" };
    let geometry = match &cell.robot.calibration {
        Some(unit) => format!("calibrated, {:.1} mm off nominal on average", millimetres(unit.deviation_mean)),
        None if cell.robot.calibration_of_controller => "nominal until the controller tells its own".to_owned(),
        None => "nominal".to_owned(),
    };
    let (limits, link) = (&cell.limits, &cell.link);
    format!(
        "cell {}: sound\n\
         \x20 robot     {} ({kind}, {geometry}), tool starts at x {:.1} y {:.1} z {:.1} mm in its base\n\
         \x20 part      origin at x {:.1} y {:.1} z {:.1} mm in the robot's base\n\
         \x20 deposit   at most {:.0} mm/s, {:.0} mm/s², {:.0} mm/s³\n\
         \x20 link      RTDE to {}:{} at {} Hz, registers from {}, time-out {:.0} ms, watchdog {:.0} ms\n\
         \x20 servoj    look-ahead {} s, gain {}\n\
         {}\
         \x20 extruder  {} at {} baud, at most {:.0} mm³/s\n\
         verified: every key is known, there, of the right type and unit and within its range; joint speeds within the \
         data sheet.\n\
         not verified: whether a model is within reach and limits (screed plan does that), and whether robot and extruder \
         answer.\n",
        cell.name,
        cell.robot.model,
        millimetres(tcp.translation.x),
        millimetres(tcp.translation.y),
        millimetres(tcp.translation.z),
        millimetres(part.x),
        millimetres(part.y),
        millimetres(part.z),
        millimetres(limits.path_velocity_max),
        millimetres(limits.path_acceleration_max),
        millimetres(limits.path_jerk_max),
        link.address,
        link.port,
        link.rate_hz,
        link.register_offset,
        link.timeout * 1e3,
        link.watchdog * 1e3,
        link.servoj_lookahead,
        link.servoj_gain,
        describe_lead(cell),
        cell.extruder.device.display(),
        cell.extruder.baud,
        cell.extruder.flow_max * 1e9,
    )
}

fn describe_lead(cell: &Cell) -> String {
    let Some(lead) = cell.lead else { return String::new() };
    let CorrectionLimits { size_max, velocity_max, .. } = lead.limits;
    let [low, high] = lead.learning.lag.map(|lag| lag * 1e3);
    let text = format!(
        "  lead      at most {:.1} deg and {:.0} deg/s, dead time {:.1} ms; lag {:.0} ms at first, {low:.0} to {high:.0} ms learnt\n",
        size_max.to_degrees(),
        velocity_max.to_degrees(),
        lead.learning.dead_time * 1e3,
        lead.drive.lag * 1e3,
    );
    let tracker = "  tracker   described, but Screed has no link to one yet: this cell cannot be printed with\n";
    text + if cell.tracked.is_some() { tracker } else { "" }
}

fn describe_model(model: &FimModel) -> String {
    let schema = if model.schema.is_empty() { "no schema named" } else { &model.schema };
    let mut text = format!("model {} ({schema}): sound\n", model.name);
    text += "  layer  name                      segments   length m  layer time s  height mm  width mm\n";
    for layer in &model.layers {
        let process = &layer.process;
        text += &format!(
            "  {:>5}  {:<24}  {:>8}  {:>9.4}  {:>12.1}  {:>9.1}  {:>8.1}\n",
            layer.index,
            layer.name,
            layer.segments.len(),
            layer.length(),
            process.layer_time,
            process.layer_height * 1e3,
            process.filament_width * 1e3,
        );
    }
    let length: f64 = model.layers.iter().map(Layer::length).sum();
    let time: f64 = model.layers.iter().map(|layer| layer.process.layer_time).sum();
    text += &format!("  {} layers, {length:.4} m, {time:.1} s\n", model.layers.len());
    text + "verified: the file is whole; units, placements and process parameters are there; every segment is supported and \
           joins the one before; lengths agree with those the file declares.\n\
           not verified here: reach and limits of a robot (--cell FILE.toml does that).\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn check(file: &Path) -> Result<(), Failure> {
        run(&CheckArgs { file: file.to_owned(), cell: None })
    }

    #[test]
    fn sound_files_are_described() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures");
        for file in [
            "cells/demo.toml",
            "cells/fim_fixture.toml",
            "cells/lead.toml",
            "cells/tracker.toml",
            "data/FIM_fixture_IFC4.ifc",
        ] {
            assert_eq!(check(&fixtures.join(file)), Ok(()), "{file}");
        }
        let cell = Cell::demo(500).unwrap_or_else(|error| panic!("{error}"));
        let text = describe_cell(&cell);
        let read = |name: &str| {
            let cell = config::load(&fixtures.join(name)).unwrap_or_else(|error| panic!("{error}"));
            describe_cell(&cell)
        };
        let lead = "lead      at most 8.0 deg and 30 deg/s, dead time 6.0 ms; lag 100 ms at first, 10 to 400 ms learnt";
        assert!(!text.contains("lead") && read("cells/lead.toml").contains(lead), "{}", read("cells/lead.toml"));
        assert!(read("cells/tracker.toml").contains("no link to one yet"));
        assert!(text.contains("RTDE to 127.0.0.1:30004 at 500 Hz") && text.contains("at most 100000 mm³/s"), "{text}");
        let (model, _) =
            read_model(&fixtures.join("data/FIM_fixture_IFC4.ifc")).unwrap_or_else(|error| panic!("{error}"));
        // The length that an independent computation gives (8.983187172 m).
        assert!(describe_model(&model).contains(" 8.9832 "), "{}", describe_model(&model));
    }

    #[test]
    fn a_broken_model_is_shown_with_its_line() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let whole = include_str!("../../../fixtures/data/FIM_fixture_IFC4.ifc");
        let file = folder.path().join("broken.ifc");
        std::fs::write(&file, whole.replacen("IFCCIRCLE(#70,1080.)", "IFCELLIPSE(#70,1080.,1080.)", 1))
            .expect("a file");
        let failure = check(&file).expect_err("an unsupported segment");
        assert_eq!(failure.exit, Exit::Input);
        let text = failure.to_string();
        assert!(text.contains("IFCELLIPSE") && text.contains("broken.ifc:") && text.contains("^"), "{text}");
        std::fs::write(&file, whole.get(..whole.len() / 2).unwrap_or_default()).expect("a file");
        let text = check(&file).expect_err("half a file").to_string();
        assert!(text.contains("cut short"), "{text}");
    }

    #[test]
    fn other_files_are_a_usage_error() {
        assert_eq!(check(Path::new("notes.txt")).expect_err("no such kind").exit, Exit::Usage);
        assert_eq!(check(Path::new("none.toml")).expect_err("no such file").exit, Exit::Input);
        assert_eq!(check(Path::new("none.ifc")).expect_err("no such file").exit, Exit::Input);
    }
}
