//! Build script: gives the linker the memory layout and the linker scripts of the board whose
//! feature is on, and the entry point of the check `panic_free`. Does nothing for the host.

use std::env;
use std::fs;
use std::path::PathBuf;

fn main() {
    println!("cargo:rerun-if-changed=memory");
    println!("cargo:rustc-check-cfg=cfg(control)");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    if env::var_os("CARGO_FEATURE_PANIC_FREE").is_some() {
        println!("cargo:rustc-link-arg-bin=panic_free=--entry=on_data_ready");
        return;
    }
    let board = ["emulated", "nucleo-g474re"].into_iter().find(|board| {
        let feature = board.to_uppercase().replace('-', "_");
        env::var_os(format!("CARGO_FEATURE_{feature}")).is_some()
    });
    let Some(board) = board else { return };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(format!("memory/{board}.x"), out.join("memory.x")).expect("the board has a memory.x");
    println!("cargo:rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    let logging: &[&str] = match board {
        "emulated" => &["emulated", "overflow"],
        _ => &["nucleo_g474re"],
    };
    for program in logging {
        println!("cargo:rustc-link-arg-bin={program}=-Tdefmt.x");
    }
}
