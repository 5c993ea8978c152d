//! Comparison of a machine's frames with the estimator on the host, as `twin` and `prove` do:
//! identical, one bit different, frames lost, foreign or late, restarts, files that are no logs.
//! `node` and `send` on a simulated controller, without a real bus.

use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use loadtwin::can::bus::{Bus, BusError, Received};
use loadtwin::can::bus_frame::BusFrame;
use loadtwin::can::estimator_node::{self, NodeArgs};
use loadtwin::can::frame_comparison::{Comparison, Figures, Verdict};
use loadtwin::can::live_display::Quiet;
use loadtwin::can::log::{LogBus, LogWriter};
use loadtwin::can::sample_sender::{self, SendArgs};
use loadtwin::can::simulated_controller::SimulatedController;
use loadtwin::can::twin_and_prove::{self, ProveArgs};
use loadtwin::can::{Model, standard, to_bus};
use loadtwin_common::io::frame::Frame;

use crate::machine::{image, samples, traffic};

static NEVER: AtomicBool = AtomicBool::new(false);

fn compare(model: &Model<'_>, frames: &[Received]) -> (Verdict, Figures) {
    let mut comparison = Comparison::new(model.clone()).expect("a good model");
    for frame in frames {
        comparison.take(frame);
    }
    (comparison.verdict(true), comparison.figures())
}

fn id(received: &Received) -> u16 {
    standard(&received.frame).expect("a standard frame").0 & 31
}

/// The frame with bit `bit` of its payload turned and its check made to fit.
fn forged(received: &Received, bit: usize) -> Received {
    let (id, data) = standard(&received.frame).expect("a standard frame");
    let mut data: [u8; 8] = data.try_into().expect("8 bytes");
    data[bit / 8] ^= 1 << (bit % 8);
    let counter = data[2];
    loadtwin_common::io::frame::e2e::protect(
        loadtwin_common::io::frame::e2e::data_id(id),
        counter,
        &mut data,
    );
    Received {
        frame: to_bus(&Frame { id, data }),
        ..*received
    }
}

#[test]
fn a_machine_with_the_same_model_is_identical_classic_and_fd_with_lost_samples() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    for fd in [false, true] {
        let taken = samples(5000, |tick| {
            tick % 777 == 300 || (2000..2300).contains(&tick)
        });
        let (verdict, figures) = compare(&model, &traffic(&model, &taken, fd));
        assert_eq!(verdict, Verdict::Identical, "{figures:#?}");
        assert_eq!(figures.samples, taken.len() as u64);
        assert!(figures.compared_frames >= 2 * figures.samples);
        assert_eq!(figures.missing_ticks, 5000 - taken.len() as u64);
        assert_eq!(figures.machine_model, Some(model.hash));
    }
}

#[test]
fn one_bit_anywhere_in_a_load_frame_is_found_and_named() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let clean = traffic(&model, &samples(400, |_| false), false);
    let at = clean
        .iter()
        .rposition(|frame| id(frame) == 1)
        .expect("a load frame");
    for bit in 24..64 {
        let mut frames = clean.clone();
        frames[at] = forged(&clean[at], bit);
        let (verdict, figures) = compare(&model, &frames);
        if figures.damaged_frames == 1 {
            // No such fault: refused by its content.
            assert!((54..59).contains(&bit) && verdict == Verdict::Incomplete);
            continue;
        }
        assert_eq!(verdict, Verdict::Different);
        let first = figures.first_difference.expect("a difference");
        assert_eq!(
            (
                first.tick,
                figures.differing_frames,
                figures.differing_bits > 0
            ),
            (399, 1, true)
        );
        let field = match bit {
            24..42 => "value",
            42..54 => "std",
            54..59 => "fault",
            _ => "age",
        };
        assert!(
            first.what.starts_with(&format!("load main: {field} ")),
            "{bit}: {}",
            first.what
        );
    }
}

#[test]
fn lost_frames_of_every_kind_are_counted_and_nothing_else_is_blamed() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let clean = traffic(&model, &samples(2000, |_| false), false);
    // A load frame: lost, and only that.
    let mut frames = clean.clone();
    let at = clean
        .iter()
        .position(|f| id(f) == 2 && f.t_us == 2_000_000)
        .expect("a load frame");
    frames.remove(at);
    let (verdict, figures) = compare(&model, &frames);
    assert_eq!(
        (verdict, figures.lost_frames, figures.differing_frames),
        (Verdict::Incomplete, 1, 0)
    );

    // One frame of a raw sample: the sample is not known, its loads have no
    // proof, and what differs from there on is not held against the machine.
    for part in [8, 9, 13] {
        let mut frames = clean.clone();
        let at = clean
            .iter()
            .position(|f| id(f) == part && f.t_us == 2_000_000)
            .expect("a raw frame");
        frames.remove(at);
        let (verdict, figures) = compare(&model, &frames);
        assert_eq!(
            (verdict, figures.differing_frames),
            (Verdict::Incomplete, 0),
            "{part}"
        );
        assert!(figures.unverifiable_frames >= 2, "{part}: {figures:#?}");
        assert!(figures.unsettled_frames > 0, "{part}: {figures:#?}");

        // Once the machine has started anew its state is known.
        frames.extend(clean.iter().copied());
        let at = frames
            .iter()
            .rposition(|f| id(f) == 1)
            .expect("a load frame");
        frames[at] = forged(&frames[at], 24);
        let (verdict, figures) = compare(&model, &frames);
        assert_eq!(
            (verdict, figures.differing_frames),
            (Verdict::Different, 1),
            "{part}"
        );
    }
}

#[test]
fn what_is_not_the_machines_is_counted_and_changes_nothing() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let clean = traffic(&model, &samples(300, |_| false), false);
    let line = |text: &str| {
        let mut bus = LogBus::new(text.as_bytes(), None).expect("memory");
        let received = bus.receive(Duration::ZERO).expect("a frame");
        received.expect("a log never times out").frame
    };
    let base = model.image.can_base;
    let ours = |id: u16, rest: &str| line(&format!("(0.000000) can0 {:03X}{rest}", base + id));
    let others = [
        line("(0.000000) can0 7E3#1122"),
        line(&format!(
            "(0.000000) can0 {:08X}#0011223344556677",
            base + 1
        )),
        ours(1, "#R8"),
        line("(0.000000) can0 20000040#0000000000000000"),
        ours(1, "#00112233445566"),
        ours(1, "##00011223344556677AABBCCDD"),
        ours(1, "#0011223344556677"),
        ours(17, "#0011223344556677"),
    ];
    let mut frames = Vec::new();
    for frame in &clean {
        frames.push(*frame);
        if id(frame) == 1 {
            // Twice the same frame, then all the others.
            frames.push(*frame);
            frames.extend(others.map(|other| Received {
                t_us: frame.t_us,
                frame: other,
            }));
        }
    }
    let (verdict, figures) = compare(&model, &frames);
    let (_, without) = compare(&model, &clean);
    assert_eq!(
        verdict,
        Verdict::Incomplete,
        "a damaged frame may have been one of ours"
    );
    assert_eq!(
        (figures.compared_frames, figures.differing_frames),
        (without.compared_frames, 0)
    );
    assert_eq!(
        figures.lost_frames + figures.unverifiable_frames + figures.unsettled_frames,
        0
    );
    assert_eq!(figures.repeated_frames, 300);
    assert_eq!(figures.foreign_frames, 4 * 300);
    assert_eq!(figures.error_frames, 300);
    assert_eq!(figures.malformed_frames, 2 * 300);
    assert_eq!(figures.damaged_frames, 300);
}

#[test]
fn estimates_before_their_raw_sample_and_far_behind_it_are_matched() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let clean = traffic(&model, &samples(1500, |_| false), false);
    let is_raw = |f: &&Received| (8..15).contains(&id(f));
    // All raw samples first, the machine a thousand samples behind.
    let late: Vec<_> = clean
        .iter()
        .filter(is_raw)
        .chain(clean.iter().filter(|f| !is_raw(f)))
        .copied()
        .collect();
    assert_eq!(compare(&model, &late).0, Verdict::Identical);
    // The estimate of each sample before its raw frames.
    let mut early = Vec::new();
    for group in clean.chunk_by(|a, b| a.t_us == b.t_us) {
        early.extend(
            group
                .iter()
                .filter(|f| !is_raw(f))
                .chain(group.iter().filter(is_raw))
                .copied(),
        );
    }
    let (verdict, figures) = compare(&model, &early);
    assert_eq!(verdict, Verdict::Identical, "{figures:#?}");
}

#[test]
fn a_restart_is_followed_and_another_model_is_noticed() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let mut frames = traffic(&model, &samples(700, |_| false), false);
    frames.extend(traffic(&model, &samples(900, |_| false), false));
    let (verdict, figures) = compare(&model, &frames);
    assert_eq!(
        (verdict, figures.restarts),
        (Verdict::Identical, 1),
        "{figures:#?}"
    );

    let other = Model {
        hash: model.hash ^ 1,
        ..model.clone()
    };
    assert_eq!(compare(&other, &frames).0, Verdict::OtherModel);
}

#[test]
fn a_log_is_proved_and_its_bad_lines_are_counted() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("candump.log");
    let mut writer = LogWriter::create(&path, "vcan0").expect("created");
    for frame in traffic(&model, &samples(1000, |_| false), false) {
        writer.write(&frame).expect("written");
    }
    writer.finish().expect("written");
    // The suffix of `candump -x`, and a torn line.
    let text = std::fs::read_to_string(&path)
        .expect("read")
        .replace('\n', " R\n");
    std::fs::write(&path, format!("{text}(12.0")).expect("written");
    let args = ProveArgs {
        log: path.display().to_string(),
        interface: None,
    };
    let summary = twin_and_prove::prove(&model, &args, &mut Quiet, &NEVER).expect("proved");
    // The torn line may have been a frame of the machine.
    assert_eq!(summary.verdict, Verdict::Incomplete);
    assert_eq!(
        (summary.figures.samples, summary.malformed_lines),
        (1000, 1)
    );
}

/// What is no log is refused by what it is, before anything is compared.
#[test]
fn files_that_are_no_logs_are_refused_by_their_names() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("other.log");
    let proved = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("written");
        let args = ProveArgs {
            log: path.display().to_string(),
            interface: None,
        };
        twin_and_prove::prove(&model, &args, &mut Quiet, &NEVER)
    };
    for (bytes, name) in [
        (&b"t1088 2B30000000000701\r"[..], "another file"),
        (
            b"time,id,data\n0.0,0x108,2B30000000000701\n",
            "a table of text",
        ),
        (b"PAR1\x15\0", "a Parquet file"),
        (b"format = 1\nname = \"bench\"\n", "a TOML file"),
    ] {
        let Err(reason) = proved(bytes) else {
            panic!("read: {}", String::from_utf8_lossy(bytes));
        };
        let line = reason.to_string();
        assert!(line.contains(&format!("found {name}, no log")), "{line}");
        assert!(line.contains("allowed: candump"), "{line}");
    }
    let damaged = proved(b"LOGG\x90\0\0\0\xff\n\xfe\nLOBJ....").expect_err("damaged");
    assert!(damaged.to_string().contains("BLF"), "{damaged}");
    // A log of `candump -L` with error frames and of FD frames is one.
    for bytes in [
        &b"(1714730400.000000) can0 20000080#0000000000000000\n(1714730400.1) can0 108#2B30\n"[..],
        b"(1714730400.000000) can0 108##12B30000000000701\n",
    ] {
        assert!(proved(bytes).is_ok(), "{}", String::from_utf8_lossy(bytes));
    }
}

#[test]
fn a_node_answers_with_the_bits_of_the_machine_through_bus_off() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let clean = traffic(&model, &samples(1000, |_| false), false);
    let is_raw = |f: &&Received| (8..15).contains(&id(f));
    let ms = Duration::from_millis;
    for disturbed in [vec![], vec![ms(100)..ms(140)]] {
        let faulty = !disturbed.is_empty();
        let mut bus = SimulatedController::new(500_000, disturbed);
        bus.incoming = clean
            .iter()
            .filter(is_raw)
            .map(|f| f.frame)
            .collect::<VecDeque<_>>();
        let args = NodeArgs {
            interface: String::new(),
            log: None,
            idle: Some(Duration::from_millis(500)),
        };
        let mut wire = Vec::new();
        let summary =
            estimator_node::run(&model, Tap(&mut bus, &mut wire), &args, &mut Quiet, &NEVER)
                .expect("ran");
        assert_eq!(
            (summary.samples, summary.bus.bus_off),
            (1000, u64::from(faulty))
        );
        assert_eq!(summary.bus.dropped, 0);
        let loads = |f: &BusFrame| (1..8).contains(&(standard(f).expect("standard").0 & 31));
        let sent: Vec<_> = wire.into_iter().filter(loads).collect();
        let meant: Vec<_> = clean.iter().map(|f| f.frame).filter(loads).collect();
        assert_eq!(sent, meant);
    }
}

#[test]
fn samples_go_out_in_real_time_and_fast() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let taken = samples(500, |_| false);
    for (fast, fd) in [(false, false), (true, false), (true, true)] {
        let args = SendArgs {
            interface: None,
            log: None,
            fast,
            fd,
            lockstep: None,
        };
        let mut bus = SimulatedController::new(1_000_000, vec![]);
        let mut wire = Vec::new();
        let each = taken.iter().map(|sample| Ok(*sample));
        let summary = sample_sender::run(
            &model,
            Tap(&mut bus, &mut wire),
            each,
            &args,
            &mut Quiet,
            &NEVER,
        )
        .expect("sent");
        assert_eq!((summary.samples, summary.incomplete_samples), (500, 0));
        // 500 Hz: one second, less the last period.
        let seconds = summary.seconds;
        assert!(
            if fast {
                seconds < 0.4
            } else {
                (0.998..1.0).contains(&seconds)
            },
            "{seconds}"
        );
        let frames: Vec<_> = wire
            .into_iter()
            .map(|frame| Received { t_us: 0, frame })
            .collect();
        assert_eq!(compare(&model, &frames).1.samples, 500);
    }
}

/// A controller of which the wire is kept.
struct Tap<'a>(&'a mut SimulatedController, &'a mut Vec<BusFrame>);

impl Bus for Tap<'_> {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        self.0.receive(timeout)
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        self.0.send(frame)?;
        self.1.push(*frame);
        Ok(())
    }

    fn restart(&mut self) -> Result<(), BusError> {
        self.0.restart()
    }

    fn now(&self) -> Duration {
        self.0.now()
    }

    fn wait(&mut self, time: Duration) {
        self.0.wait(time);
    }
}
