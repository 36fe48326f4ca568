//! How fast the demo's wall is planned, verified and streamed: `cargo bench -p screed-benches --bench setpoints`.

use screed::config::Cell;
use screed::model::fim;
use screed::plan::{Options, Plan};
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::time::Instant;

const RUNS: usize = 5;

fn main() {
    let text = quarter_circle(&QuarterCircle::default());
    let model = fim::parse("quarter-circle.ifc", text.as_bytes()).expect("the generated model is sound");
    for rate in [125, 500] {
        let cell = Cell::demo(rate).expect("the demo's cell is sound");
        let mut streamed = Vec::new();
        let mut planned = Vec::new();
        let mut count = 0;
        for _ in 0..RUNS {
            let began = Instant::now();
            let plan =
                Plan::new(&model, &cell, &Options::default(), &cell.robot.start).expect("the wall can be printed");
            planned.push(began.elapsed().as_secs_f64());
            let began = Instant::now();
            count = plan.batches().map(|batch| batch.map_or(0, |batch| batch.setpoints.len())).sum();
            streamed.push(began.elapsed().as_secs_f64());
        }
        planned.sort_by(f64::total_cmp);
        streamed.sort_by(f64::total_cmp);
        let (planned, streamed) = (planned[RUNS / 2], streamed[RUNS / 2]);
        let seconds = count as f64 / f64::from(rate);
        println!(
            "{rate} Hz, {} layers: planned and verified in {planned:.3} s; {count} setpoints (tails included) streamed in \
             {streamed:.3} s, {:.0} a second, {:.0} times real time (medians of {RUNS})",
            model.layers.len(),
            count as f64 / streamed,
            seconds / streamed
        );
    }
}
