//! Makes archives of simulated gearboxes, runs `loadtwin replay --archive` on them, and compares
//! their estimates with those of one replay of the whole recording, to the bit.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;
use tempfile::TempDir;

/// Days of a machine.
pub const DAYS: usize = 4;

/// Seconds of a day.
const SECONDS: usize = 6;

/// Name of the recording of each day.
pub const RECORDING: &str = "rec.parquet";

/// Files by their paths in the folder of the results.
pub type Files = BTreeMap<String, Vec<u8>>;

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml")
}

/// The date of a day, from 0 on.
pub fn date(day: usize) -> String {
    format!("2026-11-{:02}", day + 1)
}

/// The rows of a Parquet file.
pub fn rows(path: &Path) -> RecordBatch {
    let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    let length = reader.metadata().file_metadata().num_rows() as usize;
    let empty = RecordBatch::new_empty(reader.schema().clone());
    let mut batches = reader.with_batch_size(length.max(1)).build().unwrap();
    let all = batches.next().map_or(empty, Result::unwrap);
    assert_eq!(all.num_rows(), length);
    all
}

/// An archive, and the command on it.
pub struct Bench {
    folder: TempDir,
}

impl Bench {
    /// An archive of `machines` with a description each and recordings of their own: `g1`, `g2`, ...
    pub fn new(machines: usize) -> Self {
        let bench = Self {
            folder: TempDir::new().unwrap(),
        };
        fs::create_dir(bench.archive()).unwrap();
        let mut table = "machine,from,description\n".to_owned();
        for machine in 1..=machines {
            bench.add(machine);
            table += &format!("g{machine},2026-01-01,{}\n", example().display());
        }
        bench.describe(&table);
        bench
    }

    pub fn archive(&self) -> PathBuf {
        self.folder.path().join("archive")
    }

    pub fn results(&self) -> PathBuf {
        self.archive().join("results")
    }

    /// Writes the table of descriptions.
    pub fn describe(&self, table: &str) {
        fs::write(self.archive().join("descriptions.csv"), table).unwrap();
    }

    /// The recording of a machine on a day.
    pub fn recording(&self, machine: usize, day: usize) -> PathBuf {
        let folder = format!("recordings/machine=g{machine}/day={}", date(day));
        self.archive().join(folder).join(RECORDING)
    }

    /// The recording of a machine over all days.
    fn whole(&self, machine: usize) -> PathBuf {
        self.folder.path().join(format!("{machine}.parquet"))
    }

    fn add(&self, machine: usize) {
        let (length, seed) = ((DAYS * SECONDS).to_string(), machine.to_string());
        let whole = self.whole(machine);
        let simulated = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .arg("simulate")
            .arg(example())
            .args(["--scenario", "turbulent", "--duration-s", &length])
            .args(["--seed", &seed, "-o"])
            .arg(&whole)
            .output()
            .unwrap();
        assert!(simulated.status.success(), "{simulated:?}");
        let whole = rows(&whole);
        let length = whole.num_rows() / DAYS;
        for day in 0..DAYS {
            let path = self.recording(machine, day);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            let file = File::create(path).unwrap();
            let mut writer = ArrowWriter::try_new(file, whole.schema(), None).unwrap();
            writer.write(&whole.slice(day * length, length)).unwrap();
            writer.close().unwrap();
        }
    }

    /// `loadtwin replay --archive`, not started.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
        command
            .args(["replay", "--json", "--archive"])
            .arg(self.archive())
            .args(arguments);
        command
    }

    /// The figures of a run.
    pub fn run(&self, arguments: &[&str]) -> Value {
        let output = self.command(arguments).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// The estimates of the days of a machine are those of one replay of its whole recording.
    pub fn has_the_bits_of_one_replay(&self, machine: usize) {
        let estimates = self.folder.path().join("estimates.parquet");
        let replayed = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .arg("replay")
            .args([&example(), &self.whole(machine)])
            .args(["--force", "--estimates"])
            .arg(&estimates)
            .output()
            .unwrap();
        assert!(replayed.status.success(), "{replayed:?}");
        let whole = rows(&estimates);
        let mut first = 0;
        for day in 0..DAYS {
            let folder = format!("estimates/machine=g{machine}/day={}", date(day));
            let found = rows(&self.results().join(folder).join(RECORDING));
            let expected = whole.slice(first, found.num_rows());
            assert!(
                found.columns() == expected.columns(),
                "g{machine}, day {day}"
            );
            first += found.num_rows();
        }
        assert_eq!(first, whole.num_rows());
    }

    /// Everything that the runs have made.
    pub fn made(&self) -> Files {
        let (mut found, mut open) = (Files::new(), vec![self.results()]);
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    open.push(path);
                    continue;
                }
                let name = path.strip_prefix(self.results()).unwrap();
                found.insert(name.to_str().unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
        found
    }

    /// Rows of the table of faults: machine, day, recording, fault.
    pub fn faults(&self) -> Vec<[String; 4]> {
        let table = rows(&self.results().join("faults.parquet"));
        let cell = |name: &str, row| {
            let column = table.column_by_name(name).unwrap();
            column.as_string::<i32>().value(row).to_owned()
        };
        let names = ["machine", "day", "recording", "fault"];
        let rows = 0..table.num_rows();
        rows.map(|row| names.map(|name| cell(name, row))).collect()
    }
}
