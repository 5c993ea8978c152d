//! All counts of one load.

use serde::{Deserialize, Serialize};

use super::cycle_matrix::CycleMatrix;
use super::observation::Observation;
use super::residue::{Cycle, Residue};
use super::scale::LevelScale;
use super::tally::Tally;
use super::turning_points::TurningPoints;
use super::turns::Turns;
use super::{BINS, LEVELS, SHAFTS, bin};
use crate::Error;

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
    turning_points: TurningPoints,
    residue: Residue,
    closed: Closed,
    time: Tally<BINS>,
    turns: [Turns; SHAFTS],
    observation: Observation,
    lowest: Option<Extreme>,
    highest: Option<Extreme>,
}

/// Closed cycles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Closed {
    matrix: CycleMatrix,
    ranges: Tally<LEVELS>,
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
            closed: Closed {
                matrix: CycleMatrix::new(),
                ranges: Tally::new(),
            },
            time: Tally::new(),
            turns: [Turns::new(), Turns::new()],
            observation: Observation::default(),
            lowest: None,
            highest: None,
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
            self.take_extremes(load);
            self.time.add(bin(placed.level, BINS), 1);
            self.observation.beyond += u64::from(placed.is_beyond);
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

    fn take_extremes(&mut self, load: f32) {
        let sample = self.observation.elapsed();
        let now = Some(Extreme { load, sample });
        if self.lowest.is_none_or(|lowest| load < lowest.load) {
            self.lowest = now;
        }
        if self.highest.is_none_or(|highest| load > highest.load) {
            self.highest = now;
        }
    }

    fn take_level(&mut self, level: u8) {
        if let Some(point) = self.turning_points.push(level) {
            let closed = &mut self.closed;
            self.residue.push(point, |cycle| closed.add(cycle));
        }
    }

    /// Appends the counts of what came later on the same machine: the same as
    /// counting both sequences in one, but for the order of parts of turns.
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
        if let Some(found) = later.lowest.map(shifted)
            && self.lowest.is_none_or(|lowest| found.load < lowest.load)
        {
            self.lowest = Some(found);
        }
        if let Some(found) = later.highest.map(shifted)
            && self.highest.is_none_or(|highest| found.load > highest.load)
        {
            self.highest = Some(found);
        }
        for &level in later.residue.points() {
            self.take_level(level);
        }
        for level in later.turning_points.unconfirmed() {
            self.take_level(level);
        }
        Ok(())
    }

    /// Closed cycles and residue if the sequence ended here: its last extreme is
    /// a turning point then.
    pub fn ended(&self) -> (Closed, Residue) {
        let (mut closed, mut residue) = (self.closed.clone(), self.residue.clone());
        for point in self.turning_points.unconfirmed() {
            residue.push(point, |cycle| closed.add(cycle));
        }
        (closed, residue)
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
        let path = self.residue.points().iter().copied();
        let mut last = None;
        for level in path.chain(self.turning_points.unconfirmed()) {
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

    /// Cycles that are closed.
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

    /// What part of time was seen.
    pub fn observation(&self) -> &Observation {
        &self.observation
    }

    /// Lowest and highest valid load; none before the first one.
    pub fn extremes(&self) -> Option<[Extreme; 2]> {
        self.lowest
            .zip(self.highest)
            .map(|(lowest, highest)| [lowest, highest])
    }

    /// Whether the state is one that a sequence can lead to, after it came from bytes.
    pub(super) fn is_valid(&self) -> bool {
        self.scale.is_valid()
            && self.turning_points.is_valid()
            && self.residue.is_valid()
            && self
                .turning_points
                .follows(self.residue.points().last().copied())
            && self.closed.matrix.is_valid()
            && self.turns.iter().all(Turns::is_valid)
    }
}

// 20 kB for two loads with all counters.
const _: () = assert!(2 * size_of::<LoadCounts>() <= 20_000);
