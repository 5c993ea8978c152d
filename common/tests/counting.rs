//! Tests of the load counts (`LoadCounts`) on random sequences of levels: one that is cut at random
//! places, saved and continued or appended, has the counts of the whole; ten million samples
//! neither overflow nor drift; no sample closes more than 8 cycles. `LOADTWIN_SEQUENCES` and
//! `LOADTWIN_SAMPLES` set how many.

use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_common::counting::{LEVELS, LevelScale, LoadCounts, Residue, SHAFTS};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random sequences, or `LOADTWIN_SEQUENCES`.
const SEQUENCES: u64 = 10_000;

/// Samples of the long sequence, or `LOADTWIN_SAMPLES`.
const SAMPLES: u64 = 10_000_000;

/// Parts of one turn.
const TURN: f64 = 4_294_967_296.0;

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |number| number.parse().unwrap())
}

/// Levels that are their own loads.
fn counts(gate: u8) -> LoadCounts {
    LoadCounts::try_new(LevelScale::try_new(-0.5, 1.0).unwrap(), gate).unwrap()
}

/// One sample: its level where it is valid, the advance of both shafts, and samples that are
/// missing behind it.
struct Sample {
    load: Option<f32>,
    advance: [u32; SHAFTS],
    missing: u64,
}

/// White, a walk, a slow sine with noise, ranges that grow and shrink.
fn random(rng: &mut ChaCha8Rng) -> Vec<Sample> {
    let len = (10.0 * 1000.0_f64.powf(rng.random::<f64>())) as usize;
    let kind = rng.random_range(0..4);
    let mut level = rng.random_range(0..LEVELS as i32);
    let speed = rng.random::<u32>() >> rng.random_range(0..12);
    let sequence = (0..len).map(|i| {
        let along = i as f64;
        level = match kind {
            0 => rng.random_range(0..128),
            1 => (level + rng.random_range(-9..=9)).clamp(0, 127),
            2 => (64.0 + 50.0 * (along * 0.3).sin()) as i32 + rng.random_range(-8..=8),
            _ => (64.0 + 63.0 * (along * 0.012).sin() * f64::from(1 - 2 * (i as i32 % 2))) as i32,
        };
        let is_valid = rng.random_ratio(49, 50);
        Sample {
            load: is_valid.then_some(level as f32),
            advance: [speed, speed / 7],
            missing: if is_valid { 0 } else { rng.random_range(0..3) },
        }
    });
    sequence.collect()
}

fn take(counts: &mut LoadCounts, samples: &[Sample]) {
    for sample in samples {
        counts.push(sample.load, sample.advance);
        if sample.missing > 0 {
            counts.gap(sample.missing);
        }
    }
}

fn settled(mut counts: LoadCounts) -> LoadCounts {
    counts.settle();
    counts
}

/// Cut at random places: saved and continued there, and counted apart and appended.
#[test]
fn sequences_cut_at_random_are_counted_as_one() {
    let mut rng = ChaCha8Rng::seed_from_u64(45);
    let mut bytes = vec![0; MAX_BYTES];
    let (mut samples, mut cycles, mut cuts) = (0, 0, 0);
    for _ in 0..number("LOADTWIN_SEQUENCES", SEQUENCES) {
        let sequence = random(&mut rng);
        let gate = rng.random_range(1..12);
        let mut batch = counts(gate);
        take(&mut batch, &sequence);
        let (mut saved, mut appended) = (counts(gate), counts(gate));
        let mut rest = &sequence[..];
        while !rest.is_empty() {
            let (part, after) = rest.split_at(rng.random_range(1..=rest.len()));
            take(&mut saved, part);
            let len = saved.save(&mut bytes).unwrap();
            saved = LoadCounts::continued(&bytes[..len]).unwrap();
            let mut later = counts(gate);
            take(&mut later, part);
            appended.append(&later).unwrap();
            rest = after;
            cuts += 1;
        }
        let (closed, residue) = batch.ended();
        assert_eq!(appended.ended(), (closed.clone(), residue));
        assert_eq!(appended.level_crossings(), batch.level_crossings());
        assert_eq!(appended.time(), batch.time());
        assert_eq!(appended.observation(), batch.observation());
        assert_eq!(appended.extremes(), batch.extremes());
        assert_eq!(settled(saved), settled(batch));
        samples += sequence.len();
        cycles += closed.cycles();
    }
    println!("{samples} samples, {cycles} closed cycles, {cuts} parts");
}

/// Levels 10, 100, 40, 70 again and again: one small cycle in each large one. Every fifth sample
/// is not valid, and shafts turn by 1/1000 and 1/3000 turn a sample.
#[test]
fn nothing_overflows_or_drifts_in_a_long_sequence() {
    let samples = number("LOADTWIN_SAMPLES", SAMPLES) / 5 * 5;
    let step = (TURN / 1000.0) as u32;
    let mut counts = counts(1);
    for _ in 0..samples / 5 {
        for load in [Some(10.0), Some(100.0), Some(40.0), Some(70.0), None] {
            counts.push(load, [step, step / 3]);
        }
    }
    let periods = samples / 5;
    let (closed, residue) = counts.ended();
    let ranges: Vec<u64> = closed.ranges().iter().collect();
    // The last small cycle is open, and so is the first large one.
    assert_eq!((ranges[30], ranges[90]), (periods - 1, periods - 1));
    assert_eq!(closed.cycles(), 2 * (periods - 1));
    assert_eq!(closed.matrix().get(5, 50), periods - 1);
    assert_eq!(closed.matrix().get(20, 35), periods - 1);
    assert_eq!(
        (residue.points(), closed.matrix().lost()),
        (&[10, 100, 40, 70][..], 0)
    );
    let seen = counts.observation();
    assert_eq!((seen.seen, seen.not_valid), (4 * periods, periods));
    assert_eq!(seen.elapsed(), samples);
    assert_eq!(counts.time().get(50), periods);
    for (turns, step) in counts.turns().iter().zip([step, step / 3]) {
        let all: f64 = (0..32).map(|bin| turns.turns(bin)).sum::<f64>() + turns.unseen();
        // Whole parts of 1/32 turn are counted.
        let missing = samples as f64 * f64::from(step) / TURN - all;
        assert!((0.0..1.0 / 32.0).contains(&missing), "{missing}");
    }
    println!("{samples} samples, {} closed cycles", closed.cycles());
}

/// The longest residue, ranges 1 to 127 and back, closed by full swings: one point closes 64
/// cycles at once, but no sample more than 8, and in the end all are closed.
#[test]
fn a_sample_closes_a_bounded_number_of_cycles() {
    let mut points = vec![63_u8];
    for (k, range) in (1..128).chain((1..128).rev()).enumerate() {
        let last = points[k];
        points.push(if k % 2 == 0 {
            last + range
        } else {
            last - range
        });
    }
    points.extend((0..40).map(|k| if k % 2 == 0 { 127 } else { 0 }));
    let (mut counts, mut at_once) = (counts(1), Residue::new());
    let (mut before, mut most) = (0, 0);
    let (mut expected, mut most_at_once) = (0, 0);
    for &point in &points {
        counts.push(Some(f32::from(point)), [0; 2]);
        let now = counts.closed().cycles();
        most = most.max(now - before);
        before = now;
        let mut closed = 0;
        at_once.push(point, |_| closed += 1);
        most_at_once = most_at_once.max(closed);
        expected += closed;
    }
    assert_eq!((most, most_at_once), (8, 64));
    let (closed, residue) = counts.ended();
    assert_eq!((closed.cycles(), residue), (expected, at_once));
}
