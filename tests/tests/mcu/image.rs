//! Model images on the emulated board: choice between two slots, upload over the bus and restart,
//! refusal of images that are damaged, signed by another key, or not newer.

use std::time::Duration;

use loadtwin::can::Model;
use loadtwin::key::SigningKey;
use loadtwin::seal::seal;
use loadtwin::upload_protocol::UploadError;
use loadtwin_common::io::frame::{
    Frame, IDS_PER_MACHINE, Message, State, Status, StatusPage, decode,
};
use loadtwin_common::io::signed_image::ImageError;
use loadtwin_firmware::ram_flash::LAYOUT;
use loadtwin_firmware::stimulus::Stimulus;
use loadtwin_tests::emulator::{Bus, Emulator, MACHINE_ID, flash};
use loadtwin_tests::gearbox::{image, is_estimate, samples};

/// The status reported by the frames, and the model's name.
fn status(frames: &[Frame]) -> (Status, Option<u32>) {
    let mut reported = Status::new();
    let mut name = None;
    for frame in frames {
        let base = frame.id / IDS_PER_MACHINE * IDS_PER_MACHINE;
        if let Ok((Message::Status(newer, page), _)) = decode(base, frame.id, &frame.data) {
            reported.merge(&newer, page);
            if let StatusPage::Image(hash) = page {
                name = Some(hash);
            }
        }
    }
    (reported, name)
}

/// Waits for a start of the board, which says so first; the model's name.
pub(super) fn started(bus: &mut Bus) -> u32 {
    bus.find_map(|frame| {
        let (reported, model) = status(&[frame]);
        model.filter(|_| reported.state == State::Waiting)
    })
    .expect("the board starts again")
}

fn signed(model: &[u8], issue: u32, key: &SigningKey) -> Vec<u8> {
    seal(model, MACHINE_ID, issue, None, Some(key)).unwrap()
}

fn name(model: &[u8]) -> u32 {
    Model::from_bytes(model).unwrap().hash
}

/// Feeds samples, ends the board and gives what it sent.
fn run_to_the_end(board: Emulator, bus: Bus, count: u32) -> (Vec<Frame>, String) {
    let sent = board.sensors().send_all(samples(count));
    let frames: Vec<Frame> = bus.collect();
    let end = board.end(Duration::from_secs(20));
    assert!(end.status.success(), "{}\n{}", end.status, end.log);
    sent.join().unwrap();
    (frames, end.log)
}

/// Another model: the same machine with a longer name for its load.
fn other(model: &[u8]) -> Vec<u8> {
    let at = model
        .windows(11)
        .position(|part| part == b"main_torque")
        .expect("the load's name");
    let mut other = model.to_vec();
    other[at..at + 11].copy_from_slice(b"test_torque");
    other
}

#[test]
fn a_damaged_image_is_refused_and_the_last_valid_one_runs() {
    let key = SigningKey::generate().unwrap();
    let old = image();
    let new = other(&old);
    let images = [signed(&old, 1, &key), signed(&new, 2, &key)];
    let whole = flash(&key, &images);
    let mut damaged = whole.clone();
    // Inside the payload of the second slot.
    damaged[LAYOUT.slot_bytes as usize + 200] ^= 0x10;
    let mut both = damaged.clone();
    both[200] ^= 0x10;
    for (flash, runs, refused) in [
        (whole, Some(name(&new)), 0),
        (damaged, Some(name(&old)), ImageError::BadCrc.code()),
        (both, None, ImageError::BadCrc.code()),
    ] {
        let board = Emulator::start_flash(&flash);
        let bus = board.bus();
        let (frames, log) = run_to_the_end(board, bus, 1000);
        let (status, model) = status(&frames);
        assert_eq!(status.refused, refused);
        assert_eq!(log.contains("refused"), refused != 0, "{log}");
        if runs.is_some() {
            assert_eq!(model, runs);
            assert!(matches!(status.state, State::Homing | State::Running));
        } else {
            assert_eq!(status.state, State::NoImage);
            assert!(
                frames.iter().all(|frame| !is_estimate(frame)),
                "a status, the board, and nothing else"
            );
        }
    }
}

#[test]
fn a_model_from_the_bus_runs_after_a_restart_and_a_refused_one_never() {
    let key = SigningKey::generate().unwrap();
    let old = image();
    let new = other(&old);
    let mut bad = new.clone();
    bad.truncate(bad.len() - 1);
    let board = Emulator::start_paced(&flash(&key, &[signed(&old, 1, &key)]));
    let mut bus = board.bus();
    for (image, refusal) in [
        (
            signed(&new, 2, &SigningKey::generate().unwrap()),
            ImageError::BadSignature,
        ),
        (signed(&new, 1, &key), ImageError::Downgrade),
        (signed(&bad, 2, &key), ImageError::BadModel),
    ] {
        let (refused, _) = bus.upload(image);
        assert_eq!(refused, Err(UploadError::Refused(refusal)));
    }
    let mut sensors = board.sensors();
    // The status has the refusal, and the old model runs on.
    for sample in samples(200) {
        sensors.send(&Stimulus::Sample(sample));
    }
    let frames: Vec<Frame> = bus
        .by_ref()
        .filter(|frame| frame.id % IDS_PER_MACHINE == 0)
        .take(8)
        .collect();
    let (reported, model) = status(&frames);
    assert_eq!(reported.refused, ImageError::BadModel.code());
    assert_eq!(model, Some(name(&old)));

    let (taken, _) = bus.upload(signed(&new, 2, &key));
    assert_eq!(taken, Ok(()));
    sensors.send(&Stimulus::Restart);
    assert_eq!(started(&mut bus), name(&new));
    let (frames, _) = run_to_the_end(board, bus, 1000);
    let (reported, model) = status(&frames);
    assert_eq!((model, reported.refused), (Some(name(&new)), 0));
}
