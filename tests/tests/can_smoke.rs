//! The `SocketCAN` rig itself.

use std::process::Command;

#[test]
fn real_sockets_carry_frames_between_can_utils_and_python_can() {
    let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/rig");
    let run = Command::new(format!("{rig}/can-guest"))
        .arg(format!("{rig}/can-smoke"))
        .output()
        .expect("tests/rig/can-guest starts");
    assert!(
        run.status.success(),
        "{}\n{}{}",
        run.status,
        String::from_utf8_lossy(&run.stdout),
        String::from_utf8_lossy(&run.stderr)
    );
}
