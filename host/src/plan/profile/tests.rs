//! Profiles against numerical integration, against the paper's figures, and against their limits at seeded random.

use super::*;

const DEMO: PathLimits = PathLimits { velocity_max: 0.25, acceleration_max: 0.25, jerk_max: 10.0 };

/// splitmix64: the same numbers on every machine.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * (((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64)
    }
}

fn straight(length: f64) -> Stretch {
    Stretch { length, curvature_max: 0.0, rest_after: true }
}

/// Steps through `duration` and asserts that s is the integral of v, v that of a, and that |da/dt| ≤ jerk_max.
fn assert_consistent(duration: f64, jerk_max: f64, state_at: impl Fn(f64) -> State) {
    let n = 20_000;
    let h = duration / f64::from(n);
    for i in 0..n {
        let t = h * f64::from(i);
        let (a, m, b) = (state_at(t), state_at(t + 0.5 * h), state_at(t + h));
        let simpson = |x: f64, y: f64, z: f64| (x + 4.0 * y + z) * h / 6.0;
        let slack = 0.2 * jerk_max * h * h;
        assert!((b.s - a.s - simpson(a.velocity, m.velocity, b.velocity)).abs() < slack * h + 1e-15, "s at {t}");
        let gained = simpson(a.acceleration, m.acceleration, b.acceleration);
        assert!((b.velocity - a.velocity - gained).abs() < slack + 1e-15, "v at {t}");
        let jerk = (b.acceleration - a.acceleration).abs() / h;
        assert!(jerk <= jerk_max * 1.000_001 + 1e-9, "jerk {jerk} at {t}");
    }
}

#[test]
fn a_ramp_is_the_integral_of_its_acceleration_and_starts_and_ends_without() {
    let mut random = Random(11);
    for case in 0..40 {
        let softness = [1.0, 0.0, random.between(0.0, 1.0)][case % 3];
        let slow = random.between(0.0, 0.1);
        let fast = slow + random.between(1e-6, 0.3);
        let (acceleration_max, jerk_max) = (random.between(0.05, 2.0), random.between(1.0, 20.0));
        let ramp = Ramp::new(slow, fast, acceleration_max, jerk_max, softness);
        assert_consistent(ramp.duration(), jerk_max, |t| ramp.state_at(t));
        let (first, last) = (ramp.state_at(0.0), ramp.state_at(ramp.duration()));
        assert_eq!((first.s, first.velocity, first.acceleration), (0.0, slow, 0.0));
        assert!((last.s - ramp.distance()).abs() < 1e-15 && (last.velocity - fast).abs() < 1e-15);
        assert!(last.acceleration.abs() < 1e-12);
        let peak = (0..=1000).map(|i| ramp.state_at(ramp.duration() * f64::from(i) / 1000.0).acceleration);
        assert!(peak.fold(0.0, f64::max) <= acceleration_max * (1.0 + 1e-12));
    }
}

#[test]
fn with_unlimited_jerk_the_profile_is_the_published_one() {
    // facts of the first published system: L = 4.015 m, T = 70 s, a = 0.25 m/s² give V = 57.62 mm/s, τ = 0.230 s.
    let limits = PathLimits { jerk_max: 1e6, ..DEMO };
    let profile = Profile::lasting(&[straight(4.015)], &limits, 70.0).unwrap();
    assert!((profile.pace().cruise - 0.05762).abs() < 5e-6, "{}", profile.pace().cruise);
    let tau = profile.pace().cruise / 0.25;
    assert!((tau - 0.230).abs() < 1e-3);
    for t in [0.1, 0.3, 0.5] {
        let published = profile.pace().cruise * (t / tau).tanh();
        assert!((profile.state_at(t).velocity - published).abs() < 1e-6, "at {t}");
        assert!((profile.state_at(70.0 - t).velocity - published).abs() < 1e-6, "before the end at {t}");
    }
}

#[test]
fn a_brake_ends_at_rest_by_the_shortest_way() {
    let mut random = Random(12);
    for _ in 0..30 {
        let (velocity, jerk_max) = (random.between(0.0, 0.3), random.between(1.0, 20.0));
        let deceleration_max = random.between(0.1, 1.0);
        let acceleration = random.between(-0.1, 0.3);
        let Some(brake) = Brake::new(velocity, acceleration, deceleration_max, jerk_max) else {
            assert!(acceleration < 0.0 && velocity < acceleration * acceleration / (2.0 * jerk_max));
            continue;
        };
        assert_consistent(brake.duration() * (1.0 - 1e-12), jerk_max, |t| brake.state_at(t));
        let last = brake.state_at(brake.duration() * (1.0 - 1e-12));
        assert!(last.velocity.abs() < 1e-9 && last.acceleration.abs() < 1e-9, "{last:?}");
        for i in 0..=1000 {
            let state = brake.state_at(brake.duration() * f64::from(i) / 1000.0);
            assert!(state.acceleration >= -deceleration_max * (1.0 + 1e-12) && state.velocity >= -1e-12);
        }
    }
    // 0.2 m/s at 0.5 m/s² and 10 m/s³: 0.4 s of hold-equivalent and 0.05 s of easing; 0.2·0.45/2 m by symmetry.
    let brake = Brake::new(0.2, 0.0, 0.5, 10.0).unwrap();
    assert!((brake.duration() - 0.45).abs() < 1e-15);
    assert!((brake.state_at(1.0).s - 0.045).abs() < 1e-15);
}

/// Stretches of a random path: lines and curves, some joined smoothly, some not, some very short.
fn random_stretches(random: &mut Random) -> Vec<Stretch> {
    let count = random.between(1.0, 12.0) as usize;
    let stretch = |_| Stretch {
        length: libm::pow(10.0, random.between(-4.0, 0.5)),
        curvature_max: if random.between(0.0, 1.0) < 0.5 { 0.0 } else { random.between(0.5, 60.0) },
        rest_after: random.between(0.0, 1.0) < 0.4,
    };
    (0..count).map(stretch).collect()
}

/// Asserts the limits, continuity and every rest at dense samples.
fn assert_within(profile: &Profile, stretches: &[Stretch], limits: &PathLimits) {
    let total: f64 = stretches.iter().map(|stretch| stretch.length).sum();
    let end = profile.state_at(profile.duration());
    assert!((end.s - total).abs() < 1e-12 * (1.0 + total) && end.velocity == 0.0, "{end:?}");
    let n = 30_000;
    let h = profile.duration() / f64::from(n);
    let (mut before, mut index, mut stretch_end) = (profile.state_at(0.0), 0, stretches[0].length);
    for i in 1..=n {
        let state = profile.state_at(h * f64::from(i));
        assert!(state.velocity >= -1e-12 && state.velocity <= limits.velocity_max * (1.0 + 1e-12), "{state:?}");
        let step = state.s - before.s - 0.5 * (state.velocity + before.velocity) * h;
        assert!(step.abs() < 0.2 * limits.jerk_max * h * h * h + 1e-14, "s steps by {step} at {state:?}");
        let jerk = (state.acceleration - before.acceleration) / h;
        assert!(jerk.abs() <= limits.jerk_max * 1.001 + 1e-12 / h, "jerk {jerk} at {state:?}");
        if state.s > stretch_end {
            if stretches[index].rest_after {
                // Left the rest at most two steps ago (the first may be below rounding): no more speed than the jerk gives.
                assert!(state.velocity <= 2.0 * limits.jerk_max * h * h * 1.01, "no rest at {stretch_end}: {state:?}");
            }
            while state.s > stretch_end && index + 1 < stretches.len() {
                index += 1;
                stretch_end += stretches[index].length;
            }
        }
        let turning = state.velocity * state.velocity * stretches[index].curvature_max;
        let whole = libm::hypot(turning, state.acceleration);
        assert!(whole <= limits.acceleration_max * 1.000_1, "acceleration {whole} at {state:?}");
        before = state;
    }
}

#[test]
fn random_profiles_keep_every_limit_and_meet_their_time() {
    let mut random = Random(13);
    for case in 0..200 {
        let stretches = random_stretches(&mut random);
        let limits = PathLimits { jerk_max: random.between(2.0, 20.0), ..DEMO };
        let quickest = Profile::quickest(&stretches, &limits);
        assert_within(&quickest, &stretches, &limits);
        let wanted = quickest.duration() * random.between(1.0 + 1e-9, 4.0);
        let lasting = Profile::lasting(&stretches, &limits, wanted).unwrap();
        assert!((lasting.duration() - wanted).abs() < 1e-9, "case {case}: {} for {wanted}", lasting.duration());
        assert_within(&lasting, &stretches, &limits);
        let refused = Profile::lasting(&stretches, &limits, quickest.duration() * 0.999).unwrap_err();
        assert!((refused.shortest - quickest.duration()).abs() < 1e-9, "case {case}");
    }
}

#[test]
fn rests_are_found_and_the_state_before_and_after_is_at_rest() {
    let stretches = [straight(0.1), Stretch { rest_after: false, ..straight(0.2) }, straight(0.1)];
    let profile = Profile::lasting(&stretches, &DEMO, 10.0).unwrap();
    assert_eq!(profile.rest_count(), 2);
    let [time, s] = profile.next_rest(0.5);
    assert!((s - 0.1).abs() < 1e-15 && profile.state_at(time).velocity < 1e-12);
    let [end, s] = profile.next_rest(time + 1e-6);
    assert!((end - 10.0).abs() < 1e-9 && (s - 0.4).abs() < 1e-15);
    assert!(profile.comes_to_rest(end - 0.1) && !profile.comes_to_rest(time + 0.1));
    assert_eq!(profile.state_at(-1.0), State { s: 0.0, velocity: 0.0, acceleration: 0.0 });
    let after = profile.state_at(11.0);
    assert_eq!((after.velocity, after.acceleration), (0.0, 0.0));
    assert!((after.s - 0.4).abs() < 1e-15);
}

#[test]
fn the_last_value_within_is_found_whatever_the_shape() {
    let steep = last_within(0.0, 1.0, 0.0, |x| x.powi(30) - 1e-9);
    assert!((steep - 1e-9f64.powf(1.0 / 30.0)).abs() < 1e-13);
    // From above down to where it is infinite, and a jump.
    assert!((last_within(8.0, 0.0, 1e-15, |x| 1.0 / x - 4.0) - 0.25).abs() < 1e-15);
    let jump = last_within(0.0, 1.0, 0.0, |x| if x <= 0.3 { -1.0 } else { 5.0 });
    assert!(jump <= 0.3 && jump > 0.3 - 1e-15);
}
