//! A layer drawn: its path seen from above, coloured by speed, and its speed over time with the waypoints magnified
//! (after figure 6 of the paper named in [`super::profile`]). Plain SVG text.

use super::Plan;
use super::moves::{Move, MoveKind};
use super::path::Point;
use super::route::{Curves, Route};
use crate::svg::{self, Axes, INK, number, polyline, text, ticks};

const WIDTH: f64 = 1240.0;
const HEIGHT: f64 = 560.0;
/// Colours from rest to the highest speed, evenly spaced.
const COLOURS: [[f64; 3]; 5] =
    [[196.0, 55.0, 40.0], [231.0, 146.0, 52.0], [119.0, 171.0, 129.0], [46.0, 124.0, 168.0], [28.0, 58.0, 118.0]];
/// Steps of colour.
const SHADES: usize = 16;
/// Half the time that the magnification shows (s).
const MAGNIFIED: f64 = 0.26;

/// One sample of a layer.
struct Waypoint {
    time: f64,
    speed_mm_s: f64,
    point: Point,
}

/// The drawing of one layer, given by its position in the model's layers; none when the plan does not print it.
pub fn svg(plan: &Plan, layer: usize, title: &str) -> Option<String> {
    let step = plan.moves().iter().find(|step| step.kind == MoveKind::Deposit && step.layer == layer)?;
    let Route::Curves(curves) = &step.route else { return None };
    let waypoints = waypoints(step, curves, plan.rate());
    let highest = 1e3 * step.profile.velocity_max();
    let subtitle = format!(
        "{}: {:.3} m in {:.1} s, {} waypoints at {:.0} Hz, at most {:.1} mm/s and {:.2} m/s²",
        plan.layer_name(layer),
        curves.length(),
        step.profile.duration(),
        waypoints.len(),
        plan.rate(),
        highest,
        step.limits.acceleration_max
    );
    let mut out = svg::open(WIDTH, HEIGHT);
    text(&mut out, [30.0, 34.0], "start", "font-size=\"19\" font-weight=\"bold\"", title);
    text(&mut out, [30.0, 56.0], "start", "fill=\"#5a626c\"", &subtitle);
    draw_path(&mut out, &waypoints, highest);
    draw_speed(&mut out, &waypoints, step, highest);
    out += "</svg>\n";
    Some(out)
}

fn waypoints(step: &Move, curves: &Curves, rate: f64) -> Vec<Waypoint> {
    let sample = |period| {
        let time = f64::from(period) / rate;
        let state = step.profile.state_at(time);
        Waypoint { time, speed_mm_s: 1e3 * state.velocity, point: curves.point_at(state.s).0 }
    };
    (0..=step.periods).map(sample).collect()
}

/// The path from above, equal scales, in millimetres of the part frame.
fn draw_path(out: &mut String, waypoints: &[Waypoint], highest: f64) {
    let range = |value: fn(&Point) -> f64| {
        let values = waypoints.iter().map(|waypoint| 1e3 * value(&waypoint.point));
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    let (x, y) = (range(|point| point.x), range(|point| point.y));
    let page = [80.0, 90.0, 400.0, 400.0];
    let half = 0.54 * (x[1] - x[0]).max(y[1] - y[0]).max(1.0);
    let around = |[low, high]: [f64; 2]| [0.5 * (low + high) - half, 0.5 * (low + high) + half];
    let axes = Axes { page, x: around(x), y: around(y) };
    axes.draw(out, "x in the part frame, mm", "y in the part frame, mm");
    let mut run: Vec<[f64; 2]> = Vec::new();
    let mut shade = 0;
    for waypoint in waypoints {
        let at = axes.at(1e3 * waypoint.point.x, 1e3 * waypoint.point.y);
        let now = shade_of(waypoint.speed_mm_s, highest);
        let far = run.last().is_none_or(|last| (last[0] - at[0]).hypot(last[1] - at[1]) > 1.0);
        if far || now != shade {
            run.push(at);
        }
        if now != shade {
            polyline(out, &run, &colour(shade), 4.0);
            run = vec![at];
            shade = now;
        }
    }
    polyline(out, &run, &colour(shade), 4.0);
    for (waypoint, fill, label) in [(waypoints.first(), "#ffffff", "start"), (waypoints.last(), INK, "end")]
        .into_iter()
        .filter_map(|(w, f, l)| Some((w?, f, l)))
    {
        let [cx, cy] = axes.at(1e3 * waypoint.point.x, 1e3 * waypoint.point.y);
        *out += &format!(
            "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"5\" fill=\"{fill}\" stroke=\"{INK}\" stroke-width=\"1.6\"/>\n"
        );
        text(out, [cx - 9.0, cy + 4.5], "end", "", label);
    }
    draw_colour_bar(out, highest);
}

fn draw_colour_bar(out: &mut String, highest: f64) {
    let [left, top, width, height] = [500.0, 90.0, 12.0, 400.0];
    let step = height / SHADES as f64;
    for shade in 0..SHADES {
        let y = top + height - step * (shade + 1) as f64;
        let fill = colour(shade);
        *out += &format!(
            "<rect x=\"{left}\" y=\"{y:.2}\" width=\"{width}\" height=\"{:.2}\" fill=\"{fill}\"/>\n",
            step + 0.3
        );
    }
    let bar = Axes { page: [left, top, width, height], x: [0.0, 1.0], y: [0.0, highest] };
    for value in ticks(bar.y) {
        let [_, y] = bar.at(0.0, value);
        text(out, [left + width + 5.0, y + 4.0], "start", "font-size=\"11\"", &number(value));
    }
    text(out, [left + 0.5 * width, top - 10.0], "middle", "font-size=\"11\"", "mm/s");
}

/// Speed over time, and a magnification about the corner nearest to the middle where every waypoint is a dot.
fn draw_speed(out: &mut String, waypoints: &[Waypoint], step: &Move, highest: f64) {
    let duration = step.profile.duration();
    // Room above the curve for the magnification.
    let axes = Axes { page: [640.0, 90.0, 570.0, 400.0], x: [0.0, duration], y: [0.0, 2.4 * highest] };
    axes.draw(out, "time, s", "speed along the path, mm/s");
    polyline(out, &thinned(&axes, waypoints), "#2e7ca8", 1.4);

    let corner = step.profile.next_rest(0.5 * duration)[0];
    let from = (corner - MAGNIFIED).clamp(0.0, (duration - 2.0 * MAGNIFIED).max(0.0));
    let window = [from, from + 2.0 * MAGNIFIED];
    let shown: Vec<_> = waypoints.iter().filter(|waypoint| (window[0]..=window[1]).contains(&waypoint.time)).collect();
    let top = shown.iter().fold(1e-3, |top: f64, waypoint| top.max(waypoint.speed_mm_s));
    let inset = Axes { page: [890.0, 112.0, 300.0, 150.0], x: window, y: [0.0, 1.12 * top] };
    let [left, bottom] = axes.at(window[0], 0.0);
    let [right, upper] = axes.at(window[1], top);
    *out += &format!(
        "<path d=\"M{left:.1} {upper:.1}L890 262M{right:.1} {upper:.1}L1190 262\" stroke=\"#9aa2ac\" stroke-width=\"0.8\" \
         stroke-dasharray=\"4 3\" fill=\"none\"/>\n<rect x=\"{left:.1}\" y=\"{upper:.1}\" width=\"{:.1}\" height=\"{:.1}\" \
         fill=\"none\" stroke=\"{INK}\" stroke-width=\"1\"/>\n<rect x=\"846\" y=\"98\" width=\"356\" height=\"204\" \
         fill=\"#ffffff\" opacity=\"0.92\"/>\n",
        right - left,
        bottom - upper
    );
    inset.draw(out, "", "");
    let line: Vec<_> = shown.iter().map(|waypoint| inset.at(waypoint.time, waypoint.speed_mm_s)).collect();
    polyline(out, &line, "#9cc3da", 1.2);
    for [x, y] in line {
        *out += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2\" fill=\"#1c3a76\"/>\n");
    }
    text(out, [1040.0, 296.0], "middle", "font-size=\"11\" fill=\"#5a626c\"", "magnified: one dot a waypoint");
}

/// The curve in page units, without the points that nobody would see: those nearer than a unit to the last one kept,
/// unless the speed turns there.
fn thinned(axes: &Axes, waypoints: &[Waypoint]) -> Vec<[f64; 2]> {
    let points: Vec<_> = waypoints.iter().map(|waypoint| axes.at(waypoint.time, waypoint.speed_mm_s)).collect();
    let mut kept: Vec<[f64; 2]> = points.first().copied().into_iter().collect();
    for window in points.windows(3) {
        let turns = (window[1][1] - window[0][1]) * (window[2][1] - window[1][1]) < 0.0;
        let far = kept.last().is_none_or(|last| (last[0] - window[1][0]).hypot(last[1] - window[1][1]) > 1.0);
        if turns || far {
            kept.push(window[1]);
        }
    }
    kept.extend(points.last());
    kept
}

fn shade_of(speed: f64, highest: f64) -> usize {
    ((speed / highest * SHADES as f64) as usize).min(SHADES - 1)
}

fn colour(shade: usize) -> String {
    let position = shade as f64 / (SHADES - 1) as f64 * (COLOURS.len() - 1) as f64;
    let index = (position as usize).min(COLOURS.len() - 2);
    let (low, high, share) = (COLOURS[index], COLOURS[index + 1], position - index as f64);
    let [r, g, b] = core::array::from_fn(|i| (low[i] + (high[i] - low[i]) * share).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Cell;
    use crate::plan::tests::{plan, wall};

    #[test]
    fn the_drawing_is_well_formed_and_shows_every_waypoint_of_the_magnification() {
        let (model, cell) = (wall(1), Cell::demo(125).unwrap());
        let plan = plan(&model, &cell);
        let drawing = svg(&plan, 0, "A <wall> & more").unwrap();
        assert!(drawing.contains("A &lt;wall&gt; &amp; more"));
        assert!(!drawing.contains("NaN") && !drawing.contains("inf"));
        // 0.52 s at 125 Hz, and the marks of start and end.
        let dots = drawing.matches("<circle").count();
        assert!((65..=67 + 1).contains(&dots), "{dots}");
        for tag in ["text", "svg"] {
            assert_eq!(drawing.matches(&format!("<{tag} ")).count(), drawing.matches(&format!("</{tag}>")).count());
        }
        assert!(drawing.len() < 150_000, "{} bytes", drawing.len());
        assert_eq!(svg(&plan, 1, "absent"), None);
        if let Ok(path) = std::env::var("SCREED_PLOT") {
            std::fs::write(path, drawing).unwrap();
        }
    }
}
