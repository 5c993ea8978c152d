//! `loadtwin node`, `send` and `twin` over real sockets, with can-utils and python-can beside
//! them.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

const MACHINE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/gearbox/machine.toml"
);

fn loadtwin() -> String {
    std::env::var("LOADTWIN").unwrap_or_else(|_| {
        let target = std::env::var("CARGO_TARGET_DIR")
            .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../target").to_owned());
        format!("{target}/release/loadtwin")
    })
}

fn json(out: &Path, name: &str) -> Value {
    let text =
        |end: &str| std::fs::read_to_string(out.join(format!("{name}.{end}"))).unwrap_or_default();
    serde_json::from_str(&text("json"))
        .unwrap_or_else(|_| panic!("{name} printed no result: {}", text("err")))
}

fn count(value: &Value, key: &str) -> u64 {
    value[key]
        .as_u64()
        .unwrap_or_else(|| panic!("{key} in {value}"))
}

#[test]
fn twin_and_node_agree_on_a_real_bus_and_outlive_what_happens_to_it() {
    let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/rig");
    // In the project, because the guest writes only there.
    let parent = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/rig");
    std::fs::create_dir_all(parent).expect("target/rig");
    let folder = tempfile::tempdir_in(parent).expect("a folder");
    let out = folder.path();
    let recording = out.join("recording.parquet");
    let simulated = Command::new(loadtwin())
        .args(["simulate", MACHINE, "--duration-s", "4", "-o"])
        .arg(&recording)
        .output()
        .expect("loadtwin: run cargo build --release -p loadtwin");
    assert!(
        simulated.status.success(),
        "{}",
        String::from_utf8_lossy(&simulated.stderr)
    );
    let run = Command::new(format!("{rig}/can-guest"))
        .arg(format!("{rig}/can-twin"))
        .args([out.as_os_str(), MACHINE.as_ref(), recording.as_os_str()])
        .env("LOADTWIN", loadtwin())
        .output()
        .expect("tests/rig/can-guest starts");
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(
        run.status.success(),
        "{}\n{said}{}",
        run.status,
        String::from_utf8_lossy(&run.stderr)
    );

    // A flood of foreign frames: counted, and every bit compared all the same.
    let (twin, node, send) = (
        json(out, "clean-twin"),
        json(out, "clean-node"),
        json(out, "clean-send"),
    );
    assert_eq!(twin["verdict"], "identical", "{twin}\n{node}\n{send}");
    assert_eq!(
        (count(&send, "samples"), count(&node, "samples")),
        (2000, 2000)
    );
    assert_eq!(count(&twin, "samples"), 2000);
    assert!(count(&twin, "compared_frames") >= 4000 && count(&twin, "foreign_frames") > 0);
    for key in [
        "differing_bits",
        "lost_frames",
        "unverifiable_frames",
        "missing_ticks",
    ] {
        assert_eq!(count(&twin, key), 0, "{key}");
    }
    for log in ["prove-candump", "prove-python", "prove-clean"] {
        let proof = json(out, log);
        assert_eq!(proof["verdict"], "identical", "{log}: {proof}");
        assert_eq!(
            count(&proof, "compared_frames"),
            count(&twin, "compared_frames"),
            "{log}"
        );
    }

    // Broken frames, and the interface down and up: nothing ends, nothing is
    // held against the machine that it did not do.
    for command in ["node", "twin", "monitor"] {
        let status =
            std::fs::read_to_string(out.join(format!("rough-{command}.status"))).expect("status");
        let expected = if command == "twin" { "1" } else { "0" };
        assert_eq!(status.trim(), expected, "{command}");
    }
    let twin = json(out, "rough-twin");
    assert_eq!(twin["verdict"], "incomplete", "{twin}");
    assert_eq!(count(&twin, "differing_frames"), 0);
    assert!(
        count(&twin, "malformed_frames") > 0 && count(&twin, "damaged_frames") > 0,
        "{twin}"
    );
    assert!(
        count(&twin["bus"], "down") > 0 && count(&twin["bus"], "recovered") > 0,
        "{twin}"
    );
    assert!(count(&twin, "compared_frames") > 1000, "{twin}");
}
