//! Injects data faults into the words of a simulated channel: inverted bits, stuck values, missing
//! samples.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::injected_effect::{Apply, Dose, Effect, Scope};
use crate::simulated_gauge::{Moment, WordFault};

/// Single bits are lost: a bit of the upper half of the reading is inverted.
pub(crate) const DROPPED_BITS: Effect = Effect {
    name: "dropped-bits",
    typical: "one sample in 500 of one channel has a wrong bit",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            // The highest bit that the reading uses at nominal load.
            let highest = (gauge.span() / gauge.lsb().abs()).max(2.0).log2().ceil() as u32;
            gauge.faults.push(Box::new(DroppedBits {
                part: 0.002 * dose.strength,
                highest: highest.min(30),
                rng: own_stream(dose),
            }));
        }
    }),
};

/// A channel repeats its last word for a while.
pub(crate) const STUCK: Effect = Effect {
    name: "stuck-values",
    typical: "one channel repeats a word for 0.5 s, every 10 s on average",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            gauge.faults.push(Box::new(Stuck {
                per_s: 0.1 * dose.strength,
                until: f64::NEG_INFINITY,
                word: 0,
                rng: own_stream(dose),
            }));
        }
    }),
};

/// Samples of a channel are not delivered.
pub(crate) const MISSING: Effect = Effect {
    name: "missing-samples",
    typical: "one sample in 100 of one channel is missing",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            gauge.faults.push(Box::new(Missing {
                part: 0.01 * dose.strength,
                rng: own_stream(dose),
            }));
        }
    }),
};

fn own_stream(dose: &mut Dose) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(dose.draw.recording.random())
}

struct DroppedBits {
    part: f64,
    highest: u32,
    rng: ChaCha8Rng,
}

impl WordFault for DroppedBits {
    fn apply(&mut self, _: &Moment, word: i64) -> Option<i64> {
        let bit = self.rng.random_range(self.highest / 2..=self.highest);
        Some(if self.rng.random::<f64>() < self.part {
            word ^ (1 << bit)
        } else {
            word
        })
    }
}

struct Stuck {
    per_s: f64,
    until: f64,
    word: i64,
    rng: ChaCha8Rng,
}

impl WordFault for Stuck {
    fn apply(&mut self, moment: &Moment, word: i64) -> Option<i64> {
        let begins = self.rng.random::<f64>() < self.per_s * moment.dt;
        if moment.t >= self.until {
            self.word = word;
            if begins {
                self.until = moment.t + 0.5;
            }
        }
        Some(self.word)
    }
}

struct Missing {
    part: f64,
    rng: ChaCha8Rng,
}

impl WordFault for Missing {
    fn apply(&mut self, _: &Moment, word: i64) -> Option<i64> {
        (self.rng.random::<f64>() >= self.part).then_some(word)
    }
}
