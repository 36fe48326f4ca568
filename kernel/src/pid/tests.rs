use super::*;
use nalgebra::Complex;

const GAINS: Gains =
    Gains { proportional: 0.8, integral: 5.0, derivative: 0.03, filter_time: 0.02, tracking_time: 0.1 };

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found}, not {expected}");
}

fn pid(gains: Gains) -> Pid<1> {
    Pid::new(&[gains]).unwrap()
}

fn step(pid: &mut Pid<1>, error: f64, dt: f64) -> f64 {
    let [wanted] = pid.step(&JointPos([error]), dt, true).unwrap().0;
    wanted
}

#[test]
fn a_constant_error_is_integrated_over_the_true_time() {
    let mut pid = pid(Gains { derivative: 0.0, ..GAINS });
    let mut time = 0.0;
    // On time, late, very late.
    for dt in [0.002, 0.002, 0.011, 0.002, 0.4, 0.002] {
        time += dt;
        near(step(&mut pid, 0.3, dt), 0.3 * (0.8 + 5.0 * time), 1e-15);
    }
    let [held] = pid.step(&JointPos([0.3]), 0.002, false).unwrap().0;
    near(held, 0.3 * (0.8 + 5.0 * time), 1e-15);
}

/// k_d·s/(1 + T_f·s) answers a unit step by k_d/T_f·e^(−t/T_f) and a unit ramp by k_d·(1 − e^(−t/T_f)).
#[test]
fn the_derivative_is_that_of_a_first_order_filter() {
    let gains = Gains { proportional: 0.0, integral: 0.0, ..GAINS };
    for dt in [1e-5, 1e-4] {
        let (mut stepped, mut ramped) = (pid(gains), pid(gains));
        for k in 1..=(0.1 / dt) as usize {
            let time = k as f64 * dt;
            let decay = (-time / 0.02).exp();
            // Backward differences are off by dt/(2·T_f) of the start.
            near(step(&mut stepped, 1.0, dt), 0.03 / 0.02 * decay, 1.5 * dt / 0.02);
            near(step(&mut ramped, time, dt), 0.03 * (1.0 - decay), 0.03 * dt / 0.02);
        }
    }
    // However long a tick is, it does not overshoot.
    let mut slow = pid(gains);
    step(&mut slow, 1.0, 1.0);
    assert!((0.0..0.03).contains(&step(&mut slow, 1.0, 1.0)));
}

/// An integrator q̇ = u under k_p + k_i/s: the error of a unit step is s/(s² + k_p·s + k_i), that is
/// e^(−σt)·(cos ω_d·t − σ/ω_d·sin ω_d·t) with σ = k_p/2 and ω_d² = k_i − σ².
#[test]
fn with_an_integrator_it_closes_the_loop_that_algebra_says() {
    let (kp, ki, dt) = (6.0, 60.0, 1e-5);
    let mut pid = pid(Gains { proportional: kp, integral: ki, ..Gains::NONE });
    let (sigma, mut q) = (0.5 * kp, 0.0);
    let damped = f64::sqrt(ki - sigma * sigma);
    for k in 0..200_000 {
        let time = f64::from(k) * dt;
        let expected = (-sigma * time).exp() * ((damped * time).cos() - sigma / damped * (damped * time).sin());
        near(1.0 - q, expected, 5e-4);
        q += dt * step(&mut pid, 1.0 - q, dt);
    }
}

#[test]
fn the_integral_lets_go_of_what_is_not_put_out_by_its_time_constant() {
    let mut pid = pid(Gains { derivative: 0.0, ..GAINS });
    let (dt, limit) = (0.002, 0.1);
    let put_out = |pid: &mut Pid<1>, wanted: f64| pid.put_out(&JointPos([wanted.min(limit)])).unwrap();
    let mut wanted = 0.0;
    for _ in 0..5000 {
        wanted = step(&mut pid, 0.3, dt);
        put_out(&mut pid, wanted);
    }
    // In balance, k_i·h·e grows as fast as the share 1 − e^(−h/T_t) of the excess takes away: about k_i·e·T_t, for good.
    let share = 1.0 - f64::exp(-dt / 0.1);
    near(wanted - limit, 5.0 * 0.3 * dt / share, 1e-12);
    // Without an error, e^(−h/T_t) of the excess is left by each tick, long ones too.
    pid.start(&JointPos::ZERO, &JointPos([0.5])).unwrap();
    let mut excess = 0.4;
    for dt in [0.002, 0.002, 0.3, 0.05] {
        let wanted = step(&mut pid, 0.0, dt);
        near(wanted, limit + excess, 1e-12);
        put_out(&mut pid, wanted);
        excess *= (-dt / 0.1_f64).exp();
    }
}

#[test]
fn on_off_and_other_gains_move_nothing() {
    let mut pid = pid(GAINS);
    let mut error = 0.02;
    pid.start(&JointPos([error]), &JointPos([0.007])).unwrap();
    near(step(&mut pid, error, 1e-9), 0.007, 1e-9);
    for k in 0..50 {
        error = 0.02 * f64::cos(0.3 * f64::from(k));
        step(&mut pid, error, 0.002);
    }
    let before = pid.joints[0].wanted;
    let other = Gains { proportional: 2.0, integral: 30.0, derivative: 0.5, filter_time: 0.02, tracking_time: 0.3 };
    pid.set_gains(&[other]).unwrap();
    near(step(&mut pid, error, 1e-9), before, 1e-6);
    assert_eq!(pid.gains(), &[other]);
}

/// The controller that [`Gains::for_drive`] makes times the drive is ω/(s·(1 + T_f·s)), and keeps the margins it names.
#[test]
fn the_zeros_lie_on_the_poles_of_the_drive() {
    for (lag, gain, filter) in [(0.1, 300.0, 0.01), (0.03, 2000.0, 0.005), (0.08, 900.0, 0.02)] {
        let crossover = 12.0;
        let gains = Gains::for_drive(&Drive { lag, inverse_gain: 1.0 / gain }, crossover, filter);
        assert!(gains.is_valid(), "{gains:?}");
        for k in 0..200 {
            let s = Complex::new(0.0, 0.1 * 1.05_f64.powi(k));
            let Gains { proportional, integral, derivative, filter_time, .. } = gains;
            let controller = s * derivative / (s * filter_time + 1.0) + Complex::new(integral, 0.0) / s + proportional;
            let drive = Complex::new(gain, 0.0) / (s * s + s * (gain * lag) + gain);
            let expected = Complex::new(crossover, 0.0) / (s * (s * filter + 1.0));
            assert!((controller * drive / expected - 1.0).norm_sqr() < 1e-24);
        }
    }
}

#[test]
fn what_is_no_number_and_no_time_is_refused_and_changes_nothing() {
    let mut pid = pid(GAINS);
    step(&mut pid, 0.1, 0.002);
    let before = pid;
    assert_eq!(pid.step(&JointPos([f64::NAN]), 0.002, true), Err(PidError::NotFinite));
    for dt in [0.0, -0.002, 1.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(pid.step(&JointPos([0.1]), dt, true), Err(PidError::Step { .. })), "{dt}");
    }
    assert_eq!(pid.put_out(&JointPos([f64::INFINITY])), Err(PidError::NotFinite));
    assert_eq!(pid.start(&JointPos([f64::NAN]), &JointPos([0.0])), Err(PidError::NotFinite));
    for gains in [
        Gains { proportional: -1.0, ..GAINS },
        Gains { integral: f64::NAN, ..GAINS },
        Gains { filter_time: 0.0, ..GAINS },
        Gains { tracking_time: f64::INFINITY, ..GAINS },
    ] {
        assert_eq!(pid.set_gains(&[gains]), Err(PidError::Gains));
        assert_eq!(Pid::new(&[gains]), Err(PidError::Gains));
    }
    assert_eq!(pid, before);
}

#[test]
fn each_process_has_its_own() {
    let sets = ByProcess { deposit: 1, travel: 2, mill: 3 };
    assert_eq!([Process::Deposit, Process::Travel, Process::Mill].map(|process| *sets.of(process)), [1, 2, 3]);
}
