//! The figures as a table and as JSON.

use super::{Case, Errors, Nees, Score};
use serde_json::{Value, json};

/// The paper's own figures: raw and filtered, mean and standard deviation (m, deg).
const PAPER: [[[f64; 2]; 2]; 2] = [[[0.16, 0.07], [9.00, 3.90]], [[0.07, 0.03], [3.89, 1.71]]];

/// The table of all cases.
pub fn table(scores: &[(&Case, Score)]) -> String {
    let runs = scores.first().map_or(0, |(_, score)| score.runs);
    let mut out = format!("error, mean (standard deviation) over {runs} runs\n{:<22}", "");
    for head in ["raw", "filtered", "smoothed"] {
        out += &format!("  {head:<30}");
    }
    out += "  NEES of 3 (in band)  of 18 (in band)   in 3σ   aim\n";
    let cell = |[place, turn]: [[f64; 2]; 2]| {
        format!("  {:<30}", format!("{:.4} ({:.4}) m  {:5.2} ({:.2})°", place[0], place[1], turn[0], turn[1]))
    };
    out += &format!("{:<22}{}{}\n", "the paper", cell(PAPER[0]), cell(PAPER[1]));
    for (case, score) in scores {
        out += &format!("{:<22}", case.name);
        for errors in [&score.raw, &score.filtered, &score.smoothed] {
            out += &cell([errors.position, errors.rotation.map(f64::to_degrees)]);
        }
        let nees = |nees: &Nees| format!("{:.2} ({:.0} %)", nees.mean, 100.0 * nees.inside);
        let (place, state) = (nees(&score.nees_place), nees(&score.nees));
        let aim = match (case.aim_m, case.aim_deg, met(case, score)) {
            (Some(place), Some(turn), met) => {
                format!("{place} m, {turn}°: {}", if met { "met" } else { "missed" })
            }
            _ => "none".to_owned(),
        };
        out += &format!("  {place:<19}  {state:<16}  {:5.1} %  {aim}\n", 100.0 * score.covered);
    }
    if let Some((_, score)) = scores.first() {
        let [low, high] = score.nees_place.band;
        out += &format!(
            "NEES: of the flange's place (3) and of the whole state (18); in 95 % of cases the mean over the runs at one instant\n\
             lies in a band, {low:.2} to {high:.2} and {:.2} to {:.2}, if the filter is exactly right\n",
            score.nees.band[0], score.nees.band[1]
        );
    }
    for (case, score) in scores {
        out += &consistency(case, score);
    }
    out
}

/// Whether the filter believes of itself what it should, and how far the best that anyone could do with these measurements is.
fn consistency(case: &Case, score: &Score) -> String {
    let judged = |nees: &Nees, of: &str| {
        let [low, high] = nees.band;
        let verdict = match nees.mean {
            mean if mean > high => "ABOVE its band: the errors are larger than the filter believes",
            mean if mean < low => "BELOW its band: the errors are smaller than the filter believes",
            _ => "in its band",
        };
        let inside = 100.0 * nees.inside;
        format!(
            "  NEES of {of}: {:.2}, {verdict} ({low:.2} to {high:.2}; {inside:.0} % of the instants in it)\n",
            nees.mean
        )
    };
    let ratio = |part: fn(&Errors) -> [f64; 2]| part(&score.filtered)[0] / part(&score.smoothed)[0];
    let (smoothed, filtered) = (&score.smoothed, &score.filtered);
    format!(
        "{}\n{}{}  bound by the smoother, which knows the future too: {:.4} m, {:.2}°; the filter {:.4} m, {:.2}°: {:.2} and {:.2} times that\n",
        case.name,
        judged(&score.nees_place, "the place (3)"),
        judged(&score.nees, "the whole state (18)"),
        smoothed.position[0],
        smoothed.rotation[0].to_degrees(),
        filtered.position[0],
        filtered.rotation[0].to_degrees(),
        ratio(|errors| errors.position),
        ratio(|errors| errors.rotation),
    )
}

/// Whether the case keeps the aims it has.
pub fn met(case: &Case, score: &Score) -> bool {
    let place = case.aim_m.is_none_or(|aim| score.filtered.position[0] <= aim);
    let turn = case.aim_deg.is_none_or(|aim| score.filtered.rotation[0].to_degrees() <= aim);
    place && turn
}

/// The same for programs.
pub fn json(scores: &[(&Case, Score)]) -> Value {
    let errors = |errors: &Errors| {
        json!({
            "position_m": errors.position[0],
            "position_deviation_m": errors.position[1],
            "rotation_deg": errors.rotation[0].to_degrees(),
            "rotation_deviation_deg": errors.rotation[1].to_degrees(),
        })
    };
    let nees = |nees: &Nees| {
        let in_band = (nees.band[0]..=nees.band[1]).contains(&nees.mean);
        json!({ "mean": nees.mean, "band": nees.band, "inside": nees.inside, "mean_in_band": in_band })
    };
    let cases = scores.iter().map(|(case, score)| {
        json!({
            "case": case.name,
            "period_ms": case.period_ms,
            "jerk_time_s": case.jerk_time_s,
            "runs": score.runs,
            "raw": errors(&score.raw),
            "filtered": errors(&score.filtered),
            "smoothed": errors(&score.smoothed),
            "nees_place": nees(&score.nees_place),
            "nees_state": nees(&score.nees),
            "inside_three_sigma": score.covered,
            "aim_m": case.aim_m,
            "aim_deg": case.aim_deg,
            "met": met(case, score),
        })
    });
    Value::from(cases.collect::<Vec<_>>())
}

/// What tuning found: a line a time.
pub fn tuning(case: &Case, tried: &[(f64, Score)]) -> String {
    let mut out = format!("{}, on {} runs\n", case.name, tried.first().map_or(0, |(_, score)| score.runs));
    for (time, score) in tried {
        let Score { filtered, nees, nees_place, covered, .. } = score;
        out += &format!(
            "  {time:>6} s  {:.4} m  {:.3}°  NEES {:.2} of 3 ({:.0} % in band), {:.2} of 18, 3σ {:.1} %\n",
            filtered.position[0],
            filtered.rotation[0].to_degrees(),
            nees_place.mean,
            100.0 * nees_place.inside,
            nees.mean,
            100.0 * covered
        );
    }
    out
}
