//! Rotors: residuals of displacement sensors given the unbalance that explains them best.
//!
//! Nothing measures an unbalance, so that it belongs to the residual: what unbalances at the
//! loads, the motion before the first sample and what is known roughly can explain is taken out
//! of the readings, and of what effects predict alike ([`super::taken`]). What an unbalance does as
//! well as an effect, as at one constant speed, is then not seen of that effect.

mod clean;
mod effect;
mod observed;
mod recorded;
mod rough;
mod seen;
mod write;

use std::sync::Arc;

use loadtwin_design::rotor::Turning;
use loadtwin_machine::{Channel, Machine, Rotor, Senses};
use recorded::Recorded;
use seen::Seen;

use super::DiagnoseError;
use super::effect::Coupling;

pub use super::taken::Readings;

/// Part of a prediction that must be left beside unbalance and start, or an unbalance does the
/// same.
const OWN: f64 = 0.01;

/// Square of what an effect of usual size must come to, in noise, or it is not seen.
const SEEN: f64 = 50.0;

/// Change of speed, part of the highest, below which it counts as one speed.
const ONE_SPEED: f64 = 0.1;

/// A sensor's residual.
#[derive(Clone, Debug)]
pub struct RotorStream {
    residual: Vec<f64>,
    clean: Vec<f64>,
}

/// A recording of a rotor as residuals.
#[derive(Clone)]
pub struct RotorSession {
    seen: Arc<Seen>,
    streams: Vec<RotorStream>,
    /// Since the first recording's start [s].
    t: Vec<f64>,
}

/// What of a description takes an effect: the machine, and a channel where the effect has
/// parameters for each.
pub struct RotorPlace {
    machine: Machine,
    channel: Option<usize>,
}

impl RotorPlace {
    fn channel(&mut self) -> Option<&mut Channel> {
        self.machine.channels.get_mut(self.channel?)
    }
}

impl RotorSession {
    fn new(
        rotor: &Rotor,
        channels: &[Channel],
        mut recorded: Recorded,
    ) -> Result<Self, DiagnoseError> {
        for (channel, readings) in channels.iter().zip(&mut recorded.readings) {
            for (reading, angle) in readings.iter_mut().zip(&recorded.turning.angle) {
                *reading -= channel.to_si(channel.offset + channel.runout_at(*angle));
            }
        }
        let beside = |seen: &Arc<Seen>| Self::of(Arc::clone(seen)).effects();
        let seen = Seen::new(rotor, channels, &Arc::new(recorded), beside)?;
        Ok(Self::of(seen))
    }

    fn of(seen: Arc<Seen>) -> Self {
        let streams = (seen.residual().into_iter())
            .map(|residual| RotorStream {
                residual,
                clean: Vec::new(),
            })
            .collect();
        let dt_s = seen.turning().dt_s;
        Self {
            t: (0..seen.turning().angle.len())
                .map(|i| i as f64 * dt_s)
                .collect(),
            seen,
            streams,
        }
    }

    /// What effects do that have no shape but a place, by their parameters one after another, and
    /// the standard deviations of these.
    fn effects(&self) -> Vec<(Readings, f64)> {
        let mut all = Vec::new();
        for effect in effect::LIBRARY {
            if effect.shape().iter().any(|shape| shape.step > 0.0) {
                continue;
            }
            for shape in effect.grid(self) {
                for (term, linear) in effect.terms(self, &shape).into_iter().zip(effect.linear()) {
                    let std = linear.prior_std;
                    match effect.coupling() {
                        Coupling::Shared => all.push((term, std)),
                        Coupling::Own => {
                            all.extend((0..term.len()).map(|k| (self.alone(&term, k), std)));
                        }
                    }
                }
            }
        }
        all
    }

    /// The rotor as described.
    fn rotor(&self) -> &Rotor {
        &self.seen.rotor
    }

    /// The sensors.
    fn channels(&self) -> &[Channel] {
        &self.seen.channels
    }

    /// How the shaft turned.
    fn turning(&self) -> &Turning {
        self.seen.turning()
    }

    /// Node and direction [rad] of sensor `k`.
    fn place(&self, k: usize) -> (usize, f64) {
        displacement(&self.channels()[k])
    }

    /// Nodes with sensors.
    fn nodes(&self) -> Vec<usize> {
        nodes(self.channels())
    }

    /// What sensor `k` reads of the unbalance and the start that explain the readings best.
    fn explained(&self, k: usize) -> &[f64] {
        &self.seen.explained[k]
    }

    /// What a force at load `j` does that turns with the shaft and stays the same.
    fn bow(&self, j: usize) -> &[Readings] {
        let first = 2 * (self.rotor().loads.len() + j);
        &self.seen.columns[first..first + 2]
    }

    /// What forces at an end do that turn twice a turn, forward and backward.
    fn twice_a_turn(&self, end: usize) -> &[Readings] {
        let first = 4 * (self.rotor().loads.len() + end);
        &self.seen.columns[first..first + 4]
    }

    /// What is left of the readings less what `rotor` in place of the described one leaves.
    fn explained_beyond(&self, rotor: &Rotor) -> Readings {
        self.seen.explained_beyond(rotor)
    }

    /// A column by sensor and sample.
    fn each(&self, of: impl Fn(usize, usize) -> f64) -> Readings {
        (0..self.streams.len())
            .map(|k| (0..self.t.len()).map(|i| of(k, i)).collect())
            .collect()
    }

    /// `column` of sensor `own`, and nothing of the others.
    fn alone(&self, column: &Readings, own: usize) -> Readings {
        self.each(|k, i| if k == own { column[k][i] } else { 0.0 })
    }

    /// What is left of a column beside what an unbalance does, and whether it is enough to be seen.
    fn left_of(&self, column: Readings, prior_std: f64) -> Option<Readings> {
        if column.iter().any(Vec::is_empty) {
            return None;
        }
        let taken = &self.seen.taken;
        let whole = taken.square(&column);
        let left = taken.left_of(column);
        let square = taken.square(&left);
        (square > OWN * OWN * whole && square * prior_std * prior_std > SEEN).then_some(left)
    }

    fn one_speed(&self) -> bool {
        let speed = &self.turning().speed;
        let highest = speed.iter().copied().fold(0.0, f64::max);
        let lowest = speed.iter().copied().fold(f64::INFINITY, f64::min);
        highest - lowest < ONE_SPEED * highest
    }
}

/// Node and direction [rad] of a sensor.
fn displacement(channel: &Channel) -> (usize, f64) {
    match &channel.senses {
        Senses::Displacement(at) => (at.node, at.direction_deg.to_radians()),
        _ => (usize::MAX, 0.0),
    }
}

/// Nodes with sensors.
fn nodes(channels: &[Channel]) -> Vec<usize> {
    let mut nodes: Vec<usize> = channels.iter().map(|c| displacement(c).0).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}
