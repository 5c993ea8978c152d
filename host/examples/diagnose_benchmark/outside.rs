//! Changes to a recording that no candidate effect describes, for the benchmark's recordings
//! with an unknown effect.

use loadtwin::machine::Machine;
use loadtwin::recording::Block;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::cases::DURATION_S;

/// Names of the effects outside the library; the first one is the simulation's own.
pub const OUTSIDE: [&str; 4] = [
    "bursts",
    "slipping-coupling",
    "loose-contact",
    "interference",
];

/// Change of a recording.
#[derive(Clone, Copy)]
enum Act {
    /// The encoder loses counts at each of the moments.
    Slip,
    /// The channel reads less between every other two moments.
    Contact,
    /// An oscillation whose frequency wanders.
    Interference,
}

/// A change of one column.
pub struct Change {
    act: Act,
    strength: f64,
    column: usize,
    /// When it happens [s].
    moments: Vec<f64>,
}

/// Reading of a channel at nominal load, about.
const SPAN: f64 = 60e-6;

impl Change {
    /// The change of that name; none where the simulation has it itself.
    pub fn new(machine: &Machine, name: &str, strength: f64, seed: u64) -> Option<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let channels = machine.channels.len();
        let (act, column) = match name {
            // The first encoder comes after the channels.
            "slipping-coupling" => (Act::Slip, channels),
            "loose-contact" => (Act::Contact, rng.random_range(0..channels)),
            "interference" => (Act::Interference, rng.random_range(0..channels)),
            _ => return None,
        };
        let mut moments: Vec<f64> = (0..24).map(|_| rng.random_range(0.0..DURATION_S)).collect();
        moments.sort_by(f64::total_cmp);
        Some(Self {
            act,
            strength,
            column,
            moments,
        })
    }

    /// Changes the next block.
    pub fn apply(&mut self, block: &mut Block) {
        let Some(Some(column)) = block.columns.get_mut(self.column) else {
            return;
        };
        for (t, value) in block.t.iter().zip(column) {
            let before = self.moments.iter().filter(|m| **m <= *t).count();
            match self.act {
                Act::Slip => *value += (20.0 * self.strength * before as f64).round(),
                Act::Contact if before % 2 == 1 => *value *= 1.0 - 0.2 * self.strength,
                Act::Contact => {}
                Act::Interference => {
                    let phase = 40.0 * t + 60.0 * (0.37 * t).sin() + 25.0 * (0.9 * t).cos();
                    *value += 0.03 * self.strength * SPAN * phase.sin();
                }
            }
        }
    }
}
