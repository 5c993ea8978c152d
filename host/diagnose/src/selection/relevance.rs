//! Decides whether an effect is relevant: its largest root mean square over a block in any signal
//! must exceed a part of the reading at nominal load, 0.3 % by default.

use crate::candidate_effect::fitted::FittedEffect;
use crate::regression::design_matrix::columns;
use crate::residual_model::ResidualModel;

/// Part of the nominal load below which a significant effect is negligible, where nothing else is asked for:
/// three times the error of a torque flange of class 0.1.
pub const RELEVANT_PART: f64 = 0.003;

/// Whether an effect is large enough for its kind and changes a load by what matters, or no sensor has a load
/// to be compared with.
pub(crate) fn is_relevant<S: ResidualModel>(
    recordings: &[S],
    found: &FittedEffect<S>,
    relevant_part: f64,
) -> bool {
    let FittedEffect {
        effect,
        shape,
        parameters,
        ..
    } = found;
    effect.is_relevant(&recordings[0], shape, parameters)
        && part_of_nominal(recordings, found).is_none_or(|part| part > relevant_part)
}

/// Size of an effect in the sensor and the block of time in which it is largest: root mean square of what it
/// predicts, over what the signal reads at nominal load.
///
/// `max_k max_block rms(sum_j c_kj x_kj) / full_scale_k`, with the linear parameters `c` (`[signal]`)
/// and the columns `x` of signal `k`; none where no signal has a full scale.
fn part_of_nominal<S: ResidualModel>(recordings: &[S], found: &FittedEffect<S>) -> Option<f64> {
    let columns = columns(recordings, found.effect, &found.shape, &found.parameters);
    let sizes = (found.parameters.iter().enumerate()).filter_map(|(k, own)| {
        let full_scale = recordings[0].full_scale(k)?;
        let predicted: Vec<&[f64]> = columns.iter().map(|c| c[k].as_slice()).collect();
        if own.is_empty() || predicted.iter().any(|c| c.is_empty()) {
            return Some(0.0);
        }
        let size = |i: usize| -> f64 { own.iter().zip(&predicted).map(|(c, x)| c * x[i]).sum() };
        let residuals = recordings.iter().flat_map(|r| r.residual(k));
        let squares: Vec<f64> = (residuals.enumerate())
            .map(|(i, residual)| {
                if residual.is_finite() {
                    size(i).powi(2)
                } else {
                    f64::NAN
                }
            })
            .collect();
        let largest = (squares.chunks(recordings[0].block()))
            .filter_map(|block| {
                let known = block.iter().filter(|square| square.is_finite());
                let count = known.clone().count();
                (2 * count > block.len()).then(|| known.sum::<f64>() / count as f64)
            })
            .fold(0.0, f64::max);
        Some(largest.sqrt() / full_scale)
    });
    sizes.reduce(f64::max)
}
