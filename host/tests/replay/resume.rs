//! Continuation of a replay from its saved state: a recording cut anywhere gives the bits of
//! the whole one, estimates and counters, for every machine kind, filter and sensor fault.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use crc::{CRC_32_ISO_HDLC, Crc};
use loadtwin::image_build::{self, Filter, Sensors};
use loadtwin::machine::{IndexSignal, Machine};
use loadtwin::recording::Input;
use loadtwin::replay::Run;
use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_common::counting::{LevelScale, LoadCounts};
use loadtwin_common::estimator::{Estimator, MAX_STATE_BYTES};
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::RawSample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

use super::faulty_recordings::{Recorded, example, loadtwin};

/// Time, references and estimate of each sample, as text of their bits.
type Rows = Vec<(u64, Vec<u64>, Estimate)>;

/// Cuts of all machines.
const CUTS: usize = 1000;

/// Turn of a shaft as the counts have it.
const TURN: f64 = 4_294_967_296.0;

/// A machine with a recording.
struct Case {
    name: &'static str,
    machine: Machine,
    sensors: Sensors,
    image: Vec<u8>,
    recorded: Recorded,
    whole: Rows,
    /// Of the load cycles and turns of the whole, of each load.
    counts: Counts,
}

impl Case {
    fn new(
        name: &'static str,
        mut machine: Machine,
        filter: Filter,
        recorded: impl FnOnce(&Sensors) -> Recorded,
    ) -> Self {
        machine.recording.largest_gap = 10;
        // A part may be too short to show it.
        if let Some(index) = &mut machine.index {
            index.signal = Some(IndexSignal::Latched);
        }
        let sensors = Sensors::choose(&machine, None).unwrap().filtered_by(filter);
        let image = image_build::image(&machine, &sensors).unwrap();
        let mut case = Self {
            name,
            recorded: recorded(&sensors),
            machine,
            sensors,
            image,
            whole: Rows::new(),
            counts: Counts::default(),
        };
        let (whole, _) = case.piece((0, case.recorded.rows()), None, false);
        assert!(whole.len() >= case.recorded.rows());
        case.whole = whole;
        let empty = case.empty_counts();
        case.counts = counted(&case.whole, &empty);
        assert_ne!(case.counts, empty, "{name}");
        case
    }

    /// The estimates of some rows, and the state after them.
    fn piece(
        &self,
        (from, until): (usize, usize),
        state: Option<&[u8]>,
        more: bool,
    ) -> (Rows, Option<Vec<u8>>) {
        let mut rows = Rows::new();
        let batches = self.recorded.part(from, until);
        let input = Input::Batches(&batches);
        let (machine, sensors, image) = (&self.machine, &self.sensors, &self.image);
        let mut run = match state {
            Some(state) => Run::continued(machine, sensors, image, input, state),
            None => Run::open(machine, sensors, image, input),
        }
        .unwrap();
        let mut push = |sample: &loadtwin::replay::Sample<'_>, estimate: &Estimate| {
            let references = sample.references.iter().map(|r| r.to_bits()).collect();
            rows.push((sample.t.to_bits(), references, estimate.clone()));
        };
        while run
            .next_block(|sample, estimate, _| push(sample, estimate))
            .unwrap()
        {}
        let state = more.then(|| run.save().unwrap());
        if !more {
            run.finish(|sample, estimate, _| push(sample, estimate));
        }
        (rows, state)
    }

    /// Counts of each load, of levels over its range.
    fn empty_counts(&self) -> Counts {
        let of = |nominal: f64| {
            let limit = 1.5 * nominal as f32;
            let scale = LevelScale::covering(-limit, limit).unwrap();
            saved(&mut LoadCounts::try_new(scale, 2).unwrap())
        };
        let loads = self.machine.loads();
        Counts {
            loads: loads.iter().map(|load| of(load.nominal)).collect(),
            angle_rad: None,
        }
    }

    /// Cuts the recording at random and compares.
    fn cut(&self, rng: &mut ChaCha8Rng) -> usize {
        let rows = self.recorded.rows();
        let count = rng.random_range(1..=3);
        // The first part has two rows at least: one has no period.
        let mut cuts: Vec<usize> = (0..count).map(|_| rng.random_range(2..rows)).collect();
        cuts.sort_unstable();
        let mut found = Rows::new();
        let (mut from, mut state) = (0, None);
        let mut counts = self.empty_counts();
        for until in cuts.iter().copied().chain([rows]) {
            let (piece, after) = self.piece((from, until), state.as_deref(), until < rows);
            counts = counted(&piece, &counts);
            found.extend(piece);
            (from, state) = (until, after);
        }
        assert!(
            counts == self.counts,
            "{}: counts, cut at {cuts:?}",
            self.name
        );
        assert_eq!(found.len(), self.whole.len(), "{}: {cuts:?}", self.name);
        for (i, (found, whole)) in found.iter().zip(&self.whole).enumerate() {
            assert!(
                found.0 == whole.0 && found.1 == whole.1 && same(&found.2, &whole.2),
                "{}, cut at {cuts:?}: sample {i} is {found:?}, of the whole {whole:?}",
                self.name
            );
        }
        count
    }
}

impl Case {
    /// Restores states with wrong bytes and a right checksum: refused, or estimated from, and never
    /// a panic.
    fn endure_wrong_numbers(&self, rng: &mut ChaCha8Rng) {
        const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
        let estimator = || Estimator::try_build(Image::from_bytes(&self.image).unwrap()).unwrap();
        let mut raw = RawSample::default();
        let mut next = |rng: &mut ChaCha8Rng| {
            raw.tick = raw.tick.wrapping_add(1);
            for k in 0..self.sensors.channels.len() {
                raw.set_word(k, rng.random_range(-100_000..100_000));
            }
            for k in 0..self.sensors.encoders.len() {
                raw.set_encoder(k, raw.tick.wrapping_mul(7));
            }
            raw
        };
        let mut line = estimator();
        for _ in 0..200 {
            line.step(&next(rng));
        }
        let mut bytes = vec![0; MAX_STATE_BYTES];
        let length = line.save(&self.image, &mut bytes).unwrap();
        bytes.truncate(length);
        let mut taken = 0;
        for _ in 0..400 {
            let mut wrong = bytes.clone();
            for _ in 0..rng.random_range(1..4) {
                wrong[rng.random_range(33..length - 4)] = rng.random();
            }
            let crc = CRC.checksum(&wrong[..length - 4]).to_le_bytes();
            wrong[length - 4..].copy_from_slice(&crc);
            let mut line = estimator();
            if line.restore(&self.image, &wrong).is_ok() {
                taken += 1;
                for _ in 0..20 {
                    line.step(&next(rng));
                }
            }
        }
        assert!(taken > 50, "{}: {taken} states", self.name);
    }
}

/// Counts of each load as bytes, and the angle of the shaft after them.
#[derive(Clone, Debug, Default, PartialEq)]
struct Counts {
    loads: Vec<Vec<u8>>,
    angle_rad: Option<f32>,
}

/// Counts that go on from others; the first shaft turns by the estimated angle, the other twice as
/// fast.
fn counted(rows: &Rows, before: &Counts) -> Counts {
    let continued = |bytes: &Vec<u8>| LoadCounts::continued(bytes).unwrap();
    let mut loads: Vec<LoadCounts> = before.loads.iter().map(continued).collect();
    let mut angle_rad = before.angle_rad;
    for (_, _, estimate) in rows {
        let last = angle_rad.replace(estimate.angle_rad);
        let advance_rad = f64::from(estimate.angle_rad - last.unwrap_or(estimate.angle_rad));
        let advance = (advance_rad.rem_euclid(TAU) / TAU * TURN) as u32;
        for (counts, load) in loads.iter_mut().zip(&estimate.loads) {
            let valid = load.fault.is_none().then_some(load.value);
            counts.push(valid, [advance, advance.wrapping_mul(2)]);
        }
    }
    Counts {
        loads: loads.iter_mut().map(saved).collect(),
        angle_rad,
    }
}

fn saved(counts: &mut LoadCounts) -> Vec<u8> {
    let mut bytes = vec![0; MAX_BYTES];
    let length = counts.save(&mut bytes).unwrap();
    bytes.truncate(length);
    bytes
}

/// Whether two estimates have the same bits; NaN does not occur.
fn same(a: &Estimate, b: &Estimate) -> bool {
    let numbers = |e: &Estimate| {
        let loads = e.loads.iter().flat_map(|l| [l.value, l.std]);
        let sensors = e.sensors.iter();
        let sensors =
            sensors.flat_map(|s| [s.measured, s.innovation, s.innovation_variance, s.nis]);
        let all = loads.chain(sensors).chain([e.angle_rad]);
        all.map(f32::to_bits).collect::<Vec<_>>()
    };
    a == b && numbers(a) == numbers(b)
}

fn load(name: &str) -> Machine {
    Machine::load(&example(name)).unwrap()
}

fn gearbox() -> Recorded {
    let arguments = ["--scenario", "steps", "--duration-s", "12", "--seed", "5"];
    Recorded::simulated("gearbox/machine.toml", &arguments)
}

fn gearbox_with(name: &'static str, recorded: impl FnOnce(&Sensors) -> Recorded) -> Case {
    let machine = load("gearbox/machine.toml");
    Case::new(name, machine, Filter::Aekf, recorded)
}

fn plain_gearbox() -> Case {
    gearbox_with("gearbox", |s| gearbox().with_faults(s, 1))
}

const EFFECTS: &str = r#"
[[balance.effect]]
name = "presliding-hysteresis"
shape = [0.05]
coefficients = [0.1]
[[balance.effect]]
name = "backlash"
shape = [0.02]
coefficients = [0.05]
[[balance.effect]]
name = "delay"
shape = []
coefficients = [-1.2e-4, -0.012]
"#;

/// The drive of its example, with friction that is remembered and a current that comes late.
fn drive() -> Machine {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("drive.toml");
    let text = std::fs::read_to_string(example("feed-drive/drive.toml")).unwrap();
    let text = text.replace("inertia = 0.01", "inertia = 0.01\nnominal = 6");
    std::fs::write(&path, text + EFFECTS).unwrap();
    Machine::load(&path).unwrap()
}

fn cases() -> Vec<Case> {
    let rotor = || {
        let arguments = ["--duration-s", "2", "--seed", "7"];
        Recorded::simulated("rotor/machine.toml", &arguments)
    };
    let mut lagging = load("rotor/machine.toml");
    if let Some(rotor) = &mut lagging.rotor {
        rotor.lag_samples = Some(3);
    }
    let steady = load("gearbox/calibrated.toml");
    let bearing = load("bearing/calibrated.toml");
    vec![
        plain_gearbox(),
        gearbox_with("gearbox, wires", |s| gearbox().with_exchanged_wires(s)),
        gearbox_with("gearbox, drift", |s| gearbox().with_drift(s, 7)),
        Case::new("gearbox, steady", steady, Filter::Steady, |s| {
            gearbox().with_faults(s, 2)
        }),
        Case::new("rotor", load("rotor/machine.toml"), Filter::Aekf, |s| {
            rotor().with_faults(s, 3)
        }),
        Case::new("rotor, lagging", lagging, Filter::Aekf, |s| {
            rotor().with_faults(s, 4)
        }),
        Case::new("bearing", bearing, Filter::Aekf, |s| {
            let arguments = ["--scenario", "lc1", "--duration-s", "2", "--seed", "2"];
            Recorded::simulated("bearing/calibrated.toml", &arguments).with_faults(s, 5)
        }),
        Case::new("drive", drive(), Filter::Aekf, |s| {
            let arguments = [
                "--scenario",
                "reversals",
                "--duration-s",
                "20",
                "--seed",
                "3",
            ];
            Recorded::simulated("feed-drive/plant.toml", &arguments).with_faults(s, 6)
        }),
    ]
}

#[test]
fn a_recording_cut_anywhere_gives_the_bits_of_a_whole() {
    let cases = cases();
    let mut flags = BTreeSet::new();
    for case in &cases {
        let rows = || case.whole.iter().map(|row| &row.2);
        let sensors = rows().flat_map(|estimate| estimate.sensors.iter().map(|s| s.fault));
        let loads = rows().flat_map(|estimate| estimate.loads.iter().map(|l| l.fault));
        let faulty = sensors.clone().filter(|fault| !fault.is_none()).count();
        assert!(faulty > 100, "{}: {faulty} faulty", case.name);
        let of_case: BTreeSet<&str> = sensors.chain(loads).map(Fault::name).collect();
        println!("{}: {of_case:?}", case.name);
        flags.extend(of_case);
    }
    let all = Fault::ALL.map(Fault::name);
    assert_eq!(flags, BTreeSet::from(all), "a fault that none is cut at");
    let mut rng = ChaCha8Rng::seed_from_u64(44);
    for case in &cases {
        case.endure_wrong_numbers(&mut rng);
    }
    let (mut done, mut next) = (0, cases.iter().cycle());
    while done < CUTS {
        done += next.next().unwrap().cut(&mut rng);
    }
    println!("{done} cuts, {} machines", cases.len());
}

#[test]
fn a_state_is_of_its_image_and_whole() {
    let case = &plain_gearbox();
    let (_, state) = case.piece((0, 3000), None, true);
    let state = state.unwrap();
    assert!(state.len() < 8192, "{} bytes", state.len());
    let rest = || case.recorded.part(3000, case.recorded.rows());
    let refused = |machine: &Machine, filter: Filter, state: &[u8]| {
        let sensors = Sensors::choose(machine, None).unwrap().filtered_by(filter);
        let image = image_build::image(machine, &sensors).unwrap();
        let batches = rest();
        let run = Run::continued(machine, &sensors, &image, Input::Batches(&batches), state);
        run.err().map(|error| error.to_string()).unwrap_or_default()
    };
    let other = refused(&case.machine, Filter::Steady, &state);
    assert!(other.contains("another model"), "{other}");
    let calibrated = Machine::load(&example("gearbox/calibrated.toml")).unwrap();
    let other = refused(&calibrated, Filter::Aekf, &state);
    assert!(other.contains("another model"), "{other}");
    for (at, byte) in [
        (0, 1),
        (20, 1),
        (state.len() / 2, 4),
        (state.len() - 1, 128),
    ] {
        let mut damaged = state.clone();
        damaged[at] ^= byte;
        let found = refused(&case.machine, Filter::Aekf, &damaged);
        assert!(found.contains("damaged"), "{at}: {found}");
    }
    for length in [0, 3, 17, state.len() - 1] {
        let found = refused(&case.machine, Filter::Aekf, &state[..length]);
        assert!(found.contains("no saved state"), "{length}: {found}");
    }
    assert_eq!(refused(&case.machine, Filter::Aekf, &state), "");
    // Rows that were there before.
    let sensors = Sensors::choose(&case.machine, None).unwrap();
    let batches = case.recorded.part(2000, 4000);
    let input = Input::Batches(&batches);
    let run = Run::continued(&case.machine, &sensors, &case.image, input, &state);
    let error = run.err().map(|error| error.to_string()).unwrap_or_default();
    assert!(error.contains("only forwards"), "{error}");
}

#[test]
fn two_files_are_replayed_as_one() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let machine = example("rotor/machine.toml");
    let machine = machine.to_str().unwrap();
    let simulated = [
        "simulate",
        machine,
        "--duration-s",
        "1",
        "-o",
        &at("whole.csv"),
    ];
    assert!(loadtwin(&simulated).status.success());
    let text = std::fs::read_to_string(at("whole.csv")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let header = lines
        .iter()
        .position(|line| !line.starts_with('#'))
        .unwrap();
    let write = |name: &str, rows: &[&str]| {
        let text = [&[lines[header]][..], rows, &[""][..]].concat().join("\n");
        std::fs::write(at(name), text).unwrap();
    };
    write("whole-plain.csv", &lines[header + 1..]);
    write("first.csv", &lines[header + 1..700]);
    write("second.csv", &lines[700..]);
    let replay = |recording: &str, estimates: &str, more: &[&str]| {
        let (recording, estimates) = (at(recording), at(estimates));
        let mut all = vec!["replay", machine, &recording, "--estimates", &estimates];
        all.extend(more);
        let output = loadtwin(&all);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.success(), said)
    };
    assert!(replay("whole-plain.csv", "a.csv", &[]).0);
    let state = at("monday.state");
    let (done, said) = replay("first.csv", "b.csv", &["--state-out", &state]);
    assert!(done, "{said}");
    let (done, said) = replay("second.csv", "c.csv", &["--state-in", &state]);
    assert!(done, "{said}");
    let read = |name: &str| std::fs::read_to_string(at(name)).unwrap();
    let (_, after) = read("c.csv")
        .split_once('\n')
        .map(|(a, b)| (a.to_owned(), b.to_owned()))
        .unwrap();
    assert_eq!(read("b.csv") + &after, read("a.csv"));
    // The state is an input, and no other file is one.
    let both = replay(
        "second.csv",
        "d.csv",
        &["--state-in", &state, "--state-out", &state],
    );
    assert!(
        !both.0 && both.1.contains("no input is written to"),
        "{both:?}"
    );
    write("short.csv", &lines[700..702]);
    let wrong = replay("second.csv", "d.csv", &["--state-in", &at("short.csv")]);
    assert!(!wrong.0 && wrong.1.contains("no saved state"), "{wrong:?}");
    let over = replay("second.csv", "d.csv", &["--state-out", &at("first.csv")]);
    assert!(!over.0, "{over:?}");
}
