//! Detects model error of a rotor by the whiteness of its innovations in windows of 64 samples
//! (`Mismatch`), and chooses the noise level of the filter from those in the image. Also decides
//! which model error the standard deviations allow for, and whether the loads are contradicted.
//!
//! Where the model holds, an innovation says nothing of the next one, however noisy the sensors
//! are; where the model errs, neighbouring innovations share its error. The image has a bank of
//! noise levels: that of the description, and larger ones for models that err more. The alarm
//! raises the level while the innovations are correlated, and tries the next lower level after a
//! while. A sensor that errs alone does not raise the level: the largest of the correlations is
//! left out where there are three sensors or more.
//!
//! A level that has been consistent for long at one speed is established. A model that errs does so
//! from the start, or as the speed changes: what then contradicts is a fault of several sensors, or
//! a load that jumped. The loads are contradicted until a level that was allowed for before
//! explains the readings again.
//!
//! A start that agrees with the highest level only is not confirmed: sensors may be wrong as well as
//! the model. Another speed that agrees with a lower level confirms it, or a new start that agrees
//! with the level of the description.
//!
//! Source: Mehra, On the identification of variances and adaptive Kalman filtering, IEEE Trans.
//! Autom. Control 15 (1970), section II; Page, Continuous inspection schemes, Biometrika 41 (1954).

use serde::{Deserialize, Serialize};

use crate::io::estimate::SensorEstimate;
use crate::io::raw::MAX_CHANNELS;

/// Samples in a window. The correlation of white innovations of one sensor deviates by 1/8.
const WINDOW: u16 = 64;

/// Mean lag-1 correlation that passes, the slack of the CUSUM.
pub const PASSED: f32 = 0.1;

/// Excess over [`PASSED`], summed over windows and times the number of sensors n, at which the
/// level rises, the threshold of the CUSUM. By chance once in 10^8 windows of four sensors:
/// `exp(-2 PASSED (RAISED / n) / sigma^2)`, `sigma^2 = 1 / (64 n)`.
const RAISED: f32 = 1.6;

/// Mean NIS of a window that is no transient of a start, and by which the level rises by two:
/// the noise of the next level is ten times as large.
const FAR: f32 = 4.0;

/// Windows in which a start dies away: until then only a mean NIS above [`FAR`] counts, and in the
/// first one, of which no mean is known yet, nothing.
const STARTING: u32 = 8;

/// Windows for which a level lasts before the next lower one is tried; doubled each time that the
/// level was raised again.
const SHORTEST: u32 = 8;

/// Most doublings of [`SHORTEST`]: 2048 windows.
const DOUBLINGS: u32 = 8;

/// Windows without a change from which a level is established, most windows for which the
/// deviations of the level above are reported after a level was lowered, and windows at another
/// speed that confirm a start that was rejected.
const PROBATION: u32 = 16;

/// Sums over a window of one sensor's innovations.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Sums {
    /// Mean of the window before, which is taken off all innovations: a sensor that is off by a
    /// constant is not the model.
    offset: f32,
    last: f32,
    /// Innovations that were used, and pairs of neighbours among them.
    count: u16,
    pairs: u16,
    value: f32,
    square: f32,
    product: f32,
    /// `sum d^2 / s`.
    nis: f32,
}

impl Sums {
    /// Correlation of neighbours about the mean of the window before, or of this one where it is
    /// the `first`, over the mean square: sensors that are off by a constant hide the model.
    /// None where less than half of the innovations were used.
    fn correlation(&self, first: bool) -> Option<f32> {
        let (count, pairs) = (f32::from(self.count.max(1)), f32::from(self.pairs));
        let mean = self.value / count;
        let about = if first { mean } else { 0.0 };
        let constant = self.offset + mean;
        let square = self.square - count * about * about + count * constant * constant;
        let product = self.product - pairs * about * about;
        let known = 2 * self.pairs >= WINDOW && square > 0.0;
        known.then(|| product / square).filter(|r| r.is_finite())
    }
}

/// What a window did to the level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// A larger noise from now on.
    Raised,
    /// A smaller one, on trial.
    Lowered,
}

/// A start that agrees with no level but the highest, or with none.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct UnconfirmedStart {
    /// Where the speed was, in steps of the tables.
    place: f32,
    /// Whether the highest level explained the readings.
    explained: bool,
    /// Windows at another speed that a lower level explained since.
    confirmed: u32,
    /// Whether the level was raised again since: no transient of a start that died away.
    raised: bool,
}

impl UnconfirmedStart {
    fn at(place: f32) -> Self {
        Self {
            place,
            explained: true,
            confirmed: 0,
            raised: false,
        }
    }

    /// Whether the speed is another one, at a step of the tables.
    fn has_moved(&self, place: f32) -> bool {
        (place - self.place).abs() > 1.0
    }
}

/// The level of noise in use, and the evidence for another one.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Mismatch {
    sums: [Sums; MAX_CHANNELS],
    /// Bit k: the last innovation of sensor k was used.
    last_used: u8,
    samples: u16,
    /// Windows since the start.
    windows: u32,
    level: u8,
    /// Highest level that lasted until the next lower one was tried.
    lasted: u8,
    /// Excess of the correlation so far.
    above: f32,
    /// Windows since the level changed, and until the next lower one is tried.
    since: u32,
    until: u32,
    /// How often the level was raised.
    times: u32,
    lowered: bool,
    unexplained: bool,
    unconfirmed: Option<UnconfirmedStart>,
    /// Whether a level was established since the start.
    settled: bool,
    /// Where the speed was last, in steps of the tables, and the windows since it moved by one.
    place: f32,
    constant: u32,
    /// Windows since a reading that contradicts was used.
    quiet: u32,
    /// Highest level that was allowed for before an established level was contradicted.
    reference: Option<u8>,
}

impl Mismatch {
    /// Index of the noise in use; 0 is that of the description.
    pub fn level(&self) -> u8 {
        self.level
    }

    /// Index of the noise whose model error has to be allowed for: a lower level that fits
    /// afterwards does not show that the description holds, as forces take up what it errs by.
    pub fn allowed(&self) -> u8 {
        self.level.max(self.lasted)
    }

    /// Whether the level was lowered so lately that it may have to rise again.
    pub fn on_trial(&self) -> bool {
        self.lowered && self.since < PROBATION
    }

    /// Whether the innovations contradict even the largest noise, or an established level.
    pub fn is_contradicted(&self) -> bool {
        self.unexplained || self.reference.is_some()
    }

    /// Whether sensors and model were tested against each other since the start.
    pub fn is_tested(&self) -> bool {
        self.windows > STARTING
    }

    /// Whether no level explained the readings before any was established: forces take up what
    /// sensors or model err by at this speed, and a level that fits afterwards confirms nothing
    /// until the speed is another one.
    pub fn is_rejected(&self) -> bool {
        self.unconfirmed.is_some_and(|start| !start.explained)
    }

    /// Whether no level but the highest explained the readings of the start: so large an error is
    /// one of sensors as likely as of the model.
    pub fn is_unconfirmed(&self) -> bool {
        self.unconfirmed.is_some_and(|start| start.explained)
    }

    /// Whether an unconfirmed start is to be tested anew at the same speed, as sensors that were wrong may
    /// be right again: where no level explains it, and at a reading that contradicts.
    pub fn is_retest_due(&self, contradicted: bool) -> bool {
        self.unconfirmed.is_some_and(|start| {
            let moved = start.has_moved(self.place);
            let cause = start.raised && (contradicted || !start.explained);
            self.windows >= 2 * PROBATION && cause && !moved
        })
    }

    /// Whether the level has been consistent for long at this speed.
    pub fn is_established(&self) -> bool {
        let shortest = self.since.min(self.quiet).min(self.constant);
        self.windows > STARTING && shortest >= PROBATION && self.reference.is_none()
    }

    /// Readings that contradict the prediction were used.
    #[cold]
    pub fn contradict(&mut self) {
        if self.is_established() {
            self.reference = Some(self.allowed());
        }
        self.quiet = 0;
    }

    /// A new start, unconfirmed until the level of the description explains as many windows as
    /// establish a level.
    #[must_use]
    pub fn restarted(&self) -> Self {
        let unconfirmed = self.unconfirmed.map(|start| UnconfirmedStart {
            explained: true,
            ..start
        });
        Self {
            unconfirmed,
            ..Self::default()
        }
    }

    /// The speed is at this step of the tables.
    fn follow_speed(&mut self, place: f32) {
        self.constant = self.constant.saturating_add(1);
        if (place - self.place).abs() > 1.0 {
            (self.place, self.constant) = (place, 0);
        }
    }

    /// Samples are missing: the next innovation has no neighbour before it.
    pub fn skip(&mut self) {
        self.last_used = 0;
    }

    /// Takes in the innovations of a sample, of `levels` that there are, at a `place` of the speed
    /// in steps of the tables; what became of the level.
    pub fn push(&mut self, sensors: &[SensorEstimate], levels: u8, place: f32) -> Option<Change> {
        let mut used = 0;
        for (k, (sums, sensor)) in self.sums.iter_mut().zip(sensors).enumerate() {
            if !sensor.fault.is_none() {
                continue;
            }
            let nu = sensor.innovation - sums.offset;
            if self.last_used & (1 << k) != 0 {
                sums.product += nu * sums.last;
                sums.pairs += 1;
            }
            used |= 1 << k;
            sums.last = nu;
            sums.value += nu;
            sums.square += nu * nu;
            sums.nis += nu * nu / sensor.innovation_variance;
            sums.count += 1;
        }
        self.last_used = used;
        self.samples += 1;
        if self.samples < WINDOW {
            return None;
        }
        self.follow_speed(place);
        self.evaluate(levels)
    }

    #[cold]
    fn evaluate(&mut self, levels: u8) -> Option<Change> {
        let (mut sum, mut largest, mut known) = (0.0, f32::MIN, 0.0);
        let (mut nis, mut count) = (0.0, 0);
        let first = self.since == 0;
        for sums in &mut self.sums {
            if let Some(r) = sums.correlation(first) {
                sum += r;
                known += 1.0;
                if r > largest {
                    largest = r;
                }
            }
            nis += sums.nis;
            count += sums.count;
            let mean = sums.value / f32::from(sums.count.max(1));
            let mean = if mean.is_finite() { mean } else { 0.0 };
            *sums = Sums {
                offset: sums.offset + mean,
                last: sums.last - mean,
                ..Sums::default()
            };
        }
        self.samples = 0;
        self.windows = self.windows.saturating_add(1);
        self.since = self.since.saturating_add(1);
        self.quiet = self.quiet.saturating_add(1);
        self.settled |= self.is_established();
        if self.since.min(self.quiet) >= PROBATION {
            self.reference = self.reference.filter(|reference| self.level > *reference);
        }
        if known > 2.5 {
            (sum, known) = (sum - largest, known - 1.0);
        }
        let far = nis > FAR * f32::from(count);
        if known > 0.0 && ((far && self.windows > 1) || self.windows > STARTING) {
            let above = self.above + sum / known - PASSED;
            self.above = if above > 0.0 { above } else { 0.0 };
        }
        // A level that was left on trial is known to suffice: half of the evidence.
        let needed = if self.on_trial() {
            0.5 * RAISED
        } else {
            RAISED
        };
        let correlated = self.above * known > needed;
        let highest = levels.saturating_sub(1);
        self.unexplained = self.level == highest && far && correlated;
        self.confirm_start(correlated, highest);
        if correlated && self.level < highest {
            let by = if far && !self.lowered { 2 } else { 1 };
            self.level = (self.level + by).min(highest);
            if self.reference.is_none() {
                self.times = self.times.saturating_add(1);
            }
            let starting = !self.settled && self.windows <= self.constant + 1;
            match &mut self.unconfirmed {
                Some(start) => start.raised = true,
                None if starting && self.level == highest => {
                    self.unconfirmed = Some(UnconfirmedStart::at(self.place));
                }
                None => {}
            }
            self.turn(false);
            return Some(Change::Raised);
        }
        if self.level > 0 && self.since > self.until {
            // What an established level is contradicted by is no error of the model.
            if self.reference.is_none() {
                self.lasted = self.lasted.max(self.level);
            }
            self.level -= 1;
            self.turn(true);
            return Some(Change::Lowered);
        }
        if correlated {
            self.above = RAISED;
        }
        None
    }

    /// Rejects the loads of a start that no level explains. [`PROBATION`] windows confirm a start
    /// that agree at another speed, or at the level of the description: where a transient died away
    /// through lower and lower levels, or a new start needed no other level.
    fn confirm_start(&mut self, correlated: bool, highest: u8) {
        if self.unexplained && self.reference.is_none() {
            let start = self
                .unconfirmed
                .get_or_insert(UnconfirmedStart::at(self.place));
            (start.place, start.explained, start.confirmed) = (self.place, false, 0);
            start.raised = true;
        }
        let Some(start) = &mut self.unconfirmed else {
            return;
        };
        let agrees = start.has_moved(self.place) && !correlated && self.level < highest;
        start.confirmed += u32::from(agrees);
        let described = self.level == 0 && self.since >= PROBATION && self.windows > STARTING;
        let transient = !start.raised || self.times == 0;
        if start.confirmed >= PROBATION || (described && transient) {
            self.unconfirmed = None;
        }
    }

    fn turn(&mut self, lowered: bool) {
        self.lowered = lowered;
        self.above = 0.0;
        self.since = 0;
        self.until = match self.reference {
            None => SHORTEST << self.times.saturating_sub(1).min(DOUBLINGS),
            Some(_) => SHORTEST,
        };
        self.unexplained = false;
    }
}

#[cfg(test)]
mod tests;
