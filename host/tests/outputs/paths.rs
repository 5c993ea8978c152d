//! Paths that are not Unicode, in every command that prints them as JSON.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::process::{Command, Output};

use serde_json::Value;

/// A folder whose name is no Unicode.
struct Folder {
    outer: tempfile::TempDir,
}

impl Folder {
    fn new() -> Self {
        let folder = Self {
            outer: tempfile::tempdir().unwrap(),
        };
        std::fs::create_dir(folder.path("")).unwrap();
        let map = include_bytes!("../data/two_inertias_map.csv");
        std::fs::write(folder.path("two_inertias_map.csv"), map).unwrap();
        let machine = include_bytes!("../data/two_inertias.toml");
        std::fs::write(folder.path("machine.toml"), machine).unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.outer
            .path()
            .join(OsStr::from_bytes(b"caf\xe9"))
            .join(name)
    }

    /// Runs `loadtwin --json`; words that start with `@` are files in the folder.
    fn run(&self, words: &[&str]) -> Output {
        let argument = |word: &&str| match word.strip_prefix('@') {
            Some(name) => self.path(name).into_os_string(),
            None => OsString::from(word),
        };
        Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .args(words.iter().map(argument))
            .arg("--json")
            .current_dir(self.outer.path())
            .output()
            .unwrap()
    }

    #[track_caller]
    fn done(&self, words: &[&str]) -> Value {
        let output = self.run(words);
        let reason = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{words:?}: {reason}");
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

#[test]
fn paths_that_are_no_unicode_are_printed_with_replacements() {
    let folder = Folder::new();
    let machine = "@machine.toml";
    let scenario = ["--scenario", "torque-ramps", "--duration-s", "60"];
    let simulate = [&["simulate", machine][..], &scenario, &["-o", "@r.csv"]].concat();
    let simulated = folder.done(&simulate);
    let name = simulated["recording"].as_str().unwrap();
    assert!(name.ends_with("caf\u{fffd}/r.csv"), "{name}");
    let replayed = folder.done(&["replay", machine, "@r.csv"]);
    assert!(
        replayed["recording"]
            .as_str()
            .unwrap()
            .ends_with("caf\u{fffd}/r.csv")
    );
    folder.done(&["build", machine, "-o", "@image.bin"]);
    folder.done(&["key", "--machine", "bench", "-o", "@bench.pem"]);
    for words in [
        &["calibrate", machine, "@r.csv", "-o", "@calibrated.toml"][..],
        &["tune", machine, "@r.csv", "--keep-r", "-o", "@tuned.toml"],
        &["diagnose", machine, "@r.csv", "-o", "@better.toml"],
        &["zero", machine, "@r.csv", "-o", "@zeroed.toml"],
        &["reduce", machine, "@r.csv", "-o", "@maps.csv"],
    ] {
        let output = folder.run(words);
        // What cannot be done is a reason, not a panic.
        let code = output.status.code();
        let reason = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(code, Some(0..=2)), "{words:?}: {code:?} {reason}");
        if code == Some(0) {
            let _: Value = serde_json::from_slice(&output.stdout).unwrap();
        }
    }
    assert!(folder.path("calibrated.toml").exists() && folder.path("tuned.toml").exists());
}
