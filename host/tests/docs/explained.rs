//! `loadtwin explain` of flags, effects and of the errors that the command itself prints.

use std::path::Path;
use std::process::{Command, Output};

use crate::root;

/// Runs `loadtwin` in `folder`.
fn loadtwin(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn explained(folder: &Path, term: &str) -> String {
    String::from_utf8(loadtwin(folder, &["explain", term]).stdout).unwrap()
}

#[test]
fn flags_and_effects_are_explained_by_name() {
    let folder = root();
    assert!(explained(&folder, "stuck").contains("too many equal readings"));
    assert!(explained(&folder, "gauge-creep").contains("Record: a long hold"));
    let unknown = loadtwin(&folder, &["explain", "nosuch"]);
    assert_eq!(unknown.status.code(), Some(1));
}

/// The next step of each error is found by the line that the command prints.
#[test]
fn errors_are_explained_by_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let description = std::fs::read_to_string(root().join("examples/bench/machine.toml")).unwrap();
    write("machine.toml", &description);
    write("field.toml", &description.replace("rate_hz", "rate_hs"));
    write(
        "rate.toml",
        &description.replace("rate_hz = 2000", "rate_hz = 1000"),
    );
    let made = [
        "simulate",
        "machine.toml",
        "--duration-s",
        "1",
        "-o",
        "good.csv",
    ];
    assert!(loadtwin(folder, &made).status.success());
    let good = std::fs::read_to_string(folder.join("good.csv")).unwrap();
    write("empty.csv", "");
    write("name.csv", &good.replacen("left_upper", "lu", 1));
    let (before, last) = good.rsplit_once(',').unwrap();
    write("cell.csv", &format!("{before},x{last}"));
    for (line, says) in [
        (
            "replay machine.toml absent.csv",
            "relative to another folder",
        ),
        ("replay machine.toml empty.csv", "has no rows"),
        ("replay machine.toml name.csv", "the file has other names"),
        ("replay machine.toml cell.csv", "a cell holds no number"),
        ("replay rate.toml good.csv", "its rate is not"),
        ("replay field.toml good.csv", "a key is misspelt"),
        (
            "replay machine.toml good.csv --sensors none",
            "the name is not described",
        ),
        (
            "replay machine.toml good.csv --report r.pdf",
            "of another kind of file",
        ),
        (
            "replay machine.toml good.csv --report none/r.html",
            "folders are not made",
        ),
        (
            "replay machine.toml good.csv --estimates good.csv",
            "are one file",
        ),
        (
            "calibrate machine.toml good.csv good.csv",
            "would count twice",
        ),
        (
            "simulate machine.toml --scenario none -o s.csv",
            "outside its range",
        ),
        ("diagnose machine.toml good.csv", "too few samples"),
    ] {
        let arguments: Vec<&str> = line.split(' ').collect();
        let failed = loadtwin(folder, &arguments);
        let error = String::from_utf8(failed.stderr).unwrap();
        assert_eq!(failed.status.code(), Some(1), "{line}: {error}");
        let found = explained(folder, error.trim());
        assert_eq!(found.lines().count(), 1, "{error}{found}");
        assert!(
            found.contains(says) && found.contains("next step: "),
            "{error}{found}"
        );
    }
}
