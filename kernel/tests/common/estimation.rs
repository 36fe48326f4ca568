//! What the filter has to show, by counts of ticks and seeds: few in a test, many in a campaign.

use super::Random;
use super::dense::{Dense, MatrixX, X, matrix, stack};
use super::plant::{N, Noise, Plant};
use nalgebra::SVector;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::{Ekf, Verdict};

/// Largest differences between the kernel's filter and the dense one, in standard deviations.
#[derive(Debug, Default)]
pub struct Apart {
    /// |Δx|/σ
    pub state: f64,
    /// |ΔP|/(σᵢσⱼ)
    pub covariance: f64,
}

/// Plays every kind of measurement, each missing half of the time, into both filters.
pub fn against_dense(seed: u64, noise: Noise, ticks: usize) -> Apart {
    let mut plant = Plant::new(seed, noise, 1e-3);
    let mut ekf = plant.filter();
    let mut dense = Dense::of(&ekf);
    let mut coin = Random(seed ^ 1);
    let mut apart = Apart::default();
    let mut taken = 0;
    for _ in 0..ticks {
        let jerk = plant.step();
        ekf.predict(plant.dt, &jerk).unwrap();
        dense.predict(plant.dt, &jerk);
        let (pose, rates, encoders) = (plant.pose(), plant.rates(), plant.encoders());
        if coin.below(2) == 0 {
            let verdict = ekf.pose(&UR10E, &pose).unwrap();
            let linear = dense.pose(&pose);
            taken += usize::from(verdict.is_taken());
            same(verdict, || dense.update(&linear));
        }
        if coin.below(2) == 0 {
            let linear = dense.direct(N, &rates.0.0, &rates.1.0);
            same(ekf.rates(&rates.0, &rates.1).unwrap(), || dense.update(&linear));
        }
        if coin.below(2) == 0 {
            let linear = dense.direct(0, &encoders.0.0, &encoders.1.0);
            same(ekf.encoders(&encoders.0, &encoders.1).unwrap(), || dense.update(&linear));
        }
        let sigma = dense.p.diagonal().map(f64::sqrt);
        let scale = MatrixX::from_diagonal(&sigma.map(|sigma| 1.0 / sigma));
        apart.state = apart.state.max((scale * (stack(ekf.state()) - dense.x)).amax());
        apart.covariance = apart.covariance.max((scale * (matrix(&ekf) - dense.p) * scale).amax());
        assert!(apart.state.is_finite() && apart.covariance.is_finite());
    }
    assert!(taken > ticks / 3, "{taken} poses of {ticks} ticks");
    apart
}

/// The other filter follows unless the measurement was gated, and finds the same normalised innovation.
fn same(verdict: Verdict, update: impl FnOnce() -> f64) {
    if let Verdict::Taken { nis } = verdict {
        let other = update();
        assert!((nis - other).abs() <= 1e-5 * (1.0 + nis), "{nis} {other}");
    }
}

/// Sums over seeds and ticks of matched simulations.
#[derive(Debug, Default)]
pub struct Consistency {
    /// Mean normalised estimation error squared of a run, run by run: 18 on average.
    pub nees: Vec<f64>,
    /// Mean normalised innovation squared of poses, run by run: 6 on average.
    pub nis_pose: Vec<f64>,
    /// The same of rates: 6 on average.
    pub nis_rates: Vec<f64>,
    /// Autocorrelation of the white innovations of poses and rates at lags 1 to 10, over all runs.
    pub autocorrelation: [f64; 10],
    /// How many products each of those is a mean of.
    pub products: usize,
    /// Share of the joints' errors inside three standard deviations.
    pub covered: f64,
}

impl Consistency {
    /// Panics where the filter's own statistics do not hold; by so many poses and rates.
    pub fn judge(&self, name: &str, [poses, rates]: [f64; 2]) {
        for (what, runs, freedom, half) in [
            // Errors of neighbouring ticks are not independent: their band comes from the scatter of the runs.
            ("NEES", &self.nees, 18.0, mean(&self.nees).1),
            ("NIS of poses", &self.nis_pose, 6.0, band(6.0, poses)),
            ("NIS of rates", &self.nis_rates, 6.0, band(6.0, rates)),
        ] {
            let mean = mean(runs).0;
            assert!((mean - freedom).abs() <= half, "{name}: {what} {mean} ± {half}");
        }
        let bound = 1.96 / (self.products as f64).sqrt();
        let outside = self.autocorrelation.iter().filter(|value| value.abs() > bound).count();
        // One of ten lags may lie outside of 95 %.
        assert!(outside <= 1, "{name}: {:?}, bound {bound}", self.autocorrelation);
        assert!(self.covered >= 0.99, "{name}: {}", self.covered);
    }
}

/// Matched simulations; poses are missing half of the time. The filter is looked at every `every` ticks.
pub fn consistency(seeds: std::ops::Range<u64>, noise: Noise, ticks: usize, every: usize) -> Consistency {
    let mut result = Consistency::default();
    let (mut inside, mut all) = (0, 0);
    for seed in seeds {
        let mut plant = Plant::new(seed, noise, 8e-3);
        let mut ekf = plant.filter();
        let mut coin = Random(seed ^ 1);
        let (mut nees, mut looks, mut poses, mut rates) = (0.0, 0, (0.0, 0), (0.0, 0));
        let mut whites: [Vec<SVector<f64, N>>; 2] = Default::default();
        for tick in 1..=ticks {
            let jerk = plant.step();
            ekf.predict(plant.dt, &jerk).unwrap();
            if coin.below(2) == 0 {
                let pose = plant.pose();
                let dense = Dense::of(&ekf);
                whites[0].push(dense.white(&dense.pose(&pose)));
                poses = (poses.0 + ekf.pose(&UR10E, &pose).unwrap().nis(), poses.1 + 1);
            }
            let (rate, deviation) = plant.rates();
            let dense = Dense::of(&ekf);
            whites[1].push(dense.white(&dense.direct(N, &rate.0, &deviation.0)));
            rates = (rates.0 + ekf.rates(&rate, &deviation).unwrap().nis(), rates.1 + 1);
            if tick % every == 0 {
                let error = stack(&plant.truth) - stack(ekf.state());
                let p = matrix(&ekf);
                nees += error.dot(&p.cholesky().unwrap().solve(&error));
                looks += 1;
                for i in 0..X {
                    inside += usize::from(error[i].abs() <= 3.0 * p[(i, i)].sqrt());
                    all += 1;
                }
            }
        }
        result.nees.push(nees / f64::from(looks));
        result.nis_pose.push(poses.0 / f64::from(poses.1));
        result.nis_rates.push(rates.0 / f64::from(rates.1));
        for white in whites {
            result.products += white.len() * N;
            for (lag, sum) in result.autocorrelation.iter_mut().enumerate() {
                *sum += white.iter().zip(&white[lag + 1..]).map(|(a, b)| a.dot(b)).sum::<f64>();
            }
        }
    }
    for sum in &mut result.autocorrelation {
        *sum /= result.products as f64;
    }
    result.covered = inside as f64 / all as f64;
    result
}

/// Mean over runs, and half of its 95 % interval from the runs' own scatter.
pub fn mean(runs: &[f64]) -> (f64, f64) {
    let count = runs.len() as f64;
    let mean = runs.iter().sum::<f64>() / count;
    let variance = runs.iter().map(|run| (run - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, 1.96 * (variance / count).sqrt())
}

/// Half of the 95 % band in which the mean of so many independent χ² of `freedom` degrees lies (normal for many).
pub fn band(freedom: f64, count: f64) -> f64 {
    1.96 * (2.0 * freedom / count).sqrt()
}

/// After so many ticks of 1 ms without a pose: share of the errors inside three standard deviations, over seeds. Then poses come
/// back, and have to be believed.
pub fn dropout(seeds: std::ops::Range<u64>, noise: Noise, ticks: usize) -> f64 {
    let (mut inside, mut all) = (0, 0);
    for seed in seeds {
        let mut plant = Plant::new(seed, noise, 1e-3);
        let mut ekf = plant.filter();
        let mut look = |plant: &Plant, ekf: &Ekf<N>| {
            let (error, p) = (stack(&plant.truth) - stack(ekf.state()), matrix(ekf));
            inside += (0..X).filter(|&i| error[i].abs() <= 3.0 * p[(i, i)].sqrt()).count();
            all += X;
        };
        let mut believed = 0;
        for tick in 0..600 + ticks {
            let jerk = plant.step();
            ekf.predict(plant.dt, &jerk).unwrap();
            let (rates, deviation) = plant.rates();
            ekf.rates(&rates, &deviation).unwrap();
            if !(300..300 + ticks).contains(&tick) {
                let pose = plant.pose();
                believed += usize::from(ekf.pose(&UR10E, &pose).unwrap().is_taken());
            }
            if tick + 1 == 300 + ticks || tick + 1 == 600 + ticks {
                look(&plant, &ekf);
            }
        }
        assert!(believed >= 590, "seed {seed}: {believed} of 600 poses believed, {ticks} ticks without");
    }
    inside as f64 / all as f64
}

/// Smallest eigenvalue of P, and of P scaled to a unit diagonal, and the largest |error|/σ seen, over so many ticks with half
/// of the poses missing.
#[derive(Debug)]
pub struct Long {
    pub eigenvalue_min: f64,
    pub scaled_min: f64,
    pub error_max: f64,
}

pub fn long(seed: u64, noise: Noise, ticks: u64, every: u64) -> Long {
    let mut plant = Plant::new(seed, noise, 1e-3);
    let mut ekf = plant.filter();
    let mut result = Long { eigenvalue_min: f64::INFINITY, scaled_min: f64::INFINITY, error_max: 0.0 };
    for tick in 1..=ticks {
        let jerk = plant.step();
        ekf.predict(plant.dt, &jerk).unwrap();
        let (rates, deviation) = plant.rates();
        if plant.random.below(2) == 0 {
            let pose = plant.pose();
            ekf.pose(&UR10E, &pose).unwrap();
        }
        ekf.rates(&rates, &deviation).unwrap();
        if tick % every == 0 {
            let p = matrix(&ekf);
            let sigma: SVector<f64, X> = p.diagonal().map(f64::sqrt);
            let scale = MatrixX::from_diagonal(&sigma.map(|sigma| 1.0 / sigma));
            result.eigenvalue_min = result.eigenvalue_min.min(p.symmetric_eigenvalues().min());
            result.scaled_min = result.scaled_min.min((scale * p * scale).symmetric_eigenvalues().min());
            let error = scale * (stack(&plant.truth) - stack(ekf.state()));
            result.error_max = result.error_max.max(error.amax());
            assert!(result.eigenvalue_min > 0.0 && error.amax() < 10.0, "tick {tick}: {result:?}");
        }
    }
    result
}
