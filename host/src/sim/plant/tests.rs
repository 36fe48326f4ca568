use super::*;
use std::f64::consts::TAU;

/// A plant without noise, play, drift and give, with one drive.
fn plain(gain: f64, look_ahead: f64) -> Params {
    let mut params = Params::random(Kind::Ur10e, 1);
    for joint in &mut params.joints {
        let stiff = JointParams { gain, look_ahead, compliance: 0.0, play: 0.0, ..*joint };
        *joint = JointParams { elastic_frequency: TAU * 200.0, elastic_damping: 1.0, ..stiff };
    }
    (params.encoder_noise, params.encoder_quantum, params.rate_noise) = (0.0, 0.0, 0.0);
    params.base.drift_speed = 0.0;
    params.base.turn_speed = 0.0;
    params.base.step_interval = f64::INFINITY;
    params.base.reaction_mass = 0.0;
    params.payload = 0.0;
    params.tracker = TrackerParams { noise: 0.0, missing: 0.0, break_interval: f64::INFINITY, ..params.tracker };
    params.period_ns = 1_000_000;
    params
}

fn shifted(start: &JointPos<6>, by: f64) -> JointPos<6> {
    JointPos(start.0.map(|q| q + by))
}

/// Ogata, "Modern Control Engineering", 5.3: the unit step of ω²/(s² + 2ζωs + ω²), under- and overdamped.
#[test]
fn a_drive_answers_a_step_as_a_second_order_system_does() {
    for (gain, look_ahead) in [(300.0, 0.1), (3600.0, 0.02), (400.0, 0.13)] {
        let params = plain(gain, look_ahead);
        let mut plant = Plant::new(&params, 1);
        let (w, z) = (f64::sqrt(gain), 0.5 * look_ahead * f64::sqrt(gain));
        let dead = params.dead_time_ns as f64 * 1e-9;
        for tick in 1..=600 {
            let measured = plant.step(&shifted(&params.start, 0.1));
            let t = f64::max(f64::from(tick) * 1e-3 - dead, 0.0);
            let unit = if z < 1.0 {
                let wd = w * f64::sqrt(1.0 - z * z);
                1.0 - f64::exp(-z * w * t) * ((wd * t).cos() + z * w / wd * (wd * t).sin())
            } else {
                let root = f64::sqrt(z * z - 1.0);
                let (s1, s2) = ((z + root) * w, (z - root) * w);
                1.0 + w / (2.0 * root) * (f64::exp(-s1 * t) / s1 - f64::exp(-s2 * t) / s2)
            };
            let moved = measured.joints.0[2] - params.start.0[2];
            assert!((moved - 0.1 * unit).abs() < 1e-12, "K {gain}, L {look_ahead}, {t} s: {moved} {unit}");
        }
    }
}

#[test]
fn a_ramp_is_ahead_by_the_look_ahead_and_the_dead_time() {
    let params = plain(300.0, 0.1);
    let mut plant = Plant::new(&params, 1);
    let (speed, mut last) = (0.2, 0.0);
    for tick in 0..3000 {
        let measured = plant.step(&shifted(&params.start, speed * 1e-3 * f64::from(tick)));
        last = params.start.0[0] + speed * 1e-3 * f64::from(tick) - measured.joints.0[0];
    }
    // A held command is half a period behind the ramp, and the encoders are read a period after it is given.
    let lag = 0.1 + params.dead_time_ns as f64 * 1e-9 + 0.5e-3 - 1e-3;
    assert!((last / speed - lag).abs() < 1e-9, "{} {lag}", last / speed);
}

#[test]
fn the_dead_time_is_exact() {
    for dead_time_ns in [SUBSTEP_NS, 1_000_000, 7_250_000, 15_000_000] {
        let params = Params { dead_time_ns, period_ns: SUBSTEP_NS, ..plain(300.0, 0.1) };
        let mut plant = Plant::new(&params, 1);
        let still = (0..1000).find(|_| plant.step(&shifted(&params.start, 0.1)).joints != params.start).unwrap();
        assert_eq!(still * SUBSTEP_NS, dead_time_ns);
    }
}

#[test]
fn a_link_gives_way_to_the_weight_and_swings_at_its_frequency() {
    let mut params = plain(6400.0, 0.025);
    params.payload = 6.0;
    params.joints[1] =
        JointParams { compliance: 2e-5, elastic_frequency: TAU * 12.0, elastic_damping: 0.05, ..params.joints[1] };
    let mut plant = Plant::new(&params, 1);
    let truth = plant.truth();
    // The moment of the weight about joint 2, by hand: its axis is level, so it is weight times the level distance to the flange.
    let upright = params.tracker_from_nominal;
    let flange = upright * params.arm.forward(&truth.joints);
    let [shoulder, ..] = params.arm.frames(&truth.joints);
    let axis = (upright * shoulder).rotation.column(2).into_owned();
    let arm = flange.translation - (upright * shoulder).translation;
    let moment = axis.dot(&arm.cross(&Vector3::new(0.0, 0.0, -9.806_65 * 6.0)));
    assert!(moment.abs() > 20.0);
    assert!((truth.joints.0[1] - truth.motors.0[1] - 2e-5 * moment).abs() < 1e-12);
    // It stays at rest there.
    for _ in 0..200 {
        plant.step(&params.start);
    }
    assert!((plant.truth().joints.0[1] - truth.joints.0[1]).abs() < 1e-9);
    // After a step it swings about the motor; zero crossings are half a damped period apart.
    let mut crossings = Vec::new();
    let mut before = 0.0;
    for tick in 0..1500 {
        plant.step(&shifted(&params.start, 0.01));
        let now = plant.truth();
        let off = now.joints.0[1] - now.motors.0[1] - 2e-5 * moment;
        if tick > 400 && off * before < 0.0 {
            crossings.push(f64::from(tick) - off / (off - before));
        }
        before = off;
    }
    let half = (crossings[8] - crossings[0]) / 8.0 * 1e-3;
    let expected = 0.5 / (12.0 * f64::sqrt(1.0 - 0.05 * 0.05));
    assert!((half / expected - 1.0).abs() < 0.01, "{half} {expected}");
}

#[test]
fn backlash_is_as_wide_as_it_says() {
    let mut params = plain(6400.0, 0.025);
    for joint in &mut params.joints {
        joint.play = 4e-4;
    }
    let mut plant = Plant::new(&params, 1);
    let mut after = |by: f64| {
        for _ in 0..2000 {
            plant.step(&shifted(&params.start, by));
        }
        let truth = plant.truth();
        std::array::from_fn::<f64, 6, _>(|i| truth.joints.0[i] - truth.motors.0[i])
    };
    for (by, off) in [(1.5e-4, -1.5e-4), (0.01, -2e-4), (0.0097, 1e-4), (0.0, 2e-4)] {
        for side in after(by) {
            assert!((side - off).abs() < 1e-9, "{by}: {side}");
        }
    }
}
