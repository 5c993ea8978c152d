//! Parquet table of load counts, one row a count: cycles, residue, ranges, level crossings, time
//! and turns at load.

use std::io;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray};
use loadtwin_common::counting::{BINS, LEVELS, LoadCounts, SHAFTS, TURN_BINS};
use loadtwin_files::atomic_file::{AtomicFile, Complete};
use loadtwin_files::file_kind::FileKind;
use parquet::arrow::ArrowWriter;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

/// Key of the metadata by which the table is recognised.
const KEY: &str = "loadtwin_life_counts";

/// What is written as counts.
pub const COUNTS: FileKind = FileKind {
    noun: "counts",
    suffixes: &["parquet"],
    is_same: |file| match file.start() {
        [b'P', b'A', b'R', b'1', ..] => file.contains(&["loadtwin ", KEY]),
        _ => Ok(false),
    },
};

/// Rows of load, kind, low, high and count; low and high are in the unit of the load.
///
/// | kind | low, high | count |
/// |---|---|---|
/// | cycles | middle of the bins of minimum and maximum | closed cycles |
/// | residue | minimum and maximum of a half cycle | 0.5 |
/// | ranges | 0, range | closed cycles |
/// | crossings | load, load | upcrossings |
/// | time | ends of the bin | samples |
/// | turns-1, turns-2 | ends of the bin | turns of the shaft |
#[derive(Debug, Default)]
pub struct CountsTable {
    load: Vec<String>,
    kind: Vec<&'static str>,
    numbers: [Vec<f64>; 3],
}

impl CountsTable {
    fn push(&mut self, load: &str, kind: &'static str, numbers: [f64; 3]) {
        self.load.push(load.into());
        self.kind.push(kind);
        for (column, number) in self.numbers.iter_mut().zip(numbers) {
            column.push(number);
        }
    }

    /// Adds all counts of a load.
    pub fn add(&mut self, load: &str, counts: &LoadCounts) {
        let [from, _] = counts.scale().ends().map(f64::from);
        let level = f64::from(counts.scale().width());
        let at = |position: f64| from + position * level;
        let per_bin = (LEVELS / BINS) as f64;
        let middle = |bin: usize| at((bin as f64 + 0.5) * per_bin);
        let (closed, residue) = counts.ended();
        for (low, high, count) in closed.matrix().cells() {
            self.push(load, "cycles", [middle(low), middle(high), count as f64]);
        }
        for cycle in residue.ranges() {
            let [low, high] = [cycle.low, cycle.high].map(|l| at(f64::from(l) + 0.5));
            self.push(load, "residue", [low, high, 0.5]);
        }
        for (range, count) in closed.ranges().iter().enumerate().filter(|(_, n)| *n > 0) {
            self.push(load, "ranges", [0.0, range as f64 * level, count as f64]);
        }
        for (edge, &count) in counts.level_crossings().iter().enumerate() {
            if count > 0 {
                let edge = at((edge + 1) as f64 * per_bin);
                self.push(load, "crossings", [edge, edge, count as f64]);
            }
        }
        let ends = |bin: usize, width: f64| [at(bin as f64 * width), at((bin + 1) as f64 * width)];
        for (bin, count) in counts.time().iter().enumerate().filter(|(_, n)| *n > 0) {
            let [low, high] = ends(bin, per_bin);
            self.push(load, "time", [low, high, count as f64]);
        }
        let per_turn_bin = (LEVELS / TURN_BINS) as f64;
        for (turns, kind) in counts
            .turns()
            .iter()
            .zip(["turns-1", "turns-2"] as [_; SHAFTS])
        {
            for bin in (0..TURN_BINS).filter(|&bin| turns.turns(bin) > 0.0) {
                let [low, high] = ends(bin, per_turn_bin);
                self.push(load, kind, [low, high, turns.turns(bin)]);
            }
        }
    }

    /// Writes it as Parquet, without a name before it is published.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn complete(self, path: &Path) -> io::Result<Complete> {
        let [low, high, count] = self.numbers;
        let columns: [(&str, ArrayRef); 5] = [
            ("load", Arc::new(StringArray::from(self.load))),
            ("kind", Arc::new(StringArray::from(self.kind))),
            ("low", Arc::new(Float64Array::from(low))),
            ("high", Arc::new(Float64Array::from(high))),
            ("count", Arc::new(Float64Array::from(count))),
        ];
        let batch = RecordBatch::try_from_iter(columns).map_err(io::Error::other)?;
        let properties = WriterProperties::builder()
            .set_created_by(concat!("loadtwin ", env!("CARGO_PKG_VERSION")).into())
            .set_key_value_metadata(Some(vec![KeyValue::new(KEY.to_string(), "1".to_string())]))
            .build();
        let file = AtomicFile::create(path)?;
        let mut writer = ArrowWriter::try_new(file, batch.schema(), Some(properties))
            .map_err(io::Error::other)?;
        writer.write(&batch).map_err(io::Error::other)?;
        writer.into_inner().map_err(io::Error::other)?.complete()
    }
}
