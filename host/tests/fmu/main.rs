//! The estimator as an FMU in `FMPy`, another implementation of the standard: validation, the bits
//! of `replay` for every kind of machine, saved states, refused calls; refusals of the command.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

#[path = "../reference/python.rs"]
mod python;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn loadtwin(folder: &Path, arguments: &[&str]) -> Output {
    (Command::new(env!("CARGO_BIN_EXE_loadtwin")).args(arguments))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Standard output of a command that must succeed.
fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = loadtwin(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

/// Standard error of a command that must fail.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = loadtwin(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// Output of a Python script on files of a folder.
fn peer(folder: &Path, script: &str, files: &[&str]) -> String {
    let files: Vec<PathBuf> = files.iter().map(|file| folder.join(file)).collect();
    let files: Vec<_> = files.iter().map(|file| file.as_os_str()).collect();
    String::from_utf8(python::output(script, &files)).unwrap()
}

/// Builds the FMU of a machine and compares it with `replay`; gives the number of rows, and the part
/// of them in which a load is valid.
fn compare(machine: &str, recording: &str, folder: &TempDir, options: &[&str]) -> (usize, f64) {
    let folder = folder.path();
    let estimates = [
        "replay",
        machine,
        recording,
        "--estimates",
        "estimates.parquet",
        "--force",
    ];
    done(folder, &estimates);
    let build = ["build", machine, "--fmu", "machine.fmu", "--force"];
    done(folder, &[&build[..], options].concat());
    let output = peer(
        folder,
        "fmu_compare.py",
        &["machine.fmu", recording, "estimates.parquet"],
    );
    // FMPy prints messages of FMI 2.0 before.
    let last = output.trim().lines().last().unwrap();
    let (rows, valid) = last.split_once(' ').unwrap();
    (rows.parse().unwrap(), valid.parse().unwrap())
}

fn example(name: &str) -> String {
    let path = root().join("examples").join(name);
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_gearbox_has_the_bits_of_replay() {
    let folder = TempDir::new().unwrap();
    let recording = example("gearbox/start-stop.parquet");
    let (rows, valid) = compare(
        &example("gearbox/calibrated.toml"),
        &recording,
        &folder,
        &[],
    );
    assert_eq!(rows, 45_000);
    assert!(valid > 0.9, "{valid}");
}

#[test]
fn rotor_and_bearing_have_the_bits_of_replay_in_both_versions_of_fmi() {
    for machine in ["rotor/machine.toml", "bearing/calibrated.toml"] {
        let folder = TempDir::new().unwrap();
        let machine = example(machine);
        let recording = "recording.parquet";
        let simulate = ["simulate", &machine, "-o", recording, "--duration-s", "4"];
        let individual = ["--individual", "101", "--seed", "2"];
        done(folder.path(), &[&simulate[..], &individual].concat());
        for version in ["3.0", "2.0"] {
            let (rows, valid) = compare(&machine, recording, &folder, &["--fmi", version]);
            assert_eq!(rows, 8000);
            assert!(valid > 0.5, "{machine} {version}: {valid}");
        }
    }
}

#[test]
fn a_drive_has_the_bits_of_replay() {
    let folder = TempDir::new().unwrap();
    let described = std::fs::read_to_string(example("feed-drive/drive.toml")).unwrap();
    let described = described.replace("[balance]\n", "[balance]\nnominal = 1.0\n");
    let machine = folder.path().join("drive.toml");
    std::fs::write(&machine, described).unwrap();
    let plant = example("feed-drive/plant.toml");
    let simulate = [
        "simulate",
        &plant,
        "--scenario",
        "reversals",
        "-o",
        "drive.parquet",
    ];
    done(
        folder.path(),
        &[&simulate[..], &["--duration-s", "20"]].concat(),
    );
    let (rows, valid) = compare("drive.toml", "drive.parquet", &folder, &[]);
    assert_eq!(rows, 4000);
    assert!(valid > 0.5, "{valid}");
}

/// Missing readings are not delivered, and a signed image runs as one that is not.
#[test]
fn readings_that_are_missing_have_the_bits_of_replay() {
    let folder = TempDir::new().unwrap();
    let recording = example("gearbox/start-stop.parquet");
    let holes = format!(
        "import pyarrow.parquet as pq, pyarrow as pa, sys\n\
         t = pq.read_table({recording:?}).slice(20000, 6000)\n\
         f = t.schema.field('ta1')\n\
         v = [None if 2000 <= i < 2300 or i % 97 == 0 else x for i, x in enumerate(t['ta1'].to_pylist())]\n\
         t = t.set_column(t.schema.get_field_index('ta1'), f, pa.array(v, f.type))\n\
         pq.write_table(t, 'holes.parquet')"
    );
    let written = (Command::new(python::python()).args(["-c", &holes]))
        .current_dir(folder.path())
        .status();
    assert!(written.unwrap().success());
    done(folder.path(), &["key", "--machine", "any", "-o", "key"]);
    let machine = example("gearbox/calibrated.toml");
    let (rows, _) = compare(&machine, "holes.parquet", &folder, &["--key", "key"]);
    assert_eq!(rows, 6000);
}

#[test]
fn wrong_calls_are_errors_and_the_instance_goes_on() {
    let folder = TempDir::new().unwrap();
    let machine = example("gearbox/calibrated.toml");
    done(folder.path(), &["build", &machine, "--fmu", "a.fmu"]);
    let other = example("bearing/calibrated.toml");
    done(folder.path(), &["build", &other, "--fmu", "b.fmu"]);
    let recording = example("gearbox/start-stop.parquet");
    let output = peer(
        folder.path(),
        "fmu_refused.py",
        &["a.fmu", &recording, "b.fmu"],
    );
    assert_eq!(output, "refused\n");
}

#[test]
fn the_image_in_an_fmu_is_the_image_and_nothing_of_the_users_is_replaced() {
    let folder = TempDir::new().unwrap();
    let here = folder.path();
    let machine = example("gearbox/calibrated.toml");
    let both = [
        "build", &machine, "-o", "a.image", "--fmu", "a.fmu", "--issue", "7", "--json",
    ];
    let printed = done(here, &both);
    let printed: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(printed["fmu"]["fmi"], "3.0");
    let size = std::fs::metadata(here.join("a.fmu")).unwrap().len();
    assert_eq!(printed["fmu"]["bytes"], size);
    assert!(size < 4_000_000, "{size}");
    let unpack = "import zipfile, sys; z = zipfile.ZipFile('a.fmu'); z.testzip(); \
                  sys.exit(z.read('resources/machine.image') != open('a.image', 'rb').read())";
    let same = (Command::new(python::python()).args(["-c", unpack]))
        .current_dir(here)
        .status();
    assert!(same.unwrap().success());
    // Its own output is replaced, another file is not.
    done(here, &["build", &machine, "--fmu", "a.fmu"]);
    std::fs::write(here.join("mine.fmu"), "mine").unwrap();
    let said = refused(
        here,
        &["build", &machine, "-o", "b.image", "--fmu", "mine.fmu"],
    );
    assert!(said.contains("mine.fmu"), "{said}");
    assert_eq!(std::fs::read(here.join("mine.fmu")).unwrap(), b"mine");
    assert!(!here.join("b.image").exists());
}

#[test]
fn the_library_lies_beside_the_command_or_is_given() {
    let folder = TempDir::new().unwrap();
    let here = folder.path();
    let machine = example("gearbox/calibrated.toml");
    let built = Path::new(env!("CARGO_BIN_EXE_loadtwin"));
    let library = built.parent().unwrap().join("deps/libloadtwin_fmu.so");
    let command = here.join("loadtwin");
    std::fs::copy(built, &command).unwrap();
    let run = |more: &[&str]| {
        let build = ["build", &machine, "--fmu", "a.fmu"];
        let output = (Command::new(&command).args(build).args(more))
            .current_dir(here)
            .output();
        let output = output.unwrap();
        (
            output.status.code(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    let (code, said) = run(&[]);
    assert_eq!(code, Some(1));
    for word in [
        "libloadtwin_fmu.so",
        "not found",
        "cargo build --release",
        "--library",
    ] {
        assert!(said.contains(word), "{said}");
    }
    assert!(!here.join("a.fmu").exists());
    assert_eq!(
        run(&["--library", library.to_str().unwrap()]),
        (Some(0), String::new())
    );
    std::fs::copy(&library, here.join("libloadtwin_fmu.so")).unwrap();
    assert_eq!(run(&[]), (Some(0), String::new()));
    // Another library, no library, a part of it.
    let whole = std::fs::read(&library).unwrap();
    std::fs::write(here.join("part.so"), &whole[..1000]).unwrap();
    for wrong in [built.to_str().unwrap(), &machine, "part.so", "absent.so"] {
        let (code, said) = run(&["--library", wrong]);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains(wrong), "{said}");
    }
}
