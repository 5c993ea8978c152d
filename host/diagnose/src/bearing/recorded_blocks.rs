//! Tracks the ball-pass phases in a recording of a bearing, given its loads, and returns the blocks
//! (100 per second) that could be followed, with loads and encoder speed of every block. Less than
//! 15 s of tracked blocks are refused.

use std::path::Path;

use loadtwin_common::bearing::{BLOCK_HZ, LOADS};

use crate::diagnosis::DiagnoseError;
use loadtwin_design::bearing::Calibration;
use loadtwin_design::bearing::{CalibrationBlock, Rig, RigSample, block_samples, track_phases};
use loadtwin_simulate::BearingCourse;

/// Shortest stretch that is tested [s].
const SHORTEST_S: f64 = 15.0;

/// Standard deviation of the slip of a cage while phases are tracked: larger than in operation, as
/// the recording may be of a faulty bearing.
const SLIP: f32 = 0.02;

/// Least model error of a gauge while phases are tracked, as part of the strain; for the same
/// reason.
const UNSURE: f32 = 0.3;

/// Half of the time over which the speed is computed from counts, in blocks.
const SPAN: usize = 10;

/// A recording of a bearing.
pub struct BearingRecording {
    /// Blocks whose phases were followed.
    pub known: Vec<CalibrationBlock>,
    /// Rate of ball passing by which they were gathered, over the described one.
    pub rate: f64,
    /// Speed and loads of every block.
    pub course: BearingCourse,
}

impl BearingRecording {
    /// Follows the `samples` of the recording in `path`, in which balls pass at `rate` times what
    /// the description says.
    ///
    /// # Errors
    /// When too little of it can be followed.
    pub fn follow(
        rig: &Rig<'_>,
        calibration: &Calibration,
        samples: &[RigSample],
        rate: f64,
        path: &Path,
    ) -> Result<Self, DiagnoseError> {
        let known = track_phases(rig, samples, calibration, |model| {
            model.passes_per_turn *= rate as f32;
            model.tuning.slip_std = SLIP;
            for gauge in &mut model.gauges {
                gauge.model_error = gauge.model_error.max(UNSURE);
            }
        })?;
        let followed_s = known.len() as f64 / f64::from(BLOCK_HZ);
        if followed_s < SHORTEST_S {
            return Err(DiagnoseError::TooLittle {
                recording: path.to_owned(),
                reason: format!(
                    "the phases of ball passing were followed for {followed_s:.1} s, too little to distinguish an effect from chance; at least {SHORTEST_S} s are needed, with all loads given and the wheel turning"
                ),
            });
        }
        Ok(Self {
            known,
            rate,
            course: course(rig, samples),
        })
    }
}

fn course(rig: &Rig<'_>, samples: &[RigSample]) -> BearingCourse {
    let dt_s = 1.0 / f64::from(BLOCK_HZ);
    let blocks: Vec<&[RigSample]> = samples.chunks_exact(block_samples(rig)).collect();
    let turned = turned(rig, &blocks);
    let speed = (0..blocks.len())
        .map(|i| {
            let (from, to) = (i.saturating_sub(SPAN), (i + SPAN).min(blocks.len() - 1));
            (turned[to] - turned[from]) / ((to - from).max(1) as f64 * dt_s)
        })
        .collect();
    let mut last = [0.0; LOADS];
    let loads = (blocks.iter())
        .map(|block| {
            let mean: [f64; LOADS] = std::array::from_fn(|j| {
                block.iter().map(|(_, loads)| loads[j]).sum::<f64>() / block.len() as f64
            });
            // A missing value repeats the last.
            last = std::array::from_fn(|j| {
                if mean[j].is_finite() {
                    mean[j]
                } else {
                    last[j]
                }
            });
            last
        })
        .collect();
    BearingCourse { dt_s, speed, loads }
}

/// Angle of the wheel at the start of each block [rad]; a missing one repeats the last.
fn turned(rig: &Rig<'_>, blocks: &[&[RigSample]]) -> Vec<f64> {
    let Some(encoder) = rig.sensors.encoders.first() else {
        return vec![0.0; blocks.len()];
    };
    let modulus = f64::from(encoder.bits).exp2();
    let (mut total, mut last) = (0.0, None);
    (blocks.iter())
        .map(|block| {
            for (raw, _) in block.iter().filter(|(raw, _)| raw.has_encoder(0)) {
                let count = f64::from(raw.encoders[0]);
                let moved = count - last.unwrap_or(count);
                total += moved - (moved / modulus).round() * modulus;
                last = Some(count);
            }
            std::f64::consts::TAU * total / encoder.counts_per_turn
        })
        .collect()
}
