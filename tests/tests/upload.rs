//! Upload of an image from the host's state machine to the board's, over a simulated bus that
//! loses frames.

use loadtwin::image_build::{self, Sensors};
use loadtwin::key::SigningKey;
use loadtwin::machine::{Count, Machine};
use loadtwin::seal::seal;
use loadtwin::upload_protocol::{Next, UploadError, Uploader};
use loadtwin_common::counting::{CountSample, MAX_COUNTED};
use loadtwin_common::hardware::{EMULATED, Hardware, NUCLEO_G474RE};
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::isotp::FrameData;
use loadtwin_common::io::signed_image::ImageError;
use loadtwin_common::io::uds;
use loadtwin_firmware::app::App;
use loadtwin_firmware::counts::CountsLayout;
use loadtwin_firmware::room::Room;
use loadtwin_firmware::running_model::{Models, Turn};
use loadtwin_firmware::simulated_flash::SimulatedFlash;
use loadtwin_firmware::store::{Layout, Store};
use loadtwin_firmware::upload::{BLOCK_OVERHEAD, Event, Upload};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// As on the STM32G474: pages of 2 KiB, slots of 16 KiB.
const PAGE: usize = 2048;
const LAYOUT: Layout = Layout {
    start: 0,
    slot_bytes: 8 * PAGE as u32,
};
/// Two areas of counts behind the slots.
const COUNTS: CountsLayout = CountsLayout {
    start: 16 * PAGE as u32,
    area_bytes: PAGE as u32,
    areas: 2,
};
type Flash = SimulatedFlash<PAGE, { 18 * PAGE / 8 }>;

/// The machine that the board is on.
const MACHINE: &str = "bench";
/// Polls that a request takes at most: three, and one for each page.
const POLLS: usize = 3 + 8;

struct Bus {
    /// Frames lost, of a thousand.
    loss: u32,
    /// Sent by somebody else before the frame of that number.
    stray: Option<(u32, FrameData)>,
    random: ChaCha8Rng,
    frames: u32,
    events: Vec<Event>,
}

impl Bus {
    fn new(loss: u32, seed: u64) -> Self {
        Self {
            loss,
            stray: None,
            random: ChaCha8Rng::seed_from_u64(seed),
            frames: 0,
            events: Vec::new(),
        }
    }

    fn delivers(&mut self) -> bool {
        self.frames += 1;
        self.random.random_range(0..1000) >= self.loss
    }

    /// Runs an upload to its end.
    fn run(&mut self, store: &mut Store<Flash>, image: Vec<u8>) -> Result<(), UploadError> {
        let mut uploader = Uploader::new(image)?;
        let mut upload = Upload::<{ PAGE + BLOCK_OVERHEAD }>::new();
        let mut room = [0; 7 * PAGE];
        // Close to where the clock wraps.
        let mut now_us = u32::MAX - 20_000;
        loop {
            if let Some((_, data)) = self.stray.take_if(|(at, _)| *at <= self.frames) {
                upload.on_frame(&data, now_us);
            }
            let answers: Vec<FrameData> = match uploader.poll(now_us) {
                Next::Frame(data) if self.delivers() => {
                    upload.on_frame(&data, now_us).into_iter().collect()
                }
                Next::Frame(_) => Vec::new(),
                Next::Wait(us) => {
                    let mut answers = Vec::new();
                    for _ in 0..POLLS {
                        let progress = upload.poll(store, &mut room, 7 * PAGE, |_| Ok(()));
                        self.events.extend(progress.event);
                        answers.extend(progress.answer);
                    }
                    if answers.is_empty() {
                        now_us = now_us.wrapping_add(us);
                    }
                    answers
                }
                Next::Accepted => {
                    assert_eq!(uploader.progress().0, uploader.progress().1);
                    return Ok(());
                }
                Next::Failed(error) => return Err(error),
            };
            now_us = now_us.wrapping_add(250);
            for data in answers {
                if self.delivers() {
                    uploader.on_frame(&data, now_us);
                }
            }
        }
    }
}

fn boot(flash: Flash, key: &SigningKey) -> Store<Flash> {
    Store::boot(flash, LAYOUT, Some(key.identity(MACHINE)), |_, _, _| Ok(())).unwrap()
}

fn running(store: &Store<Flash>) -> Option<u32> {
    store.active().map(|a| a.header.issue)
}

/// A model of 10 000 bytes: five blocks.
fn image(issue: u32, key: &SigningKey) -> Vec<u8> {
    let payload: Vec<u8> = (0..10_000u32).map(|i| (i * issue / 7) as u8).collect();
    seal(&payload, MACHINE, issue, None, Some(key)).unwrap()
}

#[test]
fn an_image_arrives_and_an_older_or_foreign_one_does_not() {
    let key = SigningKey::generate().unwrap();
    let mut store = boot(Flash::new(1), &key);
    let mut bus = Bus::new(0, 1);
    assert_eq!(bus.run(&mut store, image(2, &key)), Ok(()));
    println!("{} frames for 10120 bytes", bus.frames);
    let mut store = boot(store.release(), &key);
    assert_eq!(running(&store), Some(2));
    for (image, refusal) in [
        (image(1, &key), ImageError::Downgrade),
        (image(2, &key), ImageError::Downgrade),
        (
            image(3, &SigningKey::generate().unwrap()),
            ImageError::BadSignature,
        ),
        (
            seal(&[0; 7 * PAGE], MACHINE, 3, None, Some(&key)).unwrap(),
            ImageError::TooLong,
        ),
        (
            seal(b"model", MACHINE, 3, None, None).unwrap(),
            ImageError::Unsigned,
        ),
        (
            seal(b"model", "another", 3, None, Some(&key)).unwrap(),
            ImageError::WrongMachine,
        ),
    ] {
        assert_eq!(
            bus.run(&mut store, image),
            Err(UploadError::Refused(refusal))
        );
    }
    let mut damaged = image(3, &key);
    damaged[5000] ^= 1;
    assert_eq!(
        bus.run(&mut store, damaged),
        Err(UploadError::Refused(ImageError::BadCrc))
    );
    assert_eq!(running(&boot(store.release(), &key)), Some(2));
}

type BoardModels = Models<Flash, { PAGE + BLOCK_OVERHEAD }, { 7 * PAGE }, 1>;

/// A board of `hardware`.
fn models(flash: Flash, hardware: Hardware, key: &SigningKey) -> BoardModels {
    let room = Box::leak(Box::new(Room::new()));
    let board = (Some(key.identity(MACHINE)), hardware);
    BoardModels::boot(flash, (LAYOUT, COUNTS), board, room).unwrap()
}

/// Uploads `image` to a board: what the host is answered, and what the board's status says.
fn offered(models: &mut BoardModels, image: Vec<u8>) -> (Result<(), UploadError>, u8) {
    let mut uploader = Uploader::new(image).unwrap();
    let (mut now_us, mut refused) = (0, 0);
    loop {
        let answers: Vec<Frame> = match uploader.poll(now_us) {
            Next::Frame(data) => {
                let id = uds::REQUEST_ID;
                models
                    .on_frame(&Frame { id, data }, now_us)
                    .into_iter()
                    .collect()
            }
            Next::Wait(_) => (0..POLLS)
                .filter_map(|_| {
                    let Turn {
                        reply: answer,
                        refused: code,
                        ..
                    } = models.poll(now_us);
                    refused = code.unwrap_or(refused);
                    answer
                })
                .collect(),
            Next::Accepted => return (Ok(()), refused),
            Next::Failed(error) => return (Err(error), refused),
        };
        now_us += 250;
        for answer in answers {
            uploader.on_frame(&answer.data, now_us);
        }
    }
}

/// A load that is counted.
fn count(machine: &Machine, load: usize) -> Count {
    Count {
        load: machine.loads()[load].name.to_owned(),
        range: [-100.0, 100.0],
        gate: None,
        ratio: 1.0,
    }
}

/// An image of `examples/bench` after a change.
fn bench(change: impl FnOnce(&mut Machine), issue: u32, key: &SigningKey) -> Vec<u8> {
    let example = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/bench/machine.toml"
    );
    let mut machine = Machine::load(example.as_ref()).unwrap();
    change(&mut machine);
    let sensors = Sensors::choose(&machine, None).unwrap();
    let payload = image_build::image(&machine, &sensors).unwrap();
    seal(&payload, MACHINE, issue, None, Some(key)).unwrap()
}

/// The counts are kept before an image has their room, and go on when it was refused; the time
/// between is a gap.
#[test]
fn counts_outlast_an_image_that_is_refused() {
    let key = SigningKey::generate().unwrap();
    let mut flash = boot(Flash::new(1), &key);
    let counts = |machine: &mut Machine| machine.counts = vec![count(machine, 0)];
    let mut bus = Bus::new(0, 1);
    bus.run(&mut flash, bench(counts, 1, &key)).unwrap();
    let mut models = models(flash.release(), EMULATED, &key);
    let mut app = App::without_image();
    models.start(&mut app, vec![0; 7 * PAGE].leak());
    let sample = |tick| CountSample {
        tick,
        advance: 0,
        loads: [(tick % 7) as f32 * 9.0; MAX_COUNTED],
    };
    for tick in 0..100 {
        models.count(&sample(tick));
        assert_eq!(models.poll(tick * 500), Turn::default());
    }
    let no_model = seal(&[0; 3000], MACHINE, 2, None, Some(&key)).unwrap();
    let refused = Err(UploadError::Refused(ImageError::BadModel));
    assert_eq!(offered(&mut models, no_model).0, refused);
    for _ in 0..20 {
        models.poll(0);
    }
    models.count(&sample(150));
    let [counts] = models.counted() else {
        panic!("one load is counted")
    };
    let seen = counts.observation();
    assert_eq!((seen.seen, seen.missing, seen.gaps), (101, 50, 1));
    assert_eq!(seen.restarts, 0);
    assert!(counts.closed().cycles() > 10);
}

#[test]
fn a_board_refuses_an_image_that_its_hardware_does_not_serve() {
    let key = SigningKey::generate().unwrap();
    let image = |change: fn(&mut Machine)| bench(change, 2, &key);
    let on = |hardware, image| offered(&mut models(Flash::new(1), hardware, &key), image);
    for change in [
        |_: &mut Machine| (),
        |machine: &mut Machine| machine.rate_hz = 500.0,
        |machine: &mut Machine| machine.encoders[0].bits = 12,
    ] {
        assert_eq!(on(NUCLEO_G474RE, image(change)), (Ok(()), 0));
    }
    for change in [
        |machine: &mut Machine| machine.counts = [0, 1].map(|load| count(machine, load)).into(),
        |machine: &mut Machine| machine.rate_hz = 600.0,
        |machine: &mut Machine| machine.rate_hz = 16_000.0,
        |machine: &mut Machine| machine.encoders[0].bits = 32,
        |machine: &mut Machine| {
            let mut fifth = machine.channels[0].clone();
            fifth.name = "fifth".to_owned();
            machine.channels.push(fifth);
        },
    ] {
        let refusal = ImageError::WrongHardware;
        let answered = Err(UploadError::Refused(refusal));
        let other = image(change);
        assert_eq!(on(NUCLEO_G474RE, other.clone()), (answered, refusal.code()));
        assert_eq!(on(EMULATED, other), (Ok(()), 0));
    }
}

/// Whatever the bus loses: accepted means in force, refused or given up means
/// that the old one runs; only a lost verdict leaves it open.
#[test]
fn a_bus_that_loses_frames_delays_an_upload_and_never_spoils_it() {
    let key = SigningKey::generate().unwrap();
    let mut flash = Flash::new(3);
    let mut runs = 0;
    let (mut accepted, mut failed, mut open) = (0, 0, 0);
    for seed in 0..400 {
        let mut store = boot(flash, &key);
        let next = runs + 1;
        let mut bus = Bus::new([1, 3, 20][seed as usize % 3], seed);
        let outcome = bus.run(&mut store, image(next, &key));
        let now = running(&boot(store.flash().clone(), &key)).unwrap_or(0);
        match outcome {
            Ok(()) => {
                accepted += 1;
                assert_eq!(now, next);
            }
            Err(UploadError::NoVerdict) => {
                open += 1;
                assert!(now == next || now == runs);
            }
            Err(UploadError::NoAnswer(_) | UploadError::NotTaken { .. }) => {
                failed += 1;
                assert_eq!(now, runs);
            }
            Err(error) => panic!("{error}"),
        }
        runs = now;
        flash = store.release();
    }
    println!("{accepted} accepted, {failed} given up, {open} without verdict");
    assert!(accepted >= 200 && failed > 0);
}

/// A frame of somebody else anywhere in an upload: the image arrives all the same.
#[test]
fn a_stray_frame_does_not_end_an_upload() {
    let key = SigningKey::generate().unwrap();
    let service = {
        let mut store = boot(Flash::new(1), &key);
        Bus::new(0, 1).run(&mut store, image(1, &key)).unwrap();
        store.release()
    };
    let image = image(2, &key);
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let frames = 10_120 / 7;
    let mut at = 0;
    let mut runs = 0;
    while at < frames {
        let mut data: FrameData = random.random();
        // A single frame, an announcement, the next or any frame of a block, flow control.
        match runs % 6 {
            0 => data[..2].copy_from_slice(&[0x01, 0x3E]),
            1 => data = [0x10, 0x0B, 0x34, 0x00, 0x44, 0, 0, 0],
            2 => data[..2].copy_from_slice(&[0x01, 0x37]),
            3 => data[0] = 0x20 | (at % 16) as u8,
            4 => data[0] = 0x20 | (data[0] % 16),
            _ => data[0] = 0x30,
        }
        let mut store = boot(service.clone(), &key);
        let mut bus = Bus::new(0, u64::from(at));
        bus.stray = Some((at, data));
        assert_eq!(
            bus.run(&mut store, image.clone()),
            Ok(()),
            "{at}: {data:x?}"
        );
        assert_eq!(running(&boot(store.release(), &key)), Some(2));
        runs += 1;
        at += random.random_range(1..8);
    }
    assert!(runs > 300);
}

#[test]
fn a_silent_board_is_given_up() {
    let key = SigningKey::generate().unwrap();
    let mut store = boot(Flash::new(1), &key);
    let mut bus = Bus::new(1000, 1);
    assert!(matches!(
        bus.run(&mut store, image(1, &key)),
        Err(UploadError::NotTaken { .. })
    ));
    assert!(bus.frames <= 8);
}
