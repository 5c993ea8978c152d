//! Encodes what a load was counted since an earlier state as few bytes (`LoadCounts::increment`),
//! and adds it to that state (`LoadCounts::add_increment`): the changes of all counters, the new
//! end of the residue, the extremes. An increment since nothing is a whole state.
//!
//! | part | bytes |
//! |---|---|
//! | counters | tokens: counters passed over (4 bits, 15: varint follows), change - 1 (the same) |
//! | end of the counters | passes over one more than there are, change 1 |
//! | residue | varint: points kept; varint: points added; the points |
//! | turning points | kind of motion, levels |
//! | parts of turns | varint of each shaft |
//! | extremes | 0: unchanged; 1: load and sample of lowest and highest |

use super::cycle_matrix::CELLS;
use super::load_counts::{Extreme, LoadCounts};
use super::load_revolutions;
use super::{BINS, LEVELS, SHAFTS};
use crate::Error;

/// Counters of a load: cells, ranges, time, turns, coverage.
const COUNTERS: usize = CELLS + LEVELS + BINS + SHAFTS * load_revolutions::COUNTERS + COVERAGE;

/// Counters of the coverage, and the cycles that a matrix lost.
const COVERAGE: usize = 7;

/// Value of 4 bits behind which a varint follows.
const LONG: u8 = 15;

/// What a counter counts.
#[derive(Clone, Copy, Debug)]
enum Place {
    /// Cycles of a cell of the matrix.
    Cell(usize),
    /// Cycles of a range.
    Range(usize),
    /// Samples of a bin.
    Time(usize),
    /// Parts of turns of a shaft at the loads of a bin.
    Turns(usize, usize),
    /// Samples and interruptions.
    Coverage(usize),
}

/// What the counter at `index` counts.
fn place(index: usize) -> Place {
    let mut rest = index;
    let mut is_in = |length: usize| match rest.checked_sub(length) {
        Some(behind) => {
            rest = behind;
            None
        }
        None => Some(rest),
    };
    if let Some(cell) = is_in(CELLS) {
        return Place::Cell(cell);
    }
    if let Some(range) = is_in(LEVELS) {
        return Place::Range(range);
    }
    if let Some(bin) = is_in(BINS) {
        return Place::Time(bin);
    }
    for shaft in 0..SHAFTS {
        if let Some(bin) = is_in(load_revolutions::COUNTERS) {
            return Place::Turns(shaft, bin);
        }
    }
    Place::Coverage(rest)
}

const MALFORMED: Error = Error::Malformed("increment of counts");

/// Takes the bytes of an increment.
pub trait ByteSink {
    /// Takes the next byte.
    fn put(&mut self, byte: u8);

    /// Takes a number, 7 bits a byte, the lowest first.
    fn put_varint(&mut self, mut value: u64) {
        while value > 0x7F {
            self.put(value as u8 | 0x80);
            value >>= 7;
        }
        self.put(value as u8);
    }
}

/// Gives the bytes of an increment.
pub trait ByteSource {
    /// The next byte; none at the end.
    fn take(&mut self) -> Option<u8>;

    /// The next number.
    ///
    /// # Errors
    /// `Error::Malformed` at the end, or where it has more than 64 bits.
    fn take_varint(&mut self) -> Result<u64, Error> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.take().ok_or(MALFORMED)?;
            let part = u64::from(byte & 0x7F);
            if part << shift >> shift != part {
                break;
            }
            value |= part << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(MALFORMED)
    }
}

impl ByteSource for &[u8] {
    fn take(&mut self) -> Option<u8> {
        let (&first, rest) = self.split_first()?;
        *self = rest;
        Some(first)
    }
}

fn put_token(bytes: &mut impl ByteSink, passed: u64, change: u64) {
    let [short_passed, short_change] =
        [passed, change - 1].map(|n| u8::try_from(n).map_or(LONG, |n| n.min(LONG)));
    bytes.put(short_passed << 4 | short_change);
    for (short, number) in [(short_passed, passed), (short_change, change - 1)] {
        if short == LONG {
            bytes.put_varint(number - u64::from(LONG));
        }
    }
}

fn take_token(bytes: &mut impl ByteSource) -> Result<(u64, u64), Error> {
    let token = bytes.take().ok_or(MALFORMED)?;
    let mut number = |short: u8| {
        let more = if short == LONG {
            bytes.take_varint()?
        } else {
            0
        };
        u64::from(short).checked_add(more).ok_or(MALFORMED)
    };
    let passed = number(token >> 4)?;
    let change = number(token & 0xF)?;
    Ok((passed, change.checked_add(1).ok_or(MALFORMED)?))
}

impl LoadCounts {
    /// Writes what was counted since `before`, an earlier state of the same counts; since nothing
    /// where there is none. Both are settled.
    pub fn increment(&self, before: Option<&Self>, bytes: &mut impl ByteSink) {
        let mut passed = 0;
        for index in 0..COUNTERS {
            let earlier = before.map_or(0, |before| before.counter(index));
            let change = self.counter(index).saturating_sub(earlier);
            if change > 0 {
                put_token(bytes, passed, change);
                passed = 0;
            } else {
                passed += 1;
            }
        }
        put_token(bytes, passed, 1);
        let points = self.residue.points();
        let known = before.map_or(&[][..], |before| before.residue.points());
        let kept = points.iter().zip(known).take_while(|(a, b)| a == b).count();
        let added = points.get(kept..).unwrap_or_default();
        bytes.put_varint(kept as u64);
        bytes.put_varint(added.len() as u64);
        for &point in added {
            bytes.put(point);
        }
        for byte in self.turning_points.motion_bytes() {
            bytes.put(byte);
        }
        for turns in &self.turns {
            bytes.put_varint(turns.below.into());
        }
        let extremes = self.extremes;
        match extremes.filter(|_| before.is_none_or(|before| before.extremes != extremes)) {
            None => bytes.put(0),
            Some(extremes) => {
                bytes.put(1);
                for extreme in extremes {
                    for byte in extreme.load.to_le_bytes() {
                        bytes.put(byte);
                    }
                    bytes.put_varint(extreme.sample);
                }
            }
        }
    }

    /// A counter by its place in an increment.
    fn counter(&self, index: usize) -> u64 {
        match place(index) {
            Place::Cell(cell) => self.closed.matrix.at(cell),
            Place::Range(range) => self.closed.ranges.get(range),
            Place::Time(bin) => self.time.get(bin),
            Place::Turns(shaft, bin) => {
                let turns = self.turns.get(shaft);
                turns.map_or(0, |turns| turns.parts.get(bin))
            }
            Place::Coverage(which) => {
                let seen = &self.observation;
                match which {
                    0 => seen.seen,
                    1 => seen.not_valid,
                    2 => seen.missing,
                    3 => seen.beyond,
                    4 => seen.gaps.into(),
                    5 => seen.restarts.into(),
                    _ => self.closed.matrix.lost(),
                }
            }
        }
    }

    /// Adds to a counter by its place in an increment.
    fn add_to_counter(&mut self, index: usize, change: u64) {
        let seen = &mut self.observation;
        let wide = |count: &mut u64| *count = count.saturating_add(change);
        let narrow = |count: &mut u32| {
            *count = count.saturating_add(u32::try_from(change).unwrap_or(u32::MAX));
        };
        match place(index) {
            Place::Cell(cell) => self.closed.matrix.add_at(cell, change),
            Place::Range(range) => self.closed.ranges.add(range, change),
            Place::Time(bin) => self.time.add(bin, change),
            Place::Turns(shaft, bin) => {
                if let Some(turns) = self.turns.get_mut(shaft) {
                    turns.parts.add(bin, change);
                }
            }
            Place::Coverage(0) => wide(&mut seen.seen),
            Place::Coverage(1) => wide(&mut seen.not_valid),
            Place::Coverage(2) => wide(&mut seen.missing),
            Place::Coverage(3) => wide(&mut seen.beyond),
            Place::Coverage(4) => narrow(&mut seen.gaps),
            Place::Coverage(5) => narrow(&mut seen.restarts),
            Place::Coverage(_) => self.closed.matrix.lose(change),
        }
    }

    /// Adds an increment to the state before it.
    ///
    /// # Errors
    /// `Error::Malformed` where the bytes are none, or lead to a state that no sequence leads to;
    /// the counts are of no use then.
    pub fn add_increment(&mut self, bytes: &mut impl ByteSource) -> Result<(), Error> {
        let mut index = 0_usize;
        loop {
            let (passed, change) = take_token(bytes)?;
            let passed = usize::try_from(passed).map_err(|_| MALFORMED)?;
            index = index.checked_add(passed).ok_or(MALFORMED)?;
            if index >= COUNTERS {
                break;
            }
            self.add_to_counter(index, change);
            index += 1;
        }
        if index != COUNTERS {
            return Err(MALFORMED);
        }
        let mut number = || usize::try_from(bytes.take_varint()?).map_err(|_| MALFORMED);
        let (kept, added) = (number()?, number()?);
        let mut is_whole = self.residue.keep(kept);
        for _ in 0..added {
            is_whole &= (self.residue).append_point(bytes.take().ok_or(MALFORMED)?);
        }
        let mut motion = [0; 4];
        for byte in &mut motion {
            *byte = bytes.take().ok_or(MALFORMED)?;
        }
        is_whole &= self.turning_points.set_motion(motion);
        for turns in &mut self.turns {
            turns.below = u32::try_from(bytes.take_varint()?).map_err(|_| MALFORMED)?;
        }
        match bytes.take() {
            Some(0) => {}
            Some(1) => {
                self.extremes = Some([take_extreme(bytes)?, take_extreme(bytes)?]);
            }
            _ => return Err(MALFORMED),
        }
        if is_whole && self.is_valid() {
            Ok(())
        } else {
            Err(MALFORMED)
        }
    }
}

fn take_extreme(bytes: &mut impl ByteSource) -> Result<Extreme, Error> {
    let mut load = [0; 4];
    for byte in &mut load {
        *byte = bytes.take().ok_or(MALFORMED)?;
    }
    let load = f32::from_le_bytes(load);
    let sample = bytes.take_varint()?;
    Ok(Extreme { load, sample })
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::counting::LevelScale;

    impl ByteSink for Vec<u8> {
        fn put(&mut self, byte: u8) {
            self.push(byte);
        }
    }

    fn empty() -> LoadCounts {
        LoadCounts::try_new(LevelScale::try_new(-0.5, 1.0).unwrap(), 2).unwrap()
    }

    fn increment(counts: &LoadCounts, before: Option<&LoadCounts>) -> Vec<u8> {
        let mut bytes = Vec::new();
        counts.increment(before, &mut bytes);
        bytes
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn increments_add_up_to_the_state(
            loads in prop::collection::vec(-5.0_f32..140.0, 0..600),
            every in 1_usize..200,
        ) {
            let (mut counts, mut known, mut read) = (empty(), None, empty());
            for (k, load) in loads.into_iter().enumerate() {
                if load < 0.0 {
                    counts.gap(1_000_000);
                    counts.restart();
                }
                counts.push(Some(load).filter(|load| *load < 135.0), [1 << 30, 12_345]);
                if k % every == 0 {
                    counts.settle();
                    let bytes = increment(&counts, known.as_ref());
                    let mut source = &bytes[..];
                    read.add_increment(&mut source).unwrap();
                    prop_assert!(source.is_empty());
                    prop_assert_eq!(&read, &counts);
                    known = Some(counts.clone());
                    let whole = increment(&counts, None);
                    let mut of_nothing = empty();
                    of_nothing.add_increment(&mut &whole[..]).unwrap();
                    prop_assert_eq!(&of_nothing, &counts);
                }
            }
        }

        #[test]
        fn bytes_that_are_no_increment_never_lead_to_a_wrong_state(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
        ) {
            let mut counts = empty();
            if counts.add_increment(&mut &bytes[..]).is_ok() {
                prop_assert!(counts.is_valid());
            }
        }
    }

    #[test]
    fn a_minute_without_load_takes_few_bytes() {
        let mut counts = empty();
        counts.push(Some(64.0), [0; 2]);
        let before = counts.clone();
        for _ in 0..60 * 2000 {
            counts.push(Some(64.0), [0; 2]);
        }
        let bytes = increment(&counts, Some(&before));
        assert!(bytes.len() <= 25, "{}", bytes.len());
    }
}
