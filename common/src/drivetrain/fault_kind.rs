//! Classifies the fault of an excluded gauge (dead, reversed, gain, offset, drift, erratic) from
//! running moments of its reading and of the predicted response (`Moments`).

use serde::{Deserialize, Serialize};

use crate::io::fault::Fault;

/// Time constant of the moments, in windows of the test: 0.8 s with its usual window of 0.1 s.
const LONG: f32 = 8.0;

/// Samples, in parts of a window, before a kind is named.
const EARLIEST: f32 = 0.5;

/// Growth of an offset since it was isolated that makes it a drift.
const DRIFTED: f32 = 1.25;

/// Moments of a reading `y` without its zero and of the response `x` that was expected.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Moments {
    count: f32,
    y: f32,
    x: f32,
    yy: f32,
    xy: f32,
    xx: f32,
    /// Mean of `y - x` in the first window.
    first: f32,
}

impl Moments {
    /// Takes a sample in: the mean of all up to [`LONG`] windows, then with forgetting.
    pub(crate) fn push(&mut self, y: f32, x: f32, forgetting: f32) {
        self.count += 1.0;
        let part = (1.0 / self.count).max(forgetting / LONG);
        for (mean, value) in [
            (&mut self.y, y),
            (&mut self.x, x),
            (&mut self.yy, y * y),
            (&mut self.xy, x * y),
            (&mut self.xx, x * x),
        ] {
            *mean += part * (value - *mean);
        }
        if self.count * forgetting <= 1.0 {
            self.first = self.y - self.x;
        }
        // Bounded: a count that no longer counts.
        self.count = self.count.min(LONG * 2.0 / forgetting);
    }

    /// The simplest kind whose mean square residual is within `tolerance`, else the one with
    /// the least, else erratic.
    ///
    /// Dead: `y = 0` or constant; reversed: `y = -x`; gain: `y = g x`; offset: `y = x + b`.
    pub(crate) fn kind(&self, tolerance: f32, forgetting: f32) -> Fault {
        if self.count * forgetting < EARLIEST {
            return Fault::Erratic;
        }
        let Self {
            y, x, yy, xy, xx, ..
        } = *self;
        if yy <= tolerance {
            return Fault::Dead;
        }
        if yy + 2.0 * xy + xx <= tolerance {
            return Fault::Reversed;
        }
        let offset = y - x;
        let by_offset = yy - 2.0 * xy + xx - offset * offset;
        let by_gain = if xx > 0.0 { yy - xy * xy / xx } else { yy };
        // A constant: only where the response is far from one.
        let by_nothing = 4.0 * (yy - y * y);
        let drifts = libm::fabsf(offset) > DRIFTED * libm::fabsf(self.first);
        let offset = if drifts { Fault::Drift } else { Fault::Offset };
        let candidates = [
            (by_offset, offset),
            (by_gain, Fault::Gain),
            (by_nothing, Fault::Dead),
        ];
        let least = candidates
            .into_iter()
            .fold((tolerance, Fault::Erratic), |least, next| {
                if next.0 < least.0 { next } else { least }
            });
        least.1
    }
}
