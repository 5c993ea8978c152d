//! Link test that no panic is reachable from the step of the application at a data-ready interrupt
//! (the queue to the bus left out), and that one would be found.

use std::process::{Command, Output};

fn link(extra: &[&str]) -> Output {
    Command::new(env!("CARGO"))
        .current_dir(loadtwin_tests::firmware::root())
        .args(["rustc", "--quiet", "--profile", "firmware"])
        .args([
            "--target",
            "thumbv7em-none-eabihf",
            "-p",
            "loadtwin-firmware",
        ])
        .args(["--bin", "panic_free", "--features", "panic-free", "--"])
        .args(extra)
        .output()
        .expect("cargo starts")
}

#[test]
fn a_data_ready_links_without_a_panic() {
    let linked = link(&[]);
    assert!(
        linked.status.success(),
        "{}",
        String::from_utf8_lossy(&linked.stderr)
    );
}

#[test]
fn a_panic_would_not_link() {
    let refused = link(&["--cfg", "control"]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(
        !refused.status.success() && said.contains("a_panic_is_reachable"),
        "{said}"
    );
}
