//! Firmware in the loop: samples of the emulated board over slcan and `SocketCAN`, recomputed
//! bit for bit by `loadtwin twin`.

use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use loadtwin::key::SigningKey;
use loadtwin::seal::seal;
use loadtwin_firmware::stimulus::Stimulus;
use loadtwin_tests::emulator::{Emulator, MACHINE_ID, flash};
use loadtwin_tests::gearbox::{image, samples};
use serde_json::Value;

/// Seconds of the board's samples, or `LOADTWIN_SECONDS`.
const SECONDS: u32 = 20;
/// Samples a second of the board.
const RATE_HZ: u32 = 1000;
/// For the guest to start on a busy machine.
const PATIENCE: Duration = Duration::from_mins(10);

fn read(out: &Path, name: &str) -> String {
    std::fs::read_to_string(out.join(name)).unwrap_or_default()
}

fn json(out: &Path, name: &str) -> Value {
    serde_json::from_str(&read(out, &format!("{name}.json")))
        .unwrap_or_else(|_| panic!("{name}: {}", read(out, &format!("{name}.err"))))
}

#[test]
fn samples_of_the_emulated_board_are_recomputed_bit_for_bit_on_a_real_socket() {
    let seconds = loadtwin_tests::seconds(SECONDS);
    let count = RATE_HZ * seconds;
    let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/rig");
    let target = concat!(env!("CARGO_MANIFEST_DIR"), "/../target");
    let place = tempfile::Builder::new()
        .prefix("can-mcu.")
        .tempdir_in(target)
        .expect("a directory that the guest sees");
    let out = place.path();
    let model = image();
    let path = out.join("model.image");

    // Without the samples lost on purpose: nothing may be missing.
    let mut samples = samples(count + count / 900);
    samples.truncate(count as usize);
    for (tick, sample) in (0..).zip(&mut samples) {
        sample.tick = tick;
    }

    let key = SigningKey::generate().unwrap();
    let image = seal(&model, MACHINE_ID, 1, None, Some(&key)).unwrap();
    let board = Emulator::start_flash(&flash(&key, std::slice::from_ref(&image)));
    std::fs::write(&path, &image).unwrap();
    let bus = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = bus.local_addr().unwrap().port();
    board.relay(bus);
    let mut guest = Command::new(format!("{rig}/can-guest"))
        .arg("--mcu")
        .arg(port.to_string())
        .arg(format!("{rig}/can-mcu"))
        .args([out, &path])
        .arg(count.to_string())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("tests/rig/can-guest starts");

    // The first frame that the board sends must find the twin there.
    let latest = Instant::now() + PATIENCE;
    while !out.join("listening").exists() {
        let ended = guest.try_wait().expect("the guest is ours");
        assert!(
            ended.is_none() && Instant::now() < latest,
            "nobody listens on slcan0; the guest: {ended:?}"
        );
        thread::sleep(Duration::from_millis(50));
    }
    let mut sensors = board.sensors();
    let sent = thread::spawn(move || {
        sensors.send(&Stimulus::SendRaw(true));
        for sample in samples {
            sensors.send(&Stimulus::Sample(sample));
        }
        sensors
    });
    let run = guest.wait_with_output().expect("the guest is ours");
    let said = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success(), "{}\n{said}", run.status);
    // Not before: the end of the board takes slcan0 away.
    sent.join().unwrap().send(&Stimulus::End);
    let end = board.end(Duration::from_secs(20));
    assert!(end.status.success(), "{}\n{}", end.status, end.log);

    let seconds = |name: &str| read(out, name).trim().parse::<f64>().expect("a time");
    let took = seconds("ended") - seconds("began");
    let link = read(out, "link");
    for name in ["twin", "prove"] {
        let found = json(out, name);
        println!("{name}: {found}");
        assert_eq!(found["verdict"], "identical", "{name}: {found}\n{link}");
        assert_eq!(found["samples"], count, "{name}: {found}\n{link}");
        for none in [
            "differing_bits",
            "lost_frames",
            "unverifiable_frames",
            "missing_ticks",
            "incomplete_samples",
            "damaged_frames",
            "lost_status",
        ] {
            assert_eq!(found[none], 0, "{name}: {none}");
        }
        assert!(found["compared_frames"].as_u64() >= Some(u64::from(2 * count)));
    }
    println!("{count} samples in {took:.1} s\n{link}");
}
