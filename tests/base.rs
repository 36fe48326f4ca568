//! The base's estimate on random plants: a drifting, swinging base under a soft arm with backlash, a late tracker with noise,
//! dropouts and beam breaks. `cargo test -p screed --test base -- --nocapture` prints the figures of
//! docs/estimation.md.

use nalgebra::Vector3;
use screed::sim::plant::{Plant, ROTATION_DEVIATION, position_deviation};
use screed_kernel::base::history::History;
use screed_kernel::base::swing::Swing;
use screed_kernel::base::{Base, BaseConfig, BaseLimits, Drift, Measurement, Trust};
use screed_kernel::units::JointPos;

/// For a base on a crane that drifts and swings.
fn config(plant: &Plant) -> BaseConfig {
    let params = plant.params();
    let pivot = (params.arm.forward(&params.start) * params.flange_from_tcp).translation;
    BaseConfig {
        tracker_from_nominal: params.tracker_from_nominal,
        flange_from_target: params.flange_from_target,
        pivot,
        drift: Drift { speed: 5e-3, turn_rate: 5e-4, time: 0.5 },
        swing: Swing::NONE,
        hold: 1.0,
        agreeing: 20,
        limits: BaseLimits {
            translation_max: 0.06,
            velocity_max: 0.03,
            acceleration_max: 0.5,
            rotation_max: 0.02,
            turn_rate_max: 0.02,
            turn_acceleration_max: 0.5,
        },
        period: params.period_ns as f64 * 1e-9,
    }
}

/// How far the tip is from where it is thought to be (m), tick by tick.
#[derive(Default)]
struct Errors {
    nominal: Vec<f64>,
    /// With a pose of the last 10 ms.
    seen: Vec<f64>,
    /// With an older one that is held.
    held: Vec<f64>,
    /// While the correction goes where the estimate is: after a beam break of more than the hold.
    behind: Vec<f64>,
}

/// 12 s about where it starts, at some `speed` of the tip (m/s).
fn run(seed: u64, speed: f64, errors: &mut Errors) {
    let mut plant = Plant::random(seed);
    let params = plant.params().clone();
    let config = config(&plant);
    let mut base = Base::new(&config).unwrap();
    let mut history = History::<6, 16>::new();
    let (_, jacobian) = params.arm.jacobian(&params.start);
    // Joints 1, 2 and 3 swing at 0.2, 0.25 and 0.3 Hz; so far that each moves the tip at that speed at most, over √3.
    let amplitudes: [f64; 3] = std::array::from_fn(|i| {
        let rate = std::f64::consts::TAU * (0.2 + 0.05 * i as f64);
        speed / (1.74 * rate * jacobian.fixed_view::<3, 1>(0, i).norm())
    });
    for tick in 0..6000 {
        let t = f64::from(tick) * config.period;
        let mut command = params.start;
        for (i, amplitude) in amplitudes.iter().enumerate() {
            let phase = std::f64::consts::TAU * (0.2 + 0.05 * i as f64) * t;
            command.0[i] += amplitude * f64::min(t, 1.0) * phase.sin();
        }
        let measured = plant.step(&command);
        history.push(measured.now, &measured.joints).unwrap();
        for pose in &measured.poses {
            let Ok(joints) = history.at(pose.at) else { continue };
            let measurement = Measurement {
                at: pose.at,
                tracker_from_target: pose.tracker_from_target,
                position_deviation: position_deviation(pose.tracker_from_target.translation.norm()),
                rotation_deviation: ROTATION_DEVIATION,
                joints,
                joint_deviation: JointPos([3e-5; 6]),
            };
            base.measure(params.arm, &measurement).unwrap();
        }
        let output = base.tick(measured.now).unwrap();
        if tick < 1000 {
            continue;
        }
        let base_from_tcp = params.arm.forward(&measured.joints) * params.flange_from_tcp;
        let truth = plant.truth().tracker_from_tcp.translation;
        let off = |tip: Vector3<f64>| (tip - truth).norm();
        errors.nominal.push(off((params.tracker_from_nominal * base_from_tcp).translation));
        let error = off((params.tracker_from_nominal * output.nominal_from_base * base_from_tcp).translation);
        match output.trust {
            Trust::Held { .. } if output.behind[0] > 1e-4 => errors.behind.push(error),
            Trust::Held { age } if age < 0.01 => errors.seen.push(error),
            Trust::Held { .. } => errors.held.push(error),
            Trust::Ended => {}
        }
    }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize] * 1e3
}

#[test]
fn the_tip_is_known_to_a_tenth_of_a_millimetre_while_the_base_drifts() {
    for speed in [0.015, 0.1] {
        let mut errors = Errors::default();
        for seed in 0..20 {
            run(seed, speed, &mut errors);
        }
        let Errors { nominal, seen, held, behind } = &mut errors;
        let share = seen.len() as f64 / nominal.len() as f64;
        println!("{:.0} mm/s, |error| in mm: median, 95 %, worst", speed * 1e3);
        for (name, values) in [("nominal", &mut *nominal), ("seen", &mut *seen), ("held", held), ("behind", behind)] {
            let [median, most, worst] = [0.5, 0.95, 1.0].map(|share| quantile(values, share));
            println!("  {name:8} {median:6.3} {most:6.3} {worst:6.3}, {} ticks", values.len());
        }
        assert!(share > 0.8, "{share}");
        assert!(quantile(seen, 0.95) < 0.1 && quantile(seen, 1.0) < 0.3 && quantile(nominal, 0.5) > 2.0);
    }
}
