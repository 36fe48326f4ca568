//! Where the flange of an arm can be, seen from the side and from above, with the arm in it. Plain SVG text.

use super::Description;
use super::examine::Examination;
use crate::svg::{self, Axes, INK, polyline, text};
use screed_kernel::arm::Arm;
use screed_kernel::units::JointPos;

const WIDTH: f64 = 1120.0;
const HEIGHT: f64 = 600.0;
/// Points drawn at most.
const POINTS: usize = 4_000;

/// The drawing.
pub fn svg(description: &Description, found: &Examination) -> String {
    let mut out = svg::open(WIDTH, HEIGHT);
    text(&mut out, [30.0, 34.0], "start", "font-size=\"19\" font-weight=\"bold\"", &description.name);
    let subtitle = format!(
        "flange at {} seeded joint vectors within the ranges, {:.2} m to {:.2} m from the base; line: the arm in the middle of \
         its ranges",
        found.points.len().min(POINTS),
        found.reach[0],
        found.reach[1]
    );
    text(&mut out, [30.0, 56.0], "start", "fill=\"#5a626c\"", &subtitle);
    let mut arm = skeleton(description);
    // Nearly parallel axes have frames far outside of the arm.
    arm.retain(|point| point.iter().all(|value| value.abs() <= 1.5 * found.reach[1]));
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let values = found.points.iter().chain(&arm).map(|point| point[axis]);
        values.fold([0.0_f64, 0.0_f64], |[low, high], value| [low.min(value), high.max(value)])
    });
    // One scale for both views.
    let half = 0.54 * [x, y, z].map(|[low, high]| high - low).into_iter().fold(0.1, f64::max);
    let around = |[low, high]: [f64; 2]| [0.5 * (low + high) - half, 0.5 * (low + high) + half];
    let side = Axes { page: [90.0, 90.0, 440.0, 440.0], x: around(x), y: around(z) };
    let above = Axes { page: [640.0, 90.0, 440.0, 440.0], x: around(x), y: around(y) };
    view(&mut out, &side, found, &arm, [0, 2], ["x in the base frame, m", "z in the base frame, m"]);
    view(&mut out, &above, found, &arm, [0, 1], ["x in the base frame, m", "y in the base frame, m"]);
    out += "</svg>\n";
    out
}

fn view(out: &mut String, axes: &Axes, found: &Examination, arm: &[[f64; 3]], [h, v]: [usize; 2], labels: [&str; 2]) {
    axes.draw(out, labels[0], labels[1]);
    *out += "<path stroke=\"#2e7ca8\" stroke-width=\"1.8\" stroke-linecap=\"round\" stroke-opacity=\"0.6\" d=\"";
    for point in found.points.iter().take(POINTS) {
        let [x, y] = axes.at(point[h], point[v]);
        *out += &format!("M{x:.1} {y:.1}h0");
    }
    *out += "\"/>\n";
    let line: Vec<_> = arm.iter().map(|point| axes.at(point[h], point[v])).collect();
    polyline(out, &line, "#c43728", 3.0);
    for [x, y] in line {
        *out += &format!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.2\" fill=\"#ffffff\" stroke=\"{INK}\" stroke-width=\"1.4\"/>\n"
        );
    }
}

/// The origins of base, links and flange with every joint in the middle of its range, at zero where it has none.
fn skeleton(description: &Description) -> Vec<[f64; 3]> {
    fn of<const N: usize>(description: &Description) -> Vec<[f64; 3]> {
        let Some(arm) = description.arm::<N>("arm") else { return Vec::new() };
        let middle = JointPos(std::array::from_fn(|joint| middle(&arm, joint)));
        let zero = arm.base_from_zero.map_or([0.0; 3], |pose| pose.translation.into());
        let frames = arm.frames(&middle).map(|frame| frame.translation.into());
        [[0.0; 3], zero].into_iter().chain(frames).chain([arm.forward(&middle).translation.into()]).collect()
    }
    let of = [of::<3>, of::<4>, of::<5>, of::<6>, of::<7>, of::<8>, of::<9>];
    description.links.len().checked_sub(3).and_then(|index| of.get(index)).map_or(Vec::new(), |of| of(description))
}

fn middle<const N: usize>(arm: &Arm<N>, joint: usize) -> f64 {
    let middle = 0.5 * (arm.position_min.0[joint] + arm.position_max.0[joint]);
    if middle.is_finite() { middle } else { 0.0 }
}
