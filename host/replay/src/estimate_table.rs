//! Tabulates the estimates of a replay, one row a sample, and writes them to CSV, Parquet or MDF4:
//! loads with standard deviation and fault; innovation, NIS and fault of each sensor; states and
//! displacements of a rotor.

use std::path::Path;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;

use super::rotor_columns::NodeColumns;
use loadtwin_design::image_build::Sensors;
use loadtwin_files::atomic_file::Complete;
use loadtwin_files::file_kind::FileKind;
use loadtwin_machine::Machine;
use loadtwin_recording::{
    BLOCK_ROWS, OutputColumn, Quantity, RecordingError, SUFFIXES, Unit, Writer,
};

/// What is written as estimates.
pub const ESTIMATES: FileKind = FileKind {
    noun: "estimates",
    suffixes: SUFFIXES,
    is_same: |file| match file.start() {
        [b'P', b'A', b'R', b'1', ..] => file.contains(&["loadtwin ", "_std", "_fault"]),
        [b'M', b'D', b'F', b' ', ..] => file.contains(&["machine: ", "_std", "_fault"]),
        _ => Ok(is_header(&String::from_utf8_lossy(file.header()))),
    },
};

/// Whether a header has the columns of estimates and none that someone added.
fn is_header(header: &str) -> bool {
    let names: Vec<&str> = header
        .split(',')
        .map(|column| column.rsplit_once(" [").map_or(column, |(name, _)| name))
        .collect();
    let has = |name: String| names.contains(&name.as_str());
    let of_sensor = |name: &str| {
        let ends = ["_std", "_fault", "_innovation", "_nis"];
        ends.iter().any(|end| name.ends_with(end))
    };
    let is_own = |name: &str| of_sensor(name) || has(format!("{name}_std"));
    let has_load = names.iter().any(|name| has(format!("{name}_fault")));
    match names.split_first() {
        Some((&"t", others)) => {
            has_load && (others.iter()).all(|n| is_own(n) || NodeColumns::is_state(n))
        }
        _ => false,
    }
}

/// Rows of estimates: loads with standard deviation and fault, then for each sensor the
/// innovation, its NIS and the fault, then what is asked for of a rotor's nodes; faults by the numbers of
/// [`loadtwin_common::io::fault::Fault`].
pub struct EstimateRows {
    described: Vec<OutputColumn>,
    nodes: Option<NodeColumns>,
    t: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl EstimateRows {
    /// No row yet.
    pub fn new(machine: &Machine, sensors: &Sensors, nodes: Option<NodeColumns>) -> Self {
        let mut described = Vec::new();
        let mut column = |name: String, unit| {
            described.push(OutputColumn {
                name,
                unit,
                single: true,
            });
        };
        for load in machine.loads() {
            column(load.name.to_owned(), load.unit);
            column(format!("{}_std", load.name), load.unit);
            column(format!("{}_fault", load.name), Unit::ONE);
        }
        let channels = sensors.channels.iter().map(|c| (&c.name, c.unit.si()));
        let travel = match machine.travel_unit() {
            Some(unit) if unit.quantity() == Quantity::Length => Unit::METRE,
            _ => Unit::RADIAN,
        };
        let encoders = sensors.encoders.iter().map(|e| (&e.name, travel));
        for (name, unit) in channels.chain(encoders) {
            column(format!("{name}_innovation"), unit);
            column(format!("{name}_nis"), Unit::ONE);
            column(format!("{name}_fault"), Unit::ONE);
        }
        described.extend(nodes.iter().flat_map(NodeColumns::columns));
        Self {
            columns: vec![Vec::new(); described.len()],
            described,
            nodes,
            t: Vec::new(),
        }
    }

    /// The columns besides the time.
    pub fn described(&self) -> &[OutputColumn] {
        &self.described
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Adds the estimate at time `t` (s), after the step of the estimator `line`.
    pub fn push(&mut self, t: f64, estimate: &Estimate, line: &Estimator<'_>) {
        let loads = estimate
            .loads
            .iter()
            .map(|l| [l.value, l.std, f32::from(l.fault as u8)]);
        let sensors = estimate.sensors.iter().map(|s| {
            let used = s.innovation_variance > 0.0;
            let or_missing = |value: f32| if used { value } else { f32::NAN };
            [
                or_missing(s.innovation),
                or_missing(s.nis),
                f32::from(s.fault as u8),
            ]
        });
        let nodes = (self.nodes.as_mut()).map(|nodes| nodes.values(estimate, line));
        let values = loads.chain(sensors).flatten().map(f64::from);
        let values = values.chain(nodes.into_iter().flatten());
        for (column, value) in self.columns.iter_mut().zip(values) {
            column.push(value);
        }
        self.t.push(t);
    }

    /// Hands time and columns to `write` and begins anew.
    ///
    /// # Errors
    /// Those of `write`.
    pub fn take<T, E>(
        &mut self,
        write: impl FnOnce(&[OutputColumn], &[f64], &[&[f64]]) -> Result<T, E>,
    ) -> Result<T, E> {
        let columns: Vec<&[f64]> = self.columns.iter().map(Vec::as_slice).collect();
        let written = write(&self.described, &self.t, &columns);
        self.t.clear();
        self.columns.iter_mut().for_each(Vec::clear);
        written
    }
}

/// Writes [`EstimateRows`] to a file.
pub struct EstimateWriter {
    writer: Writer,
    rows: EstimateRows,
}

impl EstimateWriter {
    /// Begins the file in `path`, CSV, Parquet or MDF4 by its extension.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn create(
        path: &Path,
        machine: &Machine,
        sensors: &Sensors,
        nodes: Option<NodeColumns>,
    ) -> Result<Self, RecordingError> {
        let rows = EstimateRows::new(machine, sensors, nodes);
        let metadata = [("machine", machine.name.as_str())];
        // A CSV begins with its header: other programs expect no comments.
        let is_text = (path.extension()).is_none_or(|end| end.eq_ignore_ascii_case("csv"));
        let metadata = if is_text { &[][..] } else { &metadata };
        Ok(Self {
            writer: Writer::create(path, rows.described(), metadata)?,
            rows,
        })
    }

    /// Adds the estimate at time `t` (s), after the step of the estimator `line`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn push(
        &mut self,
        t: f64,
        estimate: &Estimate,
        line: &Estimator<'_>,
    ) -> Result<(), RecordingError> {
        self.rows.push(t, estimate, line);
        if self.rows.len() == BLOCK_ROWS {
            self.flush()
        } else {
            Ok(())
        }
    }

    fn flush(&mut self) -> Result<(), RecordingError> {
        let writer = &mut self.writer;
        self.rows.take(|_, t, columns| writer.write(t, columns))
    }

    /// Completes the file, which has no name before it is published.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn complete(mut self) -> Result<Complete, RecordingError> {
        if !self.rows.is_empty() {
            self.flush()?;
        }
        self.writer.complete()
    }
}
