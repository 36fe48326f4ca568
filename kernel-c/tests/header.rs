//! The header says what the library does: sizes, places of fields and constants, by a C compiler.

use screed_kernel::fault::Fault;
use screed_kernel::frame::ModeCode;
use screed_kernel_c::{Command, JOINTS, RING, Sensors, Status, fault_number};
use std::fmt::Write;
use std::mem::{offset_of, size_of};
use std::process;

macro_rules! layout {
    ($c:ident, $rust:ty, $($field:ident)*) => {{
        let mut lines = format!("_Static_assert(sizeof({0}) == {1}, \"{0}\");\n", stringify!($c), size_of::<$rust>());
        $(writeln!(
            lines,
            "_Static_assert(offsetof({0}, {1}) == {2}, \"{0}.{1}\");",
            stringify!($c), stringify!($field), offset_of!($rust, $field)
        ).unwrap();)*
        lines
    }};
}

fn compiles(source: &str) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("layout.c");
    std::fs::write(&file, format!("#include \"screed_kernel.h\"\n{source}")).unwrap();
    let output = process::Command::new("cc")
        .args([
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-pedantic",
            "-fsyntax-only",
            "-I",
            env!("CARGO_MANIFEST_DIR"),
        ])
        .arg(&file)
        .output()
        .expect("needs a C compiler, as rustc does");
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

#[test]
fn the_header_has_the_librarys_layout_and_numbers() {
    let mut source = layout!(screed_sensors, Sensors, actual ready);
    source += &layout!(screed_command, Command, joints flow rate seq known deposit mode fault);
    source += &layout!(
        screed_status, Status,
        tick fault_tick rate epoch consumed end_seq credits fault_number frames_broken mode fault
    );
    let joint = 0;
    let faults = [
        ("NONE", fault_number(None)),
        ("FOLLOWING", fault_number(Some(Fault::Following { joint, value: 0.0, limit: 0.0 }))),
        ("SENSOR", fault_number(Some(Fault::Sensor { joint }))),
        ("NOT_READY", fault_number(Some(Fault::RobotNotReady))),
        ("OUTPUT", fault_number(Some(Fault::Output { joint, value: 0.0, limit: 0.0 }))),
        ("EXTRUDER", fault_number(Some(Fault::Extruder))),
    ];
    let numbers = [
        ("JOINTS", JOINTS),
        ("RING", RING),
        ("UNREADY", ModeCode::Unready as usize),
        ("HOLDING", ModeCode::Holding as usize),
        ("MOVING", ModeCode::Moving as usize),
        ("STOPPING", ModeCode::Stopping as usize),
        ("FAULTED", ModeCode::Faulted as usize),
    ];
    for (name, number) in numbers {
        writeln!(source, "_Static_assert(SCREED_{name} == {number}, \"{name}\");").unwrap();
    }
    for (name, number) in faults {
        writeln!(source, "_Static_assert(SCREED_FAULT_{name} == {number}, \"{name}\");").unwrap();
    }
    assert_eq!(compiles(&source), Ok(()));
    let wrong = source.replace("screed_command, seq) == 64", "screed_command, seq) == 68");
    assert_ne!(wrong, source);
    assert!(compiles(&wrong).is_err(), "the check cannot fail");
}
