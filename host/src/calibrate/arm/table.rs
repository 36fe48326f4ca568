//! The changed arm as a table of standard Denavit–Hartenberg rows.

use super::chain::{LinkChange, turned};
use screed_kernel::arm::{Arm, Dh};

/// Sine of the angle between two axes below which they count as parallel and a tilt is left out. That moves the flange by
/// a micrometre for each metre at most, a tenth of what a tracker can tell; their normal would be thousands of
/// kilometres away, and rounding with it more than the 1e-10 m to which inverse kinematics meets a pose.
pub(in crate::calibrate) const PARALLEL: f64 = 1e-6;

/// The arm with these changes, as one without tilts. The last row's tilt must be zero.
///
/// A row with a tilt β has the transform Rz(θ)·Tz(d)·Tx(a)·Ry(β)·Rx(α). Its last z axis, the next joint's, and its
/// first have a common normal at an angle ψ from x; the standard row that goes along it ends in a frame that differs by
/// a turn and a shift along that z axis, and the next row's θ and d take them up. Nearly parallel axes have their
/// normal far away: d and d of the next row can reach hundreds of metres, and their digits are spent on that; a makers'
/// calibration of such an arm has them too.
pub(in crate::calibrate) fn standard<const N: usize>(nominal: &Arm<N>, changes: &[LinkChange; N]) -> Arm<N> {
    let mut arm = *nominal;
    let mut carried = (0.0, 0.0);
    for (row, change) in arm.dh.iter_mut().zip(changes) {
        let (sin_alpha, cos_alpha) = turned(row, change.alpha);
        let (turn, shift) = carried;
        let changed = Dh {
            theta: row.theta + change.theta + turn,
            d: row.d + change.d + shift,
            a: row.a + change.a,
            sin_alpha,
            cos_alpha,
        };
        let straight = (changed, (0.0, 0.0));
        (*row, carried) =
            if change.tilt == 0.0 { straight } else { untilted(&changed, change.tilt).unwrap_or(straight) };
    }
    arm
}

/// The standard row to the same next axis, and what is left along it: the turn (rad) and shift (m) after it. `None`:
/// the axes are parallel.
fn untilted(row: &Dh, tilt: f64) -> Option<(Dh, (f64, f64))> {
    let (sin_tilt, cos_tilt) = libm::sincos(tilt);
    // The next axis, seen after θ and d, is (sin β·cos α, −sin α, cos β·cos α); z × it is the normal, times the sine of
    // the angle.
    let across = sin_tilt * row.cos_alpha;
    let sine = libm::copysign(libm::hypot(row.sin_alpha, across), row.sin_alpha);
    if sine.abs() < PARALLEL {
        return None;
    }
    let (sin_psi, cos_psi) = (across / sine, row.sin_alpha / sine);
    let cosine = cos_tilt * row.cos_alpha;
    // From the next axis' point at (a, 0, 0) back to the normal's foot.
    let back = row.a * sin_psi / sine;
    let standard = Dh {
        theta: row.theta + libm::atan2(sin_psi, cos_psi),
        d: row.d - back * cosine,
        a: row.a * cos_psi,
        sin_alpha: sine,
        cos_alpha: cosine,
    };
    // About that axis, from the normal to the tilted row's x.
    let turn = libm::atan2(-cos_tilt * cosine * sin_psi - sin_tilt * sine, cos_psi * cos_tilt);
    Some((standard, (turn, back)))
}
