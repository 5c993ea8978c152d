//! Property tests of load counting on random sequences: splitting, saving, appending, level
//! crossings, missing samples, gate, damaged bytes, bound of the residue.

extern crate std;

use std::vec::Vec;

use proptest::prelude::*;

use super::four_point_rainflow::MAX_POINTS;
use super::saved_counts::MAX_BYTES;
use super::{BINS, LEVELS, LevelScale, LoadCounts, bin};

/// Levels that are their own loads.
fn counts(gate: u8) -> LoadCounts {
    LoadCounts::try_new(LevelScale::try_new(-0.5, 1.0).unwrap(), gate).unwrap()
}

fn counted(gate: u8, levels: &[u8]) -> LoadCounts {
    let mut counts = counts(gate);
    for &level in levels {
        counts.push(Some(f32::from(level)), [0; 2]);
    }
    counts
}

/// Closed cycles and, as half cycles, ranges of the residue: twice their number for each range.
fn half_cycles(counts: &LoadCounts) -> Vec<u64> {
    let (closed, residue) = counts.ended();
    let mut found: Vec<u64> = closed.ranges().iter().map(|count| 2 * count).collect();
    for cycle in residue.ranges() {
        found[usize::from(cycle.range())] += 1;
    }
    found
}

/// Upcrossings from `low` or below to `high` or above: the rainflow cycles over both.
fn upcrossings(levels: &[u8], low: u8, high: u8) -> u64 {
    let (mut armed, mut count) = (false, 0);
    for &level in levels {
        if level <= low {
            armed = true;
        } else if level >= high && armed {
            armed = false;
            count += 1;
        }
    }
    count
}

fn saved(counts: &mut LoadCounts) -> Vec<u8> {
    let mut bytes = std::vec![0; MAX_BYTES];
    let len = counts.save(&mut bytes).unwrap();
    bytes.truncate(len);
    bytes
}

fn levels() -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(0..LEVELS as u8, 0..400)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_split_with_saving_between_equals_one_batch(
        levels in levels(),
        gate in 1_u8..20,
        cuts in prop::collection::vec(0_usize..400, 0..6),
    ) {
        let mut batch = counted(gate, &levels);
        let mut streamed = counts(gate);
        for (i, &level) in levels.iter().enumerate() {
            if cuts.contains(&i) {
                streamed = LoadCounts::continued(&saved(&mut streamed)).unwrap();
            }
            streamed.push(Some(f32::from(level)), [0; 2]);
        }
        prop_assert_eq!(saved(&mut streamed), saved(&mut batch));
        prop_assert_eq!(streamed, batch);
    }

    #[test]
    fn appended_counts_are_those_of_one_sequence(
        levels in levels(),
        gate in 1_u8..40,
        cut in 0_usize..400,
    ) {
        let (first, later) = levels.split_at(cut.min(levels.len()));
        let mut joined = counted(gate, first);
        joined.append(&counted(gate, later)).unwrap();
        let mut batch = counted(gate, &levels);
        prop_assert_eq!(joined.ended(), batch.ended());
        prop_assert_eq!(joined.level_crossings(), batch.level_crossings());
        joined.settle();
        batch.settle();
        prop_assert_eq!(joined, batch);
    }

    #[test]
    fn the_matrix_counts_upcrossings_of_every_pair_of_bins(levels in levels()) {
        let counts = counted(1, &levels);
        let (closed, residue) = counts.ended();
        let mut path: Vec<u8> = residue.points().to_vec();
        for level in &mut path {
            *level = bin(*level, BINS) as u8;
        }
        let bins: Vec<u8> = levels.iter().map(|&level| bin(level, BINS) as u8).collect();
        for (low, high) in [(0, 1), (10, 20), (31, 32), (5, 60), (62, 63), (0, 63)] {
            let in_cycles: u64 = (closed.matrix().cells())
                .filter(|cell| cell.0 <= low && cell.1 >= high)
                .map(|cell| cell.2)
                .sum();
            let found = in_cycles + upcrossings(&path, low as u8, high as u8);
            prop_assert_eq!(found, upcrossings(&bins, low as u8, high as u8));
        }
        for (edge, &crossings) in counts.level_crossings().iter().enumerate() {
            prop_assert_eq!(crossings, upcrossings(&bins, edge as u8, edge as u8 + 1));
        }
    }

    #[test]
    fn samples_left_out_never_make_a_cycle(
        levels in levels(),
        valid in prop::collection::vec(any::<bool>(), 400),
    ) {
        let mut counts = counts(1);
        for (&level, &valid) in levels.iter().zip(&valid) {
            counts.push(valid.then_some(f32::from(level)), [0; 2]);
        }
        let (closed, residue) = counts.ended();
        for (low, high) in [(0_u8, 1_u8), (3, 60), (20, 22), (50, 100), (0, 127)] {
            let path = residue.points();
            let in_cycles: u64 = (closed.matrix().cells())
                .filter(|cell| 2 * cell.0 < usize::from(low) && 2 * cell.1 >= usize::from(high))
                .map(|cell| cell.2)
                .sum();
            let found = in_cycles + upcrossings(path, low, high);
            prop_assert!(found <= upcrossings(&levels, low, high));
        }
        let seen = levels.iter().zip(&valid).filter(|(_, valid)| **valid).count() as u64;
        prop_assert_eq!(counts.observation().seen, seen);
        prop_assert_eq!(counts.observation().elapsed(), levels.len() as u64);
    }

    #[test]
    fn the_gate_removes_the_smaller_cycles_and_changes_no_other(
        levels in levels(),
        gate in 2_u8..60,
    ) {
        let all = half_cycles(&counted(1, &levels));
        let gated = half_cycles(&counted(gate, &levels));
        let gate = usize::from(gate);
        prop_assert_eq!(&gated[gate..], &all[gate..]);
    }

    #[test]
    fn bytes_that_are_no_counts_are_refused(
        levels in levels(),
        place in any::<prop::sample::Index>(),
        bit in 0_u8..8,
    ) {
        let mut bytes = saved(&mut counted(1, &levels));
        prop_assert!(bytes.len() <= MAX_BYTES);
        let place = place.index(bytes.len());
        prop_assert!(LoadCounts::continued(&bytes[..place]).is_err());
        bytes[place] ^= 1 << bit;
        prop_assert!(LoadCounts::continued(&bytes).is_err());
    }

    #[test]
    fn a_residue_is_never_longer_than_its_bound(
        levels in prop::collection::vec(prop_oneof![0_u8..4, 60_u8..68, 124_u8..128, 0_u8..128], 0..2000),
    ) {
        let mut counts = counts(1);
        for level in levels {
            counts.push(Some(f32::from(level)), [0; 2]);
            let mut settled = counts.clone();
            settled.settle();
            prop_assert!(settled.is_valid());
            prop_assert!(counts.ended().1.points().len() <= MAX_POINTS);
        }
    }
}

/// What is not a number, gaps and restarts are counted as such.
#[test]
fn time_that_was_not_seen_is_counted() {
    let mut counts = counts(1);
    for load in [Some(10.0), None, Some(f32::NAN), Some(-300.0), Some(20.0)] {
        counts.push(load, [1 << 31, 1 << 27]);
    }
    counts.gap(45);
    counts.restart();
    let seen = counts.observation();
    assert_eq!((seen.seen, seen.not_valid, seen.missing), (3, 2, 45));
    assert_eq!((seen.gaps, seen.restarts, seen.beyond), (1, 1, 1));
    assert_eq!(seen.share(), Some(0.06));
    let [lowest, highest] = counts.extremes().unwrap();
    assert_eq!((lowest.load, lowest.sample), (-300.0, 3));
    assert_eq!((highest.load, highest.sample), (20.0, 4));
    let [fast, slow] = counts.turns();
    assert_eq!(
        (fast.unseen(), fast.turns(2), fast.turns(0)),
        (1.0, 0.5, 0.5)
    );
    assert_eq!((slow.unseen(), slow.turns(5)), (0.0625, 0.03125));
    assert_eq!(
        counts.append(&super::tests::counts(2)),
        Err(crate::Error::OutOfRange("gate"))
    );
}
