//! The drawing: z of one run as in the paper's figure, and the errors below it.

use super::{Case, Sample, error};
use crate::svg::{self, Axes};
use screed_kernel::pose::Pose;

const WIDTH: f64 = 1240.0;
const HEIGHT: f64 = 880.0;
/// Colours of raw, filtered and smoothed, and of the truth.
const COLOURS: [&str; 3] = ["#c9ced6", "#c43728", "#2e7ca8"];
const TRUTH: &str = "#2a2f36";
/// Ticks drawn at most: more than a page has points.
const POINTS_MAX: usize = 1250;

/// One run of a case.
pub fn svg(case: &Case, seed: u64, samples: &[Sample]) -> String {
    let mut out = svg::open(WIDTH, HEIGHT);
    let bold = "font-size=\"19\" font-weight=\"bold\"";
    svg::text(&mut out, [30.0, 34.0], "start", bold, "A noisy pose, half of it missing, filtered");
    let about =
        format!("{}, seed {seed}: z of the flange in the base frame, and the distance from the truth", case.name);
    svg::text(&mut out, [30.0, 56.0], "start", "fill=\"#5a626c\"", &about);
    let end = samples.last().map_or(1.0, |sample| sample.time);
    let every = samples.len().div_ceil(POINTS_MAX).max(1);
    let shown: Vec<_> = samples.iter().step_by(every).collect();
    let raw = |sample: &&Sample| sample.raw.map(|pose| pose.translation.z);
    let heights = shown.iter().filter_map(raw).chain(shown.iter().map(|sample| sample.truth.translation.z));
    let [low, high] = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)]);
    let height = Axes { page: [90.0, 90.0, 1110.0, 420.0], x: [0.0, end], y: [low, high] };
    height.draw(&mut out, "time, s", "z, m");
    dots(&mut out, &height, &shown, |sample| sample.raw.map(|pose| pose.translation.z));
    line(&mut out, &height, &shown, TRUTH, |sample| sample.truth.translation.z);
    line(&mut out, &height, &shown, COLOURS[1], |sample| sample.filtered.translation.z);
    line(&mut out, &height, &shown, COLOURS[2], |sample| sample.smoothed.translation.z);
    let off = |sample: &Sample, pose: &Pose| error(&sample.truth, pose)[0];
    let distance = Axes { page: [90.0, 590.0, 1110.0, 220.0], x: [0.0, end], y: [0.0, 0.3] };
    distance.draw(&mut out, "time, s", "error up to 0.3 m, m");
    dots(&mut out, &distance, &shown, |sample| sample.raw.map(|pose| off(sample, &pose)).filter(|off| *off < 0.3));
    line(&mut out, &distance, &shown, COLOURS[1], |sample| off(sample, &sample.filtered).min(0.3));
    line(&mut out, &distance, &shown, COLOURS[2], |sample| off(sample, &sample.smoothed).min(0.3));
    let names = [("true", TRUTH), ("noisy", COLOURS[0]), ("filtered", COLOURS[1]), ("smoothed", COLOURS[2])];
    for (index, (name, colour)) in names.into_iter().enumerate() {
        let x = 860.0 + 90.0 * index as f64;
        svg::polyline(&mut out, &[[x, 74.0], [x + 18.0, 74.0]], colour, 4.0);
        svg::text(&mut out, [x + 24.0, 78.0], "start", "font-size=\"12\"", name);
    }
    out + "</svg>\n"
}

fn line(out: &mut String, axes: &Axes, samples: &[&Sample], colour: &str, value: impl Fn(&Sample) -> f64) {
    let points: Vec<_> = samples.iter().map(|sample| axes.at(sample.time, value(sample))).collect();
    svg::polyline(out, &points, colour, 1.5);
}

fn dots(out: &mut String, axes: &Axes, samples: &[&Sample], value: impl Fn(&Sample) -> Option<f64>) {
    for sample in samples {
        let Some(value) = value(sample) else { continue };
        let [x, y] = axes.at(sample.time, value);
        *out += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.6\" fill=\"{}\"/>\n", COLOURS[0]);
    }
}
