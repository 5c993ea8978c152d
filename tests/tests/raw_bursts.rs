//! Bursts of raw samples of the application of the boards, on a simulated controller with classic
//! and FD frames: what is sent is proved, and an overload drops bursts, never loads.

use std::time::Duration;

use heapless::spsc::Queue;
use loadtwin::can::bus::{Bus, Received};
use loadtwin::can::frame_comparison::{Comparison, Figures, Verdict};
use loadtwin::can::simulated_controller::SimulatedController;
use loadtwin::can::{Model, standard, to_bus, to_bus_fd};
use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin_common::hardware::NUCLEO_G474RE;
use loadtwin_common::io::frame::{Frame, e2e, signal_layout};
use loadtwin_common::io::raw::RawSample;
use loadtwin_firmware::app::App;
use loadtwin_firmware::raw_burst::{Burst, RawFrame, RawLink, RawReader, RawWriter};
use loadtwin_tests::bench::Bench;
use loadtwin_tests::{firmware, gearbox};

/// Frames and bytes that wait for the bus, as on the NUCLEO-G474RE.
const OUTBOX: usize = 64;
const RAW_BYTES: usize = 7 * 1024;

/// The samples of a clock without gaps, which is that of a board.
fn samples(count: u32) -> Vec<RawSample> {
    let mut samples = gearbox::samples(count);
    for (sample, tick) in samples.iter_mut().zip(0..) {
        sample.tick = tick;
    }
    samples
}

/// What a board with these samples and bursts, each from the sample of a number on, puts on a bus
/// with 500 kbit/s and 2 Mbit/s.
fn traffic(
    model: &Model<'_>,
    image: &[u8],
    samples: &[RawSample],
    bursts: &[(usize, Burst)],
) -> Vec<Received> {
    let queue: &'static mut Queue<u8, RAW_BYTES> = Box::leak(Box::new(Queue::new()));
    let link: &'static RawLink = Box::leak(Box::default());
    let (raw_in, raw_out) = queue.split();
    let mut app = App::try_new(image, model.hash).expect("the image is valid");
    let mut board = Bench::with_room_for(OUTBOX);
    board.raw = Some(RawWriter::new(link, raw_in));
    let mut reader = RawReader::new(link, raw_out, app.base());
    let mut bus = SimulatedController::new(500_000, vec![]).with_data_rate(2_000_000);
    let mut wire = Vec::new();
    let mut send_until = |bus: &mut SimulatedController, board: &mut Bench, end: Duration| {
        while bus.now() < end {
            let now_us = bus.now().as_micros() as u32;
            let frame = board.outbox.pop_front().map(RawFrame::Classic);
            match frame.or_else(|| reader.next(now_us)) {
                Some(frame) => {
                    let frame = match frame {
                        RawFrame::Classic(frame) => to_bus(&frame),
                        RawFrame::Fd(frame) => to_bus_fd(&frame),
                    };
                    bus.send(&frame).expect("nothing disturbs it");
                    let t_us = bus.now().as_micros() as u64;
                    wire.push(Received { t_us, frame });
                }
                None => bus.wait(Duration::from_micros(100)),
            }
        }
    };
    let period = Duration::from_secs_f32(1.0 / model.image.rate_hz);
    app.announce(&mut board);
    for (number, sample) in samples.iter().enumerate() {
        send_until(&mut bus, &mut board, period * number as u32);
        for (_, burst) in bursts.iter().filter(|(from, _)| *from == number) {
            app.begin_burst(*burst, &mut board);
        }
        board.sample = Some(*sample);
        app.on_data_ready(&mut board);
    }
    let end = bus.now() + Duration::from_secs(5);
    send_until(&mut bus, &mut board, end);
    for counter in [
        &board.counters.queue_overflow,
        &board.counters.missed,
        &board.counters.overruns,
    ] {
        assert_eq!(counter.load(std::sync::atomic::Ordering::Relaxed), 0);
    }
    wire
}

fn compare(model: &Model<'_>, frames: &[Received]) -> (Verdict, Figures) {
    let mut comparison = Comparison::new(model.clone()).expect("a good model");
    for frame in frames {
        comparison.take(frame);
    }
    (comparison.verdict(true), comparison.figures())
}

/// Load and sensor frames.
fn estimates(frames: &[Received]) -> Vec<Frame> {
    let classic = frames.iter().filter_map(|received| {
        let (id, data) = standard(&received.frame)?;
        let data = data.try_into().ok()?;
        Some(Frame { id, data })
    });
    let is_estimate = |frame: &Frame| {
        let offset = frame.id % 32;
        (signal_layout::load::OFFSET..=signal_layout::sensor_health::OFFSET).contains(&offset)
    };
    classic.filter(is_estimate).collect()
}

/// Those of estimators that begin with the samples of these numbers.
fn estimates_of(image: &[u8], samples: &[RawSample], begins: &[usize]) -> Vec<Frame> {
    let mut frames = Vec::new();
    let ends = begins.iter().skip(1).copied().chain([samples.len()]);
    for (begin, end) in begins.iter().zip(ends) {
        let mut part = samples[*begin..end].to_vec();
        for (sample, tick) in part.iter_mut().zip(0..) {
            sample.tick = tick;
        }
        let sent = gearbox::on_host(image, &part, false);
        frames.extend(sent.into_iter().filter(gearbox::is_estimate));
    }
    frames
}

const CLASSIC: Burst = Burst {
    samples: 900,
    share_percent: 45,
    fd: false,
};

const FD: Burst = Burst {
    samples: 5000,
    share_percent: 60,
    fd: true,
};

/// Longer than the bus can carry beside the loads.
const TOO_LONG: Burst = Burst {
    samples: 5000,
    share_percent: 10,
    fd: false,
};

#[test]
fn a_burst_is_proved_classic_and_fd_and_loads_outside_it_are_no_loss() {
    let image = gearbox::image();
    let model = Model::from_bytes(&image).expect("good");
    let samples = samples(9000);
    for burst in [CLASSIC, FD] {
        let frames = traffic(&model, &image, &samples, &[(1500, burst)]);
        let (verdict, figures) = compare(&model, &frames);
        assert_eq!(verdict, Verdict::Identical, "{figures:#?}");
        assert_eq!(
            (figures.bursts, figures.dropped_bursts, figures.samples),
            (1, 0, burst.samples.into())
        );
        let expected = estimates_of(&image, &samples, &[0, 1500]);
        assert_eq!(estimates(&frames), expected);
        let within = usize::from(burst.samples);
        let proved = estimates_of(&image, &samples[1500..1500 + within], &[0]).len();
        assert_eq!(figures.compared_frames as usize, proved);
        assert_eq!(figures.outside_frames as usize, expected.len() - proved);
        assert_eq!(figures.firmware.as_deref(), Some(env!("CARGO_PKG_VERSION")));
    }
}

#[test]
fn a_bit_that_differs_in_a_burst_is_named() {
    let image = gearbox::image();
    let model = Model::from_bytes(&image).expect("good");
    let frames = traffic(&model, &image, &samples(4000), &[(1000, CLASSIC)]);
    let is_load = |received: &&Received| {
        standard(&received.frame).is_some_and(|(id, _)| id % 32 == signal_layout::load::OFFSET)
    };
    let loads: Vec<usize> = (0..frames.len())
        .filter(|i| is_load(&&frames[*i]))
        .collect();
    // The 600th load after the burst began is that of tick 599.
    for (number, expected) in [
        (1599, (Verdict::Different, 1, Some(599))),
        (3500, (Verdict::Identical, 0, None)),
    ] {
        let mut forged = frames.clone();
        let at = loads[number];
        let (id, data) = standard(&frames[at].frame).expect("a load");
        let mut data: [u8; 8] = data.try_into().expect("8 bytes");
        data[3] ^= 1;
        let counter = data[2];
        e2e::protect(e2e::data_id(id), counter, &mut data);
        forged[at].frame = to_bus(&Frame { id, data });
        let (verdict, figures) = compare(&model, &forged);
        let tick = figures.first_difference.map(|first| first.tick);
        assert_eq!((verdict, figures.differing_frames, tick), expected);
    }
}

#[test]
fn an_overload_drops_the_burst_counted_and_no_load_and_the_next_one_is_proved() {
    let image = gearbox::image();
    let model = Model::from_bytes(&image).expect("good");
    let samples = samples(9000);
    let bursts = [(1000, TOO_LONG), (5000, CLASSIC)];
    let frames = traffic(&model, &image, &samples, &bursts);
    assert_eq!(
        estimates(&frames),
        estimates_of(&image, &samples, &[0, 1000, 5000])
    );
    let (verdict, figures) = compare(&model, &frames);
    assert_eq!(verdict, Verdict::Identical, "{figures:#?}");
    assert_eq!((figures.bursts, figures.dropped_bursts), (1, 1));
    assert!(figures.samples > u64::from(CLASSIC.samples));

    // A raw frame lost on the bus: no proof, and nothing is held against the board.
    let mut lost = frames.clone();
    let heads: Vec<usize> = (0..lost.len())
        .filter(|i| {
            standard(&lost[*i].frame)
                .is_some_and(|(id, _)| id % 32 == signal_layout::raw_head::OFFSET)
        })
        .collect();
    lost.remove(heads[heads.len() - 400]);
    let (verdict, figures) = compare(&model, &lost);
    assert_eq!(
        (verdict, figures.differing_frames),
        (Verdict::Incomplete, 0),
        "{figures:#?}"
    );
}

#[test]
fn another_burst_does_not_begin_while_one_is_under_way() {
    let image = gearbox::image();
    let model = Model::from_bytes(&image).expect("good");
    let samples = samples(4000);
    let bursts = [(1000, CLASSIC), (1300, FD)];
    let frames = traffic(&model, &image, &samples, &bursts);
    assert_eq!(
        estimates(&frames),
        estimates_of(&image, &samples, &[0, 1000])
    );
    let (verdict, figures) = compare(&model, &frames);
    assert_eq!(
        (verdict, figures.bursts, figures.samples),
        (Verdict::Identical, 1, 900),
        "{figures:#?}"
    );
}

/// The machine of the NUCLEO-G474RE, four words and a counter at 2 kHz: the bursts of
/// `docs/reference/boards.md`, and no longer ones.
#[test]
fn bursts_of_the_real_boards_machine_are_as_long_as_documented() {
    let path = firmware::root().join("examples/bench/machine.toml");
    let machine = Machine::load(&path).expect("the description is valid");
    let sensors = Sensors::choose(&machine, None).expect("few enough sensors");
    let image = image_build::image(&machine, &sensors).expect("the machine fits an image");
    let model = Model::from_bytes(&image).expect("good");
    assert_eq!(NUCLEO_G474RE.serves(&model.image), Ok(()));
    let samples: Vec<RawSample> = (0..6000)
        .map(|tick: u32| {
            let mut sample = RawSample {
                tick,
                ..RawSample::default()
            };
            for channel in 0..4 {
                let noise = (tick * 4 + channel).wrapping_mul(2_654_435_761) >> 18;
                sample.set_word(channel as usize, 40_000 + noise as i32);
            }
            sample.set_encoder(0, (tick * 8) & 0xFFFF);
            sample
        })
        .collect();
    for (samples_in_burst, share_percent, fd, is_proved) in [
        (400, 50, false, true),
        (600, 50, false, false),
        (1000, 100, true, true),
        (3000, 100, true, false),
    ] {
        let burst = Burst {
            samples: samples_in_burst,
            share_percent,
            fd,
        };
        let frames = traffic(&model, &image, &samples, &[(1000, burst)]);
        let (verdict, figures) = compare(&model, &frames);
        assert_eq!(verdict, Verdict::Identical, "{figures:#?}");
        let counts = (figures.bursts, figures.dropped_bursts);
        let expected = if is_proved { (1, 0) } else { (0, 1) };
        assert_eq!(counts, expected, "{burst:?}: {figures:#?}");
        assert_eq!(
            estimates(&frames),
            estimates_of(&image, &samples, &[0, 1000])
        );
    }
}
