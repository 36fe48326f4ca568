//! What a calibration found, in words and as JSON. Words are in mm and degrees, JSON in m and rad.

use super::Fit;
use super::arm::{Group, Identified, Parameter};
use super::frame::Frame;
use super::pose_fit::PoseResidual;
use super::target::Target;
use super::tcp::Tcp;
use nalgebra::{Dim, Matrix, RawStorage, Rotation3, UnitQuaternion, Vector3};
use screed_kernel::pose::Pose;
use serde_json::{Value, json};
use std::fmt::Write;

/// A calibration, told both ways.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// For a person.
    pub words: String,
    /// For a program.
    pub json: Value,
}

/// A frame from point pairs.
pub fn frame(found: &Frame, outer: &str, inner: &str) -> Report {
    let registration = &found.registration;
    let pose = &registration.outer_from_inner;
    let mut words = format!("{outer}_from_{inner} from {} pairs of points\n", registration.count);
    pose_in_words(&mut words, pose, &sigmas(&found.covariance, 0));
    noise_in_words(&mut words, found.sigma, found.fit.as_ref());
    let _ = writeln!(
        words,
        "  residuals    {:.4} mm rms, largest {:.4} mm at pair {}",
        registration.residual_rms * 1e3,
        registration.residual_max * 1e3,
        registration.residual_max_pair + 1
    );
    let axis: Vector3<f64> = registration.axes_in_outer.column(0).into_owned();
    let _ = writeln!(
        words,
        "  held worst   the turn about {:.2} {:.2} {:.2} ({outer}): the points are {:.1} mm from that axis (rms)",
        axis.x,
        axis.y,
        axis.z,
        registration.levers.x * 1e3
    );
    let residuals: Vec<_> = found.residuals.iter().map(|residual| residual.data.0[0]).collect();
    let json = json!({
        "calibration": "frame",
        "outer": outer,
        "inner": inner,
        "outer_from_inner": pose_as_json(pose),
        "covariance": rows(&found.covariance),
        "sigma_m": found.sigma,
        "fit": found.fit.as_ref().map(fit_as_json),
        "axes_in_outer": registration.axes_in_outer.data.0,
        "levers_m": registration.levers.data.0[0],
        "residual_rms_m": registration.residual_rms,
        "residuals_m": residuals,
    });
    Report { words, json }
}

/// A tool's tip.
pub fn tcp(found: &Tcp) -> Report {
    let mut words = format!("tool centre point from {} touches\n", found.residuals.len());
    let sigmas = sigmas(&found.covariance, 0);
    let spread = |from: usize| Vector3::new(sigmas[from], sigmas[from + 1], sigmas[from + 2]);
    for (name, place, sigma) in [("tip", &found.tip_in_flange, spread(0)), ("point", &found.point_in_base, spread(3))] {
        let _ = writeln!(words, "  {name:<12} xyz_mm = {}  ± {} mm", millimetres(place, 4), millimetres(&sigma, 4));
    }
    words += "               the tip in the flange frame, the point in the base; ± one standard deviation\n";
    noise_in_words(&mut words, found.sigma, found.fit.as_ref());
    let norms: Vec<_> = found.residuals.iter().map(Vector3::norm).collect();
    residuals_in_words(&mut words, &norms, "touch");
    let residuals: Vec<_> = found.residuals.iter().map(|residual| residual.data.0[0]).collect();
    let json = json!({
        "calibration": "tcp",
        "tip_in_flange_m": found.tip_in_flange.data.0[0],
        "point_in_base_m": found.point_in_base.data.0[0],
        "covariance": rows(&found.covariance),
        "sigma_m": found.sigma,
        "fit": found.fit.as_ref().map(fit_as_json),
        "swing_rad": found.swing,
        "residuals_m": residuals,
    });
    Report { words, json }
}

/// A target on the flange, and the tracker.
pub fn target(found: &Target) -> Report {
    let mut words = format!("tracker and target from {} poses\nflange_from_target\n", found.residuals.len());
    pose_in_words(&mut words, &found.flange_from_target, &sigmas(&found.covariance, 0));
    words += "tracker_from_base\n";
    pose_in_words(&mut words, &found.tracker_from_base, &sigmas(&found.covariance, 6));
    fit_in_words(&mut words, &found.fit);
    poses_in_words(&mut words, "residuals", &found.residuals);
    let json = json!({
        "calibration": "target",
        "flange_from_target": pose_as_json(&found.flange_from_target),
        "tracker_from_base": pose_as_json(&found.tracker_from_base),
        "covariance": rows(&found.covariance),
        "fit": fit_as_json(&found.fit),
        "swing_rad": found.swing,
        "condition": found.condition,
        "residuals": found.residuals,
    });
    Report { words, json }
}

/// An arm, the robot of that name.
pub fn arm<const N: usize>(found: &Identified<N>, robot: &str) -> Report {
    let mut words = format!("{robot} from {} poses\n", found.residuals.len());
    poses_in_words(&mut words, "before", &found.residuals_before);
    poses_in_words(&mut words, "after", &found.residuals);
    fit_in_words(&mut words, &found.fit);
    let expected = found.target_sigma * 1e3;
    let _ = writeln!(
        words,
        "  expected     the target within {expected:.4} mm rms at other poses like these, by the noise stated"
    );
    let _ = writeln!(words, "  condition    {:.0} (up to 100 is good)", found.condition);
    words += "changes of the table, ± one standard deviation\n";
    for estimate in &found.estimates {
        let (factor, unit) = if estimate.parameter.is_angle() { (1.0_f64.to_degrees(), "deg") } else { (1e3, "mm") };
        let (change, sigma) = (estimate.change * factor, estimate.sigma * factor);
        let _ = writeln!(words, "  {:<12} {change:>10.5} ± {sigma:.5} {unit}", estimate.parameter.to_string());
    }
    words += "cannot be told apart\n";
    for Group { held, with } in &found.groups {
        let _ = match with.is_empty() {
            true => writeln!(words, "  {} moves nothing: held as it was", names(held)),
            false => writeln!(words, "  {} and {}: {} held as it was", names(held), names(with), names(held)),
        };
    }
    words += "flange_from_target\n";
    pose_in_words(&mut words, &found.flange_from_target, &[]);
    words += "tracker_from_base\n";
    pose_in_words(&mut words, &found.tracker_from_base, &[]);
    Report { words, json: arm_as_json(found, robot) }
}

fn arm_as_json<const N: usize>(found: &Identified<N>, robot: &str) -> Value {
    let row = |row: &screed_kernel::arm::Dh| {
        let alpha = row.sin_alpha.atan2(row.cos_alpha);
        json!({ "theta_rad": row.theta, "d_m": row.d, "a_m": row.a, "alpha_rad": alpha,
                "sin_alpha": row.sin_alpha, "cos_alpha": row.cos_alpha })
    };
    let estimate = |estimate: &super::arm::Estimate| {
        let unit = if estimate.parameter.is_angle() { "rad" } else { "m" };
        json!({ "parameter": estimate.parameter.to_string(), "change": estimate.change, "sigma": estimate.sigma,
                "unit": unit })
    };
    let list = |parameters: &[Parameter]| parameters.iter().map(Parameter::to_string).collect::<Vec<_>>();
    let group = |group: &Group| json!({ "held": list(&group.held), "with": list(&group.with) });
    json!({
        "calibration": "arm",
        "robot": robot,
        "dh": found.arm.dh.iter().map(row).collect::<Vec<_>>(),
        "changes": found.estimates.iter().map(estimate).collect::<Vec<_>>(),
        "covariance": rows(&found.covariance),
        "cannot_be_told_apart": found.groups.iter().map(group).collect::<Vec<_>>(),
        "flange_from_target": pose_as_json(&found.flange_from_target),
        "tracker_from_base": pose_as_json(&found.tracker_from_base),
        "fit": fit_as_json(&found.fit),
        "target_sigma_m": found.target_sigma,
        "condition": found.condition,
        "residuals_before": found.residuals_before,
        "residuals": found.residuals,
    })
}

fn names(parameters: &[Parameter]) -> String {
    parameters.iter().map(Parameter::to_string).collect::<Vec<_>>().join(", ")
}

/// Square roots of a covariance's diagonal, from a row on.
fn sigmas<D: Dim, S: RawStorage<f64, D, D>>(covariance: &Matrix<f64, D, D, S>, from: usize) -> Vec<f64> {
    (from..covariance.nrows()).map(|row| covariance[(row, row)].sqrt()).collect()
}

fn rows<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(matrix: &Matrix<f64, R, C, S>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

fn millimetres(place: &Vector3<f64>, digits: usize) -> String {
    let [x, y, z] = place.data.0[0].map(|metres| metres * 1e3);
    format!("[{x:.digits$}, {y:.digits$}, {z:.digits$}]")
}

/// As a cell file takes it, with one standard deviation of each where there are any.
fn pose_in_words(words: &mut String, pose: &Pose, sigmas: &[f64]) {
    let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(pose.rotation).euler_angles();
    let [roll, pitch, yaw] = [roll, pitch, yaw].map(f64::to_degrees);
    let (mut position, mut turn) = (String::new(), String::new());
    if let [x, y, z, rx, ry, rz, ..] = *sigmas {
        position = format!("  ± {} mm", millimetres(&Vector3::new(x, y, z), 4));
        let [rx, ry, rz] = [rx, ry, rz].map(f64::to_degrees);
        turn = format!("  ± [{rx:.5}, {ry:.5}, {rz:.5}] deg about x, y, z");
    }
    let _ = writeln!(words, "  xyz_mm = {}{position}", millimetres(&pose.translation, 4));
    let _ = writeln!(words, "  rpy_deg = [{roll:.6}, {pitch:.6}, {yaw:.6}]{turn}");
}

fn pose_as_json(pose: &Pose) -> Value {
    let quaternion = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.rotation));
    json!({
        "translation_m": pose.translation.data.0[0],
        "rotation": rows(&pose.rotation),
        "quaternion_wxyz": [quaternion.w, quaternion.i, quaternion.j, quaternion.k],
    })
}

fn fit_as_json(fit: &Fit) -> Value {
    json!({
        "chi_squared": fit.chi_squared,
        "degrees": fit.degrees,
        "noise_ratio": fit.noise_ratio(),
        "noise_ratio_band": fit.noise_ratio_band(),
    })
}

fn noise_in_words(words: &mut String, sigma: f64, fit: Option<&Fit>) {
    match fit {
        Some(fit) => fit_in_words(words, fit),
        None => {
            let _ = writeln!(words, "  noise        {:.4} mm a coordinate, by the residuals", sigma * 1e3);
        }
    }
}

/// How the residuals compare with the noise stated, and what that says.
fn fit_in_words(words: &mut String, fit: &Fit) {
    let ([low, high], ratio) = (fit.noise_ratio_band(), fit.noise_ratio());
    let verdict = if ratio > high {
        "larger: the noise is understated or the model wrong, and ± too small"
    } else if ratio < low {
        "smaller: the noise is overstated, and ± too large"
    } else {
        "as they should be"
    };
    let _ = writeln!(
        words,
        "  fit          residuals {ratio:.3} times the noise (95 of 100: {low:.3} to {high:.3}): {verdict}"
    );
}

fn residuals_in_words(words: &mut String, norms: &[f64], what: &str) {
    let rms = (norms.iter().map(|norm| norm * norm).sum::<f64>() / norms.len() as f64).sqrt();
    let largest = (1..).zip(norms).max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((index, norm)) = largest {
        let index: usize = index;
        let _ =
            writeln!(words, "  residuals    {:.4} mm rms, largest {:.4} mm at {what} {index}", rms * 1e3, norm * 1e3);
    }
}

fn poses_in_words(words: &mut String, name: &str, residuals: &[PoseResidual]) {
    let rms = |value: fn(&PoseResidual) -> f64| {
        (residuals.iter().map(|residual| value(residual).powi(2)).sum::<f64>() / residuals.len() as f64).sqrt()
    };
    let largest = (1..).zip(residuals).max_by(|a, b| a.1.position_m.total_cmp(&b.1.position_m));
    if let Some((index, largest)) = largest {
        let index: usize = index;
        let _ = writeln!(
            words,
            "  {name:<12} {:.4} mm and {:.5} deg rms, largest {:.4} mm at pose {index}",
            rms(|residual| residual.position_m) * 1e3,
            rms(|residual| residual.rotation_rad).to_degrees(),
            largest.position_m * 1e3
        );
    }
}
