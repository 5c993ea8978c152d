//! Accumulates the sufficient statistics of a channel for the calibration fits: sums and products
//! of load and reading over 4096 bins of the carrier angle, counts of missing and stuck readings.

use std::f64::consts::TAU;

/// Bins of one turn; fine enough that a map is constant in a bin, to 1 % of
/// its peak at order 40.
pub const BINS: usize = 4096;

/// Sums over the samples of one bin, or of many.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Number of samples.
    pub n: f64,
    /// What is sensed: torque, load or speed (SI).
    pub s: f64,
    /// Its square.
    pub ss: f64,
    /// The reading (SI), less the origin.
    pub y: f64,
    /// Its square.
    pub yy: f64,
    /// Both multiplied.
    pub sy: f64,
}

impl Sums {
    /// Adds another bin.
    pub fn add(&mut self, other: &Self) {
        self.n += other.n;
        self.s += other.s;
        self.ss += other.ss;
        self.y += other.y;
        self.yy += other.yy;
        self.sy += other.sy;
    }

    /// Sum of the errors `y - offset - m s`.
    pub fn error(&self, offset: f64, m: f64) -> f64 {
        self.y - offset * self.n - m * self.s
    }

    /// Sum of their squares.
    pub fn squared_error(&self, offset: f64, m: f64) -> f64 {
        let square = self.yy + offset * offset * self.n + m * m * self.ss
            - 2.0 * offset * self.y
            - 2.0 * m * self.sy
            + 2.0 * offset * m * self.s;
        // Cancellation can leave less than nothing.
        square.max(0.0)
    }
}

/// The readings of one channel over the carrier angle.
#[derive(Clone, Debug)]
pub struct Moments {
    bins: Vec<Sums>,
    stuck: u64,
    run: u32,
    last: f64,
    missing: u64,
    /// Subtracted from every reading, so that squares do not cancel.
    origin: f64,
}

impl Default for Moments {
    fn default() -> Self {
        Self {
            bins: vec![Sums::default(); BINS],
            stuck: 0,
            run: 0,
            last: f64::NAN,
            missing: 0,
            origin: f64::NAN,
        }
    }
}

impl Moments {
    /// Adds reading `y` at carrier angle `angle` (rad) while the channel sensed `s`.
    pub fn push(&mut self, angle: f64, s: f64, y: f64) {
        if !(angle.is_finite() && s.is_finite()) {
            return;
        }
        if self.origin.is_nan() {
            self.origin = y;
        }
        let y = y - self.origin;
        let turns = angle / TAU;
        let bin = (((turns - turns.floor()) * BINS as f64) as usize).min(BINS - 1);
        let sums = &mut self.bins[bin];
        sums.n += 1.0;
        sums.s += s;
        sums.ss += s * s;
        sums.y += y;
        sums.yy += y * y;
        sums.sy += s * y;
    }

    /// Watches a reading, used or not, for runs of equal words; from
    /// `stuck_after` equal ones on it counts as stuck.
    pub fn watch(&mut self, y: f64, stuck_after: u32) {
        if y.is_nan() {
            self.missing += 1;
        }
        self.run = if y == self.last { self.run + 1 } else { 0 };
        self.stuck += u64::from(self.run >= stuck_after);
        self.last = y;
    }

    /// Readings that were stuck.
    pub fn stuck(&self) -> u64 {
        self.stuck
    }

    /// Readings that were not delivered.
    pub fn missing(&self) -> u64 {
        self.missing
    }

    /// Constant subtracted from every reading; offsets of fits are relative to it.
    pub fn origin(&self) -> f64 {
        if self.origin.is_nan() {
            0.0
        } else {
            self.origin
        }
    }

    /// The bins of one turn.
    pub fn bins(&self) -> &[Sums] {
        &self.bins
    }

    /// The bins put together to `count`, which divides [`BINS`].
    pub fn coarse(&self, count: usize) -> Vec<Sums> {
        self.bins
            .chunks(BINS / count)
            .map(|bins| {
                bins.iter().fold(Sums::default(), |mut sum, bin| {
                    sum.add(bin);
                    sum
                })
            })
            .collect()
    }

    /// All samples.
    pub fn total(&self) -> Sums {
        self.coarse(1)[0]
    }

    /// Part of the turn, in 64 bins, that has samples.
    pub fn coverage(&self) -> f64 {
        let bins = self.coarse(64);
        bins.iter().filter(|bin| bin.n > 0.0).count() as f64 / bins.len() as f64
    }
}
