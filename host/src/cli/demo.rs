//! `screed demo`

use super::args::DemoArgs;
use super::print::report;
use crate::failure::Failure;
use crate::run::demo::Demo;

/// Shows it, and says how it went.
pub fn run(args: &DemoArgs) -> Result<(), Failure> {
    let demo = Demo {
        layers: usize::from(args.layers),
        rate_hz: args.rate,
        stop_after: args.stop_after.map(|time| time.as_secs_f64()),
        fast: args.fast,
        line_fault: args.line_fault,
        program: args.program.clone(),
        log: args.log.clone(),
        record: args.record.clone(),
        record_extruder: args.record_extruder.clone(),
        quiet: args.json,
    };
    report(&demo.run()?, args.json)
}
