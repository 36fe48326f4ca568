//! The figures as a table and as JSON.

use super::{Case, Error, LAYERS, Score};
use serde_json::{Value, json};

/// The most that is wanted of lag and contour on the scored layers (m).
pub const AIM: f64 = 0.3e-3;

/// The table of all cases.
pub fn table(scores: &[(Case, Score)]) -> String {
    let mut out = format!(
        "simulated UR10e, demo's wall, {LAYERS} layers; tool, actual against reference (dead time of 6 ms taken out) and against\n\
         the curves, max (rms) in mm: on the first layer, which is learnt from; on the others; and on the first, the demo's own, again\n\
         with what it has taught\n\
         {:<8}{:<32}{:<17}{:<17}{:<17}{:<17}{:<17}{:<17}{:<20}aim 0.3\n",
        "rate",
        "cell file says",
        "lag, first",
        "lag, others",
        "lag, again",
        "contour, first",
        "contour, others",
        "contour, again",
        "learnt L, K"
    );
    let cell = |error: &Error| format!("{:<17}", format!("{:.3} ({:.3})", 1e3 * error.max, 1e3 * error.rms));
    for (case, score) in scores {
        let says = case.assumed.map_or("no compensation".to_owned(), |[lag, gain]| {
            format!("look-ahead {:+.0} %, gain {:+.0} %", 100.0 * (lag - 1.0), 100.0 * (gain - 1.0))
        });
        let again = score.again.map_or([String::new(), String::new()], |errors| [cell(&errors[0]), cell(&errors[1])]);
        let column = |errors: &[Error; 2], again: &str| format!("{}{}{again:<17}", cell(&errors[0]), cell(&errors[1]));
        let (lag, contour) = (column(&score.lag, &again[0]), column(&score.contour, &again[1]));
        let learnt = score
            .learnt
            .map_or(String::new(), |drive| format!("{:.1} ms, {:.0} /s²", 1e3 * drive.lag, 1.0 / drive.inverse_gain));
        let met = match met(*case, score, scores) {
            None => "",
            Some(true) => "met",
            Some(false) => "missed",
        };
        out += &format!("{:<8}{says:<32}{lag}{contour}{learnt:<20}{met}\n", format!("{} Hz", case.rate_hz));
    }
    if let Some((_, score)) = scores.first() {
        let [mean, max] = score.speed.map(|speed| 1e3 * speed);
        let behind = scores.iter().fold(0.0_f64, |most, (_, score)| most.max(score.behind));
        out += &format!(
            "speed on the scored layers {mean:.1} mm/s on average, {max:.1} at most; a lead stayed behind by {behind:.1e} rad at most\n"
        );
    }
    out
}

/// Whether lag and contour keep the aim after the first layer and on the demo's layer again, the contour no worse than without
/// compensation.
pub fn met(case: Case, score: &Score, scores: &[(Case, Score)]) -> Option<bool> {
    case.assumed?;
    let (_, without) = scores.iter().find(|(other, _)| other.rate_hz == case.rate_hz && other.assumed.is_none())?;
    let [lag, contour] = score.again?;
    let no_worse = (0..2).all(|layer| score.contour[layer].max <= without.contour[layer].max);
    let no_worse = no_worse && contour.max <= without.contour[0].max;
    Some([lag, contour, score.lag[1], score.contour[1]].iter().all(|error| error.max <= AIM) && no_worse)
}

/// The same for programs.
pub fn json(scores: &[(Case, Score)]) -> Value {
    let errors = |errors: &[Error; 2]| {
        let [first, others] = errors.map(|error| json!({ "max_m": error.max, "rms_m": error.rms }));
        json!({ "first_layer": first, "other_layers": others })
    };
    let cases = scores.iter().map(|(case, score)| {
        json!({
            "rate_hz": case.rate_hz,
            "assumed_lookahead_factor": case.assumed.map(|[lag, _]| lag),
            "assumed_gain_factor": case.assumed.map(|[_, gain]| gain),
            "demo_layer_again": score.again.map(|[lag, contour]| {
                json!({
                    "lag_max_m": lag.max,
                    "lag_rms_m": lag.rms,
                    "contour_max_m": contour.max,
                    "contour_rms_m": contour.rms,
                })
            }),
            "lag": errors(&score.lag),
            "contour": errors(&score.contour),
            "speed_mean_m_s": score.speed[0],
            "speed_max_m_s": score.speed[1],
            "learnt_lag_s": score.learnt.map(|drive| drive.lag),
            "learnt_gain_1_s2": score.learnt.map(|drive| 1.0 / drive.inverse_gain),
            "behind_max_rad": score.behind,
            "met": met(*case, score, scores),
        })
    });
    Value::from(cases.collect::<Vec<_>>())
}
