use super::*;
use std::fs;
use std::path::Path;

fn metadata() -> Metadata {
    Metadata {
        screed: "0.1.0".to_owned(),
        cell: "demo".to_owned(),
        model: "wall.ifc".to_owned(),
        model_hash: "0123456789abcdef".to_owned(),
        arm: "ur10e".to_owned(),
        rate_hz: 125,
        modes: vec!["idle".to_owned(), "moving".to_owned()],
    }
}

fn record(tick: u64) -> CycleRecord {
    let value = tick as f64;
    CycleRecord {
        tick: Tick(tick),
        readable: Nanos(tick * 8_000_000),
        received: Nanos(tick * 8_000_000 + 4_000),
        ticked: Nanos(tick * 8_000_000 + 20_000),
        sent: Nanos(tick * 8_000_000 + 31_000),
        robot_timestamp: 40.0 + 0.008 * value,
        seq: tick as u32 + 1,
        mode: (tick % 3) as u8,
        flags: Flags::DEPOSIT
            | if tick.is_multiple_of(2) { Flags::default() } else { Flags::DOUBLED }
            | if tick.is_multiple_of(3) { Flags::NON_RT } else { Flags::default() },
        layer: (tick / 50) as u16,
        rate: 1.0,
        flow: 2.16e-5 * value,
        commanded: JointPos([0.1 * value, -1.0, 2.0, -3.0, 1e-300, f64::MIN_POSITIVE]),
        actual: JointPos([0.1 * value - 1e-3, -0.0, f64::MAX, -3.1, 1.5, 0.25]),
        missed: (tick % 5) as u32,
        overrun_level: tick as u32,
    }
}

fn write(path: &Path, count: u64) {
    let mut writer = LogWriter::create(path, &metadata()).expect("the temporary folder takes files");
    for tick in 0..count {
        writer.push(&record(tick)).expect("the temporary folder has space");
    }
    writer.finish().expect("the temporary folder has space");
}

/// The sound records, and the error that ended them.
fn read(path: &Path) -> (Vec<CycleRecord>, Option<LogError>) {
    let mut records = Vec::new();
    match LogReader::open(path) {
        Err(error) => (records, Some(error)),
        Ok(reader) => {
            for item in reader {
                match item {
                    Ok(record) => records.push(record),
                    Err(error) => return (records, Some(error)),
                }
            }
            (records, None)
        }
    }
}

fn is_the_beginning(records: &[CycleRecord]) -> bool {
    (0..).zip(records).all(|(tick, found)| *found == record(tick))
}

#[test]
fn what_was_written_is_read_back_bit_by_bit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("cycles.screedlog");
    for count in [0, 1, 63, 64, 65, 1000] {
        write(&path, count);
        assert_eq!(LogReader::open(&path).expect("a sound log").metadata(), &metadata());
        let (records, error) = read(&path);
        assert!(error.is_none(), "{error:?}");
        assert_eq!(records.len() as u64, count);
        assert!(is_the_beginning(&records));
        let header = 20 + serde_json::to_vec(&metadata()).expect("plain strings").len() as u64;
        let blocks = count.div_ceil(BLOCK_RECORDS as u64) + 1;
        let size = fs::metadata(&path).expect("the log").len();
        assert_eq!(size, header + blocks * 12 + count * RECORD_SIZE as u64);
    }
}

#[test]
fn a_log_torn_at_any_byte_gives_its_whole_blocks_and_says_that_it_is_torn() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("torn.screedlog");
    write(&path, 70);
    let whole = fs::read(&path).expect("the log");
    let header = 20 + serde_json::to_vec(&metadata()).expect("plain strings").len();
    let first_block_end = header + 12 + 64 * RECORD_SIZE;
    let second_block_end = first_block_end + 12 + 6 * RECORD_SIZE;
    for size in 0..whole.len() {
        fs::write(&path, whole.get(..size).unwrap_or_default()).expect("the temporary folder has space");
        let (records, error) = read(&path);
        assert!(is_the_beginning(&records));
        if size < header {
            assert!(matches!(error, Some(LogError::NotALog { .. } | LogError::Header { .. })), "{size}: {error:?}");
            continue;
        }
        let (count, end) = match size {
            _ if size < first_block_end => (0, header),
            _ if size < second_block_end => (64, first_block_end),
            _ => (70, second_block_end),
        };
        assert_eq!(records.len(), count, "cut at {size}");
        let Some(LogError::Torn { offset, records, .. }) = error else { panic!("{size}: {error:?}") };
        assert_eq!((offset, records), (end as u64, count as u64));
    }
}

#[test]
fn a_flipped_bit_anywhere_is_noticed_and_no_wrong_record_is_handed_out() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("flipped.screedlog");
    write(&path, 70);
    let whole = fs::read(&path).expect("the log");
    for at in 0..whole.len() {
        let mut bytes = whole.clone();
        if let Some(byte) = bytes.get_mut(at) {
            *byte ^= 1 << (at % 8);
        }
        fs::write(&path, &bytes).expect("the temporary folder has space");
        let (records, error) = read(&path);
        assert!(error.is_some(), "flipped byte {at}");
        assert!(is_the_beginning(&records), "flipped byte {at}");
    }
}

#[test]
fn blocks_out_of_order_and_bytes_behind_the_end_are_noticed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("order.screedlog");
    write(&path, 64 * 3);
    let whole = fs::read(&path).expect("the log");
    let header = 20 + serde_json::to_vec(&metadata()).expect("plain strings").len();
    let block = 12 + 64 * RECORD_SIZE;
    let mut missing = whole.clone();
    missing.drain(header + block..header + 2 * block);
    fs::write(&path, &missing).expect("the temporary folder has space");
    let (records, error) = read(&path);
    assert_eq!(records.len(), 64);
    let text = error.map(|error| error.to_string()).unwrap_or_default();
    assert!(text.contains("it is block 2 where block 1 is due"), "{text}");

    let mut longer = whole;
    longer.push(0);
    fs::write(&path, &longer).expect("the temporary folder has space");
    let (records, error) = read(&path);
    assert_eq!(records.len(), 192);
    assert!(matches!(error, Some(LogError::Corrupt { .. })), "{error:?}");
}

#[test]
fn a_writer_that_never_finishes_leaves_a_log_that_says_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("killed.screedlog");
    let mut writer = LogWriter::create(&path, &metadata()).expect("the temporary folder takes files");
    for tick in 0..130 {
        writer.push(&record(tick)).expect("the temporary folder has space");
    }
    drop(writer);
    let (records, error) = read(&path);
    assert_eq!(records.len(), 128);
    assert!(matches!(error, Some(LogError::Torn { records: 128, .. })), "{error:?}");
}

#[test]
fn the_table_has_a_header_with_units_and_reads_back_exactly() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("table.screedlog");
    write(&path, 70);
    let mut table = Vec::new();
    write_csv(LogReader::open(&path).expect("a sound log"), &mut table).expect("a sound log");
    let table = String::from_utf8(table).expect("plain text");
    let mut lines = table.lines();
    let header: Vec<_> = lines.next().unwrap_or_default().split(',').collect();
    assert_eq!(header.len(), 17 + 12);
    assert_eq!((header.get(16), header.get(28)), (Some(&"flow_m3_s"), Some(&"actual_6_rad")));
    let rows: Vec<Vec<_>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 70);
    for (tick, row) in (0..).zip(&rows) {
        let record = record(tick);
        let field =
            |name: &str| header.iter().position(|&column| column == name).and_then(|index| row.get(index).copied());
        let number = |name: &str| field(name).and_then(|text| text.parse::<f64>().ok());
        assert_eq!(field("mode"), Some(["idle", "moving", "2"][(tick % 3) as usize]));
        assert_eq!(field("doubled"), Some(if tick.is_multiple_of(2) { "0" } else { "1" }));
        assert_eq!(number("readable_ns"), Some(record.readable.0 as f64));
        assert_eq!(
            (field("missed"), number("overrun_level")),
            (Some(["0", "1", "2", "3", "4"][(tick % 5) as usize]), Some(tick as f64))
        );
        assert_eq!(field("non_rt"), Some(if tick.is_multiple_of(3) { "1" } else { "0" }));
        assert_eq!(number("robot_timestamp_s"), Some(record.robot_timestamp));
        assert_eq!(number("flow_m3_s"), Some(record.flow));
        assert_eq!(number("commanded_5_rad"), Some(1e-300));
        assert_eq!(number("actual_3_rad"), Some(f64::MAX));
    }

    // A torn log gives its whole rows and then the error.
    let bytes = fs::read(&path).expect("the log");
    fs::write(&path, bytes.get(..bytes.len() - 5).unwrap_or_default()).expect("the temporary folder has space");
    let mut table = Vec::new();
    let torn = write_csv(LogReader::open(&path).expect("a sound header"), &mut table);
    assert!(matches!(torn, Err(csv::CsvError::Log(LogError::Torn { records: 70, .. }))), "{torn:?}");
    assert_eq!(String::from_utf8_lossy(&table).lines().count(), 71);
}
