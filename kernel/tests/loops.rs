//! `docs/kernel-loops.md` lists every loop of the kernel with its bound; here the list is held to the source, and the bounds
//! that do not follow from a type to what the kernel does.

mod common;

use common::Random;
use screed_kernel::dexterity::SWEEPS_MAX;
use screed_kernel::drive::DEAD_TICKS_MAX;
use screed_kernel::ekf::replay::{STEP_MEASUREMENTS_MAX, WAITING_MAX};
use screed_kernel::estimator::POSES_MAX;
use screed_kernel::frame::{self, BatchPart, CODE_MAX, FRAME_MAX, JOINTS_MAX, ToKernel, WIRE_MAX};
use screed_kernel::guard::PLANES_MAX;
use screed_kernel::ring::{EXTENTS_MAX, Ring, RingError};
use screed_kernel::setpoint::{Coder, Setpoint};
use screed_kernel::tick::{Kernel, RECEIVE_MAX, Sensors, TRANSMIT_MAX};
use screed_kernel::units::{JointPos, Nanos};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// What begins a loop: a statement, or a call that walks an array or a slice.
const STATEMENTS: [&str; 3] = ["for ", "while ", "loop "];
const CALLS: [&str; 9] = [
    ".iter()",
    ".iter_mut()",
    ".into_iter()",
    "from_fn(",
    ".copy_within(",
    ".copy_from_slice(",
    ".repeat(",
    // Of an array; that of an option turns once.
    "].map(",
    "joints.map(",
];

/// Count of loops by file and function.
type Loops = BTreeMap<(String, String), usize>;

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Every line of code of the kernel, with its file and function.
fn lines() -> Vec<(String, String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut lines = Vec::new();
    for path in files {
        let file = path.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
        let text = fs::read_to_string(&path).unwrap();
        // Nothing but tests; `steps.rs` counts steps for them.
        if file == "steps.rs" || file.ends_with("/tests.rs") {
            continue;
        }
        let mut function = String::new();
        for line in text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default().lines() {
            let code = line.trim();
            if code.starts_with("//") {
                continue;
            }
            let words: Vec<_> = code.split([' ', '(', '<', ':']).collect();
            let after = |word| words.iter().position(|found| *found == word).and_then(|at| words.get(at + 1));
            if let Some(name) = after("fn").or_else(|| after("const").filter(|_| line == code)) {
                function = (*name).to_owned();
            }
            lines.push((file.clone(), function.clone(), code.to_owned()));
        }
    }
    lines
}

fn in_source() -> Loops {
    let mut loops = Loops::new();
    for (file, function, code) in lines() {
        let statement = STATEMENTS.iter().any(|start| code.starts_with(start));
        let calls: usize = CALLS.iter().map(|call| code.matches(call).count()).sum();
        // A `for` over an iterator is one loop.
        let count = if statement { 1 } else { calls };
        if count > 0 {
            *loops.entry((file, function)).or_default() += count;
        }
    }
    loops
}

/// The functions with a statement that begins so.
fn statements(starts: &[&str]) -> Vec<(String, String)> {
    let begins = |code: &str| starts.iter().any(|start| code.starts_with(start));
    lines().into_iter().filter(|(.., code)| begins(code)).map(|(file, function, _)| (file, function)).collect()
}

/// Rows `| file | function | count | bound | asserted by |`.
fn rows() -> Vec<Vec<&'static str>> {
    let docs = include_str!("../../docs/kernel-loops.md");
    let rows = docs.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect()
}

#[test]
fn every_loop_is_listed_with_a_bound_and_what_asserts_it() {
    let mut listed = Loops::new();
    for row in rows() {
        let [file, function, count, bound, asserted] = row[..] else { panic!("{row:?} has not five columns") };
        let name = |cell: &str| cell.trim_matches('`').to_owned();
        assert!(!bound.is_empty() && !asserted.is_empty(), "{row:?}");
        listed.insert((name(file), name(function)), count.parse().unwrap());
    }
    assert_eq!(listed, in_source(), "left the list in docs/kernel-loops.md, right the source");
}

/// A `for` over an array, a list or a range ends by itself; any other loop needs a test that says when.
#[test]
fn where_only_the_type_bounds_a_loop_it_is_no_while_and_no_loop() {
    let mut tested = 0;
    for (file, function) in statements(&["while ", "loop "]) {
        let head = [file, function].map(|name| format!("`{name}`"));
        let row = rows().into_iter().find(|row| row[..2] == head).unwrap();
        let (by_test, by_compiler) = (row[4].contains('`'), row[3].ends_with("by the compiler"));
        assert!(by_test || by_compiler, "{head:?} has no test");
        tested += usize::from(by_test);
    }
    assert!(tested > 0);
}

#[test]
fn every_test_that_the_list_names_exists() {
    let mut files = Vec::new();
    for folder in ["src", "tests"] {
        sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut files);
    }
    let all: String = files.iter().map(|path| fs::read_to_string(path).unwrap()).collect();
    let mut named = 0;
    for row in rows() {
        let asserted = row[4];
        for test in asserted.split('`').skip(1).step_by(2) {
            assert!(all.contains(&format!("fn {test}()")), "{row:?} names a test that is not there");
            named += 1;
        }
    }
    assert!(named >= 5);
}

#[test]
fn the_constants_have_the_listed_values() {
    let docs = include_str!("../../docs/kernel-loops.md");
    for (name, value) in [
        ("JOINTS_MAX", JOINTS_MAX),
        ("PLANES_MAX", PLANES_MAX),
        ("SWEEPS_MAX", SWEEPS_MAX),
        ("EXTENTS_MAX", EXTENTS_MAX),
        ("RECEIVE_MAX", RECEIVE_MAX),
        ("FRAME_MAX", FRAME_MAX),
        ("WIRE_MAX", WIRE_MAX),
        ("CODE_MAX", CODE_MAX),
        ("TRANSMIT_MAX", TRANSMIT_MAX),
        ("WAITING_MAX", WAITING_MAX),
        ("STEP_MEASUREMENTS_MAX", STEP_MEASUREMENTS_MAX),
        ("DEAD_TICKS_MAX", DEAD_TICKS_MAX),
        ("POSES_MAX", POSES_MAX),
    ] {
        assert!(docs.contains(&format!("`{name}` = {value}")), "{name} is {value}");
    }
}

#[test]
fn a_setpoint_takes_a_byte_for_each_number_and_ten_at_most() {
    const N: usize = 6;
    let mut random = Random(3);
    let (mut shortest, mut longest) = (usize::MAX, 0);
    for _ in 0..200_000 {
        let mut bytes = [0; 100];
        let share = random.below(4);
        for byte in &mut bytes {
            *byte = match share {
                0 => random.bits() as u8,
                1 => 0,
                _ => 0x80 * u8::from(random.below(10) < 8),
            };
        }
        bytes[0] &= 1;
        if let Ok((_, used)) = Coder::<N>::new().decode(&bytes) {
            (shortest, longest) = (shortest.min(used), longest.max(used));
        }
    }
    assert_eq!(shortest, N + 2);
    assert!(longest > 50 && longest <= 1 + 10 * (N + 1), "{longest}");
    // So many setpoints can be in one message, and no more.
    let (mut coder, mut code, mut used, mut count) = (Coder::<N>::new(), [0; CODE_MAX], 0, 0);
    while let Ok(length) = coder.encode(&Setpoint::ZERO, &mut code[used..]) {
        (used, count) = (used + length, count + 1);
    }
    assert_eq!(count, CODE_MAX / (N + 2));
    let code = &code[..used];
    let part =
        BatchPart { batch: u32::MAX, first_seq: u32::MAX, opens: true, commits: true, after: Some(u32::MAX), code };
    assert!(frame::encode(&ToKernel::Batch(part), &mut [0; WIRE_MAX]).is_ok());
}

#[test]
fn a_ring_lists_so_many_batches_and_no_more() {
    let mut ring = Ring::<1, 64>::new();
    let still = Setpoint { joints: JointPos([0.0]), flow: 0.0, deposit: false };
    let mut batches = 0;
    let refused = loop {
        let next = ring.end_seq() + 1;
        if let Err(error) = ring.stage(next, None) {
            break error;
        }
        ring.push(&still).unwrap();
        ring.commit().unwrap();
        batches += 1;
    };
    assert_eq!((batches, refused, ring.credits()), (EXTENTS_MAX, RingError::Full, 0));
}

#[test]
fn a_tick_takes_a_frame_and_the_answers_that_wait_are_bounded() {
    let mut kernel = Box::new(Kernel::<2, 64>::new(&common::ARM));
    let mut stale = [0; WIRE_MAX];
    let used = frame::encode(&ToKernel::Rearm { fault: 9 }, &mut stale).unwrap();
    let stream = stale[..used].repeat(1000);
    let sensors = Sensors::robot(JointPos([0.0; 2]), true);
    for k in 0..20 {
        assert_eq!(kernel.receive(&stream), RECEIVE_MAX);
        assert_eq!(kernel.receive(&stream), 0, "not before the next tick");
        kernel.tick(Nanos(k), &sensors);
    }
    let mut answers = [0; 100_000];
    let waiting = kernel.poll_transmit(&mut answers);
    assert!((TRANSMIT_MAX - 100..=TRANSMIT_MAX).contains(&waiting), "{waiting}");
    assert_eq!(answers[waiting - 1], 0, "whole frames only");
    assert_eq!(kernel.poll_transmit(&mut [0; 100_000]), 0);
}
