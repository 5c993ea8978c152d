//! Recordings of simulated machines with sensor faults, and cut parts of them, for the replay
//! tests.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch};
use arrow_schema::{DataType, Field, Schema};
use loadtwin::image_build::Sensors;
use loadtwin::recording::Batches;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

pub(crate) fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples")
        .join(name)
}

pub(crate) fn loadtwin(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Kinds of faults that a sensor is given.
const FAULTS: usize = 11;

/// Drift of a strain [m/m a row].
const DRIFT: f64 = 1e-8;

/// A recording as columns of numbers.
pub(crate) struct Recorded {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Recorded {
    pub(crate) fn simulated(machine: &str, arguments: &[&str]) -> Self {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("recording.csv");
        let machine = example(machine);
        let mut all = vec!["simulate", machine.to_str().unwrap()];
        all.extend(arguments);
        all.extend(["-o", path.to_str().unwrap()]);
        let output = loadtwin(&all);
        assert!(output.status.success(), "{output:?}");
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .from_path(&path)
            .unwrap();
        let names: Vec<String> = reader.headers().unwrap().iter().map(Into::into).collect();
        let mut columns = vec![Vec::new(); names.len()];
        for row in reader.records() {
            for (column, cell) in columns.iter_mut().zip(&row.unwrap()) {
                column.push(cell.parse().unwrap_or(f64::NAN));
            }
        }
        Self { names, columns }
    }

    pub(crate) fn rows(&self) -> usize {
        self.columns[0].len()
    }

    /// With sensors that are silent, stuck, off, noisy, reversed, scaled, drifting, dead, jumping or at
    /// an end of the converter for a while, and with lost rows.
    pub(crate) fn with_faults(mut self, sensors: &Sensors, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let rows = self.rows();
        let is_sensor = |name: &str| {
            let name = name.split(" [").next().unwrap_or_default();
            sensors.channels.iter().any(|c| c.name == name)
                || sensors.encoders.iter().any(|e| e.name == name)
        };
        for (name, column) in self.names.iter().zip(&mut self.columns) {
            if !is_sensor(name) {
                continue;
            }
            let known = column.iter().copied().filter(|v| v.is_finite());
            let size = known.map(f64::abs).fold(0.0, f64::max);
            for kind in 0..FAULTS {
                let from = rng.random_range(0..rows);
                let until = (from + rng.random_range(1..rows / 12)).min(rows);
                let held = column[from];
                for (k, value) in column[from..until].iter_mut().enumerate() {
                    *value = match kind {
                        0 => f64::NAN,
                        1 => held,
                        2 => *value + 0.3 * size,
                        3 if rng.random_bool(0.1) => *value - 0.2 * size,
                        4 => -*value,
                        5 => 1.6 * *value,
                        6 => *value + 1e-3 * size * k as f64,
                        7 => held + 1e-4 * size * rng.random::<f64>(),
                        8 if k % 50 == 0 => *value + size,
                        9 => 1e6 * size,
                        10 => -1e6 * size,
                        _ => *value,
                    };
                }
            }
        }
        let lost: Vec<usize> = (0..6).map(|_| rng.random_range(100..rows - 100)).collect();
        for column in &mut self.columns {
            let mut row = 0;
            column.retain(|_| {
                row += 1;
                !lost.iter().any(|lost| (*lost..lost + 3).contains(&row))
            });
        }
        self
    }

    fn sensor(&mut self, name: &str) -> &mut Vec<f64> {
        let is_it = |of: &String| of.split(" [").next() == Some(name);
        let column = self.names.iter().position(is_it).unwrap();
        &mut self.columns[column]
    }

    /// With two channels that are exchanged from a third of the recording on.
    pub(crate) fn with_exchanged_wires(mut self, sensors: &Sensors) -> Self {
        let [one, other] = [0, 1].map(|k| sensors.channels[k].name.as_str());
        let from = self.rows() / 3;
        let wires = self.sensor(one).split_off(from);
        let others = self.sensor(other).split_off(from);
        self.sensor(one).extend(others);
        self.sensor(other).extend(wires);
        self
    }

    /// With a channel that drifts from the start on, and an encoder that reads at random at the end.
    pub(crate) fn with_drift(mut self, sensors: &Sensors, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let channel = self.sensor(&sensors.channels[0].name);
        for (row, value) in channel.iter_mut().enumerate() {
            *value += DRIFT * row as f64;
        }
        let encoder = &sensors.encoders[0];
        let from = 2 * self.rows() / 3;
        for count in &mut self.sensor(&encoder.name)[from..] {
            *count += f64::from(rng.random_range(0..16384));
        }
        self
    }

    pub(crate) fn part(&self, from: usize, until: usize) -> Batches {
        let fields: Vec<Field> = (self.names.iter())
            .map(|name| Field::new(name, DataType::Float64, true))
            .collect();
        let column = |values: &Vec<f64>| {
            let known = values[from..until]
                .iter()
                .map(|v| v.is_finite().then_some(*v));
            Arc::new(known.collect::<Float64Array>()) as ArrayRef
        };
        let columns = self.columns.iter().map(column).collect();
        let schema = Arc::new(Schema::new(fields));
        let batch = RecordBatch::try_new(Arc::clone(&schema), columns).unwrap();
        Batches::new(schema, [Ok(batch)].into_iter())
    }
}
