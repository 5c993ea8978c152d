//! Recorder with a real mosquitto, through kills of the recorder and of the broker and a network
//! that is cut: each sample is in the archive once or counted as missing, and each message reaches
//! a subscriber in order.
#![cfg(unix)]

#[path = "../can/machine.rs"]
#[expect(dead_code, reason = "the tests of CAN use the others")]
mod machine;
mod outage;
mod rig;

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::Ordering::SeqCst;
use std::thread;
use std::time::{Duration, Instant};

use arrow_array::Array;
use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use loadtwin::can::Model;
use loadtwin_common::io::raw::RawSample;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

use rig::{Adapter, Recorder, broker, free_port, network};

/// Seconds of bus: `LOADTWIN_RECORD_SECONDS`, else a short form.
fn seconds() -> u32 {
    let stated = std::env::var("LOADTWIN_RECORD_SECONDS").ok();
    stated.map_or(20, |text| text.parse().expect("seconds"))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for day in fs::read_dir(folder).expect("days") {
        let day = day.unwrap().path();
        assert!(
            day.file_name()
                .unwrap()
                .to_str()
                .unwrap()
                .starts_with("day=20")
        );
        found.extend(fs::read_dir(day).unwrap().map(|file| file.unwrap().path()));
    }
    found.sort();
    found
}

/// Ticks of the recorded samples, whose values must be those of the bus.
fn recorded(archive: &Path, samples: &[RawSample]) -> Vec<u64> {
    let mut ticks = Vec::new();
    for path in files(&archive.join("recordings/machine=bench")) {
        let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
        for batch in reader.build().unwrap() {
            let batch = batch.unwrap();
            let column = |name| {
                batch
                    .column_by_name(name)
                    .unwrap()
                    .as_primitive::<Float64Type>()
            };
            for row in 0..batch.num_rows() {
                let read = |name| {
                    let column = column(name);
                    column.is_valid(row).then(|| column.value(row))
                };
                let Some(tick) = read("tick") else { continue };
                let sample = &samples[tick as usize];
                let word = |k| sample.has_word(k).then(|| f64::from(sample.words[k]));
                assert_eq!((read("constant"), read("varying")), (word(0), word(1)));
                assert_eq!(read("encoder"), Some(sample.encoders[0].into()));
                assert_eq!(read("index"), sample.index.map(f64::from));
                ticks.push(tick as u64);
            }
        }
    }
    ticks
}

/// Runs of missing ticks.
fn gaps(ticks: &[u64]) -> Vec<u64> {
    let steps = ticks
        .windows(2)
        .map(|pair| pair[1].checked_sub(pair[0] + 1).expect("once"));
    steps.filter(|missing| *missing > 0).collect()
}

fn recorder(dir: &Path, every: u32, broker: u16) -> Recorder {
    Recorder {
        machine: Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/two_inertias.toml"),
        archive: dir.join("archive"),
        every,
        broker,
    }
}

#[test]
fn every_sample_is_in_the_archive_once_and_every_message_reaches_a_subscriber() {
    let dir = tempfile::tempdir().expect("a folder");
    let length = seconds();
    let every = (length / 10).max(2);
    let image = machine::image();
    let samples = machine::samples(length * 500, |_| false);
    let (port, log) = (free_port(), dir.path().join("messages"));
    let (entrance, is_cut) = network(port);
    let (mut mosquitto, mut subscriber) = broker(dir.path(), port, &log);
    let adapter = Adapter::new();
    let recorder = recorder(dir.path(), every, entrance);
    let mut running = recorder.start(&adapter);
    let began = Instant::now();
    let at = |part: f64| {
        let due = began + Duration::from_secs(length.into()).mul_f64(part);
        thread::sleep(due.saturating_duration_since(Instant::now()));
    };
    let killed_and_started = |running: &mut rig::Program| {
        adapter.close();
        running.kill();
        adapter.discard();
        thread::sleep(Duration::from_millis(300));
        *running = recorder.start(&adapter);
    };
    thread::scope(|scope| {
        scope.spawn(|| adapter.carry(&Model::from_bytes(&image).expect("good"), &samples));
        at(0.15);
        killed_and_started(&mut running);
        at(0.25);
        // What it has acknowledged reaches the subscriber: it keeps nothing on the disk.
        is_cut.store(true, SeqCst);
        thread::sleep(Duration::from_millis(300));
        mosquitto.kill();
        subscriber.kill();
        at(0.35);
        killed_and_started(&mut running);
        at(0.45);
        (mosquitto, subscriber) = broker(dir.path(), port, &log);
        is_cut.store(false, SeqCst);
        at(0.6);
        is_cut.store(true, SeqCst);
        at(0.7);
        is_cut.store(false, SeqCst);
        at(0.8);
        killed_and_started(&mut running);
    });
    thread::sleep(Duration::from_secs(2));
    let said = running.end();
    thread::sleep(Duration::from_millis(500));

    let ticks = recorded(&recorder.archive, &samples);
    let missing = gaps(&ticks);
    println!(
        "{} of {} ticks, gaps {missing:?}",
        ticks.len(),
        samples.len()
    );
    assert_eq!(*ticks.last().unwrap(), samples.len() as u64 - 1);
    assert_eq!(said["samples_written"], ticks.len());
    assert_eq!(said["samples_missing"], missing.iter().sum::<u64>());
    assert_eq!((&said["gaps"], missing.len()), (&3.into(), 3));
    let most = 500 * u64::from(every + 2);
    assert!(
        missing.iter().all(|gap| *gap <= most),
        "{missing:?}, {most}"
    );
    assert_eq!(
        (&said["damaged"], &said["restarts"]),
        (&0.into(), &0.into())
    );
    assert!(said["estimates_written"].as_u64().unwrap() > ticks.len() as u64 / 10);
    messages_are_complete(&log, &said, length);

    let first = &files(&recorder.archive.join("recordings/machine=bench"))[0];
    let replayed = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args([Path::new("replay"), &recorder.machine, first])
        .output()
        .unwrap();
    assert!(replayed.status.success(), "{replayed:?}");
}

/// Each message came, in order but for repetitions, and health came with the last will.
fn messages_are_complete(log: &Path, said: &Value, length: u32) {
    let (count, states) = messages(log);
    assert_eq!(
        (&said["messages_waiting"], &said["messages_dropped"]),
        (&0.into(), &0.into())
    );
    // Two loads a second, but for the seconds of the starts.
    assert!(count as u32 > 2 * (length - 6), "{count} messages");
    assert_eq!(states.last().unwrap(), "offline");
    assert!(
        states.iter().filter(|state| *state == "offline").count() >= 2,
        "{states:?}"
    );
    assert!(states.contains(&"online".to_owned()));
}

/// Number of the messages that came, in order but for repetitions, and the states of the health.
fn messages(log: &Path) -> (usize, Vec<String>) {
    let text = fs::read_to_string(log).unwrap();
    let (mut seen, mut repeated) = (BTreeSet::new(), 0);
    let mut states = Vec::new();
    for line in text.lines() {
        let fields: Vec<&str> = line.splitn(3, '\t').collect();
        let payload: Value = serde_json::from_str(fields[2]).expect("JSON");
        if fields[0] == "loadtwin/bench/health" {
            states.push(payload["state"].as_str().unwrap().to_owned());
            continue;
        }
        let sequence = payload["sequence"].as_u64().unwrap();
        if seen.contains(&sequence) {
            repeated += 1;
            continue;
        }
        assert_eq!(sequence, seen.len() as u64 + 1, "in order: {line}");
        seen.insert(sequence);
        assert!(payload["samples"].as_u64().unwrap() > 0, "{payload}");
        assert_eq!(
            fields[0],
            format!("loadtwin/bench/loads/{}", payload["load"].as_str().unwrap())
        );
    }
    println!(
        "{} messages, {repeated} repeated; health {states:?}",
        seen.len()
    );
    (seen.len(), states)
}
