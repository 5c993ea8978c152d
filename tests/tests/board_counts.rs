//! `loadtwin life` on a bus: the real binary reads the counts that the boards' application keeps, over
//! a pseudo-terminal and from a log of that, and prints what it prints of a recording.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use loadtwin::key::SigningKey;
use loadtwin::machine::Machine;
use loadtwin::seal::seal;
use loadtwin_common::counting::{CountSample, MAX_COUNTED};
use loadtwin_common::hardware::EMULATED;
use loadtwin_common::io::frame::Frame;
use loadtwin_firmware::app::App;
use loadtwin_firmware::ram_flash::{COUNTS, LAYOUT, PAGE, RamFlash};
use loadtwin_firmware::room::Room;
use loadtwin_firmware::running_model::Models;
use loadtwin_firmware::slcan;
use loadtwin_firmware::upload::BLOCK_OVERHEAD;
use loadtwin_tests::emulator::{MACHINE_ID, flash};
use loadtwin_tests::{firmware::root, gearbox};
use serde_json::Value;
use serialport::{SerialPort as _, TTYPort};

/// Longest image (bytes).
const ROOM: usize = 64 * 1024;

/// Samples after which the board keeps its counts: 50 s at 2 kHz.
const SAMPLES: u32 = 100_000;

/// Turns of work in which a whole state is kept.
const KEEPING: usize = 400;

type Board = Models<RamFlash<Vec<u8>>, { PAGE + BLOCK_OVERHEAD }, ROOM, MAX_COUNTED>;

/// The counted loads at a tick [N m].
fn loads(tick: u32) -> [f32; MAX_COUNTED] {
    let t = f64::from(tick) / 2000.0;
    let torque = 300.0 * (0.7 * t).sin() + 80.0 * (13.1 * t).sin();
    [
        torque as f32,
        (-0.8 * torque + 20.0 * (31.0 * t).cos()) as f32,
    ]
}

/// A board that has counted [`SAMPLES`] and kept them.
fn board(description: &Path) -> Board {
    let machine = Machine::load(description).unwrap();
    let key = SigningKey::generate().unwrap();
    let payload = gearbox::image_of(&machine);
    let image = seal(&payload, MACHINE_ID, 1, None, Some(&key)).unwrap();
    let flash = RamFlash(flash(&key, &[image]));
    let identity = (Some(key.identity(MACHINE_ID)), EMULATED);
    let room = Box::leak(Box::new(Room::new()));
    let mut board = Board::boot(flash, (LAYOUT, COUNTS), identity, room).unwrap();
    let mut app = App::without_image();
    board.start(&mut app, vec![0; ROOM].leak());
    assert_eq!(app.refused(), 0);
    for tick in 0..SAMPLES {
        board.count(&CountSample {
            tick,
            advance: 1 << 20,
            loads: loads(tick),
        });
        if tick % 2 == 0 {
            board.poll(tick * 500);
        }
    }
    for _ in 0..KEEPING {
        board.poll(SAMPLES * 500);
    }
    board
}

/// Answers what comes over the serial line until `ends`; gives all frames as a log.
fn answer(board: &mut Board, mut line: TTYPort, ends: &AtomicBool) -> String {
    let begin = Instant::now();
    let mut log = String::new();
    let mut note = |frame: &Frame| {
        let bytes = frame.data.iter().fold(String::new(), |mut text, byte| {
            _ = write!(text, "{byte:02X}");
            text
        });
        let t = begin.elapsed().as_secs_f64();
        _ = writeln!(log, "({t:.6}) can0 {:03X}#{bytes}", frame.id);
    };
    let mut lines = slcan::Decoder::default();
    let mut bytes = [0; 256];
    while !ends.load(Ordering::Relaxed) {
        let count = line.read(&mut bytes).unwrap_or(0);
        for byte in &bytes[..count] {
            let Some(found) = lines.push(*byte) else {
                continue;
            };
            let slcan::Line::Frame(frame) = found else {
                line.write_all(b"\r").unwrap();
                continue;
            };
            note(&frame);
            let now_us = begin.elapsed().as_micros() as u32;
            let mut replies: Vec<Frame> = board.on_frame(&frame, now_us).into_iter().collect();
            let mut silent = 0;
            while silent < 3 {
                let reply = board.poll(now_us).reply;
                silent = if reply.is_some() { 0 } else { silent + 1 };
                replies.extend(reply);
            }
            for reply in &replies {
                note(reply);
                line.write_all(&slcan::encode(reply)).unwrap();
            }
        }
    }
    log
}

fn loadtwin(folder: &Path, command: &str, arguments: &[&str]) -> Output {
    let target =
        std::env::var("CARGO_TARGET_DIR").map_or_else(|_| root().join("target"), Into::into);
    let binary = std::env::var("LOADTWIN").map_or(target.join("release/loadtwin"), Into::into);
    Command::new(binary)
        .current_dir(folder)
        .args(["--json", command])
        .args(arguments)
        .output()
        .expect("loadtwin: run cargo build --release")
}

fn report(folder: &Path, arguments: &[&str]) -> Value {
    let output = loadtwin(folder, "life", arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refusal(folder: &Path, command: &str, arguments: &[&str]) -> String {
    let output = loadtwin(folder, command, arguments);
    assert_eq!(output.status.code(), Some(1));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What does not depend on the clock of the file.
fn counts(report: &Value) -> BTreeMap<String, Value> {
    let loads = report["loads"].as_object().unwrap();
    let counts = loads.iter().map(|(name, load)| {
        let mut machine = load["machines"][0].clone();
        for extreme in machine["extremes"].as_array_mut().unwrap() {
            extreme["t"] = Value::Null;
        }
        (name.clone(), serde_json::json!([machine, load["cycles"]]))
    });
    counts.collect()
}

/// `examples/bench` with these loads counted.
fn counting(loads: &[&str]) -> String {
    let bench = fs::read_to_string(root().join("examples/bench/machine.toml")).unwrap();
    loads.iter().fold(bench, |bench, load| {
        bench + &format!("\n[[count]]\nload = {load:?}\nrange = [-600.0, 600.0]\n")
    })
}

#[test]
fn build_refuses_more_loads_than_a_board_counts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("one.toml"), counting(&["motor_torque"])).unwrap();
    let two = counting(&["motor_torque", "brake_torque"]);
    fs::write(folder.join("two.toml"), two).unwrap();
    for (file, image, board) in [
        ("one.toml", "one.image", "nucleo-g474re"),
        ("two.toml", "two.image", "emulated"),
    ] {
        let built = loadtwin(folder, "build", &[file, "-o", image, "--board", board]);
        let said = String::from_utf8_lossy(&built.stderr);
        assert!(built.status.success(), "{file}, {board}: {said}");
    }
    let refused = [
        "two.toml",
        "-o",
        "refused.image",
        "--board",
        "nucleo-g474re",
    ];
    let said = refusal(folder, "build", &refused);
    assert!(!folder.join("refused.image").exists());
    assert!(
        said.contains("[[count]]: found 2 loads, allowed: up to 1"),
        "{said}"
    );
}

#[test]
fn life_prints_of_a_board_what_it_prints_of_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let described = counting(&["motor_torque", "brake_torque"]);
    fs::write(folder.join("plain.toml"), counting(&[])).unwrap();
    fs::write(folder.join("counting.toml"), described).unwrap();
    let mut rows = String::from("t [s],motor_torque [Nm],brake_torque [Nm]\n");
    for tick in 0..SAMPLES {
        let [motor, brake] = loads(tick);
        _ = writeln!(rows, "{:.4},{motor},{brake}", f64::from(tick) / 2000.0);
    }
    fs::write(folder.join("recording.csv"), rows).unwrap();

    let mut board = board(&folder.join("counting.toml"));
    let (mut adapter, terminal) = TTYPort::pair().expect("a pseudo-terminal");
    adapter.set_timeout(Duration::from_millis(20)).unwrap();
    let bus = format!("slcan:{}@500000", terminal.name().expect("a name"));
    let ends = AtomicBool::new(false);
    let of_machine = ["--machine", "counting.toml"];
    let (found, log) = thread::scope(|scope| {
        let answers = scope.spawn(|| answer(&mut board, adapter, &ends));
        let found = std::panic::catch_unwind(|| {
            report(folder, &[&[bus.as_str()], &of_machine[..]].concat())
        });
        ends.store(true, Ordering::Relaxed);
        (found.unwrap(), answers.join().unwrap())
    });
    let loads = ["--load", "motor_torque", "--load", "brake_torque"];
    let range = ["--range", "-600:600"];
    let recorded = report(folder, &[&["recording.csv"], &loads[..], &range].concat());
    assert_eq!(counts(&found), counts(&recorded));
    let motor = &found["loads"]["motor_torque"];
    assert_eq!(motor["machines"][0]["samples"]["seen"], SAMPLES);
    assert!(
        motor["machines"][0]["closed_cycles"].as_u64() > Some(50),
        "{motor}"
    );

    // The log of it; with a recording after it; gears, for a board counts turns.
    fs::write(folder.join("board.log"), &log).unwrap();
    let logged = report(folder, &[&["board.log"], &of_machine[..]].concat());
    assert_eq!(logged["loads"], found["loads"]);
    let both = report(
        folder,
        &[&["board.log", "recording.csv"], &of_machine[..]].concat(),
    );
    let samples = &both["loads"]["brake_torque"]["machines"][0]["samples"];
    assert_eq!(
        (&samples["seen"], &samples["restarts"]),
        (&(2 * SAMPLES).into(), &1.into())
    );
    let one = [&["board.log", "--gear", "6.6"], &loads[..2], &of_machine].concat();
    let torque = report(folder, &one)["loads"]["motor_torque"]["equivalent_torque"][0].as_f64();
    assert!(
        torque.is_some_and(|torque| (200.0..400.0).contains(&torque)),
        "{torque:?}"
    );

    let lines: Vec<&str> = log.lines().collect();
    fs::write(folder.join("cut.log"), lines[..lines.len() / 2].join("\n")).unwrap();
    for (arguments, expected) in [
        (&["board.log"][..], "--machine"),
        (&["board.log", "--machine", "plain.toml"], "[[count]]"),
        (
            &["board.log", "--machine", "counting.toml", "--gate", "9"],
            "[[count]]",
        ),
        (
            &["cut.log", "--machine", "counting.toml"],
            "no whole reading",
        ),
        (
            &["recording.csv", "--load", "motor_torque", "--gear", "6.6"],
            "--speed",
        ),
    ] {
        let said = refusal(folder, "life", arguments);
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
}
