//! The page's drawings.

use crate::svg::{self, Axes, INK};
use crate::wcet::evt::AtThreshold;
use crate::wcet::report::Instructions;
use crate::wcet::search::Found;

/// Colours that are told apart, also by people who see few.
pub const COLOURS: [&str; 6] = ["#1f6fb4", "#d1611b", "#7a3e9d", "#2a8a57", "#8a6d1b", "#5b6472"];

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 330.0;
const PAGE: [f64; 4] = [74.0, 16.0, 760.0, 240.0];

/// A named histogram: upper edges (ns) and counts.
pub struct Series<'a> {
    /// Its name.
    pub name: String,
    /// Its bins.
    pub bins: &'a [(u64, u64)],
}

/// Histograms over each other; both axes logarithmic.
pub fn histograms(series: &[Series<'_>], marks: &[(f64, &str)]) -> String {
    let edges = || series.iter().flat_map(|series| series.bins.iter().map(|(edge, _)| *edge as f64));
    let most = series.iter().flat_map(|series| series.bins.iter().map(|(_, count)| *count)).max().unwrap_or(1) as f64;
    let (low, high) = (edges().fold(f64::MAX, f64::min), edges().fold(1.0, f64::max));
    let high = marks.iter().map(|(mark, _)| *mark).fold(high, f64::max);
    let axes = Axes { page: PAGE, x: [(low * 0.8).log10(), (high * 1.3).log10()], y: [-0.3, (2.0 * most).log10()] };
    let mut out = svg::open(WIDTH, HEIGHT);
    decades(&mut out, &axes, "time");
    for (k, series) in series.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let mut points = Vec::new();
        for (edge, count) in series.bins {
            // Eight bins to a doubling.
            let right = (*edge as f64).log10();
            let left = right - 2_f64.log10() / 8.0;
            let top = (*count as f64).log10();
            let floor = axes.y[0];
            if points.last().is_none_or(|last: &[f64; 2]| (last[0] - axes.at(left, floor)[0]).abs() > 0.6) {
                points.extend(points.last().map(|last| [last[0], axes.at(left, floor)[1]]));
                points.push(axes.at(left, floor));
            }
            points.push(axes.at(left, top));
            points.push(axes.at(right, top));
        }
        points.extend(points.last().map(|last| [last[0], axes.at(0.0, axes.y[0])[1]]));
        svg::polyline(&mut out, &points, colour, 1.6);
        let x = PAGE[0] + 8.0 + 188.0 * (k % 4) as f64;
        legend(&mut out, [x, HEIGHT - 12.0], colour, &series.name);
    }
    for (mark, name) in marks {
        let [x, top] = axes.at(mark.log10(), axes.y[1]);
        let bottom = axes.at(mark.log10(), axes.y[0])[1];
        svg::polyline(&mut out, &[[x, top], [x, bottom]], "#b3261e", 1.2);
        svg::text(&mut out, [x - 4.0, top + 14.0], "end", "fill=\"#b3261e\" font-size=\"11\"", name);
    }
    out + "</svg>\n"
}

fn legend(out: &mut String, [x, y]: [f64; 2], colour: &str, name: &str) {
    svg::polyline(out, &[[x, y - 4.0], [x + 20.0, y - 4.0]], colour, 3.0);
    svg::text(out, [x + 26.0, y], "start", "font-size=\"12\"", name);
}

/// Grid and frame of logarithmic axes, time (ns) to the right and counts upward.
fn decades(out: &mut String, axes: &Axes, label: &str) {
    let [left, top, width, height] = axes.page;
    for decade in axes.x[0].ceil() as i32..=axes.x[1].floor() as i32 {
        let [x, _] = axes.at(f64::from(decade), axes.y[0]);
        *out += &format!("<path d=\"M{x:.1} {top}v{height}\" stroke=\"#e3e6ea\"/>\n");
        svg::text(out, [x, top + height + 18.0], "middle", "font-size=\"11\"", &time(10_f64.powi(decade)));
    }
    for decade in 0..=axes.y[1].floor() as i32 {
        let [_, y] = axes.at(axes.x[0], f64::from(decade));
        *out += &format!("<path d=\"M{left} {y:.1}h{width}\" stroke=\"#e3e6ea\"/>\n");
        svg::text(out, [left - 8.0, y + 4.0], "end", "font-size=\"11\"", &svg::number(10_f64.powi(decade)));
    }
    *out += &format!(
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"{INK}\"/>\n"
    );
    svg::text(out, [left + width, top + height + 34.0], "end", "font-size=\"12\"", label);
    let turn = format!("transform=\"rotate(-90 {:.1} {:.1})\"", 18.0, top + 0.5 * height);
    svg::text(out, [18.0, top + 0.5 * height], "middle", &turn, "samples");
}

/// A time (ns) in the unit that fits.
pub fn time(ns: f64) -> String {
    match ns {
        ns if ns < 1e3 => format!("{ns:.0} ns"),
        ns if ns < 1e4 => format!("{:.1} µs", ns * 1e-3).replace(".0 ", " "),
        ns if ns < 1e6 => format!("{:.0} µs", ns * 1e-3),
        ns if ns < 1e7 => format!("{:.1} ms", ns * 1e-6).replace(".0 ", " "),
        ns if ns < 1e9 => format!("{:.0} ms", ns * 1e-6),
        ns => format!("{:.1} s", ns * 1e-9).replace(".0 ", " "),
    }
}

/// From fewest to most instructions of each class, the mean as a line across.
pub fn ranges(rows: &[&Instructions]) -> String {
    let height = 60.0 + 30.0 * rows.len() as f64;
    let most = rows.iter().map(|row| row.max).max().unwrap_or(1) as f64;
    let page = [130.0, 10.0, 640.0, 30.0 * rows.len() as f64];
    let axes = Axes { page, x: [2.0, (most * 1.5).log10()], y: [0.0, 1.0] };
    let mut out = svg::open(WIDTH, height);
    for decade in 2..=axes.x[1].floor() as i32 {
        let [x, _] = axes.at(f64::from(decade), 0.0);
        out += &format!("<path d=\"M{x:.1} {}v{}\" stroke=\"#e3e6ea\"/>\n", page[1], page[3]);
        svg::text(
            &mut out,
            [x, page[1] + page[3] + 18.0],
            "middle",
            "font-size=\"11\"",
            &grouped(10_u64.pow(decade as u32)),
        );
    }
    svg::text(&mut out, [page[0] + page[2], page[1] + page[3] + 36.0], "end", "font-size=\"12\"", "instructions");
    for (k, row) in rows.iter().enumerate() {
        let y = page[1] + 30.0 * k as f64 + 7.0;
        let [from, to, mean] =
            [row.min as f64, row.max as f64, row.mean].map(|value| axes.at(value.max(100.0).log10(), 0.0)[0]);
        svg::text(&mut out, [page[0] - 8.0, y + 13.0], "end", "", row.class);
        out += &format!(
            "<rect x=\"{from:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"16\" rx=\"2\" fill=\"{}\" fill-opacity=\"0.75\"/>\n",
            (to - from).max(2.0),
            COLOURS[0]
        );
        svg::polyline(&mut out, &[[mean, y], [mean, y + 16.0]], "#ffffff", 2.0);
        svg::text(&mut out, [to + 6.0, y + 13.0], "start", "font-size=\"12\"", &grouped(row.max));
    }
    out + "</svg>\n"
}

/// How far each climb got, and how far chance alone, as a share of the committed worst: a small drawing for each class.
pub fn climbs(found: &[&Found]) -> String {
    let rounds = found.iter().map(|found| found.rounds.len()).max().unwrap_or(0) as f64;
    let lines = found.len().div_ceil(4);
    let mut out = svg::open(WIDTH, 190.0 * lines as f64 + 24.0);
    for (k, found) in found.iter().enumerate() {
        let share = |value: u64| value as f64 / found.before.max(1) as f64;
        let all = || found.rounds.iter().chain(&found.random_rounds).map(|value| share(*value));
        let (low, high) = (all().fold(0.95, f64::min), all().fold(1.05, f64::max));
        let room = 0.05 * (high - low);
        let corner = [52.0 + 212.0 * (k % 4) as f64, 26.0 + 190.0 * (k / 4) as f64];
        let page = [corner[0], corner[1], 150.0, 116.0];
        let axes = Axes { page, x: [0.0, rounds.max(1.0)], y: [low - room, high + room] };
        axes.draw(&mut out, if k / 4 + 1 == lines { "round" } else { "" }, "");
        svg::text(&mut out, [corner[0], corner[1] - 8.0], "start", "font-weight=\"600\"", found.class);
        svg::polyline(&mut out, &[axes.at(0.0, 1.0), axes.at(rounds.max(1.0), 1.0)], COLOURS[5], 1.0);
        for (values, colour, width, first) in
            [(&found.random_rounds, COLOURS[1], 1.6, None), (&found.rounds, COLOURS[0], 2.2, Some(axes.at(0.0, 1.0)))]
        {
            let points = (1..).zip(values).map(|(round, value)| axes.at(f64::from(round), share(*value)));
            svg::polyline(&mut out, &first.into_iter().chain(points).collect::<Vec<_>>(), colour, width);
        }
    }
    let names = ["climbed from the committed worst", "as many random courses", "committed worst = 1"];
    for (k, (name, colour)) in names.into_iter().zip([COLOURS[0], COLOURS[1], COLOURS[5]]).enumerate() {
        legend(&mut out, [60.0 + 260.0 * k as f64, 190.0 * lines as f64 + 16.0], colour, name);
    }
    out + "</svg>\n"
}

/// The shape at each threshold with two standard errors to either side.
pub fn stability(fits: &[AtThreshold]) -> String {
    let ends = || fits.iter().flat_map(|fit| [fit.shape - 2.0 * fit.shape_error, fit.shape + 2.0 * fit.shape_error]);
    let (low, high) = (ends().fold(f64::MAX, f64::min).min(0.0), ends().fold(f64::MIN, f64::max).max(0.0));
    let room = 0.06 * (high - low);
    let (low, high) = (low - room, high + room);
    let axes = Axes { page: [74.0, 12.0, 360.0, 170.0], x: [78.0, 97.0], y: [low, high] };
    let mut out = svg::open(470.0, 236.0);
    axes.draw(&mut out, "threshold: % of samples below it", "shape ξ");
    for fit in fits {
        let at = |shape: f64| axes.at(100.0 * fit.share, shape);
        svg::polyline(
            &mut out,
            &[at(fit.shape - 2.0 * fit.shape_error), at(fit.shape + 2.0 * fit.shape_error)],
            COLOURS[0],
            1.4,
        );
        let [x, y] = at(fit.shape);
        out += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{}\"/>\n", COLOURS[0]);
    }
    out + "</svg>\n"
}

/// A whole number in groups of three digits.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out
}
