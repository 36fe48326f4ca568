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
    let mut source = layout!(screed_sensors, Sensors, actual estimate correction ready has_estimate has_correction);
    source += &layout!(screed_command, Command, joints correction flow rate seq known deposit mode fault);
    source += &layout!(
        screed_status, Status,
        tick fault_tick time_lost_ns rate epoch consumed end_seq credits fault_number frames_broken frames_unknown
        ticks_late mode fault
    );
    let faults = [
        "FOLLOWING",
        "SENSOR",
        "NOT_READY",
        "OUTPUT",
        "EXTRUDER",
        "DEVIATION",
        "CORRECTION",
        "SATURATED",
        "UNREACHABLE",
        "BASE",
        "DRIVE",
        "LEAD",
        "TRACKER",
        "OVERRUN",
        "LINK",
    ];
    for (name, kind) in faults.into_iter().zip(Fault::KINDS) {
        writeln!(source, "_Static_assert(SCREED_FAULT_{name} == {}, \"{name}\");", fault_number(Some(kind))).unwrap();
    }
    assert_eq!((faults.len(), fault_number(None)), (Fault::KINDS.len(), 0));
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
    assert_eq!(compiles(&source), Ok(()));
    let wrong = source.replace("screed_command, seq) == 112", "screed_command, seq) == 116");
    assert_ne!(wrong, source);
    assert!(compiles(&wrong).is_err(), "the check cannot fail");
}
