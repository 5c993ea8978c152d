//! Descriptions with sensor sets that `loadtwin replay` refuses.

use std::process::Command;

/// The index of an encoder that is in no set homes none of their maps.
#[test]
fn a_map_that_the_set_does_not_home_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/gearbox");
    let text = std::fs::read_to_string(format!("{examples}/calibrated.toml")).unwrap();
    let of_main = "encoder = \"encoder_main\"";
    assert_eq!(text.matches(of_main).count(), 1);
    let text = (text.replace(of_main, "encoder = \"encoder_hss\""))
        .replace("\"calibrated-", &format!("\"{examples}/calibrated-"))
        .replace(
            "\"sensitivity.csv",
            &format!("\"{examples}/sensitivity.csv"),
        );
    let machine = folder.path().join("other.toml");
    std::fs::write(&machine, text).unwrap();
    let recording = format!("{examples}/start-stop.parquet");
    for words in [["replay"].as_slice(), &["build", "-o", "never.image"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
        command.arg(words[0]).arg(&machine).args(&words[1..]);
        if words[0] == "replay" {
            command.arg(&recording);
        }
        let output = command.current_dir(folder.path()).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{words:?}: {message}");
        for part in ["torque-arm-3", "encoder_hss", "does not home"] {
            assert!(
                message.contains(part),
                "{words:?}: no {part:?} in {message}"
            );
        }
    }
    assert!(!folder.path().join("never.image").exists());
}
