//! Runs a simulation sample by sample: collects the readings of a simulated machine in blocks, and
//! writes them to a CSV, Parquet or MDF4 file.

use std::path::Path;

use loadtwin_machine::Machine;
use loadtwin_recording::{BLOCK_ROWS, Block, OutputColumn, RecordingError, Writer};

use crate::error::SimulateError;

/// Longest recording [s]: a day.
const LONGEST_S: f64 = 86_400.0;

/// A simulated machine with its sensors, sampled at a steady rate.
pub trait Sampled {
    /// Appends what is read at sample `row`, a value to each column.
    fn sample(&mut self, row: u64, columns: &mut [Vec<f64>]);

    /// From sample `row` to the next.
    fn advance(&mut self, row: u64);
}

/// A recording in the making: an iterator over its blocks.
pub struct Recorder<S> {
    pub(crate) sampled: S,
    columns: Vec<OutputColumn>,
    /// What a file says about itself.
    metadata: Vec<(&'static str, String)>,
    dt: f64,
    row: u64,
    rows: u64,
}

/// Checks the length of a recording [s].
pub(crate) fn check_duration(duration_s: f64) -> Result<(), SimulateError> {
    if duration_s > 0.0 && duration_s <= LONGEST_S {
        Ok(())
    } else {
        Err(SimulateError::Duration {
            found: duration_s,
            most: LONGEST_S,
        })
    }
}

impl<S: Sampled> Recorder<S> {
    /// The recording of `duration_s` that `seed` draws.
    pub(crate) fn start(
        sampled: S,
        columns: Vec<OutputColumn>,
        machine: &Machine,
        scenario: &str,
        seed: u64,
        duration_s: f64,
    ) -> Self {
        Self {
            sampled,
            columns,
            metadata: vec![
                ("machine", machine.name.clone()),
                ("scenario", scenario.to_owned()),
                ("seed", seed.to_string()),
                ("rate_hz", machine.rate_hz.to_string()),
            ],
            dt: 1.0 / machine.rate_hz,
            row: 0,
            rows: (duration_s * machine.rate_hz).round().max(1.0) as u64,
        }
    }

    /// The columns of the blocks, the time not among them.
    pub fn columns(&self) -> &[OutputColumn] {
        &self.columns
    }

    /// Samples of the whole recording.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Writes the remaining recording to `path`: CSV, Parquet or MDF4 by
    /// its extension. `progress` hears from 0 to 1 how far it is.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be written.
    pub fn write(
        mut self,
        path: &Path,
        mut progress: impl FnMut(f64),
    ) -> Result<(), RecordingError> {
        let metadata: Vec<(&str, &str)> = (self.metadata.iter())
            .map(|(key, value)| (*key, value.as_str()))
            .collect();
        let mut writer = Writer::create(path, &self.columns, &metadata)?;
        while let Some(block) = self.next() {
            let columns: Vec<&[f64]> = block.columns.iter().flatten().map(Vec::as_slice).collect();
            writer.write(&block.t, &columns)?;
            progress(self.row as f64 / self.rows as f64);
        }
        writer.finish()
    }
}

impl<S: Sampled> Iterator for Recorder<S> {
    type Item = Block;

    fn next(&mut self) -> Option<Block> {
        let first_row = self.row;
        let count = (self.rows - first_row).min(BLOCK_ROWS as u64) as usize;
        let mut columns = vec![Vec::with_capacity(count); self.columns.len()];
        for _ in 0..count {
            self.sampled.sample(self.row, &mut columns);
            self.sampled.advance(self.row);
            self.row += 1;
        }
        (count > 0).then(|| Block {
            first_row,
            t: (first_row..self.row)
                .map(|row| row as f64 * self.dt)
                .collect(),
            columns: columns.into_iter().map(Some).collect(),
            bridged: Vec::new(),
        })
    }
}
