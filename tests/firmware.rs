//! Build of the firmware's binaries for the boards by cargo, and the root of the project.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The workspace.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Builds the binary `program` for `board` and gives its path.
///
/// # Panics
/// Where it does not build.
pub fn build(board: &str, program: &str) -> PathBuf {
    build_with(board, program, &[])
}

/// As [`build`], with `features` and the files that variables name in `environment`.
///
/// # Panics
/// Where it does not build.
pub fn build_with(features: &str, program: &str, environment: &[(&str, &Path)]) -> PathBuf {
    const TARGET: &str = "thumbv7em-none-eabihf";
    let status = Command::new(env!("CARGO"))
        .current_dir(root())
        .args([
            "build",
            "--quiet",
            "--profile",
            "firmware",
            "--target",
            TARGET,
        ])
        .args(["-p", "loadtwin-firmware", "--features", features])
        .args(["--bin", program])
        .envs(environment.iter().copied())
        // In pieces the code is inlined otherwise, and instruction counts are others.
        .env("CARGO_INCREMENTAL", "0")
        .status()
        .expect("cargo starts");
    assert!(status.success(), "{program} for {features} does not build");
    target().join(TARGET).join("firmware").join(program)
}

/// Where cargo puts what it builds.
pub fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from)
}
