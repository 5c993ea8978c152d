//! Calibration of a bearing on a rig whose loads are known.
//!
//! The filter itself follows the phases with the loads told; given phases and
//! contacts, the answer of a gauge is linear in its coefficients, so that their fit is
//! one linear least-squares problem. Contact stiffness, preload and compliance follow by Gauss-Newton
//! on what the linear fit leaves.
//!
//! Source: Kerst et al. 2019, section VI-D, in another form.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use loadtwin_common::bearing::block::Block;
use loadtwin_common::bearing::contact::{Contacts, Features};
use loadtwin_common::bearing::{
    BASIS, Bearing as Filter, FEATURES, GAUGES, HARMONICS, LOADS, ROWS,
};
use loadtwin_common::raw::RawSample;
use rayon::prelude::*;

use super::build::model;
use super::calibration::Calibration;
use crate::build::{BuildError, Sensors};
use crate::machine::{Bearing, Machine};

/// Times that phases are followed and gauges fitted in turn.
const PASSES: usize = 4;
/// Powers of the time that take the warming of the bulk strain.
const DRIFT: usize = 4;
const BULK: usize = DRIFT + LOADS + ROWS * FEATURES;
const COEFFICIENTS: usize = BULK + ROWS * HARMONICS * FEATURES * 2;
/// Stretches of the recording between which errors count as independent.
const STRETCHES: usize = 40;
/// Blocks of which one is used to fit the physical parameters.
const THINNED: usize = 4;
/// Least part of the blocks that must have been followed.
const LEAST_FOLLOWED: f64 = 0.5;
/// Errors of the model stay for many blocks, where the filter takes them for new ones
/// in each: how much larger they are told to it.
const TOGETHER: f64 = 6.0;
/// Smallest noise of a gauge that is believed [um/m].
const LEAST_NOISE: f64 = 0.5;
/// Weight of the mean strain: its error from block to block [um/m].
const BULK_ERROR: f64 = 5.0;

/// A sample on the rig: raw words, and `Fx, Fy, Fz` [N], `Mx, Mz` [N m].
pub type RigSample = (RawSample, [f64; LOADS]);

/// A machine on its rig.
#[derive(Clone, Copy, Debug)]
pub struct Rig<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Its bearing.
    pub bearing: &'a Bearing,
    /// Its sensors.
    pub sensors: &'a Sensors,
}

/// A block with its loads [kN] and the phases of both rows at its start.
struct Known {
    block: Block,
    loads: [f32; LOADS],
    phase: [f64; ROWS],
    /// Time as part of the recording, -1 to 1.
    time: f64,
}

/// Fits the answers of the gauges and the bearing's own parameters to `samples`.
///
/// # Errors
/// When the description does not make a model, or the phases cannot be followed.
pub fn calibrate(rig: &Rig<'_>, samples: &[RigSample]) -> Result<Calibration, BuildError> {
    let mut calibration = Calibration::guess(GAUGES);
    expect(samples, &mut calibration);
    let mut known = Vec::new();
    for pass in 0..PASSES {
        known = follow(rig, samples, &calibration, pass == 0)?;
        fit_gauges(rig, &known, &mut calibration)?;
        if pass == 1 {
            refine(rig, &known, &mut calibration)?;
        }
    }
    uncertainty(rig, &known, &mut calibration)?;
    Ok(calibration)
}

/// Mean and covariance of the loads: what is expected of them where readings say little.
fn expect(samples: &[RigSample], calibration: &mut Calibration) {
    let known = || {
        (samples.iter().map(|sample| &sample.1))
            .filter(|loads| loads.iter().all(|load| load.is_finite()))
    };
    let count = known().count().max(1) as f64;
    let mut mean = [0.0; LOADS];
    for loads in known() {
        for (sum, load) in mean.iter_mut().zip(loads) {
            *sum += load / count;
        }
    }
    let mut covariance = [[0.0; LOADS]; LOADS];
    for loads in known() {
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, sum) in row.iter_mut().enumerate() {
                *sum += (loads[i] - mean[i]) * (loads[j] - mean[j]) / count;
            }
        }
    }
    calibration.load_mean = mean;
    calibration.load_covariance = covariance;
}

/// Follows the phases with known loads.
fn follow(
    rig: &Rig<'_>,
    samples: &[RigSample],
    calibration: &Calibration,
    first: bool,
) -> Result<Vec<Known>, BuildError> {
    let mut model = model(rig.machine, rig.bearing, rig.sensors, calibration)?;
    // Bulk strain says nothing about the phase.
    model.tuning.bulk_std = 1e3;
    if first {
        for gauge in &mut model.gauges {
            gauge.model_error = 0.7;
        }
    }
    let radius = f64::from(model.geometry.radius_mm);
    let rate = rig.machine.rate_hz as f32;
    let filter = Filter::try_build(model, rate).map_err(BuildError::Model)?;
    let mut state = filter.start();
    let block = (rate / loadtwin_common::bearing::BLOCK_HZ).round().max(1.0) as usize;
    let mut known = Vec::new();
    let mut mean = [0.0; LOADS];
    for (i, (raw, _)) in samples.iter().enumerate() {
        if i % block == 0 && i >= block {
            // The loads over the block that has just ended.
            mean = [0.0; LOADS];
            for (_, loads) in &samples[i - block..i] {
                for (j, (sum, load)) in mean.iter_mut().zip(loads).enumerate() {
                    let unit = if j < 3 { 1e-3 } else { 1.0 / radius };
                    *sum += load * unit / block as f64;
                }
            }
            state.know(mean.map(|load| load as f32));
        }
        filter.step(&mut state, raw);
        if let Some((taken, belief)) = state.taken_in()
            && state.is_locked()
            && mean.iter().all(|load| load.is_finite())
        {
            let x = &belief.gaussian.state;
            let phase = f64::from(taken.phase);
            known.push(Known {
                block: *taken,
                loads: mean.map(|load| load as f32),
                phase: [0, 1].map(|row| {
                    f64::from(x[row])
                        - phase
                            * (0.5 + 0.5 * f64::from(belief.equilibrium.pace[row] + x[ROWS + row]))
                }),
                time: 2.0 * i as f64 / samples.len() as f64 - 1.0,
            });
        }
    }
    if (known.len() * block) as f64 > LEAST_FOLLOWED * samples.len() as f64 {
        Ok(known)
    } else {
        Err(BuildError::NotFollowed {
            part: 100.0 * (known.len() * block) as f64 / samples.len().max(1) as f64,
            least: 100.0 * LEAST_FOLLOWED,
        })
    }
}

/// Features of each block with the physical parameters of `calibration`.
fn features<'a>(
    rig: &Rig<'_>,
    known: impl Iterator<Item = &'a Known>,
    calibration: &Calibration,
) -> Result<Vec<Features>, BuildError> {
    let model = model(rig.machine, rig.bearing, rig.sensors, calibration)?;
    let contacts = Contacts::try_new(model.geometry).map_err(BuildError::Model)?;
    let mut state = None;
    Ok(known
        .map(|block| {
            let at = match state {
                None => contacts.settle(&block.loads, 0.0),
                Some(position) => {
                    let nearer = contacts.newton(&position, &block.loads, 0.0);
                    contacts.newton(&nearer.position, &block.loads, 0.0)
                }
            };
            state = Some(at.position);
            let mut features = Features::default();
            for g in 0..GAUGES {
                contacts.features(&at, 0.0, g, &mut features.value[g], &mut features.slope[g]);
            }
            features
        })
        .collect())
}

/// Sums of a linear least-squares problem.
#[derive(Clone)]
struct Normal {
    gram: Mat<f64>,
    right: Mat<f64>,
    square: f64,
    rows: f64,
}

/// One row for each reading of a block: coefficients, reading, weight.
fn rows(
    known: &Known,
    features: &Features,
    passing: f64,
    g: usize,
    mut each: impl FnMut(&[f64; COEFFICIENTS], f64, usize),
) {
    let mut basis = [[0.0; COEFFICIENTS]; BASIS];
    let mut time = 1.0;
    for power in &mut basis[0][..DRIFT] {
        *power = time;
        time *= known.time;
    }
    for (slot, load) in basis[0][DRIFT..].iter_mut().zip(&known.loads) {
        *slot = f64::from(*load);
    }
    for row in 0..ROWS {
        for k in 0..FEATURES {
            let f = f64::from(features.value[g][row][k]);
            basis[0][DRIFT + LOADS + row * FEATURES + k] = f;
            for n in 0..HARMONICS {
                let (sin, cos) = ((n + 1) as f64 * (known.phase[row] - passing)).sin_cos();
                let place = BULK + ((row * HARMONICS + n) * FEATURES + k) * 2;
                basis[2 * n + 1][place] = cos * f;
                basis[2 * n + 1][place + 1] = -sin * f;
                basis[2 * n + 2][place] = -sin * f;
                basis[2 * n + 2][place + 1] = -cos * f;
            }
        }
    }
    for k in 0..BASIS {
        if known.block.root[k][k] == 0.0 {
            continue;
        }
        let mut row = [0.0; COEFFICIENTS];
        for j in k..BASIS {
            let u = f64::from(known.block.root[k][j]);
            let from = if j == 0 { 0 } else { BULK };
            for (sum, value) in row[from..].iter_mut().zip(&basis[j][from..]) {
                *sum += u * value;
            }
        }
        each(&row, f64::from(known.block.reading[g][k]), k);
    }
}

/// Weight of row `k`: the mean strain is modelled less well than the rest.
fn weight(known: &Known, noise: f64, k: usize) -> f64 {
    if k == 0 {
        let n = f64::from(known.block.count);
        noise * noise / (noise * noise + n * BULK_ERROR * BULK_ERROR)
    } else {
        1.0
    }
}

fn normal<'a>(
    rig: &Rig<'_>,
    known: impl Iterator<Item = &'a Known>,
    features: &[Features],
    g: usize,
) -> Normal {
    let passing = f64::from(rig.bearing.balls) * rig.bearing.gauges[g].azimuth_deg.to_radians();
    let mut gram = vec![0.0; COEFFICIENTS * COEFFICIENTS];
    let mut right = vec![0.0; COEFFICIENTS];
    let (mut square, mut count) = (0.0, 0.0);
    for (block, features) in known.zip(features) {
        rows(block, features, passing, g, |row, y, k| {
            let w = weight(block, 1.0, k);
            let first = if k == 0 { 0 } else { BULK };
            for i in first..COEFFICIENTS {
                let scaled = w * row[i];
                right[i] += scaled * y;
                let line = &mut gram[i * COEFFICIENTS..(i + 1) * COEFFICIENTS];
                for j in first..=i {
                    line[j] += scaled * row[j];
                }
            }
            square += w * y * y;
            count += 1.0;
        });
    }
    Normal {
        gram: Mat::from_fn(COEFFICIENTS, COEFFICIENTS, |i, j| {
            gram[i.max(j) * COEFFICIENTS + i.min(j)]
        }),
        right: Mat::from_fn(COEFFICIENTS, 1, |i, _| right[i]),
        square,
        rows: count,
    }
}

impl Normal {
    /// Factor of the sums, with a ridge of a millionth that settles what the data leave open.
    fn factor(&self) -> Option<faer::linalg::solvers::Llt<f64>> {
        let mut gram = self.gram.clone();
        for i in 0..COEFFICIENTS {
            gram[(i, i)] = gram[(i, i)] * (1.0 + 1e-6) + 1e-9;
        }
        gram.llt(Side::Lower).ok()
    }

    /// Coefficients and the sum of squares that they leave.
    fn solve(&self) -> (Mat<f64>, f64) {
        let zero = || Mat::zeros(COEFFICIENTS, 1);
        let x = self
            .factor()
            .map_or_else(zero, |factor| factor.solve(&self.right));
        let explained =
            (x.transpose() * &self.right)[(0, 0)] * 2.0 - (x.transpose() * &self.gram * &x)[(0, 0)];
        (x, (self.square - explained).max(0.0))
    }
}

fn fit_gauges(
    rig: &Rig<'_>,
    known: &[Known],
    calibration: &mut Calibration,
) -> Result<(), BuildError> {
    let features = features(rig, known.iter(), calibration)?;
    let fits: Vec<Mat<f64>> = (0..GAUGES)
        .into_par_iter()
        .map(|g| normal(rig, known.iter(), &features, g).solve().0)
        .collect();
    for (g, x) in fits.iter().enumerate() {
        let answer = &mut calibration.gauge[g];
        answer.name.clone_from(&rig.bearing.gauges[g].name);
        answer.offset = x[(0, 0)];
        place(
            &mut |i| x[(i, 0)],
            &mut answer.bulk_load,
            &mut answer.bulk_feature,
            &mut answer.local,
        );
        let passing = f64::from(rig.bearing.balls) * rig.bearing.gauges[g].azimuth_deg.to_radians();
        let left = Left::of(known, &features, passing, g, x);
        answer.bulk_error = left.bulk;
        answer.noise_std = left.noise;
        answer.model_error = TOGETHER * left.relative;
    }
    Ok(())
}

/// What a fit leaves of a gauge's strain.
struct Left {
    /// Standard deviation of the bulk strain [um/m].
    bulk: f64,
    /// Of the local strain at rest [um/m], and the part that goes with the strain.
    noise: f64,
    relative: f64,
}

impl Left {
    /// `e^2 = noise^2 + relative^2 |C|^2` over the blocks, large errors counting less.
    fn of(known: &[Known], features: &[Features], passing: f64, g: usize, x: &Mat<f64>) -> Self {
        let mut bulk = (0.0, 1e-9);
        let mut q = [1e-9, 0.0, 1e-9, 0.0, 0.0];
        for (block, features) in known.iter().zip(features) {
            let (mut square, mut error, mut count) = (0.0, 0.0, 0.0);
            rows(block, features, passing, g, |row, y, k| {
                let predicted: f64 = row.iter().enumerate().map(|(i, r)| r * x[(i, 0)]).sum();
                let left = y - predicted;
                if k == 0 {
                    bulk.0 += left * left / f64::from(block.block.count);
                    bulk.1 += 1.0;
                } else {
                    square += predicted * predicted;
                    error += left * left;
                    count += 1.0;
                }
            });
            if count > 0.0 {
                let (strain, error) = (2.0 * square / f64::from(block.block.count), error / count);
                let w = 1.0 / (1.0 + error + 0.01 * strain).powi(2);
                for (sum, value) in
                    q.iter_mut()
                        .zip([1.0, strain, strain * strain, error, strain * error])
                {
                    *sum += w * value;
                }
            }
        }
        let determinant = q[0] * q[2] - q[1] * q[1];
        let mut noise = (q[3] * q[2] - q[4] * q[1]) / determinant;
        let mut relative = (q[0] * q[4] - q[1] * q[3]) / determinant;
        // All of it may go with the strain; a converter's noise remains.
        if noise.is_nan() || noise <= LEAST_NOISE * LEAST_NOISE {
            noise = LEAST_NOISE * LEAST_NOISE;
            relative = q[4] / q[2];
        }
        Self {
            bulk: f64::sqrt(bulk.0 / bulk.1),
            noise: noise.sqrt(),
            relative: relative.max(1e-4).sqrt(),
        }
    }
}

/// Spreads the coefficients over the fields of an answer.
fn place(
    at: &mut dyn FnMut(usize) -> f64,
    bulk_load: &mut [f64; LOADS],
    bulk_feature: &mut [[f64; FEATURES]; ROWS],
    local: &mut super::calibration::Local,
) {
    for (i, slot) in bulk_load.iter_mut().enumerate() {
        *slot = at(DRIFT + i);
    }
    for (i, slot) in bulk_feature.iter_mut().flatten().enumerate() {
        *slot = at(DRIFT + LOADS + i);
    }
    for (i, slot) in local.iter_mut().flatten().flatten().flatten().enumerate() {
        *slot = at(BULK + i);
    }
}

/// What the linear fit leaves with the physical parameters at `factors`.
fn left(rig: &Rig<'_>, known: &[Known], factors: [f64; 3]) -> Result<f64, BuildError> {
    let mut trial = Calibration::guess(GAUGES);
    trial.stiffness[0] = factors[0];
    trial.preload[0] = factors[1];
    trial.compliance[0] = factors[2];
    let thinned = || known.iter().step_by(THINNED);
    let features = features(rig, thinned(), &trial)?;
    let sum: f64 = (0..GAUGES)
        .into_par_iter()
        .map(|g| {
            let normal = normal(rig, thinned(), &features, g);
            let (_, left) = normal.solve();
            normal.rows * (left / normal.rows).ln()
        })
        .sum();
    Ok(sum)
}

/// Contact stiffness, preload and compliance by Newton's method on the
/// likelihood that the linear fits leave, two steps, each parameter by itself within 30 %.
fn refine(rig: &Rig<'_>, known: &[Known], calibration: &mut Calibration) -> Result<(), BuildError> {
    const STEP: f64 = 0.06;
    let mut at = [
        calibration.stiffness[0],
        calibration.preload[0],
        calibration.compliance[0],
    ];
    let mut std = [0.0; 3];
    let mut best = left(rig, known, at)?;
    for _ in 0..2 {
        for i in 0..3 {
            let shifted = |by: f64| {
                let mut moved = at;
                moved[i] += by;
                moved
            };
            let (below, above) = (
                left(rig, known, shifted(-STEP))?,
                left(rig, known, shifted(STEP))?,
            );
            let curvature = (above - 2.0 * best + below) / (STEP * STEP);
            let slope = (above - below) / (2.0 * STEP);
            let step = if curvature > 0.0 {
                (-slope / curvature).clamp(-2.0 * STEP, 2.0 * STEP)
            } else {
                -2.0 * STEP * slope.signum()
            };
            let moved = shifted(step).map(|factor| factor.clamp(0.7, 1.3));
            let cost = left(rig, known, moved)?;
            for (cost, factors) in [
                (cost, moved),
                (below, shifted(-STEP)),
                (above, shifted(STEP)),
            ] {
                if cost < best {
                    best = cost;
                    at = factors;
                }
            }
            // Errors of neighbouring blocks go together: a stretch counts once a second.
            std[i] = (2.0 / curvature.max(1e-9)).sqrt() * 20.0;
        }
    }
    calibration.stiffness = [at[0], std[0]];
    calibration.preload = [at[1], std[1]];
    calibration.compliance = [at[2], std[2]];
    Ok(())
}

/// Standard deviations of the coefficients.
///
/// `(X'X)^-1 (sum_c g_c g_c') (X'X)^-1`, `g_c` the gradient of stretch c of the recording:
/// errors within a stretch may go together as they like.
fn uncertainty(
    rig: &Rig<'_>,
    known: &[Known],
    calibration: &mut Calibration,
) -> Result<(), BuildError> {
    let all = features(rig, known.iter(), calibration)?;
    let length = known.len().div_ceil(STRETCHES);
    let deviations: Vec<Vec<f64>> = (0..GAUGES)
        .into_par_iter()
        .map(|g| {
            let parts: Vec<Normal> = known
                .chunks(length)
                .zip(all.chunks(length))
                .map(|(known, features)| normal(rig, known.iter(), features, g))
                .collect();
            let mut total = parts[0].clone();
            for part in &parts[1..] {
                total.gram += &part.gram;
                total.right += &part.right;
            }
            let Some(factor) = total.factor() else {
                return vec![f64::INFINITY; COEFFICIENTS];
            };
            let x = factor.solve(&total.right);
            let mut squares = vec![0.0; COEFFICIENTS];
            for part in &parts {
                let moved = factor.solve(&part.right - &part.gram * &x);
                for (i, square) in squares.iter_mut().enumerate() {
                    *square += moved[(i, 0)] * moved[(i, 0)];
                }
            }
            squares.into_iter().map(f64::sqrt).collect()
        })
        .collect();
    for (answer, std) in calibration.gauge.iter_mut().zip(&deviations) {
        place(
            &mut |i| std[i],
            &mut answer.bulk_load_std,
            &mut answer.bulk_feature_std,
            &mut answer.local_std,
        );
    }
    Ok(())
}
