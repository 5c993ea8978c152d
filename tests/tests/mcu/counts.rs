//! Load cycles that the emulated board counts, to the bit of the host's for every machine kind, and
//! the counts that it keeps in flash, read over its bus.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use loadtwin::can::CanError;
use loadtwin::can::kept_counts::{KeptCountsError, of_board};
use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::{Count, Machine};
use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_common::counting::{MAX_COUNTED, MachineCounts};
use loadtwin_common::image::Image;
use loadtwin_common::io::raw::RawSample;
use loadtwin_common::io::signed_image::CRC;
use loadtwin_firmware::app::App;
use loadtwin_firmware::stimulus::Stimulus;
use loadtwin_tests::bench::Bench;
use loadtwin_tests::emulator::{CanBus, Emulator, End};
use loadtwin_tests::firmware::root;
use loadtwin_tests::simulated;

use super::image::started;

/// Length of the run at whose end counts are kept (s): the board keeps them after 50 s.
const KEPT_S: f64 = 50.6;

/// Sample rate of that run (Hz), low for a short test.
const KEPT_RATE_HZ: f64 = 40.0;

/// Samples after a restart.
const AGAIN: usize = 500;

/// `machine` with its first loads counted over their nominal range.
fn counting(mut machine: Machine) -> Machine {
    let counts: Vec<Count> = (machine.loads().iter())
        .take(MAX_COUNTED)
        .map(|load| Count {
            load: load.name.to_owned(),
            range: [-load.nominal, load.nominal],
            gate: None,
            ratio: 30.0,
        })
        .collect();
    machine.counts = counts;
    machine
}

type Counts = MachineCounts<MAX_COUNTED>;

/// Nothing counted yet.
fn nothing(image: &[u8]) -> Counts {
    MachineCounts::try_new(&Image::from_bytes(image).unwrap().counted).unwrap()
}

/// The counts on the host after the samples from a start of the board on.
fn on_host(image: &[u8], mut counts: Counts, samples: &[RawSample]) -> Counts {
    let mut app = App::try_new(image, 0).unwrap();
    let mut board = Bench::with_room_for(usize::MAX);
    let mut next = samples[0].tick;
    for sample in samples {
        board.sample = Some(*sample);
        app.on_data_ready(&mut board);
        board.outbox.clear();
        for sample in board.counted.drain(..) {
            counts.push(&sample, sample.tick - next);
            next = sample.tick + 1;
        }
    }
    for counts in counts.loads_mut() {
        counts.settle();
    }
    counts
}

/// Compares the counts at the end of a run with those of the host.
fn assert_counts(name: &str, end: &End, mut expected: Counts) {
    assert!(end.status.success(), "{name}: {}\n{}", end.status, end.log);
    assert!(!expected.loads().is_empty(), "{name}");
    for (load, counts) in expected.loads_mut().iter_mut().enumerate() {
        let mut bytes = vec![0; MAX_BYTES];
        let len = counts.save(&mut bytes).unwrap();
        let line = format!("counts of load {load}: {:08x}", CRC.checksum(&bytes[..len]));
        assert!(end.log.contains(&line), "{name}: {line}\n{}", end.log);
    }
}

#[test]
fn a_board_of_every_kind_counts_to_the_bit_of_the_host() {
    // As long as it takes until loads are valid, and a second more.
    for (file, scenario, seconds) in [
        ("examples/gearbox/calibrated.toml", "turbulent", 3.0),
        ("examples/rotor/machine.toml", "constant", 0.6),
        ("examples/bearing/calibrated.toml", "lc1", 2.5),
        ("tests/machines/cogging-drive.toml", "", 1.0),
    ] {
        let machine = counting(Machine::load(&root().join(file)).unwrap());
        let sensors = Sensors::choose(&machine, None).unwrap();
        let image = image_build::image(&machine, &sensors).unwrap();
        let samples = simulated::samples(&machine, &sensors, scenario, seconds);
        let board = Emulator::start_stored(&image, &samples);
        let bus = board.bus();
        board.sensors().send_stored();
        for _ in bus {}
        let end = board.end(Duration::from_secs(20));
        let expected = on_host(&image, nothing(&image), &samples);
        let seen = expected.loads()[0].observation();
        println!("{file}: {seen:?}");
        assert!(seen.seen >= 400, "{file}: {seen:?}");
        assert_counts(file, &end, expected);
    }
}

#[test]
fn the_board_keeps_its_counts_over_a_restart_and_its_bus_reads_them() {
    let file = root().join("tests/machines/cogging-drive.toml");
    let mut machine = counting(Machine::load(&file).unwrap());
    machine.rate_hz = KEPT_RATE_HZ;
    let sensors = Sensors::choose(&machine, None).unwrap();
    let image = image_build::image(&machine, &sensors).unwrap();
    let samples = simulated::samples(&machine, &sensors, "", KEPT_S);
    let board = Emulator::start(&image);
    let mut bus = CanBus::new(board.bus());
    let mut sensors = board.sensors();
    let all = samples.clone();
    let sent = std::thread::spawn(move || {
        for sample in all {
            sensors.send(&Stimulus::Sample(sample));
        }
        sensors
    });
    // Its counts are there once a whole state was kept.
    let stop = AtomicBool::new(false);
    let pages = loop {
        match of_board(&mut bus, &stop) {
            Ok(pages) => break pages,
            Err(CanError::Counts(KeptCountsError::None)) => {}
            Err(error) => panic!("{error}"),
        }
    };
    let [page] = &pages[..] else {
        panic!("one image, found {}", pages.len())
    };
    let kept = page.counts[0].observation().elapsed() as usize;
    assert!((2000..=samples.len()).contains(&kept), "{kept}");
    let mut expected = on_host(&image, nothing(&image), &samples[..kept]);
    assert_eq!(page.counts, expected.loads());
    assert!(expected.loads()[0].closed().cycles() > 50);

    // What was counted since is lost with a restart, and nothing else.
    let again = samples[..AGAIN].to_vec();
    let mut bus = bus.into_inner();
    let restarting = std::thread::spawn(move || {
        let mut sensors = sent.join().unwrap();
        sensors.send(&Stimulus::Restart);
        sensors
    });
    started(&mut bus);
    let ending = restarting.join().unwrap().send_all(again.clone());
    for _ in bus {}
    let end = board.end(Duration::from_secs(20));
    ending.join().unwrap();
    expected.restart();
    let expected = on_host(&image, expected, &again);
    let seen = expected.loads()[0].observation();
    println!("{kept} samples kept; {seen:?}");
    assert_eq!((seen.elapsed() as usize, seen.restarts), (kept + AGAIN, 1));
    assert_counts("drive", &end, expected);
}
