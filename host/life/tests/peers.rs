//! Compares counts and equivalent loads with rainflow, fatpack, pylife and py-fatigue, on the
//! examples of ASTM E1049-85 and of textbooks and on 10 000 random sequences: half cycles and
//! residue are equal, equivalent loads agree to 1e-6.
//!
//! The sequences are of whole levels, so that peers and levels see the same numbers.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use loadtwin_common::counting::{Cycle, LevelScale, LoadCounts};
use loadtwin_life::{Spectrum, equivalent_load};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Exponents of `peers.py`.
const EXPONENTS: [f64; 5] = [3.0, 4.0, 6.6, 9.0, 12.0];

/// Random sequences; more with `LOADTWIN_SEQUENCES`.
const SEQUENCES: usize = 10_000;

/// Peers, and whether they have a residue.
const PEERS: [(&str, bool); 4] = [
    ("rainflow", false),
    ("fatpack", true),
    ("pylife", true),
    ("py-fatigue", false),
];

fn counted(levels: &[u8]) -> LoadCounts {
    let scale = LevelScale::try_new(-0.5, 1.0).unwrap();
    let mut counts = LoadCounts::try_new(scale, 1).unwrap();
    for &level in levels {
        counts.push(Some(f32::from(level)), [0; 2]);
    }
    counts
}

/// The peers' lines for `sequences`, in their order.
fn peers(sequences: &[Vec<u8>], mut each: impl FnMut(&[u8], &Value)) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = std::env::var_os("LOADTWIN_PYTHON")
        .map_or_else(|| here.join("../../target/venv/bin/python"), PathBuf::from);
    let mut child = Command::new(&python)
        .arg(here.join("tests/peers.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap_or_else(|e| {
            panic!(
                "{}: {e}; tests/run sets it up, or LOADTWIN_PYTHON names a Python with \
                 tests/requirements.txt",
                python.display()
            )
        });
    let mut stdin = child.stdin.take().unwrap();
    let stdout = BufReader::new(child.stdout.take().unwrap());
    std::thread::scope(|scope| {
        scope.spawn(move || {
            for levels in sequences {
                writeln!(stdin, "{levels:?}").unwrap();
            }
        });
        let mut lines = stdout.lines();
        for levels in sequences {
            let line = lines.next().expect("the peers gave up").unwrap();
            each(levels, &serde_json::from_str(&line).unwrap());
        }
    });
    assert!(child.wait().unwrap().success());
}

fn numbers(value: &Value) -> Vec<f64> {
    let values = value.as_array().unwrap().iter();
    values.map(|number| number.as_f64().unwrap()).collect()
}

/// Counts, residue and equivalent loads equal those of every peer.
fn compare(levels: &[u8], found: &Value) {
    let counts = counted(levels);
    let (closed, residue) = counts.ended();
    let mut half_cycles: Vec<f64> = closed.ranges().iter().map(|n| 2.0 * n as f64).collect();
    for range in residue.ranges().map(Cycle::range) {
        half_cycles[usize::from(range)] += 1.0;
    }
    let points: Vec<f64> = residue.points().iter().map(|&level| level.into()).collect();
    let spectrum = Spectrum::of("levels", &counts).unwrap();
    for (peer, has_residue) in PEERS {
        let of_peer = &found[peer];
        assert_eq!(
            numbers(&of_peer["half_cycles"]),
            half_cycles,
            "{peer}: {levels:?}"
        );
        assert_eq!(!of_peer["residue"].is_null(), has_residue);
        if has_residue {
            assert_eq!(numbers(&of_peer["residue"]), points, "{peer}: {levels:?}");
        }
        for (m, theirs) in EXPONENTS.into_iter().zip(numbers(&of_peer["equivalent"])) {
            let ours = equivalent_load(&spectrum, m, 1.0).unwrap();
            assert!(
                (ours / theirs - 1.0).abs() < 1e-6,
                "{peer}, exponent {m}: {ours} {theirs}"
            );
        }
    }
}

/// Random levels: white, a walk, few levels, slow sine with noise.
fn random(rng: &mut ChaCha8Rng, longest: usize) -> Vec<u8> {
    let len = (10.0 * (longest as f64 / 10.0).powf(rng.random::<f64>())) as usize;
    let kind = rng.random_range(0..4);
    let mut level = rng.random_range(0..128_i32);
    let sequence = (0..len).map(|i| {
        level = match kind {
            0 => rng.random_range(0..128),
            1 => (level + rng.random_range(-9..=9)).clamp(0, 127),
            2 => 30 * rng.random_range(0..5) + 3,
            _ => {
                let slow = 50.0 * (i as f64 * 0.3).sin();
                (64.0 + slow) as i32 + rng.random_range(-8..=8)
            }
        };
        level as u8
    });
    let mut sequence: Vec<u8> = sequence.collect();
    // py-fatigue counts nothing of fewer than four turning points.
    sequence[..3].copy_from_slice(&[0, 2, 1]);
    sequence
}

/// The examples of the standard, of textbooks and of the peers' documentation, raised to levels.
#[test]
fn examples_are_counted_as_published() {
    let examples: [(&str, &[i32]); 5] = [
        (
            "ASTM E1049-85, figure 6; rainflow",
            &[-2, 1, -3, 5, -1, 3, -4, 4, -2],
        ),
        (
            "Haibach, Betriebsfestigkeit, figure 3.3-30; pylife",
            &[2, 5, 3, 6, 2, 3, 1, 6, 1, 4, 2, 3, 1, 4, 2, 5, 3, 4, 2],
        ),
        (
            "Lee, Barkey, Kang, Metal Fatigue Analysis Handbook; pylife",
            &[2, -1, 3, -5, 4, -4, 2, 2, -1, 3, -5, 4, -4, 2],
        ),
        (
            "test series of fatpack, in its classes",
            &[
                4, 7, 2, 10, 5, 9, 3, 4, 2, 12, 5, 11, 1, 4, 3, 10, 6, 12, 4, 8, 1, 9, 4, 6,
            ],
        ),
        (
            "equal ranges, plateaus",
            &[0, 0, 1, 1, -1, 1, 0, 0, -1, 1, -1, -1],
        ),
    ];
    let sequences: Vec<Vec<u8>> = (examples.iter())
        .map(|(_, levels)| levels.iter().map(|level| (level + 10) as u8).collect())
        .collect();
    peers(&sequences, compare);
    // By hand, figure 3.3-30: seven closed cycles and this residue.
    let (closed, residue) = counted(&sequences[1]).ended();
    assert_eq!(closed.cycles(), 7);
    assert_eq!(residue.points(), [12, 16, 11, 15, 12]);
}

#[test]
fn counts_are_those_of_four_peers() {
    let mut rng = ChaCha8Rng::seed_from_u64(45);
    let count = std::env::var("LOADTWIN_SEQUENCES").map_or(SEQUENCES, |n| n.parse().unwrap());
    let longest = if count > SEQUENCES { 10_000 } else { 300 };
    let mut done = 0;
    while done < count {
        let sequences: Vec<Vec<u8>> = (0..SEQUENCES.min(count - done))
            .map(|_| random(&mut rng, longest))
            .collect();
        peers(&sequences, compare);
        done += sequences.len();
    }
}
