//! Estimates the ball-pass phases of both rows over a rig recording, by the bearing filter with the
//! measured loads as known inputs. Gives a `CalibrationBlock` (readings, mean loads, phases) for
//! each update of the locked filter, and checks that enough of the recording was followed.

use loadtwin_common::bearing::harmonic_block::HarmonicBlock;
use loadtwin_common::bearing::{BLOCK_HZ, BearingEstimator as Filter, BearingModel, LOADS, ROWS};

use crate::bearing::calibration_file::Calibration;
use crate::bearing::model_image::model;
use crate::bearing::rig_calibration::{Rig, RigSample};
use crate::error::BuildError;

/// Factor on the resting errors of the gauges while phases are tracked: with the loads given, a
/// slow filter is no drawback.
const NOISE_INFLATION: f32 = 3.0;

/// A block with its loads (kN) and the phases of both rows at its start.
pub struct CalibrationBlock {
    /// What the gauges read.
    pub block: HarmonicBlock,
    /// `Fx, Fy, Fz, Mx, Mz`, moments over the radius.
    pub loads: [f32; LOADS],
    /// Phase of ball passing of each row (rad).
    pub phase: [f64; ROWS],
    /// Time as part of the recording, -1 to 1.
    pub time: f64,
    /// Number of the block since the recording began.
    pub number: usize,
}

/// Samples of a block.
pub fn block_samples(rig: &Rig<'_>) -> usize {
    (rig.machine.rate_hz as f32 / BLOCK_HZ).round().max(1.0) as usize
}

/// Follows the phases with known loads by the model of `calibration`, after `inflate_noise` has
/// adapted it.
///
/// # Errors
/// When the description does not make a model.
pub fn track_phases(
    rig: &Rig<'_>,
    samples: &[RigSample],
    calibration: &Calibration,
    inflate_noise: impl FnOnce(&mut BearingModel),
) -> Result<Vec<CalibrationBlock>, BuildError> {
    let mut model = model(rig.machine, rig.bearing, rig.sensors, calibration)?;
    // Bulk strain says nothing about the phase.
    model.tuning.bulk_std = 1e3;
    for gauge in &mut model.gauges {
        gauge.resting_error *= NOISE_INFLATION;
    }
    inflate_noise(&mut model);
    let radius = f64::from(model.geometry.radius_mm);
    let rate = rig.machine.rate_hz as f32;
    let filter = Filter::try_build(model, rate).map_err(BuildError::Model)?;
    let mut state = filter.start();
    let block = block_samples(rig);
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
            if mean.iter().all(|load| load.is_finite()) {
                state.set_known_loads(mean.map(|load| load as f32));
            }
        }
        filter.step(&mut state, raw);
        if let Some((updated_block, posterior)) = state.updated()
            && state.is_locked()
            && mean.iter().all(|load| load.is_finite())
        {
            let x = &posterior.gaussian.state;
            let phase = f64::from(updated_block.phase);
            known.push(CalibrationBlock {
                block: *updated_block,
                loads: mean.map(|load| load as f32),
                phase: [0, 1].map(|row| {
                    f64::from(x[row])
                        - phase
                            * (0.5
                                + 0.5 * f64::from(posterior.equilibrium.pace[row] + x[ROWS + row]))
                }),
                time: 2.0 * i as f64 / samples.len() as f64 - 1.0,
                number: i / block - 1,
            });
        }
    }
    Ok(known)
}

/// Checks that `least` of the recording was followed.
///
/// # Errors
/// When it was not.
pub fn check_followed(
    rig: &Rig<'_>,
    samples: &[RigSample],
    known: &[CalibrationBlock],
    least: f64,
) -> Result<(), BuildError> {
    let followed = (known.len() * block_samples(rig)) as f64 / samples.len().max(1) as f64;
    if followed > least {
        Ok(())
    } else {
        Err(BuildError::NotFollowed {
            part: 100.0 * followed,
            least: 100.0 * least,
        })
    }
}
