//! The Python package, as it is installed: put together from the library that was built and the
//! modules beside it, and tested by a Python with `tests/requirements.txt`.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Python of `LOADTWIN_PYTHON`, or the one that `tests/run` sets up.
fn python() -> PathBuf {
    std::env::var_os("LOADTWIN_PYTHON")
        .map_or_else(|| root().join("target/venv/bin/python"), PathBuf::from)
}

/// A folder with the package.
fn package() -> TempDir {
    let folder = TempDir::new().unwrap();
    let package = folder.path().join("loadtwin");
    std::fs::create_dir(&package).unwrap();
    let modules = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/loadtwin");
    for module in std::fs::read_dir(modules).unwrap() {
        let module = module.unwrap().path();
        if module.is_file() {
            std::fs::copy(&module, package.join(module.file_name().unwrap())).unwrap();
        }
    }
    // The library lies beside the test that was built with it.
    let built = std::env::current_exe().unwrap();
    let library = built.parent().unwrap().join("lib_loadtwin.so");
    std::fs::copy(&library, package.join("_loadtwin.abi3.so"))
        .unwrap_or_else(|error| panic!("{}: {error}", library.display()));
    folder
}

fn run(arguments: &[&str]) {
    let folder = package();
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    // Beside the tests lies the command, with whose figures they compare.
    let built = std::env::current_exe().unwrap();
    let command = built.parent().unwrap().parent().unwrap().join("loadtwin");
    let output = Command::new(python())
        .args(arguments)
        .current_dir(root())
        .env("LOADTWIN", command)
        .env("MPLBACKEND", "agg")
        .env(
            "PYTHONPATH",
            std::env::join_paths([folder.path(), &tests]).unwrap(),
        )
        .output()
        .unwrap_or_else(|error| panic!("{}: {error}; tests/run sets it up", python().display()));
    let said = String::from_utf8_lossy(&output.stderr);
    let also = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{also}\n{said}");
    println!("{also}\n{said}");
}

#[test]
fn tables_of_every_library_give_the_estimates_of_the_command() {
    run(&["-m", "unittest", "-v", "test_replay"]);
}

#[test]
fn wrong_input_is_an_exception() {
    run(&["-m", "unittest", "-v", "test_refused"]);
}

#[test]
fn examples_in_docstrings_run() {
    run(&["-m", "unittest", "-v", "test_docstrings"]);
}

#[test]
fn notebooks_run() {
    run(&["-m", "unittest", "-v", "test_notebooks"]);
}
