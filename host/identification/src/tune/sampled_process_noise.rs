//! Computes the process noise of a drivetrain as the sample covariance of its process error over
//! random draws of its parameters (Monte Carlo).

use faer::Mat;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;

use loadtwin_design::gearbox::{Torsion, operating_points};
use loadtwin_machine::Drivetrain;

/// Q over one step of `dt_s` as the sample covariance of the process error,
/// for the mechanical states in SI units.
///
/// `Q = 1/n sum_points 1/samples sum w w'`, `w = (F(p) - F(p_nominal)) x`, every
/// inertia, drag, stiffness and damping drawn from a normal distribution with
/// standard deviation `relative_std` of its value, independently.
///
/// Source: Bosmans et al. 2023, section 5.3.2.
pub fn sampled_process_noise(
    drivetrain: &Drivetrain,
    dt_s: f64,
    relative_std: f64,
    samples: usize,
    seed: u64,
) -> Mat<f64> {
    let nominal = Torsion::new(drivetrain);
    let (f, points) = (
        nominal.discretised(dt_s),
        operating_points(drivetrain, &nominal),
    );
    let states = nominal.states();
    let sum = (0..samples)
        .into_par_iter()
        .map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(draw as u64);
            let moved = Torsion::new(&drawn(drivetrain, relative_std, &mut rng)).discretised(dt_s);
            let mut q = Mat::<f64>::zeros(states, states);
            for point in &points {
                let error: Vec<f64> = (0..states)
                    .map(|i| {
                        point
                            .iter()
                            .enumerate()
                            .map(|(j, x)| (moved[(i, j)] - f[(i, j)]) * x)
                            .sum()
                    })
                    .collect();
                for i in 0..states {
                    for j in 0..states {
                        q[(i, j)] += error[i] * error[j] / points.len() as f64;
                    }
                }
            }
            q
        })
        .reduce(|| Mat::zeros(states, states), |a, b| a + b);
    Mat::from_fn(states, states, |i, j| sum[(i, j)] / samples as f64)
}

/// The drivetrain with every parameter drawn; none loses its sign.
fn drawn(drivetrain: &Drivetrain, relative_std: f64, rng: &mut ChaCha8Rng) -> Drivetrain {
    let mut drawn = drivetrain.clone();
    let Ok(normal) = Normal::new(1.0, relative_std) else {
        return drawn;
    };
    let mut factor = || normal.sample(rng).max(0.05);
    for inertia in &mut drawn.inertias {
        inertia.moment_kg_m2 *= factor();
        inertia.drag_nm_s_per_rad *= factor();
    }
    for shaft in &mut drawn.shafts {
        shaft.stiffness_nm_per_rad *= factor();
        shaft.damping_nm_s_per_rad *= factor();
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_design::gearbox::process_noise;
    use loadtwin_machine::Machine;
    use std::path::Path;

    #[test]
    fn a_small_spread_gives_the_first_order_value() {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/gearbox/machine.toml"
        );
        let machine = Machine::load(Path::new(path)).unwrap();
        let drivetrain = machine.drivetrain.unwrap();
        for (spread, tolerance) in [(0.01, 0.05), (0.1, 0.1)] {
            let drawn = sampled_process_noise(&drivetrain, 2e-3, spread, 4000, 3);
            let first = process_noise(&drivetrain, 2e-3, spread, &[0.0; 4]);
            for i in 0..4 {
                let ratio = (drawn[(i, i)] / first[(i, i)]).sqrt();
                assert!(
                    (ratio - 1.0).abs() < tolerance,
                    "state {i} at {spread}: {ratio}"
                );
            }
            // The shaft's stiffness moves both speeds apart.
            let correlation = |q: &Mat<f64>| q[(2, 3)] / (q[(2, 2)] * q[(3, 3)]).sqrt();
            assert!((correlation(&drawn) - correlation(&first)).abs() < 0.1);
        }
    }
}
