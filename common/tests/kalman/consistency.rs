//! Consistency of the linear, extended and unscented filter: mean NEES and NIS of fixed-seed
//! Monte Carlo runs inside two-sided 99.9 % chi-squared bounds.
//!
//! NEES: one value from the end of each run, so that the values are
//! independent. NIS: all samples of all runs; innovations of a consistent
//! filter are white.

use crate::model::{Pendulum, shaft, three_channels};
use loadtwin_common::kalman::gaussian::Gaussian;
use loadtwin_common::kalman::innovation::{Gate, Innovation};
use loadtwin_common::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use loadtwin_common::kalman::unscented::Unscented;
use loadtwin_common::kalman::{NonlinearTransition, predict, predict_extended, update, update_all};
use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, Vector2, Vector3, Vector4};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use statrs::distribution::{ChiSquared, ContinuousCDF};

const RUNS: usize = 300;
const STEPS: usize = 200;

/// Sums over all runs.
#[derive(Default)]
struct Tally {
    nees: f64,
    nees_freedom: f64,
    nis: f64,
    nis_freedom: f64,
}

impl Tally {
    fn innovation(&mut self, innovation: &Innovation) {
        assert!(innovation.used());
        self.nis += f64::from(innovation.nis);
        self.nis_freedom += 1.0;
    }

    fn end<const NX: usize>(&mut self, posterior: &Gaussian<NX>, truth: &SVector<f64, NX>) {
        let p: SMatrix<f64, NX, NX> = posterior.covariance().cast();
        let error = posterior.state.cast::<f64>() - truth;
        self.nees += error.dot(&p.cholesky().unwrap().solve(&error));
        self.nees_freedom += NX as f64;
    }

    fn assert_consistent(&self) {
        for (name, sum, freedom) in [
            ("NEES", self.nees, self.nees_freedom),
            ("NIS", self.nis, self.nis_freedom),
        ] {
            let chi_squared = ChiSquared::new(freedom).unwrap();
            let (low, high) = (
                chi_squared.inverse_cdf(5e-4),
                chi_squared.inverse_cdf(1.0 - 5e-4),
            );
            assert!(
                (low..=high).contains(&sum),
                "mean {name} {:.3}, allowed {:.3} to {:.3}",
                sum / freedom,
                low / freedom,
                high / freedom
            );
        }
    }
}

fn normal<const N: usize>(rng: &mut ChaCha8Rng, root: &SMatrix<f64, N, N>) -> SVector<f64, N> {
    root * SVector::<f64, N>::from_fn(|_, _| StandardNormal.sample(rng))
}

#[test]
fn linear_filter_is_consistent() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (f, q) = (shaft::transition(), shaft::process_noise());
    let transition = Transition::<4, 1>::try_new(&f, RandomWalk).unwrap();
    let noise = ProcessNoise::try_new(&q).unwrap();
    let (h, r) = (shaft::observation(), shaft::measurement_noise());
    let q_root = q.cast::<f64>().cholesky().unwrap().l();
    let r_root = SMatrix::from_diagonal(&r.cast::<f64>().map(f64::sqrt));
    let p0 = Vector4::new(0.1, 1.0, 1.0, 100.0);
    let p0_root = Matrix4::from_diagonal(&p0.cast::<f64>().map(f64::sqrt));
    let mut tally = Tally::default();
    for _ in 0..RUNS {
        let mut truth = normal(&mut rng, &p0_root);
        let mut posterior = Gaussian::independent(SVector::zeros(), &p0).unwrap();
        for _ in 0..STEPS {
            truth = f.cast() * truth + normal(&mut rng, &q_root);
            let y: Vector2<f64> = h.cast() * truth + normal(&mut rng, &r_root);
            predict(&mut posterior, &transition, &noise);
            for i in 0..2 {
                let nu = y[i] as f32 - (h.row(i) * posterior.state)[0];
                let h_i = h.row(i).into();
                tally.innovation(&update(&mut posterior, &h_i, nu, r[i], &mut Gate::open()));
            }
        }
        tally.end(&posterior, &truth);
    }
    tally.assert_consistent();
}

/// The pendulum, drawn from the filter's own prior and noise.
fn pendulum_runs<const NY: usize>(
    seed: u64,
    r: SVector<f64, NY>,
    mut step: impl FnMut(&mut Gaussian<3>, &ProcessNoise<3>, SVector<f32, NY>, &mut Tally),
    observe: impl Fn(&Vector3<f32>) -> SVector<f32, NY>,
) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (q, p0) = (
        Vector3::new(1e-6, 1e-4, 0.01),
        Vector3::new(0.01, 0.04, 0.25),
    );
    let noise = ProcessNoise::independent(&q).unwrap();
    let root = |v: Vector3<f32>| Matrix3::from_diagonal(&v.cast::<f64>().map(f64::sqrt));
    let r_root = SMatrix::from_diagonal(&r.map(f64::sqrt));
    let mut tally = Tally::default();
    for _ in 0..RUNS {
        let mut truth = normal(&mut rng, &root(p0));
        let mut posterior = Gaussian::independent(Vector3::zeros(), &p0).unwrap();
        for _ in 0..STEPS {
            truth = Pendulum.propagate(&truth.cast()).cast() + normal(&mut rng, &root(q));
            let y = observe(&truth.cast()).cast::<f64>() + normal(&mut rng, &r_root);
            step(&mut posterior, &noise, y.cast(), &mut tally);
        }
        tally.end(&posterior, &truth);
    }
    tally.assert_consistent();
}

#[test]
fn extended_filter_is_consistent() {
    let mut gates = [Gate::open(); 2];
    let r = Vector2::new(1e-3, 4e-3);
    pendulum_runs(
        2,
        r.cast(),
        |posterior, noise, y, tally| {
            predict_extended(posterior, &Pendulum, noise).unwrap();
            for innovation in update_all(posterior, &Pendulum, &y, &r, &mut gates) {
                tally.innovation(&innovation);
            }
        },
        |x| Vector2::new(Pendulum.observe(0, x), Pendulum.observe(1, x)),
    );
}

#[test]
fn unscented_filter_is_consistent() {
    let mut gates = [Gate::open(); 3];
    let unscented = Unscented::default();
    let r = Vector3::new(1e-3, 4e-3, 0.1);
    pendulum_runs(
        3,
        r.cast(),
        |posterior, noise, y, tally| {
            unscented
                .predict(posterior, |x| Pendulum.propagate(x), noise)
                .unwrap();
            for innovation in unscented
                .update(posterior, three_channels, &y, &r, &mut gates)
                .unwrap()
            {
                tally.innovation(&innovation);
            }
        },
        three_channels,
    );
}
