//! The figures as a table and as JSON.

use super::{CONDITIONS, Errors, SPEEDS, Score};
use crate::sim::plant::Kind;
use serde_json::{Value, json};

/// The most that is wanted (m), and of how many plants.
pub const AIM: f64 = 0.3e-3;

/// The largest sensitivity, least gain margin (dB) and phase margin (rad) that are wanted.
pub const SENSITIVITY: f64 = 2.0;
/// dB
pub const GAIN_DB: f64 = 6.0;
/// rad
pub const PHASE: f64 = std::f64::consts::FRAC_PI_4;

const KINDS: [(Kind, &str); 2] = [(Kind::Nj130, "NJ130 on a crane"), (Kind::Ur10e, "UR10e on a platform")];

/// A value that so much of them do not exceed.
fn quantile(mut values: Vec<f64>, part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get(((part * values.len() as f64).ceil() as usize).saturating_sub(1).min(last)).copied().unwrap_or(f64::NAN)
}

/// Whether a plant's loops are as stable as is wanted.
pub fn is_stable(score: &Score) -> bool {
    score.margin.is_kept()
}

/// Share of the plants that keep the aim in a figure.
fn kept(scores: &[&Score], figure: impl Fn(&Score) -> f64) -> f64 {
    scores.iter().filter(|score| figure(score) < AIM).count() as f64 / scores.len() as f64
}

/// The tables of both kinds.
pub fn table(scores: &[Score]) -> String {
    let mut out = format!(
        "base drifting by 3 mm/s in a random direction, or turning to another every 2 to 6 s; tool on a circle of 0.15 m;\n\
         of the plants the median and what 95 % do not exceed, mm\n\
         absolute: dead time taken out; timed: at the same instant; below {} mm: share of the plants, by their largest error;\n\
         a run that a fault ended counts as infinite\n",
        1e3 * AIM
    );
    for (kind, title) in KINDS {
        let of: Vec<&Score> = scores.iter().filter(|score| score.kind == kind).collect();
        if of.is_empty() {
            continue;
        }
        out += &format!(
            "\n{title}, {} plants\n{:<10}{:<13}{:<16}{:<16}{:<16}{:<16}{:<18}below: absolute, contour\n",
            of.len(),
            "speed",
            "condition",
            "absolute max",
            "absolute rms",
            "timed max",
            "contour max",
            "contour rms"
        );
        for (s, speed) in SPEEDS.iter().enumerate() {
            for (c, condition) in CONDITIONS.iter().enumerate() {
                let cell = |figure: fn(&Errors) -> f64| {
                    let all = || of.iter().map(|score| 1e3 * figure(&score.errors[s][c])).collect();
                    format!("{:<16}", format!("{:.3}  {:.3}", quantile(all(), 0.5), quantile(all(), 0.95)))
                };
                out += &format!(
                    "{:<10}{:<13}{}{}{}{}{}  {:.0} %, {:.0} %\n",
                    format!("{:.0} mm/s", 1e3 * speed),
                    condition,
                    cell(|errors| errors.absolute[0]),
                    cell(|errors| errors.absolute[1]),
                    cell(|errors| errors.timed[0]),
                    cell(|errors| errors.contour[0]),
                    cell(|errors| errors.contour[1]),
                    100.0 * kept(&of, |score| score.errors[s][c].absolute[0]),
                    100.0 * kept(&of, |score| score.errors[s][c].contour[0]),
                );
            }
        }
        out += &stability(&of);
    }
    out + &together(scores)
}

/// What all plants do with the correction on.
fn together(scores: &[Score]) -> String {
    let all: Vec<&Score> = scores.iter().collect();
    let mut out = format!("\nall {} plants, correction on, below {} mm: absolute, contour\n", all.len(), 1e3 * AIM);
    for (s, speed) in SPEEDS.iter().enumerate() {
        out += &format!("{:<10}", format!("{:.0} mm/s", 1e3 * speed));
        for (c, condition) in CONDITIONS.iter().enumerate().skip(2) {
            out += &format!(
                "{condition}: {:.1} %, {:.1} %   ",
                100.0 * kept(&all, |score| score.errors[s][c].absolute[0]),
                100.0 * kept(&all, |score| score.errors[s][c].contour[0]),
            );
        }
        out = out.trim_end().to_owned() + "\n";
    }
    out
}

/// The lines on margins and disturbances.
fn stability(of: &[&Score]) -> String {
    let all = |figure: fn(&Score) -> f64| of.iter().map(|score| figure(score)).collect::<Vec<_>>();
    let sensitivity = all(|score| score.margin.sensitivity);
    let gain = all(|score| -20.0 * score.margin.gain.log10());
    let phase = all(|score| -score.margin.phase.to_degrees());
    let stable = of.iter().filter(|score| is_stable(score)).count();
    let share = |k: usize| of.iter().map(|score| score.disturbed.shares[k]).fold(0.0, f64::max);
    let stopped = of.iter().filter(|score| score.disturbed.fault.is_some()).count();
    let relocks: usize = of.iter().map(|score| score.disturbed.relocks).sum();
    format!(
        "loops: Ms {:.2} (median), {:.2} (worst); gain margin {:.1}, {:.1} dB; phase margin {:.0}, {:.0}°; within Ms {SENSITIVITY}, \
         {GAIN_DB} dB, {:.0}°: {stable} of {}\n\
         steps, beam breaks, a push of 0.1 m: {relocks} times locked on again; speed, acceleration, jerk sent at most {:.2}, {:.2}, \
         {:.2} of the guard's limits; {stopped} of {} stopped at the push\n",
        quantile(sensitivity.clone(), 0.5),
        quantile(sensitivity, 1.0),
        -quantile(gain.clone(), 0.5),
        -quantile(gain, 1.0),
        -quantile(phase.clone(), 0.5),
        -quantile(phase, 1.0),
        PHASE.to_degrees(),
        of.len(),
        share(0),
        share(1),
        share(2),
        of.len(),
    )
}

/// Every plant, for programs.
pub fn json(scores: &[Score]) -> Value {
    let pair = |[max, rms]: [f64; 2]| json!({ "max_m": max, "rms_m": rms });
    let errors = |errors: &Errors| {
        json!({
            "absolute": pair(errors.absolute),
            "timed": pair(errors.timed),
            "contour": pair(errors.contour),
        })
    };
    let plants = scores.iter().map(|score| {
        let runs = SPEEDS.iter().zip(&score.errors).flat_map(|(speed, row)| {
            CONDITIONS.iter().zip(row).map(move |(condition, found)| {
                json!({ "speed_m_s": speed, "condition": condition, "errors": errors(found) })
            })
        });
        json!({
            "kind": KINDS.iter().find(|(kind, _)| *kind == score.kind).map(|(_, title)| title),
            "sensitivity_max": score.margin.sensitivity,
            "gain_margin_db": 20.0 * score.margin.gain.log10(),
            "phase_margin_deg": score.margin.phase.to_degrees(),
            "stable": is_stable(score),
            "runs": runs.collect::<Vec<_>>(),
            "disturbed": {
                "velocity_share": score.disturbed.shares[0],
                "acceleration_share": score.disturbed.shares[1],
                "jerk_share": score.disturbed.shares[2],
                "relocks": score.disturbed.relocks,
                "fault": score.disturbed.fault.map(|fault| fault.code()),
            },
        })
    });
    Value::from(plants.collect::<Vec<_>>())
}
