//! Recorder while its broker is killed with a connection open, and while the disk is full: no
//! message is lost that was stored, no file is half, and samples that are not written are counted.

use std::fs;
use std::path::Path;
use std::sync::atomic::Ordering::SeqCst;
use std::thread;
use std::time::{Duration, Instant};

use loadtwin::can::Model;

use super::rig::{Adapter, Recorder, broker, free_port, network};
use super::{files, gaps, machine, messages, recorded, recorder};

/// Samples a second.
const RATE: u32 = 500;

/// Waits until a file has more bytes.
fn wait_for_more(path: &Path) {
    let size = || fs::metadata(path).map_or(0, |of| of.len());
    let (before, end) = (size(), Instant::now() + Duration::from_secs(20));
    while size() == before {
        assert!(Instant::now() < end, "nothing comes");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_broker_that_is_killed_while_connected_costs_no_message() {
    const SECONDS: u32 = 14;
    let dir = tempfile::tempdir().expect("a folder");
    let image = machine::image();
    let samples = machine::samples(SECONDS * RATE, |_| false);
    let (port, log) = (free_port(), dir.path().join("messages"));
    let (entrance, is_cut) = network(port);
    let (mut mosquitto, mut subscriber) = broker(dir.path(), port, &log);
    let adapter = Adapter::new();
    let running = recorder(dir.path(), 2, entrance).start(&adapter);
    thread::scope(|scope| {
        scope.spawn(|| adapter.carry(&Model::from_bytes(&image).expect("good"), &samples));
        // The later ones while what was stored meanwhile is sent.
        for _ in 0..3 {
            wait_for_more(&log);
            mosquitto.kill();
            // No connection before there is a subscriber.
            is_cut.store(true, SeqCst);
            thread::sleep(Duration::from_secs(1));
            subscriber.kill();
            (mosquitto, subscriber) = broker(dir.path(), port, &log);
            is_cut.store(false, SeqCst);
        }
    });
    thread::sleep(Duration::from_secs(2));
    let said = running.end();
    thread::sleep(Duration::from_millis(500));
    let (count, _) = messages(&log);
    // Two loads a second, but for the first and the last one.
    assert!(count >= 2 * (SECONDS as usize - 2), "{count} messages");
    assert_eq!(
        (&said["messages_waiting"], &said["messages_dropped"]),
        (&0.into(), &0.into())
    );
    assert_eq!(said["samples_written"], samples.len());
}

#[test]
fn on_a_full_disk_nothing_is_half_and_what_is_not_written_is_counted() {
    const SECONDS: u32 = 16;
    // Of the summary, and of a few messages.
    const BLOCKS: u32 = 4;
    let dir = tempfile::tempdir().expect("a folder");
    let image = machine::image();
    let samples = machine::samples(SECONDS * RATE, |_| false);
    let (port, log) = (free_port(), dir.path().join("messages"));
    let _broker = broker(dir.path(), port, &log);
    let adapter = Adapter::new();
    let recorder = recorder(dir.path(), 2, port);
    let running = recorder.start_on_full_disk(&adapter, BLOCKS);
    thread::scope(|scope| {
        scope.spawn(|| adapter.carry(&Model::from_bytes(&image).expect("good"), &samples));
        thread::sleep(Duration::from_secs(9));
        let folder = recorder.archive.join("recordings/machine=bench");
        assert!(!folder.exists() || files(&folder).is_empty());
        Recorder::free(&running);
    });
    thread::sleep(Duration::from_secs(2));
    let said = running.end();
    thread::sleep(Duration::from_millis(500));
    let ticks = recorded(&recorder.archive, &samples);
    assert_eq!(said["samples_written"], ticks.len());
    let written = said["samples_written"].as_u64().unwrap();
    let not_written = said["samples_not_written"].as_u64().unwrap();
    println!("{written} of {} samples", samples.len());
    assert_eq!(written + not_written, samples.len() as u64);
    assert_eq!(said["samples_missing"], 0);
    // From the file on that was begun on the full disk, without a gap.
    assert!(written >= u64::from(6 * RATE) && gaps(&ticks).is_empty());
    assert_eq!(*ticks.last().unwrap(), samples.len() as u64 - 1);
    // Messages of the full disk are not stored, and none of the others is lost.
    let (count, _) = messages(&log);
    assert!(
        (12..2 * SECONDS as usize).contains(&count),
        "{count} messages"
    );
    assert_eq!(said["messages_waiting"], 0);
}
