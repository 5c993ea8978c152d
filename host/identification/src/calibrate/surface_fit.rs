//! Fits the surface of a gauge, its reading over torque and carrier angle: linear in the torque,
//! piecewise linear in the angle with a number of nodes by the Bayesian information criterion.
//! Gives its sensitivity over the angle, offset, RMSE and adjusted R^2.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::calibrate::channel_moments::{BINS, Moments, Sums};

/// Nodes over the turn that are tried.
const LEVELS: [usize; 8] = [1, 8, 16, 32, 64, 128, 256, 512];

/// Samples that each interval between nodes must have.
const SAMPLES_PER_NODE: f64 = 4.0;

/// `y(T, theta) = f_T T f_theta(theta) + d`, `max |f_theta| = 1` and there positive.
///
/// `f_theta` is continuous and linear between nodes in equal steps, as many as
/// the Bayesian information criterion prefers; fitted by linear least squares.
///
/// Source: Bosmans et al. 2023, eq. (1).
#[derive(Clone, Debug)]
pub struct Surface {
    /// `f_T f_theta` at the nodes [reading per unit sensed].
    pub map: Vec<f64>,
    /// `d` (reading).
    pub offset: f64,
    /// Root mean square of the residuals, `sqrt(SSR / (n - p))` (reading).
    pub rmse: f64,
    /// `1 - (SSR / (n - p)) / (SST / (n - 1))`.
    pub adjusted_r2: f64,
}

impl Surface {
    /// Fits the surface; none where the samples do not determine it.
    pub fn fit(moments: &Moments, angular: bool) -> Option<Self> {
        let total = moments.total();
        let spread = total.yy - total.y * total.y / total.n;
        let most = if angular { LEVELS.len() } else { 1 };
        LEVELS[..most]
            .iter()
            .filter_map(|&nodes| {
                let (coefficients, residual) = least_squares(moments, nodes)?;
                let p = (nodes + 1) as f64;
                let criterion = total.n * (residual / total.n).ln() + p * total.n.ln();
                Some((criterion, coefficients, residual, p))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, mut coefficients, residual, p)| {
                let offset = coefficients.pop().unwrap_or(0.0) + moments.origin();
                let variance = residual / (total.n - p);
                Self {
                    map: coefficients,
                    offset,
                    rmse: variance.sqrt(),
                    adjusted_r2: 1.0 - variance / (spread / (total.n - 1.0)),
                }
            })
    }

    /// `f_T`, signed [reading per unit sensed].
    pub fn sensitivity(&self) -> f64 {
        self.map.iter().copied().fold(
            0.0,
            |peak: f64, m| if m.abs() > peak.abs() { m } else { peak },
        )
    }
}

/// Coefficients at the nodes and offset, and the sum of squared residuals.
fn least_squares(moments: &Moments, nodes: usize) -> Option<(Vec<f64>, f64)> {
    let enough = |bin: &Sums| bin.n >= SAMPLES_PER_NODE && bin.ss > 0.0;
    if !moments.coarse(nodes).iter().all(enough) {
        return None;
    }
    let size = nodes + 1;
    let mut normal = Mat::<f64>::zeros(size, size);
    let mut right = Mat::<f64>::zeros(size, 1);
    for (k, bin) in moments.bins().iter().enumerate() {
        let position = (k as f64 + 0.5) * nodes as f64 / BINS as f64;
        let (left, u) = (position as usize % nodes, position.fract());
        let weights = [(left, 1.0 - u), ((left + 1) % nodes, u)];
        for (i, wi) in weights {
            for (j, wj) in weights {
                normal[(i, j)] += wi * wj * bin.ss;
            }
            normal[(i, nodes)] += wi * bin.s;
            normal[(nodes, i)] += wi * bin.s;
            right[(i, 0)] += wi * bin.sy;
        }
        normal[(nodes, nodes)] += bin.n;
        right[(nodes, 0)] += bin.y;
    }
    // Columns are scaled to the same size.
    let scale: Vec<f64> = (0..size).map(|i| normal[(i, i)].sqrt()).collect();
    let scaled = Mat::from_fn(size, size, |i, j| normal[(i, j)] / (scale[i] * scale[j]));
    let rhs = Mat::from_fn(size, 1, |i, _| right[(i, 0)] / scale[i]);
    let solution = scaled.llt(Side::Lower).ok()?.solve(&rhs);
    let coefficients: Vec<f64> = (0..size).map(|i| solution[(i, 0)] / scale[i]).collect();
    let explained: f64 = (0..size).map(|i| coefficients[i] * right[(i, 0)]).sum();
    let residual = (moments.total().yy - explained).max(f64::MIN_POSITIVE);
    Some((coefficients, residual))
}
