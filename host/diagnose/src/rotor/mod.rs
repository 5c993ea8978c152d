//! Diagnosis of rotors: the types of its residual signals (displacement sensors, given the
//! unbalance that explains them best), of a recording, and of the description that an effect
//! changes; and the response of a sensor to the forces of an effect, without what an unbalance
//! explains.
//!
//! An unbalance is not measured, so that it is a nuisance. The contributions of unbalances at the
//! loads, of the motion before the first sample and of uncertain parameters are projected out of
//! the readings and of the regressors ([`crate::regression::projection`]). The part of an effect
//! that an unbalance can imitate, as at one constant speed, is then not observable.

mod candidate_effect;
mod diagnosable;
mod improved_description;
mod null_simulation;
mod recorded_samples;
mod residual_computation;
mod uncertain_parameters;

use std::sync::Arc;

use crate::rotor::recorded_samples::RotorRecording;
use crate::rotor::residual_computation::RotorContext;
use loadtwin_design::rotor::ShaftRotation;
use loadtwin_machine::{Channel, Machine, Rotor, Senses};

use crate::candidate_effect::Scope;
use crate::diagnosis::DiagnoseError;

pub use crate::residual_model::SignalSet;

/// Part of a prediction that must be left beside unbalance and start, or an unbalance does the
/// same.
const MIN_INDEPENDENT: f64 = 0.01;

/// Least square of an effect of usual size, in units of the noise variance, to be observable.
const MIN_VISIBLE_POWER: f64 = 50.0;

/// Change of speed, part of the highest, below which it counts as one speed.
const ONE_SPEED: f64 = 0.1;

/// A sensor's residual.
#[derive(Clone, Debug)]
pub struct RotorSignal {
    residual: Vec<f64>,
    fault_free: Vec<f64>,
}

/// A recording of a rotor as residuals.
#[derive(Clone)]
pub struct RotorResiduals {
    context: Arc<RotorContext>,
    residuals: Vec<RotorSignal>,
    /// Since the first recording's start [s].
    t: Vec<f64>,
}

/// The part of a description that an effect changes: the machine, and a channel where the effect
/// has parameters for each.
pub struct RotorTarget {
    machine: Machine,
    channel: Option<usize>,
}

impl RotorTarget {
    fn channel(&mut self) -> Option<&mut Channel> {
        self.machine.channels.get_mut(self.channel?)
    }
}

impl RotorResiduals {
    fn new(
        rotor: &Rotor,
        channels: &[Channel],
        mut recorded: RotorRecording,
    ) -> Result<Self, DiagnoseError> {
        for (channel, readings) in channels.iter().zip(&mut recorded.readings) {
            for (reading, angle) in readings.iter_mut().zip(&recorded.turning.angle) {
                *reading -= channel.to_si(channel.offset + channel.runout_at(*angle));
            }
        }
        let beside = |context: &Arc<RotorContext>| Self::of(Arc::clone(context)).effects();
        let context = RotorContext::new(rotor, channels, &Arc::new(recorded), beside)?;
        Ok(Self::of(context))
    }

    fn of(context: Arc<RotorContext>) -> Self {
        let residuals = (context.residual().into_iter())
            .map(|residual| RotorSignal {
                residual,
                fault_free: Vec::new(),
            })
            .collect();
        let dt_s = context.turning().dt_s;
        Self {
            t: (0..context.turning().angle.len())
                .map(|i| i as f64 * dt_s)
                .collect(),
            context,
            residuals,
        }
    }

    /// What effects do that have no shape but a place, by their parameters one after another, and
    /// the standard deviations of these.
    fn effects(&self) -> Vec<(SignalSet, f64)> {
        let mut all = Vec::new();
        for effect in candidate_effect::LIBRARY {
            if effect
                .nonlinear_parameters()
                .iter()
                .any(|shape| shape.step > 0.0)
            {
                continue;
            }
            for shape in effect.initial_values(self) {
                for (term, linear) in effect
                    .regressors(self, &shape)
                    .into_iter()
                    .zip(effect.linear_parameters())
                {
                    let std = linear.prior_std;
                    match effect.scope() {
                        Scope::Machine => all.push((term, std)),
                        Scope::PerSignal => {
                            all.extend((0..term.len()).map(|k| (self.on_channel(&term, k), std)));
                        }
                    }
                }
            }
        }
        all
    }

    /// The rotor as described.
    fn described(&self) -> &Rotor {
        &self.context.described
    }

    /// The rotor with the uncertain parameters that were found.
    fn rotor(&self) -> &Rotor {
        &self.context.rotor
    }

    /// The sensors.
    fn channels(&self) -> &[Channel] {
        &self.context.channels
    }

    /// How the shaft turned.
    fn turning(&self) -> &ShaftRotation {
        self.context.turning()
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
        &self.context.explained[k]
    }

    /// What a force at load `j` does that turns with the shaft and stays the same.
    fn bow_response(&self, j: usize) -> &[SignalSet] {
        let first = 2 * (self.rotor().loads.len() + j);
        &self.context.columns[first..first + 2]
    }

    /// What forces at an end do that turn twice a turn, forward and backward.
    fn second_order_response(&self, end: usize) -> &[SignalSet] {
        let first = 4 * (self.rotor().loads.len() + end);
        &self.context.columns[first..first + 4]
    }

    /// Residuals of the readings less those with `rotor` in place of the described one.
    fn explained_beyond(&self, rotor: &Rotor) -> SignalSet {
        self.context.explained_beyond(rotor)
    }

    /// A column by sensor and sample.
    fn each(&self, of: impl Fn(usize, usize) -> f64) -> SignalSet {
        (0..self.residuals.len())
            .map(|k| (0..self.t.len()).map(|i| of(k, i)).collect())
            .collect()
    }

    /// `column` of sensor `own`, and nothing of the others.
    fn on_channel(&self, column: &SignalSet, own: usize) -> SignalSet {
        self.each(|k, i| if k == own { column[k][i] } else { 0.0 })
    }

    /// Residual of a column after projection on unbalances, and whether it is large enough to be observed.
    fn orthogonal_part(&self, column: SignalSet, prior_std: f64) -> Option<SignalSet> {
        if column.iter().any(Vec::is_empty) {
            return None;
        }
        let projection = &self.context.projection;
        let whole = projection.square(&column);
        let left = projection.annihilate(column);
        let square = projection.square(&left);
        (square > MIN_INDEPENDENT * MIN_INDEPENDENT * whole
            && square * prior_std * prior_std > MIN_VISIBLE_POWER)
            .then_some(left)
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
