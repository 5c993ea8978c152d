//! Defines null samples, the residuals of the same machine and profile without any effect, and
//! composes one from simulations: each block from one of them at random.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::residual_model::ResidualModel;

/// Residuals without effect: `[null_sample][recording][signal]`, samples as in the recording.
pub type NullSamples = Vec<Vec<Vec<Vec<f64>>>>;

/// A null sample of `recording`: each block from one of the simulations at random,
/// `fault_free[simulation][signal]`, plus the residual of the fault-free machine as described.
pub(crate) fn resample_blocks<S: ResidualModel>(
    recording: &S,
    fault_free: &[Vec<Vec<f64>>],
    rng: &mut ChaCha8Rng,
) -> Vec<Vec<f64>> {
    let (n, block) = (recording.speed().len(), recording.block());
    let choice: Vec<usize> = (0..n.div_ceil(block))
        .map(|_| rng.random_range(0..fault_free.len()))
        .collect();
    (0..recording.residuals().len())
        .map(|k| {
            let known = recording.fault_free(k);
            (0..n)
                .map(|i| {
                    let resample_blocks = fault_free[choice[i / block]]
                        .get(k)
                        .and_then(|r| r.get(i).copied());
                    resample_blocks.map_or(f64::NAN, |r| r + known.get(i).copied().unwrap_or(0.0))
                })
                .collect()
        })
        .collect()
}
