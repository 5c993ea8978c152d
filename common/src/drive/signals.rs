//! Unwraps and homes the position counts of a drive, delays each signal to the time of the latest
//! one, and gives the readings of one instant to the filter (`SignalHistory`, `Readings`).

use serde::{Deserialize, Serialize};

use crate::drive::delay_line::DelayLine;
use crate::drive::model::{DriveModel, MAX_KNOWN, PositionSensor, Signal};
use crate::io::fault::Fault;
use crate::io::measurement::{Measured, Measurement};
use crate::io::raw::{MAX_CHANNELS, RawSample};

/// Lost samples that a prediction bridges; after more the estimator starts anew.
pub(super) const LONGEST_GAP: u32 = 100;

/// Earlier readings of each signal, and the unwrapped position.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SignalHistory {
    lines: [DelayLine<f32>; MAX_CHANNELS],
    position: DelayLine<i64>,
    /// The last word of the position's counter.
    counter: Option<u32>,
    /// Position since start, unwrapped (counts).
    counts: i64,
    /// Counts that the index pulse adds to it.
    home: Option<i64>,
}

/// The readings of one sample, each at the time of the latest signal.
pub(super) struct Readings {
    pub(super) drive: Measured<f32>,
    pub(super) speed: Measured<f32>,
    /// From the state's origin [rad, m].
    pub(super) position: Measured<f32>,
    pub(super) known: [Measured<f32>; MAX_KNOWN],
}

impl SignalHistory {
    /// No sample yet.
    pub(super) fn empty() -> Self {
        Self {
            lines: [DelayLine::empty(); MAX_CHANNELS],
            position: DelayLine::empty(),
            counter: None,
            counts: 0,
            home: None,
        }
    }

    /// Drops all readings; the position of the counter stays.
    pub(super) fn forget_readings(&mut self) {
        *self = Self {
            counter: self.counter,
            counts: self.counts,
            home: self.home,
            ..Self::empty()
        };
    }

    /// Adds a sample; what was lost before it is missing.
    pub(super) fn push(&mut self, model: &DriveModel<'_>, m: &Measurement, raw: &RawSample) {
        let lost = m.lost.min(LONGEST_GAP);
        for (line, value) in (self.lines.iter_mut().zip(&m.values)).take(model.signals().count()) {
            for _ in 0..lost {
                line.push(Err(Fault::Missing));
            }
            line.push(*value);
        }
        let Some(sensor) = &model.position else {
            return;
        };
        for _ in 0..lost {
            self.position.push(Err(Fault::Missing));
        }
        let delivered = raw.has_encoder(0).then(|| raw.encoders.first().copied());
        let Some(count) = delivered.flatten() else {
            self.position.push(Err(Fault::Missing));
            return;
        };
        let since = |last: u32| i64::from(sensor.counter.difference(count, last));
        // The first word is what the counter holds, signed.
        self.counts += since(self.counter.unwrap_or(0));
        self.counter = Some(count);
        if let (Some(at_pulse), Some(latched), None) = (sensor.at_pulse, raw.index, self.home) {
            self.home = Some(i64::from(at_pulse) - (self.counts - since(latched)));
        }
        self.position.push(Ok(self.counts));
    }

    /// The latest position at the time of the readings (counts); 0 where none is measured.
    pub(super) fn position(&self, sensor: Option<&PositionSensor>) -> Measured<i64> {
        sensor.map_or(Ok(0), |sensor| {
            self.position.at(sensor.delay, |newer, _, _| newer)
        })
    }

    /// The latest speed at the time of the readings; missing where none is measured.
    pub(super) fn speed(&self, model: &DriveModel<'_>) -> Measured<f32> {
        self.readings(model, 0, false).speed
    }

    /// Counts from the start to where the position is 0; none until the index pulse.
    pub(super) fn home(&self) -> Option<i64> {
        self.home
    }

    /// The readings of the latest sample; of a stale one all are missing.
    pub(super) fn readings(&self, model: &DriveModel<'_>, origin: i64, stale: bool) -> Readings {
        let mut next = self.lines.iter();
        let mut of = |signal: Option<&Signal>| match (signal, stale) {
            (Some(signal), false) => (next.next().ok_or(Fault::Missing))
                .and_then(|line| line.at(signal.delay, |new, old, part| new + part * (old - new))),
            (Some(_), true) | (None, _) => Err(Fault::Missing),
        };
        let (drive, speed) = (of(model.drive.as_ref()), of(model.speed.as_ref()));
        let mut known = [Err(Fault::Missing); MAX_KNOWN];
        for (reading, signal) in known.iter_mut().zip(&model.known) {
            *reading = of(Some(signal));
        }
        let position = match &model.position {
            Some(sensor) if !stale => self.position.at(sensor.delay, |new, old, part| {
                let whole = new.wrapping_sub(origin) as f32;
                (whole + part * old.wrapping_sub(new) as f32) * sensor.count
            }),
            _ => Err(Fault::Missing),
        };
        Readings {
            drive,
            speed,
            position,
            known,
        }
    }
}
