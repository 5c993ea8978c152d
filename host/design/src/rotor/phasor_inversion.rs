//! Estimates the forces on a rotor without a filter, as a baseline: least-squares forces (N) from
//! the once-per-revolution (1x) phasors of the displacement sensors (m) at one speed.

use faer::linalg::solvers::SolveLstsq;
use faer::{Mat, c64};

use crate::rotor::fe_model::RotorModel;
use crate::rotor::harmonic_response::forced_response;
use loadtwin_machine::{Channel, Rotor, Senses};

/// The 1x phasor inversion: `F = argmin |H(speed) F - Y|`, with `Y` the amplitudes of
/// the sensors once a turn and `H` their response to forces that turn with the shaft.
///
/// Knows nothing of start-ups, of other frequencies and of noise.
pub struct PhasorInversion {
    model: RotorModel,
    rows: Vec<Vec<f64>>,
    nodes: Vec<usize>,
}

impl PhasorInversion {
    /// For displacement sensors `channels` and the loads of `rotor`.
    pub fn new(rotor: &Rotor, channels: &[Channel]) -> Self {
        let model = RotorModel::new(rotor);
        let row = |channel: &Channel| match &channel.senses {
            Senses::Displacement(at) => {
                let sensitivity = channel.sensitivity.unwrap_or(1.0);
                (model
                    .direction(at.node, at.direction_deg.to_radians())
                    .iter())
                .map(|part| sensitivity * part)
                .collect()
            }
            _ => vec![0.0; model.len()],
        };
        Self {
            rows: channels.iter().map(row).collect(),
            nodes: rotor.loads.iter().map(|load| load.node).collect(),
            model,
        }
    }

    /// Amplitude `F` of each load (N): along x `Re(F exp(i angle))`, along y `Im` of it.
    ///
    /// `readings`: amplitude of each sensor (m), `Re(Y exp(i angle))`. None where fewer
    /// sensors than loads are there, or at the critical speed of an undamped rotor.
    pub fn forces(&self, speed_rad_s: f64, readings: &[c64]) -> Option<Vec<c64>> {
        if readings.len() < self.nodes.len() {
            return None;
        }
        let mut response = Mat::<c64>::zeros(readings.len(), self.nodes.len());
        for (j, node) in self.nodes.iter().enumerate() {
            let mut force = Mat::<c64>::zeros(self.model.len(), 1);
            force[(4 * node, 0)] = c64::new(1.0, 0.0);
            force[(4 * node + 1, 0)] = c64::new(0.0, -1.0);
            let q = forced_response(&self.model, speed_rad_s, speed_rad_s, &force).ok()?;
            for (i, row) in self.rows.iter().enumerate() {
                response[(i, j)] = row.iter().zip(&q).map(|(r, q)| *q * *r).sum();
            }
        }
        let right = Mat::from_fn(readings.len(), 1, |i, _| readings[i]);
        let found = response.qr().solve_lstsq(right);
        Some((0..self.nodes.len()).map(|j| found[(j, 0)]).collect())
    }
}
