//! The figures as a table and as JSON.

use super::{Case, Error, LAYERS, Score};
use serde_json::{Value, json};

/// The most that is wanted of lag and contour on the scored layers (m).
pub const AIM: f64 = 0.3e-3;

/// The table of all cases.
pub fn table(scores: &[(Case, Score)]) -> String {
    let mut out = format!(
        "simulated UR10e, demo's wall, {LAYERS} layers; tool, actual against reference (dead time of 6 ms taken out) and against\n\
         the curves, max (rms) in mm: on the first layer, which is learnt from, and on the others\n\
         {:<8}{:<32}{:<17}{:<17}{:<17}{:<17}{:<20}aim 0.3\n",
        "rate", "cell file says", "lag, first", "lag, others", "contour, first", "contour, others", "learnt L, K"
    );
    let cell = |error: &Error| format!("{:<17}", format!("{:.3} ({:.3})", 1e3 * error.max, 1e3 * error.rms));
    for (case, score) in scores {
        let says = case.assumed.map_or("no compensation".to_owned(), |[lag, gain]| {
            format!("look-ahead {:+.0} %, gain {:+.0} %", 100.0 * (lag - 1.0), 100.0 * (gain - 1.0))
        });
        let [lag, contour] = [&score.lag, &score.contour].map(|errors| cell(&errors[0]) + &cell(&errors[1]));
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

/// Whether lag and contour keep the aim after the first layer, the contour no worse than without compensation.
pub fn met(case: Case, score: &Score, scores: &[(Case, Score)]) -> Option<bool> {
    case.assumed?;
    let (_, without) = scores.iter().find(|(other, _)| other.rate_hz == case.rate_hz && other.assumed.is_none())?;
    let no_worse = (0..2).all(|layer| score.contour[layer].max <= without.contour[layer].max);
    Some(score.lag[1].max <= AIM && score.contour[1].max <= AIM && no_worse)
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
