//! Measurement files: the examples of the documentation, what is refused with its place, and noise.

use crate::calibrate::file::{FileError, FrameFile, Source, TcpFile, TrackerFile};
use crate::calibrate::{CalibrateError, arm, frame, report, target, tcp};
use crate::failure::{Exit, Failure};
use screed_kernel::arms::ur::UR10E;
use screed_tape::random::Random;

/// The examples of docs/calibration.md, in their order: frame, tcp, target.
fn examples() -> [&'static str; 3] {
    let docs = include_str!("../../../../docs/calibration.md");
    let blocks: Vec<_> = docs.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    blocks.try_into().expect("three examples")
}

fn run_frame(text: &str) -> Result<frame::Frame, Failure> {
    let source = Source::new("frame.toml", text);
    let file: FrameFile = source.parse()?;
    let (pairs, sigma) = file.checked(&source)?;
    let found = frame::fit(&pairs, sigma)?;
    assert!(!report::frame(&found, &file.outer, &file.inner).words.is_empty());
    Ok(found)
}

fn run_tcp(text: &str) -> Result<tcp::Tcp, Failure> {
    let source = Source::new("tcp.toml", text);
    let (poses, sigma) = source.parse::<TcpFile>()?.checked(&source, Some(&UR10E))?;
    let found = tcp::pivot(&poses, sigma)?;
    assert!(!report::tcp(&found).words.is_empty());
    Ok(found)
}

fn run_target(text: &str) -> Result<target::Target, Failure> {
    let source = Source::new("target.toml", text);
    let file: TrackerFile = source.parse()?;
    let found = target::calibrate(&file.pairs(&source, Some(&UR10E))?, &file.noise(&source)?)?;
    assert!(!report::target(&found).words.is_empty());
    Ok(found)
}

fn run_arm(text: &str) -> Result<arm::Identified<6>, Failure> {
    let source = Source::new("arm.toml", text);
    let file: TrackerFile = source.parse()?;
    let found = arm::identify(&UR10E, &file.measurements(&source, &UR10E)?, &file.noise(&source)?)?;
    assert!(!report::arm(&found, "ur10e").words.is_empty());
    Ok(found)
}

fn told<T>(result: Result<T, Failure>) -> String {
    match result {
        Ok(_) => String::new(),
        Err(failure) => {
            assert_eq!(failure.exit, Exit::Input);
            failure.to_string()
        }
    }
}

#[test]
fn the_examples_of_the_documentation_are_sound() {
    let [frame, tcp, target] = examples();
    let found = run_frame(frame).expect("a frame");
    let [low, high] = found.fit.expect("the noise is in the file").noise_ratio_band();
    assert!((low..high).contains(&found.fit.expect("the same").noise_ratio()));
    let found = run_tcp(tcp).expect("a tip");
    assert!(found.fit.is_none() && found.sigma < 1e-4, "{}", found.sigma);
    let found = run_target(target).expect("frames");
    let [low, high] = found.fit.noise_ratio_band();
    assert!((low..high).contains(&found.fit.noise_ratio()), "{:?}", found.fit);
}

#[test]
fn what_is_wrong_with_a_file_is_told_with_its_place_and_a_remedy() {
    let [frame, tcp, target] = examples();
    let spoilt = |text: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    };
    let cases = [
        (told(run_frame(&spoilt(frame, "outer_mm", "outer_m"))), "unknown field `outer_m`"),
        (told(run_frame(&spoilt(frame, "outer = \"tracker\"\n", ""))), "missing field `outer`"),
        (told(run_frame(&spoilt(frame, "inner_mm = [0, 0, 0]", ""))), "missing field `inner_mm`"),
        (told(run_frame(&spoilt(frame, "[0, 0, 0]", "[0, 0]"))), "invalid length 2"),
        (told(run_frame(&spoilt(frame, "[0, 0, 0]", "[0, nan, 0]"))), "inner_mm: expected numbers from"),
        (told(run_frame(&spoilt(frame, "[0, 0, 0]", "[0, 1e7, 0]"))), "found 10000000"),
        (told(run_frame(&spoilt(frame, "sigma_um = 20", "sigma_um = -1"))), "sigma_um: expected more than 0"),
        (told(run_frame(&spoilt(frame, "sigma_um = 20", "sigma_um ="))), "frame.toml:3"),
        (told(run_tcp(&spoilt(tcp, "rpy_deg = [180, 0, 0]", "joints_deg = [1]"))), "unknown field `joints_deg`"),
        (told(run_tcp(&spoilt(tcp, ", rpy_deg = [180, 0, 0]", ""))), "rpy_deg or quaternion_wxyz, found neither"),
        (told(run_tcp(&spoilt(tcp, "flange =", "joints_deg = [0, 0, 0, 0, 0, 0]\nflange ="))), "found both"),
        (told(run_tcp(&spoilt(tcp, "rpy_deg = [180, 0, 0]", "quaternion_wxyz = [1, 1, 0, 0]"))), "a length of 1"),
        (told(run_target(&spoilt(target, "rotation_deg = 0.01", "rotation_deg = 0"))), "rotation_deg: expected more"),
        (told(run_target(&spoilt(target, "per_m = 3", "per_m = -3"))), "position_um_per_m: expected a number from 0"),
        (told(run_target(&spoilt(target, "position_um = 7.5\n", ""))), "missing field `position_um`"),
        (told(run_arm(target)), "this measurement: expected joints_deg of the robot, found none"),
    ];
    for (told, expected) in cases {
        assert!(told.contains(expected) && told.contains("remedy: ") && told.contains("--> "), "{expected}: {told}");
    }
    let joints = |joints: &str| format!("[[touch]]\n{joints}\n");
    for (text, expected) in [
        (joints("joints_deg = [0, 0, 0, 0, 0]"), "6 numbers for the robot, found 5"),
        (joints("joints_deg = [0, 0, 0, 0, 0, inf]"), "numbers from -10000 to 10000, found inf"),
        (joints("joints_deg_mm = [0, 0, 0, 0, 0, 0]"), "joints_deg of the robot, found the other key"),
        (joints(""), "joints or flange, found neither"),
    ] {
        let told = told(run_tcp(&text));
        assert!(told.contains(expected) && told.contains("remedy: ") && told.contains("tcp.toml:"), "{told}");
    }
    let source = Source::new("tcp.toml", "[[touch]]\njoints_deg = [0, 0, 0, 0, 0, 0]\n");
    let nameless = source.parse::<TcpFile>().expect("laid out well").checked::<6>(&source, None);
    assert!(matches!(nameless, Err(FileError::Value { what: "joints", .. })), "{nameless:?}");
    let many = "[[pair]]\nouter_mm = [0, 0, 0]\ninner_mm = [0, 0, 0]\n".repeat(10_001);
    assert!(told(run_frame(&format!("outer = \"a\"\ninner = \"b\"\n{many}"))).contains("at most 10000"));
}

#[test]
fn a_frame_of_the_other_handedness_is_refused() {
    let [frame, ..] = examples();
    let told = told(run_frame(&frame.replace("[0, 0, 1000]", "[0, 0, -1000]")));
    assert!(told.contains("mirror image") && told.contains("remedy: check the signs"), "{told}");
}

/// Whatever a file says, there is an answer or a failure with something to do.
#[test]
fn no_text_makes_it_panic() {
    let mut random = Random(41);
    let mut sound = 0;
    for case in 0..3000 {
        let mut bytes = examples()[case % 3].as_bytes().to_vec();
        for _ in 0..1 + random.below(4) {
            let at = random.below(bytes.len() as u32) as usize;
            match random.below(4) {
                0 => bytes[at] = b"0123456789.-e[]{},=\n\"x"[random.below(22) as usize],
                1 => bytes.insert(at, b"0123456789.-e[]{},=\n\"x"[random.below(22) as usize]),
                2 => {
                    bytes.remove(at);
                }
                _ => bytes.truncate(at.max(1)),
            }
        }
        let text = String::from_utf8(bytes).expect("the examples are ASCII");
        let told = match case % 3 {
            0 => told(run_frame(&text)),
            1 => told(run_tcp(&text)),
            _ => told(run_target(&text)),
        };
        assert!(told.is_empty() || told.contains("remedy: "), "{text}\n{told}");
        sound += usize::from(told.is_empty());
    }
    assert!((100..2900).contains(&sound), "{sound}");
}

#[test]
fn every_refusal_says_what_to_do() {
    let axis = nalgebra::Vector3::x();
    for error in [
        CalibrateError::TooFew { what: "poses", found: 1, least: 3 },
        CalibrateError::NotFinite { measurement: 0 },
        CalibrateError::Noise { found: -1.0 },
        CalibrateError::NoTurn,
        CalibrateError::OneAxis { axis_in_flange: axis, swing: 0.0 },
        CalibrateError::Undetermined { parameters: vec!["a".to_owned(), "b".to_owned()] },
        CalibrateError::NotConverged { iterations: 9, noise_ratio: 1e9 },
        CalibrateError::Mirrored { residual_rms: 1.0, mirrored_rms: 0.1 },
    ] {
        let [problem] = &Failure::from(error).problems[..] else { panic!("one problem") };
        assert!(problem.remedy.as_ref().is_some_and(|remedy| remedy.len() > 10), "{problem}");
    }
}
