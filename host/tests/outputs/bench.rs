//! Test folder for the output tests: a machine, its maps and recordings, and the files that its
//! commands read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const MACHINE: &str = include_str!("../data/two_inertias.toml");
const MAP: &str = include_str!("../data/two_inertias_map.csv");

/// Contents of the files of a folder, hidden ones as well, by name.
pub type Contents = BTreeMap<String, Vec<u8>>;

pub struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// `machine.toml`, its map, `good.csv`, `other.csv`, and `bridge.toml` with `zero.csv`.
    pub fn new() -> Self {
        let bench = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        bench.write("machine.toml", MACHINE);
        bench.write("two_inertias_map.csv", MAP);
        bench.write("good.csv", recording(3000));
        bench.write("other.csv", recording(2000));
        let bridge = "bridge = { bridge = \"quarter-1\", gauge_factor = 2.0, \
                      gauge_resistance_ohm = 350.0 }";
        let adc = "adc = { lsb = 0.001, stuck_after = 8 }";
        assert!(MACHINE.contains(adc));
        let bridged = MACHINE.replacen(adc, &format!("adc = {{ lsb = 2e-6 }}\n{bridge}"), 1);
        bench.write("bridge.toml", bridged);
        let rows = (0..100).map(|i| format!("{:.3},0.25\n", f64::from(i) / 500.0));
        let rows: String = rows.collect();
        bench.write("zero.csv", "t [s],constant [mV/V]\n".to_owned() + &rows);
        bench
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), text).unwrap();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_default()
    }

    /// The command of a line of words, not yet started.
    pub fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
        command
            .args(line.split_whitespace())
            .current_dir(self.folder.path());
        command
    }

    pub fn run(&self, line: &str) -> Output {
        self.command(line).output().unwrap()
    }

    pub fn succeeds(&self, line: &str) {
        let output = self.run(line);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{line}: {message}");
    }

    /// Runs a command that must fail with 1 and one line that holds all of `expected`, and
    /// leave every file as it was.
    pub fn refused(&self, line: &str, expected: &[&str]) {
        let before = self.contents();
        let output = self.run(line);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{line}: {message}");
        assert_eq!(message.trim_end().lines().count(), 1, "{line}: {message}");
        for part in expected {
            assert!(message.contains(part), "{line}: no {part:?} in {message}");
        }
        let after = self.contents();
        let changed: Vec<_> = (before.iter())
            .filter(|(name, bytes)| after.get(*name) != Some(bytes))
            .map(|(name, _)| name)
            .chain(after.keys().filter(|name| !before.contains_key(*name)))
            .collect();
        assert!(changed.is_empty(), "{line}: {changed:?}");
    }

    /// Every file of the folder.
    pub fn contents(&self) -> Contents {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let paths = entries.map(|entry| entry.unwrap().path());
        paths
            .filter(|path| path.is_file())
            .map(|path| {
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                (name, std::fs::read(path).unwrap())
            })
            .collect()
    }
}

/// `rows` samples of a standing machine under half its nominal torque.
fn recording(rows: usize) -> String {
    let mut text =
        "t [s],constant [µm/m],varying [µm/m],encoder [counts],index [counts],torque_main [kNm]\n"
            .to_owned();
    for i in 0..rows {
        let noise = [0.1, -0.2, 0.15, -0.05, 0.0][i % 5];
        let index = if i == 5 { "0" } else { "" };
        let (t, constant, varying) = (i as f64 / 500.0, 50.0 + noise, 63.507 - noise);
        text += &format!("{t:.3},{constant:.3},{varying:.3},0,{index},150\n");
    }
    text
}
