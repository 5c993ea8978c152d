//! Source rules for equal bits on board and host: transcendental functions come from `libm`
//! only.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use loadtwin_tests::firmware::root;

/// Features of `dependency` as the host program is built.
fn features(dependency: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .current_dir(root())
        .args([
            "tree",
            "--offline",
            "-p",
            "loadtwin",
            "-e",
            "normal,features",
            "--prefix",
            "none",
        ])
        .args(["-i", dependency])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let prefix = format!("{dependency} feature \"");
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter_map(|line| Some(line.strip_prefix(&prefix)?.split('"').next()?.to_owned()))
        .collect()
}

/// The source files of `common`.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn nalgebra_takes_its_functions_from_libm_alone() {
    let nalgebra = features("nalgebra");
    assert!(nalgebra.contains("libm-force"), "{nalgebra:?}");
    assert!(!nalgebra.contains("std"), "{nalgebra:?}");
    let simba = features("simba");
    assert!(simba.contains("libm_force"), "{simba:?}");
    assert!(!simba.contains("std"), "{simba:?}");
}

#[test]
fn common_calls_no_function_that_differs_between_targets() {
    let functions = [
        "sin",
        "cos",
        "sin_cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "exp2",
        "exp_m1",
        "ln",
        "ln_1p",
        "log",
        "log2",
        "log10",
        "powf",
        "powi",
        "cbrt",
        "hypot",
        "mul_add",
        "norm",
        "rem_euclid",
    ];
    let mut files = Vec::new();
    sources(&root().join("common/src"), &mut files);
    assert!(files.len() > 20, "{files:?}");
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        // Tests run on the host alone.
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for (i, line) in code.lines().enumerate() {
            let line = line.split("//").next().unwrap_or_default();
            let place = format!("{}:{}: {line}", file.display(), i + 1);
            for function in functions {
                assert!(!line.contains(&format!(".{function}(")), "{place}");
            }
            for dynamic in ["DMatrix", "DVector", "Dyn>", "Dyn,"] {
                assert!(!line.contains(dynamic), "{place}");
            }
        }
    }
}
