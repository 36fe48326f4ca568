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

/// Four joints and base still, so that what is measured differs by noise alone.
#[test]
fn the_trackers_noise_is_the_published_one() {
    let mut params = plain(300.0, 0.1);
    params.tracker.noise = 1.0;
    let mut plant = Plant::new(&params, 3);
    let truth = params.tracker_from_nominal * params.arm.forward(&params.start) * params.flange_from_target;
    let (mut squares, mut sums, mut count) = ([0.0; 6], [0.0; 6], 0.0);
    for _ in 0..20_000 {
        for pose in plant.step(&params.start).poses {
            let off = pose.tracker_from_target.translation - truth.translation;
            let rotation = pose.tracker_from_target.rotation * truth.rotation.transpose();
            let turn = Pose { rotation, translation: off }.rotation_vector();
            for (k, value) in off.iter().chain(turn.iter()).enumerate() {
                squares[k] += value * value;
                sums[k] += value;
            }
            count += 1.0;
        }
    }
    assert!(count > 19_900.0);
    // By the table: half of 15 µm + 6 µm/m, and 0.01°. Of 20,000 values a deviation is known to 0.5 % (one sigma).
    let place = 0.5e-6 * (15.0 + 6.0 * truth.translation.norm());
    for (k, (square, sum)) in squares.iter().zip(sums).enumerate() {
        let expected = if k < 3 { place } else { 0.01_f64.to_radians() };
        let (deviation, mean) = (f64::sqrt(square / count), sum / count);
        assert!((deviation / expected - 1.0).abs() < 0.02, "{k}: {deviation:e} {expected:e}");
        assert!(mean.abs() < 4.0 * expected / f64::sqrt(count), "{k}: {mean:e}");
    }
}

/// A target at 100 m/s is half a millimetre further in 5 µs, many times the noise.
#[test]
fn a_stamp_is_wrong_by_five_microseconds_at_most() {
    let params = TrackerParams { noise: 1.0, latency: 0.0, ..plain(300.0, 0.1).tracker };
    let at = |now: Nanos| Pose::from_translation(100.0 * now.0 as f64 * 1e-9, 5.0, 0.0);
    let mut tracker = Tracker::new(&params, Random::new(4), at(Nanos(0)));
    let (mut square, mut worst, mut count) = (0.0, 0.0_f64, 0.0);
    for substep in 1..=8000 {
        let now = Nanos(substep * SUBSTEP_NS);
        tracker.see(now, &at(now));
        for pose in tracker.arrived(now) {
            assert_eq!(pose.at, now);
            let off = pose.tracker_from_target.translation.x - at(now).translation.x;
            (square, worst, count) = (square + off * off, worst.max(off.abs()), count + 1.0);
        }
    }
    assert_eq!(count, 2000.0);
    // Even in ±0.5 mm, plus noise of up to 0.6 mm at 200 m, which is on average a quarter of it in the square.
    let noise: f64 = (1..=2000).map(|k| position_deviation(f64::hypot(0.1 * f64::from(k), 5.0)).powi(2)).sum();
    let expected = f64::sqrt((5e-4_f64.powi(2) / 3.0) + noise / 2000.0);
    assert!((f64::sqrt(square / count) / expected - 1.0).abs() < 0.06, "{} {expected}", f64::sqrt(square / count));
    assert!(worst < 5e-4 + 4.0 * position_deviation(200.0), "{worst}");
}

#[test]
fn a_pose_is_the_truth_of_its_stamp_and_comes_late() {
    let mut params = plain(6400.0, 0.025);
    params.tracker.latency = 0.003;
    let mut plant = Plant::new(&params, 3);
    let mut truths = std::collections::HashMap::new();
    let mut last = Nanos(0);
    for tick in 0..60 {
        let measured = plant.step(&shifted(&params.start, 0.3e-3 * f64::from(tick)));
        let truth = plant.truth();
        let flange = truth.tracker_from_tcp * params.flange_from_tcp.inverse();
        truths.insert(measured.now, flange * params.flange_from_target);
        assert_eq!(measured.poses.len(), usize::from(tick >= 3));
        for pose in measured.poses {
            assert_eq!(pose.at.plus(3_000_000), measured.now);
            assert!(pose.at > last);
            last = pose.at;
            assert!((truths[&pose.at].translation - pose.tracker_from_target.translation).norm() < 1e-12);
        }
    }
}

#[test]
fn poses_are_lost_one_by_one_and_by_breaks_of_the_beam() {
    let mut params = plain(300.0, 0.1);
    params.tracker.missing = 0.05;
    let mut plant = Plant::new(&params, 5);
    let all: usize = (0..20_000).map(|_| plant.step(&params.start).poses.len()).sum();
    // 1,000 of 20,000 are lost, with a deviation of 31.
    assert!((18_900..19_100).contains(&all), "{all}");
    params.tracker = TrackerParams {
        missing: 0.0,
        break_interval: 2.0,
        break_length: [0.1, 0.3],
        relock: [0.2, 1.0],
        ..params.tracker
    };
    let mut plant = Plant::new(&params, 5);
    let (mut last, mut gaps) = (None, Vec::new());
    for _ in 0..200_000 {
        for pose in plant.step(&params.start).poses {
            let gap = last.map_or(1_000_000, |last| pose.at.since(last));
            if gap > 1_000_000 {
                gaps.push(gap as f64 * 1e-9);
            }
            last = Some(pose.at);
        }
    }
    // 200 s of 2.8 s each, on average.
    assert!((45..100).contains(&gaps.len()), "{}", gaps.len());
    assert!(gaps.iter().all(|gap| (0.3..1.301).contains(gap)), "{gaps:?}");
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    assert!((mean - 0.8).abs() < 0.1, "{mean}");
}

#[test]
fn encoders_have_their_noise_and_quantum_and_rates_theirs() {
    let mut params = plain(300.0, 0.1);
    (params.encoder_noise, params.encoder_quantum, params.rate_noise) = (2e-5, 1e-5, 1e-3);
    let mut plant = Plant::new(&params, 7);
    let (mut squares, mut rates) = (0.0, 0.0);
    for _ in 0..2000 {
        let measured = plant.step(&params.start);
        for ((q, start), rate) in measured.joints.0.iter().zip(&params.start.0).zip(&measured.rates.0) {
            assert!((q / 1e-5 - (q / 1e-5).round()).abs() < 1e-6);
            squares += (q - start) * (q - start);
            rates += rate * rate;
        }
    }
    // A quantum adds a twelfth of its square.
    let (encoder, rate) = (f64::sqrt(squares / 12_000.0), f64::sqrt(rates / 12_000.0));
    assert!((encoder / f64::sqrt(4e-10 + 1e-10 / 12.0) - 1.0).abs() < 0.03, "{encoder:e}");
    assert!((rate / 1e-3 - 1.0).abs() < 0.03, "{rate:e}");
}

#[test]
fn the_base_swings_at_its_frequency_after_a_step_and_drifts_at_its_speed() {
    let mut params = plain(300.0, 0.1);
    params.base.frequency = [2.0, 2.5, 3.0, 4.0, 5.0, 6.0].map(|hertz| TAU * hertz);
    params.base.damping = 0.03;
    let mut plant = Plant::new(&params, 9);
    let step = Displacement { translation: Vector3::new(1e-3, 2e-3, -1e-3), rotation: Vector3::new(0.0, 1e-3, 0.0) };
    plant.shift_base(&step);
    assert!(plant.truth().nominal_from_base.translation.norm() < 1e-12);
    let mut crossings = Vec::new();
    let mut before = -2e-3;
    for tick in 0..30_000 {
        plant.step(&params.start);
        let off = plant.truth().nominal_from_base.translation.y - 2e-3;
        if off * before < 0.0 && crossings.len() < 9 {
            crossings.push(f64::from(tick) - off / (off - before));
        }
        before = off;
    }
    let half = (crossings[8] - crossings[0]) / 8.0 * 1e-3;
    let expected = 0.5 / (2.5 * f64::sqrt(1.0 - 0.03 * 0.03));
    assert!((half / expected - 1.0).abs() < 1e-3, "{half} {expected}");
    let end = plant.truth().nominal_from_base;
    assert!(
        (end.translation - step.translation).norm() < 1e-6 && (end.rotation_vector() - step.rotation).norm() < 1e-6
    );
    // Drift: the base follows its place of rest; between two turns it goes at 3 mm/s.
    params.base = BaseParams { drift_speed: 3e-3, drift_time: 1e3, ..params.base };
    let mut plant = Plant::new(&params, 9);
    let at = |plant: &mut Plant, ticks: u32| {
        for _ in 0..ticks {
            plant.step(&params.start);
        }
        plant.truth().nominal_from_base.translation
    };
    let (first, second) = (at(&mut plant, 20_000), at(&mut plant, 1000));
    assert!(((second - first).norm() - 3e-3).abs() < 1e-7, "{}", (second - first).norm());
}

/// The base's centre of mass and the arm's move against each other: what one gains, the other loses.
#[test]
fn an_arm_that_starts_pushes_the_base_back() {
    let mut params = plain(6400.0, 0.025);
    params.base.mass = 500.0;
    params.base.reaction_mass = 10.0;
    params.base.frequency = [TAU * 0.01; 6];
    params.base.damping = 0.0;
    let mut plant = Plant::new(&params, 9);
    let flange = |plant: &Plant| params.arm.forward(&plant.truth().joints).translation;
    let before = flange(&plant);
    let mut goal = params.start;
    goal.0[1] += 0.05;
    for _ in 0..200 {
        plant.step(&goal);
    }
    let (moved, back) = (flange(&plant) - before, plant.truth().nominal_from_base.translation);
    assert!(moved.norm() > 0.02);
    assert!((back * 500.0 + moved * 10.0).norm() < 0.01 * moved.norm() * 10.0, "{moved} {back}");
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_does_not() {
    let run = |seed: u64, noise: u64| {
        let params = Params::random(if seed.is_multiple_of(2) { Kind::Nj130 } else { Kind::Ur10e }, seed);
        let mut plant = Plant::new(&params, noise);
        let mut bits = Vec::new();
        for tick in 0..500 {
            let by = 0.05 * f64::sin(0.02 * f64::from(tick));
            let measured = plant.step(&shifted(&params.start, by));
            bits.extend(measured.joints.0.iter().chain(&measured.rates.0).map(|value| value.to_bits()));
            for pose in measured.poses {
                bits.extend(pose.tracker_from_target.rotation.iter().map(|value| value.to_bits()));
                bits.extend(pose.tracker_from_target.translation.iter().map(|value| value.to_bits()));
            }
            bits.extend(plant.truth().tracker_from_tcp.translation.iter().map(|value| value.to_bits()));
        }
        bits
    };
    for seed in 0..4 {
        assert_eq!(run(seed, seed), run(seed, seed));
        assert_ne!(run(seed, seed), run(seed, seed + 1));
        assert_ne!(run(seed, seed), run(seed + 2, seed));
    }
    assert_eq!(
        Plant::random(4).step(&Plant::random(4).params().start),
        Plant::random(4).step(&Plant::random(4).params().start)
    );
}

/// 100 plants of each kind stay finite and inside what their parts allow, and every range is drawn from end to end.
#[test]
fn random_plants_are_of_their_ranges() {
    let mut dead = [u64::MAX, 0];
    for seed in 0..200 {
        let mut plant = Plant::random(seed);
        let params = plant.params().clone();
        assert_eq!(params.arm.name, ["nj130-2.6", "ur10e"][(seed % 2) as usize]);
        assert!((1_000_000..=15_000_000).contains(&params.dead_time_ns));
        dead = [dead[0].min(params.dead_time_ns), dead[1].max(params.dead_time_ns)];
        let start = plant.truth();
        for tick in 0..150 {
            plant.step(&shifted(&params.start, 0.02 * (1.0 - f64::cos(0.01 * f64::from(tick)))));
        }
        let truth = plant.truth();
        let moved = (truth.tracker_from_tcp.translation - start.tracker_from_tcp.translation).norm();
        assert!(moved > 1e-4 && moved < 0.3, "seed {seed}: {moved}");
        assert!(
            truth.nominal_from_base.translation.norm() < 5e-3,
            "seed {seed}: {}",
            truth.nominal_from_base.translation
        );
        for q in start.joints.0.iter().zip(&params.start.0).map(|(link, start)| link - start) {
            assert!(q.abs() < 5e-3, "seed {seed}: {q}");
        }
    }
    assert!(dead[0] < 1_500_000 && dead[1] > 14_500_000, "{dead:?}");
}

#[test]
fn the_documented_ranges_are_those_of_the_code() {
    let span = |[low, high]: [f64; 2]| if low == high { format!("{low}") } else { format!("{low} to {high}") };
    let row =
        |range: &Range| format!("| {} | {} | {} | {} |", range.name, range.unit, span(range.nj130), span(range.ur10e));
    let docs = include_str!("../../../../docs/plant.md");
    let (_, table) = docs.split_once("| what | unit | NJ130 | UR10e |\n| --- | --- | --- | --- |\n").unwrap();
    let listed: Vec<_> = table.lines().take_while(|line| line.starts_with('|')).map(str::to_owned).collect();
    assert_eq!(listed, RANGES.iter().map(row).collect::<Vec<_>>());
}
