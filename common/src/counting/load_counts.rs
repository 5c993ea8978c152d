//! Counts one load, sample by sample (`LoadCounts`): rainflow cycles, time at level, shaft
//! revolutions by load, extremes, valid and missing samples, gaps and restarts. Derives level
//! crossings from the cycles, and appends the counts of a later sequence.

use heapless::Deque;
use serde::{Deserialize, Serialize};

use super::coverage::Observation;
use super::cycle_matrix::CycleMatrix;
use super::four_point_rainflow::{Cycle, MAX_POINTS, Residue};
use super::load_revolutions::Turns;
use super::scale::LevelScale;
use super::tally_array::Tally;
use super::turning_points::TurningPoints;
use super::{BINS, LEVELS, SHAFTS, bin};
use crate::Error;

/// Steps of [`Residue::step`] a sample: so many cycles close at most, for a bounded time a
/// sample. One point can close 64 cycles; the samples after it close the others.
const STEPS: usize = 8;

/// Most turning points that wait for the residue.
///
/// In `k` samples since none waited, `k` points came at most; taking them needs
/// `k` steps, and `(MAX_POINTS + k) / 2` for the cycles. `STEPS k` were made.
const WAITING: usize = 20;

const _: () = assert!(2 * STEPS * WAITING >= MAX_POINTS + 3 * WAITING);

/// An extreme of a load.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extreme {
    /// The load [N m, N].
    pub load: f32,
    /// Samples since counting began.
    pub sample: u64,
}

/// All counts of one load, updated sample by sample.
///
/// Samples without a valid load and gaps are left out of the sequence. Counting
/// the samples that were seen as if they followed each other counts no cycle
/// that was not there: the rainflow cycles over a pair of levels are as many as
/// the upcrossings from one to the other, and those of a part of the samples are
/// never more than those of all (Rychlik 1987).
///
/// A sample closes 8 cycles at most, so that its time is bounded. What waits
/// for the next samples is part of [`Self::ended`], and [`Self::settle`] takes it.
///
/// ```
/// use loadtwin_common::counting::{LevelScale, LoadCounts};
/// let scale = LevelScale::covering(-1000.0, 1000.0)?;
/// let mut counts = LoadCounts::try_new(scale, 1)?;
/// for torque_nm in [0.0, 500.0, -200.0, 300.0, -600.0] {
///     counts.push(Some(torque_nm), [0; 2]);
/// }
/// let (ended, residue) = counts.ended();
/// assert_eq!(ended.cycles(), 1);
/// assert_eq!(residue.points().len(), 3);
/// # Ok::<(), loadtwin_common::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadCounts {
    scale: LevelScale,
    pub(super) turning_points: TurningPoints,
    pub(super) residue: Residue,
    /// Confirmed turning points that the residue has not taken yet; none in saved counts.
    #[serde(skip)]
    waiting: Deque<u8, WAITING>,
    pub(super) closed: Closed,
    pub(super) time: Tally<BINS>,
    pub(super) turns: [Turns; SHAFTS],
    pub(super) observation: Observation,
    /// Lowest and highest.
    pub(super) extremes: Option<[Extreme; 2]>,
}

/// Closed cycles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Closed {
    pub(super) matrix: CycleMatrix,
    pub(super) ranges: Tally<LEVELS>,
}

impl Closed {
    fn add(&mut self, cycle: Cycle) {
        self.matrix.add(cycle);
        self.ranges.add(usize::from(cycle.range()), 1);
    }

    /// By lower and upper bin, or by range and mean.
    pub fn matrix(&self) -> &CycleMatrix {
        &self.matrix
    }

    /// Cycles for each range (levels).
    pub fn ranges(&self) -> &Tally<LEVELS> {
        &self.ranges
    }

    /// All cycles.
    pub fn cycles(&self) -> u64 {
        self.ranges.iter().sum()
    }
}

impl LoadCounts {
    /// Nothing counted yet; `gate` (levels), see [`TurningPoints`].
    ///
    /// # Errors
    /// `Error::OutOfRange` for a gate of zero or of the whole scale.
    pub fn try_new(scale: LevelScale, gate: u8) -> Result<Self, Error> {
        Ok(Self {
            scale,
            turning_points: TurningPoints::try_new(gate)?,
            residue: Residue::new(),
            waiting: Deque::new(),
            closed: Closed {
                matrix: CycleMatrix::new(),
                ranges: Tally::new(),
            },
            time: Tally::new(),
            turns: [Turns::new(), Turns::new()],
            observation: Observation::default(),
            extremes: None,
        })
    }

    /// Takes one sample: the load where it is valid, and by how much each shaft
    /// turned since the sample before [2^-32 turn], either way.
    pub fn push(&mut self, load: Option<f32>, advance: [u32; SHAFTS]) {
        let load = load.filter(|load| load.is_finite());
        let placed = load.map(|load| self.scale.place(load));
        let level = placed.map(|placed| placed.level);
        for (turns, advance) in self.turns.iter_mut().zip(advance) {
            turns.add(level, advance);
        }
        if let (Some(load), Some(placed)) = (load, placed) {
            if placed.is_beyond {
                self.observation.beyond += 1;
            }
            let is_within = (self.extremes.as_ref())
                .is_some_and(|[low, high]| load >= low.load && load <= high.load);
            if !is_within {
                let sample = self.observation.elapsed();
                self.take_extreme(Extreme { load, sample });
            }
            self.time.add(bin(placed.level, BINS), 1);
            self.observation.seen += 1;
            self.take_level(placed.level);
        } else {
            self.observation.not_valid += 1;
        }
    }

    /// Counts a gap of samples that were never taken.
    pub fn gap(&mut self, samples: u64) {
        let observation = &mut self.observation;
        observation.gaps = observation.gaps.saturating_add(1);
        observation.missing = observation.missing.saturating_add(samples);
    }

    /// Counts a restart; what was counted before continues.
    pub fn restart(&mut self) {
        self.observation.restarts = self.observation.restarts.saturating_add(1);
    }

    /// Seldom a new extreme.
    #[cold]
    #[inline(never)]
    fn take_extreme(&mut self, now: Extreme) {
        let [low, high] = self.extremes.get_or_insert([now; 2]);
        if now.load < low.load {
            *low = now;
        }
        if now.load > high.load {
            *high = now;
        }
    }

    fn take_level(&mut self, level: u8) {
        let point = self.turning_points.push(level);
        if !self.waiting.is_empty() {
            self.take_waiting(point);
        } else if let Some(point) = point {
            for _ in 0..STEPS {
                match self.residue.step(point) {
                    Some(cycle) => self.closed.add(cycle),
                    None => return,
                }
            }
            // There is a place: none waits.
            _ = self.waiting.push_back(point);
        }
    }

    /// Lets a point wait, and takes the steps of a sample.
    #[cold]
    #[inline(never)]
    fn take_waiting(&mut self, point: Option<u8>) {
        if let Some(point) = point
            && self.waiting.push_back(point).is_err()
        {
            // Never, by the number of places.
            self.settle();
            _ = self.waiting.push_back(point);
        }
        for _ in 0..STEPS {
            if !self.take_step() {
                return;
            }
        }
    }

    /// One step towards taking the points that wait; false where none waits.
    fn take_step(&mut self) -> bool {
        let Some(&point) = self.waiting.front() else {
            return false;
        };
        match self.residue.step(point) {
            Some(cycle) => self.closed.add(cycle),
            None => _ = self.waiting.pop_front(),
        }
        true
    }

    /// Closes the cycles that wait for the next samples.
    pub fn settle(&mut self) {
        while self.take_step() {}
    }

    /// Appends the counts of what came later on the same machine: the same as
    /// counting both sequences in one, but for the order of parts of turns and
    /// for what waits (see [`Self::settle`]).
    ///
    /// # Errors
    /// `Error::OutOfRange` when scale or gate are others.
    pub fn append(&mut self, later: &Self) -> Result<(), Error> {
        if self.scale != later.scale {
            return Err(Error::OutOfRange("scale of levels"));
        }
        if self.turning_points.gate() != later.turning_points.gate() {
            return Err(Error::OutOfRange("gate"));
        }
        let before = self.observation.elapsed();
        self.closed.matrix.add_all(&later.closed.matrix);
        self.closed.ranges.add_all(&later.closed.ranges);
        self.time.add_all(&later.time);
        for (turns, other) in self.turns.iter_mut().zip(&later.turns) {
            turns.add_all(other);
        }
        self.observation.add_all(&later.observation);
        let shifted = |extreme: Extreme| Extreme {
            sample: extreme.sample.saturating_add(before),
            ..extreme
        };
        for extreme in later.extremes.into_iter().flatten() {
            self.take_extreme(shifted(extreme));
        }
        for level in later.path() {
            self.take_level(level);
        }
        Ok(())
    }

    /// Closed cycles and residue if the sequence ended here: its last extreme is
    /// a turning point then.
    pub fn ended(&self) -> (Closed, Residue) {
        let (mut closed, mut residue) = (self.closed.clone(), self.residue.clone());
        for point in (self.waiting.iter().copied()).chain(self.turning_points.unconfirmed()) {
            residue.push(point, |cycle| closed.add(cycle));
        }
        (closed, residue)
    }

    /// Turning points in no closed cycle yet, the unconfirmed ones at the end.
    fn path(&self) -> impl Iterator<Item = u8> {
        let confirmed = self.residue.points().iter().chain(&self.waiting).copied();
        confirmed.chain(self.turning_points.unconfirmed())
    }

    /// Upcrossings of the edges between bins, `BINS - 1` of them; as many
    /// downcrossings, one more or less. Movements within the gate cross nothing.
    ///
    /// A closed cycle crosses each edge inside it once upwards; what remains is
    /// the path of the residue. So no counters are needed for them.
    pub fn level_crossings(&self) -> [u64; BINS - 1] {
        let mut crossings = [0; BINS - 1];
        let mut add = |low: usize, high: usize, count: u64| {
            for crossing in &mut crossings[low..high] {
                *crossing += count;
            }
        };
        for (low, high, count) in self.closed.matrix.cells() {
            add(low, high, count);
        }
        let mut last = None;
        for level in self.path() {
            let now = bin(level, BINS);
            if let Some(before) = last
                && before < now
            {
                add(before, now, 1);
            }
            last = Some(now);
        }
        crossings
    }

    /// The levels.
    pub fn scale(&self) -> &LevelScale {
        &self.scale
    }

    /// The gate of turning points (levels).
    pub fn gate(&self) -> u8 {
        self.turning_points.gate()
    }

    /// Cycles that are closed; those that wait are not among them.
    pub fn closed(&self) -> &Closed {
        &self.closed
    }

    /// Samples at the loads of each bin.
    pub fn time(&self) -> &Tally<BINS> {
        &self.time
    }

    /// Turns of each shaft by load.
    pub fn turns(&self) -> &[Turns; SHAFTS] {
        &self.turns
    }

    /// Numbers of samples and interruptions behind the counts.
    pub fn observation(&self) -> &Observation {
        &self.observation
    }

    /// Lowest and highest valid load; none before the first one.
    pub fn extremes(&self) -> Option<[Extreme; 2]> {
        self.extremes
    }

    /// Whether the state is one that a sequence can lead to, after it came from bytes.
    pub(super) fn is_valid(&self) -> bool {
        self.scale.is_valid()
            && self.turning_points.is_valid()
            && self.residue.is_valid()
            && self.waiting.is_empty()
            && (self.turning_points).follows(self.residue.points().last().copied())
            && self.closed.matrix.is_valid()
            && self.turns.iter().all(Turns::is_valid)
    }
}

// 20 kB for two loads with all counters.
const _: () = assert!(2 * size_of::<LoadCounts>() <= 20_000);
