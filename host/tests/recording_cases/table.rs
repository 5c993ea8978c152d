//! The shipped recording as a table in memory that a test changes and writes in another format.
use std::fmt::Write;
use std::path::Path;

use loadtwin::image_build::Sensors;
use loadtwin::machine::Machine;
use loadtwin::recording::{CsvLayout, Reader, Wanted};
use loadtwin::replay::{self, Figures};

pub const PERIOD_S: f64 = 0.002;
/// Columns, each with its unit; the time is beside them.
const COLUMNS: [(&str, &str); 6] = [
    ("ta1", "m/m"),
    ("ta2", "m/m"),
    ("ta3", "m/m"),
    ("encoder_main", "counts"),
    ("index", "counts"),
    ("torque_main", "Nm"),
];
pub const ENCODER: usize = 3;
pub const INDEX: usize = 4;

pub fn example(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/gearbox")
        .join(name)
}

/// The gearbox, its recordings laid out by `layout`.
pub fn machine(layout: &str) -> Machine {
    let mut machine = Machine::load(&example("calibrated.toml")).unwrap();
    machine.recording = toml::from_str(layout).unwrap();
    machine
}

/// Time and values of each row; NaN is an empty cell.
#[derive(Clone)]
pub struct Table {
    pub t: Vec<f64>,
    pub rows: Vec<[f64; COLUMNS.len()]>,
    /// Header of the index column.
    pub index: String,
    /// Decimals of the time.
    pub decimals: usize,
}

impl Table {
    /// Rows of the start-stop cycle, at `k PERIOD_S` from 0 on.
    pub fn shipped(rows: std::ops::Range<usize>) -> Self {
        let wanted = COLUMNS.map(|(name, unit)| Wanted {
            name,
            unit: unit.parse().unwrap(),
            required: true,
        });
        let reader = Reader::open(
            &example("start-stop.parquet"),
            &CsvLayout::default(),
            &wanted,
        );
        let mut values = Vec::new();
        for block in reader.unwrap() {
            let block = block.unwrap();
            for i in 0..block.len() {
                let cell = |k: usize| block.columns[k].as_ref().unwrap()[i];
                values.push(std::array::from_fn(cell));
            }
        }
        let rows = values[rows].to_vec();
        Self {
            t: (0..rows.len()).map(|k| k as f64 * PERIOD_S).collect(),
            rows,
            index: "index [counts]".into(),
            decimals: 9,
        }
    }

    pub fn write(&self, path: &Path) {
        let mut text = String::from("t [s]");
        for (k, (name, unit)) in COLUMNS.iter().enumerate() {
            match k {
                INDEX => write!(text, ",{}", self.index).unwrap(),
                _ => write!(text, ",{name} [{unit}]").unwrap(),
            }
        }
        for (t, row) in self.t.iter().zip(&self.rows) {
            write!(text, "\n{t:.*}", self.decimals).unwrap();
            for value in row {
                text.push(',');
                if !value.is_nan() {
                    write!(text, "{value}").unwrap();
                }
            }
        }
        text.push('\n');
        std::fs::write(path, text).unwrap();
    }

    /// The estimates of the recording, or why there are none.
    pub fn replay(&self, machine: &Machine) -> Result<Estimates, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rec.csv");
        self.write(&path);
        let line = replay(&path, machine);
        line.map_err(|line| line.replace(&format!("{}: ", path.display()), ""))
    }
}

/// What an estimator made of a recording.
#[derive(Debug)]
pub struct Estimates {
    /// Value and standard deviation of the loads, sample by sample.
    pub loads: Vec<[u32; 4]>,
    /// NMAE of the main shaft's torque, full and by segment [%].
    pub nmae: std::collections::BTreeMap<String, Option<f64>>,
    pub note: Option<String>,
}

impl Estimates {
    pub fn full(&self) -> f64 {
        self.nmae["full"].unwrap()
    }
}

pub fn replay(path: &Path, machine: &Machine) -> Result<Estimates, String> {
    let sensors = Sensors::choose(machine, None).unwrap();
    let mut figures = Figures::new(machine);
    let mut loads = Vec::new();
    let run = replay::run(machine, &sensors, path, |sample, estimate, _| {
        figures.push(sample, estimate);
        let [a, b] = [&estimate.loads[0], &estimate.loads[1]];
        loads.push([a.value, a.std, b.value, b.std].map(f32::to_bits));
    });
    run.map_err(|error| error.to_string())?;
    let (_, main) = figures.loads().next().unwrap();
    Ok(Estimates {
        loads,
        nmae: main.nmae_percent,
        note: figures.segment_note(),
    })
}
