//! Builds the data of the regression on a drive over all recordings, decimated: the drive itself
//! with folds for cross-validation (whole recordings from three on) and stretches for significance
//! (`Dataset`); and the columns of the linear model, of an effect, and of each recording's own
//! offset.

use rayon::prelude::*;

use crate::candidate_effect::Effect;
use crate::smoothed_motion::Motion;

/// Groups of blocks that are left out in turn.
const FOLDS: usize = 10;

/// Decimated values that are left out together: two periods of the cut-off.
const BLOCK_ROWS: usize = 8;

/// From so many recordings on, whole ones are left out: an effect has to hold
/// at an operating point that it was not fitted at.
const RECORDINGS_AS_FOLDS: usize = 3;

/// Stretches of all recordings in which an improvement has to repeat itself.
const STRETCHES: usize = 16;

/// Standard deviation of a recording's own offset in parts of the drive's RMS: a
/// sensor that was not zeroed is off by some percent of its range.
pub const OFFSET_PRIOR: f64 = 0.1;

/// Rows a recording, on average, from which on an offset leaves something of it.
const FEWEST_ROWS_WITH_OFFSET: usize = 10;

/// What recordings say about a balance, decimated value by decimated value.
pub struct Dataset {
    /// The drive [its unit].
    pub drive: Vec<f64>,
    /// Which values are left out together.
    pub fold: Vec<usize>,
    /// In which stretch of a recording each value is.
    pub stretch: Vec<usize>,
    /// Time in its recording [s].
    pub t: Vec<f64>,
    /// Which recording.
    pub recording: Vec<usize>,
    /// Where whole recordings are left out, standard deviation of the offset that
    /// each has of its own, in parts of the drive's RMS.
    pub left_out_offset: f64,
}

impl Dataset {
    /// The table of `motions`.
    pub fn new(motions: &[Motion]) -> Self {
        let mut table = Self {
            drive: Vec::new(),
            fold: Vec::new(),
            stretch: Vec::new(),
            t: Vec::new(),
            recording: Vec::new(),
            left_out_offset: 0.0,
        };
        let by_recording = motions.len() >= RECORDINGS_AS_FOLDS;
        let parts = STRETCHES.div_ceil(motions.len().max(1));
        let mut first_stretch = 0;
        for (k, motion) in motions.iter().enumerate() {
            let drive = motion.decimated(&motion.drive);
            let n = drive.len();
            let parts = parts.min(n);
            for i in 0..n {
                let block = if motion.is_sequence() {
                    i / BLOCK_ROWS
                } else {
                    i
                };
                table
                    .fold
                    .push(if by_recording { k } else { block % FOLDS });
                table.stretch.push(first_stretch + i * parts / n);
                table.recording.push(k);
            }
            first_stretch += parts;
            table.t.extend(motion.decimated_times());
            table.drive.extend(drive);
        }
        if by_recording && table.has_offsets(motions.len()) {
            table.left_out_offset = OFFSET_PRIOR;
        }
        table
    }

    /// Whether each of `recordings` can have an offset of its own: not where one
    /// is the only one, or a single value.
    fn has_offsets(&self, recordings: usize) -> bool {
        recordings > 1 && self.has_means(recordings)
    }

    /// Whether the mean of each of `recordings` is not all that there is of it.
    pub fn has_means(&self, recordings: usize) -> bool {
        self.len() > FEWEST_ROWS_WITH_OFFSET * recordings
    }

    /// Rows.
    pub fn len(&self) -> usize {
        self.drive.len()
    }
}

/// The columns of an effect over all recordings.
pub fn columns(motions: &[Motion], effect: &dyn Effect, shape: &[f64]) -> Vec<Vec<f64>> {
    joined(motions, |motion| effect.columns(motion, shape))
}

/// A column for each recording that is one there: a sensor is not zeroed alike
/// in each.
pub fn offsets(motions: &[Motion], table: &Dataset) -> Vec<Vec<f64>> {
    if !table.has_offsets(motions.len()) {
        return Vec::new();
    }
    (0..motions.len())
        .map(|k| {
            let is_here = |r: &usize| if *r == k { 1.0 } else { 0.0 };
            table.recording.iter().map(is_here).collect()
        })
        .collect()
}

/// The columns of the linear model: acceleration, speed, each load, one; those
/// that the regime has.
pub fn linear(motions: &[Motion]) -> Vec<Vec<f64>> {
    joined(motions, |motion| {
        let mut columns = vec![vec![1.0; motion.len()]];
        columns.push(motion.acceleration.clone());
        columns.push(motion.speed.clone());
        columns.extend(motion.loads.iter().cloned());
        columns
    })
}

fn joined(motions: &[Motion], of: impl Fn(&Motion) -> Vec<Vec<f64>> + Sync) -> Vec<Vec<f64>> {
    let each: Vec<Vec<Vec<f64>>> = motions
        .par_iter()
        .map(|motion| of(motion).iter().map(|c| motion.decimated(c)).collect())
        .collect();
    let count = each.first().map_or(0, Vec::len);
    (0..count)
        .map(|k| {
            each.iter()
                .flat_map(|columns| columns[k].iter().copied())
                .collect()
        })
        .collect()
}
