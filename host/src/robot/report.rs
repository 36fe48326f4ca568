//! An arm and its examination as text and as JSON.

use super::Description;
use super::description::Link;
use super::examine::Examination;
use screed_kernel::pose::Pose;
use serde_json::{Value, json};

/// The arm: joints with their rows, ranges and ratings, poses, notes.
pub fn describe(description: &Description) -> String {
    let Description { name, origin, links, .. } = description;
    let mut text = format!("robot {name}: {} joints\nfrom {origin}\n", links.len());
    let width = links.iter().map(|link| link.name.chars().count()).max().unwrap_or(0).max(5);
    text += &format!(
        "  {:<width$}  kind       theta deg         d mm         a mm  alpha deg  {:>21}  {:>12}  {:>13}\n",
        "joint", "range", "speed", "acceleration"
    );
    for link in links {
        let scale = Scale::of(link);
        let alpha = link.dh.sin_alpha.atan2(link.dh.cos_alpha);
        text += &format!(
            "  {:<width$}  {:<9}  {:>9}  {:>11}  {:>11}  {:>9}  {:>21}  {:>12}  {:>13}\n",
            link.name,
            if link.is_revolute() { "revolute" } else { "prismatic" },
            plain(link.dh.theta.to_degrees(), 4),
            plain(link.dh.d * 1e3, 4),
            plain(link.dh.a * 1e3, 4),
            plain(alpha.to_degrees(), 4),
            scale.range(link),
            scale.rating(link.velocity_max, "/s"),
            scale.rating(link.acceleration_max, "/s²"),
        );
        if let Some(coupling) = link.joint.coupling {
            let other = links.get(coupling.joint).map_or("?", |link| link.name.as_str());
            text += &format!("  {:<width$}  also moves {} times as far as {other}\n", "", plain(coupling.factor, 6));
        }
    }
    for (label, pose) in [
        ("frame 0 in the base", &description.base_from_zero),
        ("flange in the last frame", &description.last_from_flange),
    ] {
        if let Some(pose) = pose {
            text += &format!("  {label}: {}\n", place(pose));
        }
    }
    for note in &description.notes {
        text += &format!("  note: {note}\n");
    }
    text
}

/// What the examination found.
pub fn tell(found: &Examination) -> String {
    let [low, high] = found.reach;
    let millimetres = |[low, high]: [f64; 2]| format!("{} to {}", plain(low * 1e3, 0), plain(high * 1e3, 0));
    let mut text = format!(
        "checked with {} joint vectors (seed {}):\n\
         \x20 inverse       {}\n\
         \x20 round trips   {} missed; the others end within {:.1e} m and {:.1e} rad of their pose\n\
         \x20 Jacobian      within {:.1e} of central differences\n\
         \x20 reach         flange {} to {} mm from the base; x {}, y {}, z {} mm\n\
         \x20 dexterity     smallest singular value {:.2e} at worst, {:.2e} in the middle\n",
        found.count,
        found.seed,
        found.family,
        found.misses,
        found.position_error,
        found.rotation_error,
        found.jacobian_error,
        plain(low * 1e3, 0),
        plain(high * 1e3, 0),
        millimetres(found.bounds[0]),
        millimetres(found.bounds[1]),
        millimetres(found.bounds[2]),
        found.singular_value[0],
        found.singular_value[1],
    );
    for (joints, why) in &found.examples {
        let joints: Vec<_> = joints.iter().map(|joint| plain(*joint, 6)).collect();
        text += &format!("  missed at ({}) rad or m: {why}\n", joints.join(", "));
    }
    text
}

/// Both, as JSON; SI units.
pub fn json(description: &Description, found: Option<&Examination>) -> Value {
    let pose = |pose: &Option<Pose>| {
        pose.map(|pose| {
            let rows: Vec<Vec<f64>> = pose.rotation.row_iter().map(|row| row.iter().copied().collect()).collect();
            json!({ "rotation": rows, "translation_m": pose.translation.as_slice() })
        })
    };
    let links = description.links.iter().map(|link| {
        let finite = |value: f64| value.is_finite().then_some(value);
        json!({
            "name": link.name,
            "kind": if link.is_revolute() { "revolute" } else { "prismatic" },
            "theta": link.dh.theta,
            "d": link.dh.d,
            "a": link.dh.a,
            "sin_alpha": link.dh.sin_alpha,
            "cos_alpha": link.dh.cos_alpha,
            "coupled_to": link.joint.coupling.map(|coupling| coupling.joint),
            "coupling_factor": link.joint.coupling.map(|coupling| coupling.factor),
            "position_min": finite(link.position_min),
            "position_max": finite(link.position_max),
            "velocity_max": link.velocity_max,
            "acceleration_max": link.acceleration_max,
        })
    });
    let mut value = json!({
        "name": description.name,
        "origin": description.origin,
        "base_from_zero": pose(&description.base_from_zero),
        "joints": links.collect::<Vec<_>>(),
        "last_from_flange": pose(&description.last_from_flange),
        "notes": description.notes,
    });
    if let (Some(found), Some(object)) = (found, value.as_object_mut()) {
        let checked = json!({
            "inverse": found.family,
            "count": found.count,
            "seed": found.seed,
            "misses": found.misses,
            "missed_at": found.examples.iter().map(|(joints, why)| json!({ "joints": joints, "why": why })).collect::<Vec<_>>(),
            "position_error_m": found.position_error,
            "rotation_error_rad": found.rotation_error,
            "jacobian_error": found.jacobian_error,
            "reach_m": found.reach,
            "bounds_m": found.bounds,
            "singular_value_least": found.singular_value[0],
            "singular_value_median": found.singular_value[1],
        });
        object.insert("checked".to_owned(), checked);
    }
    value
}

/// Degrees for a joint that turns, millimetres for one that slides.
struct Scale {
    unit: &'static str,
    factor: f64,
}

impl Scale {
    fn of(link: &Link) -> Self {
        match link.is_revolute() {
            true => Self { unit: "deg", factor: 1.0_f64.to_degrees() },
            false => Self { unit: "mm", factor: 1e3 },
        }
    }

    fn range(&self, link: &Link) -> String {
        if link.position_min.is_infinite() && link.position_max.is_infinite() {
            return "without end".to_owned();
        }
        let shown = |value: f64| plain(value * self.factor, 2);
        format!("{} … {} {}", shown(link.position_min), shown(link.position_max), self.unit)
    }

    fn rating(&self, value: Option<f64>, per: &str) -> String {
        value.map_or("unknown".to_owned(), |value| format!("{} {}{per}", plain(value * self.factor, 1), self.unit))
    }
}

fn place(pose: &Pose) -> String {
    let [x, y, z] = [0, 1, 2].map(|axis| plain(pose.translation[axis] * 1e3, 4));
    let turn = pose.rotation_vector();
    let [rx, ry, rz] = [0, 1, 2].map(|axis| plain(turn[axis].to_degrees(), 4));
    format!("x {x} y {y} z {z} mm, turned by ({rx}, {ry}, {rz}) deg as a rotation vector")
}

/// A number with at most so many decimals, and no zeros behind.
fn plain(value: f64, decimals: i32) -> String {
    let scale = 10_f64.powi(decimals);
    // Not "-0".
    let rounded = (value * scale).round() / scale + 0.0;
    format!("{rounded}")
}
