//! Decodes frames by the DBC files, general and of one machine, with another library (cantools):
//! the numbers are those that were encoded.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::{Command, Stdio};

use loadtwin::can::dbc::{DBC, LoadScale, of_machine};
use loadtwin_common::io::estimate::{Estimate, LoadEstimate, SensorEstimate};
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::frame;
use loadtwin_common::io::frame::{Frame, FrameEncoder, Message, State, Status};
use loadtwin_common::io::raw::RawSample;
use serde_json::Value;

use crate::python;

/// Decodes `ID HEX` lines with cantools and `dbc`; one object for each line,
/// raw numbers and physical ones.
const DECODE: &str = r#"
import cantools, json, sys
db = cantools.database.load_file(sys.argv[1], strict=True)
for line in sys.stdin:
    id, data = line.split()
    id, data = int(id, 16), bytes.fromhex(data)
    message = db.get_message_by_frame_id(id)
    raw = message.decode(data, scaling=False, decode_choices=False)
    scaled = message.decode(data, decode_choices=False)
    print(json.dumps({"name": message.name, "raw": raw, "scaled": scaled}))
"#;

fn decode(dbc: &str, frames: &[(u16, Vec<u8>)]) -> Vec<Value> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("loadtwin.dbc");
    std::fs::write(&path, dbc).expect("written");
    let mut child = Command::new(python::python())
        .args(["-c", DECODE])
        .arg(&path)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python with cantools: set LOADTWIN_PYTHON, or run tests/run");
    let mut input = String::new();
    for (id, data) in frames {
        let _ = write!(input, "{id:X} ");
        for byte in data {
            let _ = write!(input, "{byte:02X}");
        }
        input.push('\n');
    }
    let mut stdin = child.stdin.take().expect("piped");
    let writer = std::thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().expect("python ends");
    writer.join().expect("joined").expect("written");
    assert!(
        output.status.success(),
        "cantools refuses the DBC or a frame"
    );
    let decoded: Vec<Value> = String::from_utf8(output.stdout)
        .expect("text")
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(decoded.len(), frames.len());
    decoded
}

/// Estimates that reach every code, from a generator of one's own.
fn estimates(count: u32) -> impl Iterator<Item = Estimate> {
    let mut seed = 7_u32;
    let mut next = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        seed >> 8
    };
    (0..count).map(move |tick| {
        let mut estimate = Estimate {
            tick,
            homed: tick % 3 == 0,
            ..Estimate::default()
        };
        for _ in 0..2 {
            let bad = match next() % 50 {
                0 => f32::NAN,
                1 => f32::INFINITY,
                2 => 1e9,
                3 => -1e9,
                _ => 0.0,
            };
            let load = LoadEstimate {
                value: (next() as f32 / 8_388_608.0 - 1.0) * 2600.0 + bad,
                std: next() as f32 / 16_777_216.0 * 900.0 + bad.abs(),
                age: (next() >> (next() % 24)) as u16,
                fault: Fault::ALL[next() as usize % Fault::ALL.len()],
            };
            estimate.loads.push(load).expect("room");
        }
        for _ in 0..10 {
            let innovation = next() as f32 / 8_388_608.0 - 1.0;
            let innovation_variance = next() as f32 / 16_777_216.0 * 0.01;
            let nis = innovation * innovation / innovation_variance;
            let fault = Fault::ALL[next() as usize % Fault::ALL.len()];
            let sensor = SensorEstimate {
                innovation,
                innovation_variance,
                nis,
                fault,
                ..Default::default()
            };
            estimate.sensors.push(sensor).expect("room");
        }
        estimate
    })
}

const FULL_SCALES: [f32; 2] = [2500.0, 0.1];

fn frames(base: u16) -> Vec<Frame> {
    let mut encoder = FrameEncoder::try_new(base, 1000.0, FULL_SCALES, 0xDEAD_BEEF).expect("good");
    let mut frames = Vec::new();
    for estimate in estimates(4000) {
        encoder.estimate(&estimate, |frame| frames.push(frame));
    }
    for n in 0..12 {
        let status = Status {
            state: State::ALL[n % 4],
            tick: 0xFFFF_FFFF - n as u32,
            overruns: 1,
            missed: 70_000,
            bus_off: 3,
            queue_overflow: 4,
            refused: 0xF3,
            sensors: 10,
        };
        frames.push(encoder.status(&status));
    }
    frames
}

fn number(value: &Value, signal: &str) -> f64 {
    value[signal]
        .as_f64()
        .unwrap_or_else(|| panic!("{signal} in {value}"))
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs().max(1e-9)
}

fn assert_same(base: u16, dbc: &str, names: [&str; 2], full_scales: [f64; 2]) {
    let frames = frames(base);
    let bytes: Vec<_> = frames
        .iter()
        .map(|frame| (frame.id, frame.data.to_vec()))
        .collect();
    let mut kinds = [0; 3];
    for (frame, there) in frames.iter().zip(decode(dbc, &bytes)) {
        let (message, counter) = frame::decode(base, frame.id, &frame.data).expect("our frame");
        let (raw, scaled) = (&there["raw"], &there["scaled"]);
        assert_eq!(
            number(raw, "Counter"),
            f64::from(counter.expect("protected"))
        );
        match message {
            Message::Load(i, here) => {
                let name = names[i];
                assert_eq!(there["name"], name);
                assert_eq!(number(raw, &format!("{name}Value")), f64::from(here.value));
                assert_eq!(number(raw, &format!("{name}Std")), f64::from(here.std));
                assert_eq!(
                    number(raw, &format!("{name}Fault")),
                    f64::from(here.fault as u8)
                );
                assert_eq!(number(raw, &format!("{name}Age")), f64::from(here.age));
                if let Some(value) = here.value(full_scales[i]) {
                    assert!(near(number(scaled, &format!("{name}Value")), value));
                }
                if let Some(std) = here.std(full_scales[i]) {
                    assert!(near(number(scaled, &format!("{name}Std")), std));
                }
                kinds[0] += 1;
            }
            Message::Sensor(i, here) => {
                assert_eq!(number(raw, "Sensor"), i as f64);
                assert_eq!(number(raw, "Homed") != 0.0, here.homed);
                assert_eq!(
                    number(raw, &format!("Sensor{i}Fault")),
                    f64::from(here.fault as u8)
                );
                assert_eq!(
                    number(raw, &format!("Sensor{i}Innovation")),
                    f64::from(here.innovation)
                );
                assert_eq!(number(raw, &format!("Sensor{i}Nis")), f64::from(here.nis));
                if let Some(nis) = here.nis() {
                    assert_eq!(number(scaled, &format!("Sensor{i}Nis")), f64::from(nis));
                }
                kinds[1] += 1;
            }
            Message::Status(here, _) => {
                assert_eq!(number(raw, "State"), f64::from(here.state as u8));
                match number(raw, "Page") as u8 {
                    0 => assert_eq!(number(raw, "ImageHash"), f64::from(0xDEAD_BEEF_u32)),
                    1 => assert_eq!(
                        (number(raw, "Overruns"), number(raw, "Missed")),
                        (1.0, 65_535.0)
                    ),
                    2 => assert_eq!(
                        (number(raw, "BusOff"), number(raw, "QueueOverflow")),
                        (3.0, 4.0)
                    ),
                    3 => {
                        assert_eq!(number(raw, "Refused"), 243.0);
                        assert_eq!((number(raw, "Loads"), number(raw, "Sensors")), (2.0, 10.0));
                    }
                    4 => assert_eq!(number(raw, "Tick"), f64::from(here.tick)),
                    _ => assert_eq!(number(scaled, "Rate"), 1000.0),
                }
                kinds[2] += 1;
            }
            Message::Raw | Message::Board(..) => panic!("no such frame was made"),
        }
    }
    // 1 kHz: two loads every sample, a sensor every 16th.
    assert_eq!(kinds, [8000, 250, 12]);
}

#[test]
fn cantools_reads_the_same_numbers_in_percent() {
    assert_same(0x500, DBC, ["Load1", "Load2"], [100.0, 100.0]);
}

#[test]
fn cantools_reads_the_same_numbers_in_the_units_of_a_machine() {
    let loads = [
        LoadScale {
            name: "main shaft",
            unit: "Nm",
            full_scale: FULL_SCALES[0],
        },
        LoadScale {
            name: "5th wheel",
            unit: "N",
            full_scale: FULL_SCALES[1],
        },
    ];
    let dbc = of_machine(0x320, &loads, &[]);
    let full_scales = FULL_SCALES.map(f64::from);
    assert_same(0x320, &dbc, ["main_shaft", "Load_5th_wheel"], full_scales);
    assert!(!dbc.contains("Load3") && dbc.contains("\"Nm\"") && !dbc.contains("BO_ 1280"));
}

#[test]
fn cantools_reads_raw_samples() {
    let encoder = FrameEncoder::try_new(0x500, 1000.0, FULL_SCALES, 0).expect("good");
    let mut sample = RawSample {
        tick: 0x8000_0001,
        index: Some(0xFFFF_FFFE),
        ..RawSample::default()
    };
    for i in 0..8 {
        sample.set_word(i, i32::MIN + 0x0123_4567 * i as i32);
    }
    sample.set_encoder(0, u32::MAX);
    sample.set_encoder(1, 1 << 31);
    let mut frames = Vec::new();
    encoder.raw(&sample, |frame| {
        frames.push((frame.id, frame.data.to_vec()));
    });
    let fd = encoder.raw_fd(&sample);
    frames.push((fd.id, fd.data.to_vec()));
    let decoded = decode(DBC, &frames);
    let find = |signal: &str, fd: bool| {
        let (classic, whole) = decoded.split_at(decoded.len() - 1);
        let among = if fd { whole } else { classic };
        among
            .iter()
            .find_map(|message| message["raw"][signal].as_i64())
            .expect("a signal")
    };
    for fd in [false, true] {
        assert_eq!(find("Tick", fd), 0x8000_0001);
        assert_eq!((find("Valid", fd), find("HasIndex", fd)), (0x3FF, 1));
        for i in 0..8 {
            assert_eq!(find(&format!("Word{i}"), fd), i64::from(sample.words[i]));
        }
        assert_eq!(
            (find("Encoder0", fd), find("Encoder1", fd)),
            (0xFFFF_FFFF, 1 << 31)
        );
        assert_eq!(find("Latched", fd), 0xFFFF_FFFE);
    }
}

/// Of a machine, as the command prints it; read by another decoder as well.
fn printed(arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
    let output = command.arg("dbc").args(arguments).output().expect("runs");
    assert!(output.status.success(), "{arguments:?}");
    let dbc = String::from_utf8(output.stdout).expect("text");
    assert!(decode(&dbc, &[]).is_empty());
    dbc
}

fn example(name: &str) -> String {
    format!("{}/../examples/{name}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn forces_are_in_newtons_and_sensors_have_their_names() {
    let unit_of = |dbc: &str, signal: &str| {
        let start = format!(" SG_ {signal} ");
        let line = dbc.lines().find(|line| line.starts_with(&start));
        let line = line.unwrap_or_else(|| panic!("no {signal}")).to_owned();
        line.split('"').nth(1).expect("a unit").to_owned()
    };
    let rotor = printed(&[&example("rotor/machine.toml")]);
    assert_eq!(unit_of(&rotor, "disc1_xValue"), "N");
    assert!(rotor.contains(" SG_ x5Innovation m0 ") && rotor.contains(" y32Nis 65535 "));
    assert!(!rotor.contains("Sensor4") && !rotor.contains("Load5"));
    let bearing = printed(&[&example("bearing/calibrated.toml")]);
    for (load, unit) in [
        ("Fx", "N"),
        ("Fy", "N"),
        ("Fz", "N"),
        ("Mx", "Nm"),
        ("Mz", "Nm"),
    ] {
        assert_eq!(unit_of(&bearing, &format!("{load}Value")), unit);
        assert_eq!(unit_of(&bearing, &format!("{load}Std")), unit);
    }
    let gearbox = example("gearbox/machine.toml");
    assert!(printed(&[&gearbox]).contains(" ta3Fault m2 "));
    let other = printed(&[&gearbox, "--sensors", "ring-gear-1"]);
    assert!(other.contains(" rg1Fault m0 ") && other.contains(" encoder_mainFault m1 "));
    assert!(!other.contains("ta1") && unit_of(&other, "main_shaftValue") == "Nm");
}
