extern crate std;

use super::*;
use std::vec::Vec;

const H: f64 = 0.002;
const TRUE: Drive = Drive { lag: 0.13, inverse_gain: 1.0 / 210.0 };
const ASSUMED: Drive = Drive { lag: 0.1, inverse_gain: 1.0 / 300.0 };
const LEARNING: Learning = Learning {
    lag: [0.02, 0.25],
    inverse_gain: [1.0 / 2500.0, 1.0 / 80.0],
    dead_time: 2.0 * H,
    filter_time: 0.05,
    velocity_min: 0.01,
    memory: 20.0,
    noise: 1e-6,
    adoption: 0.2,
};

/// The law itself, in steps of a 200th of a tick, the target held in between and late by so many ticks.
struct Joint {
    q: f64,
    v: f64,
    late: Vec<f64>,
}

impl Joint {
    fn new(dead_ticks: usize) -> Self {
        Self { q: 0.0, v: 0.0, late: std::vec![0.0; dead_ticks] }
    }

    fn step(&mut self, target: f64, drive: &Drive) {
        self.late.push(target);
        let target = self.late.remove(0);
        let dt = H / 200.0;
        for _ in 0..200 {
            let a = (target - self.q - drive.lag * self.v) / drive.inverse_gain;
            self.v += dt * a;
            self.q += dt * self.v;
        }
    }
}

/// Position, speed and acceleration of a path that begins at rest.
fn path(t: f64) -> [f64; 3] {
    let waves = [(0.2, 0.9), (0.05, 2.3)];
    waves.iter().fold([0.0; 3], |[q, v, a], (size, w)| {
        let (s, c) = (w * t).sin_cos();
        [q + size * (1.0 - c), v + size * w * s, a + size * w * w * c]
    })
}

/// Plays the path for so many seconds, with what is used for the lead; where the joint is each time, and what was learnt.
fn play(learning: &Learning, seconds: f64, dead_ticks: usize, noise: f64) -> (Vec<[f64; 2]>, Identification<1>) {
    let mut identification = Identification::new(&[ASSUMED], learning, H).unwrap();
    let (mut joint, mut seed, mut errors) = (Joint::new(dead_ticks), 3_u64, Vec::new());
    for k in 0..(seconds / H) as usize {
        let t = k as f64 * H;
        let [q, v, a] = path(t);
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let actual = joint.q + noise * ((seed >> 33) as f64 / (1_u64 << 30) as f64 - 1.0);
        let lead = lead(identification.drives(), &JointVel([v]), &JointAcc([a]));
        let sent = JointPos([q + lead.0[0]]);
        identification.observe(&sent, &JointPos([actual]), H).unwrap();
        // Dead time, and half a tick for which a target is held, are left.
        errors.push([t, joint.q - path(t - dead_ticks as f64 * H)[0]]);
        joint.step(sent.0[0], &TRUE);
    }
    (errors, identification)
}

#[test]
fn the_lead_undoes_the_drive() {
    let mut joint = Joint::new(0);
    let mut worst = [0.0_f64; 2];
    for k in 0..10_000 {
        let t = f64::from(k) * H;
        let [q, v, a] = path(t);
        // Acceleration begins with a step, which takes some time to be forgotten. A held target is half a tick late.
        if t > 1.0 {
            worst[0] = worst[0].max((joint.q - path(t - 0.5 * H)[0]).abs());
            worst[1] = worst[1].max((joint.q - path(t - TRUE.lag)[0]).abs());
        }
        joint.step(q + TRUE.lead(v, a), &TRUE);
    }
    assert!(worst[0] < 3e-6, "{worst:?}");
    assert!(worst[1] > 0.02, "without: {worst:?}");
}

#[test]
fn lag_and_gain_are_found_with_the_half_tick_for_which_a_target_is_held() {
    for noise in [0.0, 1e-5] {
        let (errors, identification) = play(&LEARNING, 10.0, 2, noise);
        let [Drive { lag, inverse_gain }] = *identification.learnt();
        assert!((lag - TRUE.lag - 0.5 * H).abs() < 1e-4, "{lag}");
        assert!((inverse_gain / TRUE.inverse_gain - 1.0).abs() < 0.03, "{inverse_gain}");
        let late = errors.iter().filter(|[t, _]| *t > 5.0).fold(0.0_f64, |worst, [_, error]| worst.max(error.abs()));
        let early = errors.iter().filter(|[t, _]| *t < 2.0).fold(0.0_f64, |worst, [_, error]| worst.max(error.abs()));
        assert!(late < 3e-5 && early > 1e-3, "{early} {late}");
    }
}

#[test]
fn dead_time_that_is_not_named_is_found_as_lag() {
    let (_, identification) = play(&Learning { dead_time: 0.0, ..LEARNING }, 10.0, 5, 0.0);
    let [Drive { lag, .. }] = *identification.learnt();
    assert!((lag - TRUE.lag - 5.5 * H).abs() < 2e-4, "{lag}");
}

#[test]
fn what_the_bounds_exclude_is_not_learnt() {
    let narrow = Learning { lag: [0.08, 0.11], ..LEARNING };
    let (_, identification) = play(&narrow, 10.0, 2, 0.0);
    assert_eq!(identification.learnt()[0].lag, 0.11);
    let narrow = Learning { inverse_gain: [1.0 / 350.0, 1.0 / 250.0], ..LEARNING };
    let (_, identification) = play(&narrow, 10.0, 2, 0.0);
    let [Drive { lag, inverse_gain }] = *identification.learnt();
    assert!(inverse_gain == 1.0 / 250.0 && (lag - TRUE.lag).abs() < 0.01, "{lag} {inverse_gain}");
}

#[test]
fn nothing_is_learnt_where_nothing_moves() {
    let mut identification = Identification::new(&[ASSUMED], &LEARNING, H).unwrap();
    for k in 0..10_000 {
        // Noise, and a creep below the least speed.
        let noise = [1e-5, -1e-5][k % 2];
        let creep = 0.004 * k as f64 * H;
        identification.observe(&JointPos([creep]), &JointPos([creep + noise]), H).unwrap();
    }
    assert_eq!((identification.learnt(), identification.drives()), (&[ASSUMED], &[ASSUMED]));
}

#[test]
fn a_pause_begins_anew_and_keeps_what_was_learnt() {
    let (_, mut identification) = play(&LEARNING, 10.0, 2, 0.0);
    let before = *identification.learnt();
    assert_eq!(identification.observe(&JointPos([f64::NAN]), &JointPos([0.0]), H), Err(DriveError::NotFinite));
    // Somewhere else, at rest.
    for _ in 0..1000 {
        identification.observe(&JointPos([1.0]), &JointPos([1.0]), H).unwrap();
    }
    assert_eq!(*identification.learnt(), before);
    assert_eq!(identification.observe(&JointPos([0.0]), &JointPos([0.0]), 0.0), Err(DriveError::NotFinite));
}

#[test]
fn what_cannot_be_is_refused() {
    let refused = |learning: Learning| Identification::new(&[ASSUMED], &learning, H) == Err(DriveError::Configuration);
    assert!(!refused(LEARNING));
    assert!(refused(Learning { lag: [0.12, 0.25], ..LEARNING }), "the assumed one lies outside");
    assert!(refused(Learning { lag: [0.2, 0.05], ..LEARNING }));
    assert!(refused(Learning { inverse_gain: [-0.1, 1.0], ..LEARNING }));
    assert!(refused(Learning { dead_time: 64.0 * H, ..LEARNING }));
    assert!(refused(Learning { noise: 0.0, ..LEARNING }));
    assert!(refused(Learning { memory: f64::NAN, ..LEARNING }));
}

#[test]
fn a_lag_beyond_its_bounds_is_told_once_it_has_been_asked_for_as_long_as_memory_goes() {
    let first = |lag: [f64; 2], seconds| {
        let learning = Learning { lag, memory: 4.0, ..LEARNING };
        play(&learning, seconds, 2, 1e-6).1.astray()
    };
    assert_eq!(first([0.02, 0.25], 9.0), None);
    // Beyond by less than a tenth of the width: it stays on the bound, and is not told.
    assert_eq!(first([0.02, 0.125], 9.0), None);
    assert_eq!(first([0.02, 0.11], 3.5), None);
    let Some(Astray { joint: 0, lag, limit: 0.11 }) = first([0.02, 0.11], 9.0) else { panic!() };
    assert!((lag - TRUE.lag).abs() < 5e-3, "{lag}");
    let learning = Learning { lag: [0.02, 0.11], memory: 4.0, ..LEARNING };
    let mut identification = play(&learning, 9.0, 2, 1e-6).1;
    identification.pause();
    assert_eq!(identification.astray(), None);
}
