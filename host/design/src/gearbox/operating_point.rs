//! Linearises the filter model in a drivetrain's image at one carrier angle under nominal loads:
//! gives transition F, observation H, process noise Q and measurement noise R. `loadtwin tune`
//! computes frequency responses and load noise from them.

use faer::Mat;
use loadtwin_common::drivetrain::{GearboxModel, LOADS, Role};
use loadtwin_common::signal::phase::Phase;

use crate::gearbox::torsional_model::Torsion;
use loadtwin_machine::Drivetrain;

/// `x+ = F x + w`, `y = H x + v` at one carrier angle under nominal loads, in the
/// units of the model image; its last states are the loads.
///
/// Source: Bosmans et al. 2023, eq. (4), (8).
#[derive(Clone, Debug)]
pub struct OperatingPoint {
    /// F, n x n.
    pub transition: Mat<f64>,
    /// H, m x n: channels that measure, then encoders.
    pub observation: Mat<f64>,
    /// Diagonal of R.
    pub measurement_noise: Vec<f64>,
    /// Q without that of the loads, n x n.
    pub process_noise: Mat<f64>,
    /// Number of mechanical states, the first ones.
    pub mechanical: usize,
    /// Number of loads, the last states.
    pub loads: usize,
}

impl OperatingPoint {
    /// The point at carrier angle `angle_rad` of the model in an image. An angle that no sensor measures
    /// is left out: it stays 0.
    pub fn new(model: &GearboxModel<'_>, drivetrain: &Drivetrain, angle_rad: f64) -> Self {
        let top = model.scale.len() - LOADS;
        let (all, loads) = (model.scale.len(), model.loads.len());
        // The second load of a drivetrain with one is a constant 0.
        let n = top + loads;
        let mechanical = 2 * drivetrain.inertias.len();
        let mut transition = Mat::<f64>::identity(n, n);
        let mut process_noise = Mat::<f64>::zeros(n, n);
        let mut triangle = model.process_noise.iter();
        for i in 0..top {
            for j in 0..n {
                transition[(i, j)] = f64::from(model.transition[i * all + j]);
            }
            for j in 0..=i {
                let q = triangle.next().copied().map_or(0.0, f64::from);
                process_noise[(i, j)] = q;
                process_noise[(j, i)] = q;
            }
        }
        let state = nominal_state(model, drivetrain, n);
        let phase = Phase::from_rad(angle_rad as f32);
        let mut rows: Vec<Vec<f64>> = Vec::new();
        let mut measurement_noise = Vec::new();
        for channel in &model.channels {
            let Role::Measure {
                map,
                variance,
                biases,
                ..
            } = &channel.role
            else {
                continue;
            };
            let row: Vec<f64> = channel.row.iter().take(n).copied().map(f64::from).collect();
            let sensed: f64 = row.iter().zip(&state).map(|(c, x)| c * x).sum();
            let (sensitivity, slope) = map.at(phase);
            let mut gradient: Vec<f64> = row.iter().map(|c| c * f64::from(sensitivity)).collect();
            gradient[0] += sensed * f64::from(slope);
            for bias in biases {
                gradient[usize::from(bias.state)] += f64::from(bias.factor);
            }
            rows.push(gradient);
            measurement_noise.push(f64::from(variance.bin(phase)));
        }
        for encoder in &model.encoders {
            rows.push(encoder.row.iter().take(n).copied().map(f64::from).collect());
            measurement_noise.push(f64::from(encoder.variance));
        }
        if rows.iter().all(|row| row[0] == 0.0) {
            // Without a steady covariance: nothing measures the angle, and nothing depends on it.
            for j in 0..n {
                transition[(0, j)] = 0.0;
                process_noise[(0, j)] = 0.0;
                process_noise[(j, 0)] = 0.0;
            }
        }
        Self {
            observation: Mat::from_fn(rows.len(), n, |i, j| rows[i][j]),
            transition,
            measurement_noise,
            process_noise,
            mechanical,
            loads,
        }
    }

    /// Q with the variance of each load's step in one sample, in nominal loads squared.
    pub fn with_load_noise(&self, load_noise: &[f64]) -> Mat<f64> {
        let mut q = self.process_noise.clone();
        let first = q.nrows() - self.loads;
        for (j, variance) in load_noise.iter().enumerate().take(self.loads) {
            q[(first + j, first + j)] = *variance;
        }
        q
    }
}

/// Nominal loads and speeds, and the twists that belong to them.
fn nominal_state(model: &GearboxModel<'_>, drivetrain: &Drivetrain, n: usize) -> Vec<f64> {
    let torsion = Torsion::new(drivetrain);
    let loads: Vec<f64> = drivetrain.loads.iter().map(|l| l.nominal_nm).collect();
    let inertias = drivetrain.inertias.len();
    let mut state = vec![0.0; n];
    for (i, twist) in torsion.rigid_twists(&loads).into_iter().enumerate() {
        state[1 + i] = twist / f64::from(model.scale[1 + i]);
    }
    for i in inertias..2 * inertias {
        state[i] = drivetrain.nominal_speed_rad_s / f64::from(model.scale[i]);
    }
    for (j, load) in loads.iter().enumerate() {
        state[n - loads.len() + j] = load / f64::from(model.scale[n - loads.len() + j]);
    }
    state
}
