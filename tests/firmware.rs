//! The firmware's binaries.

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
        .args(["-p", "loadtwin-firmware", "--features", board])
        .args(["--bin", program])
        .status()
        .expect("cargo starts");
    assert!(status.success(), "the firmware for {board} does not build");
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    target.join(TARGET).join("firmware").join(program)
}
