//! Computes the residuals of one rotor recording: unbalances, initial motion and uncertain
//! parameters are projected out, linearised repeatedly about the estimates of these parameters.
//! Also the responses to forces from which effects are computed, and the difference of the
//! residuals from those with a changed rotor.

use std::sync::Arc;

use crate::diagnosis::DiagnoseError;
use crate::regression::projection::NuisanceProjection;
use crate::residual_model::SignalSet;
use crate::rotor::recorded_samples::RotorRecording;
use crate::rotor::uncertain_parameters::UncertainParameter;
use loadtwin_design::rotor::{ForcedRotor, ShaftRotation, SynchronousForce};
use loadtwin_machine::{Channel, Rotor};

/// Linearisations of the uncertain parameters about their estimates.
const ROUNDS: usize = 3;

/// Prior standard deviations by which an uncertain parameter may differ from the description.
const MOST_OFF: f64 = 4.0;

/// The part of a recording that no effect changes.
pub(crate) struct RotorContext {
    /// As described.
    pub described: Rotor,
    /// As described, except for the uncertain parameters.
    pub rotor: Rotor,
    pub channels: Vec<Channel>,
    recorded: Arc<RotorRecording>,
    /// Forces that are tried: the unbalances first.
    forces: Vec<SynchronousForce>,
    /// What each sensor reads under each force of unit size, a quarter turn apart.
    pub columns: Vec<SignalSet>,
    /// Sizes of all columns of the model: what explains the readings best.
    pub sizes: Vec<f64>,
    /// What the sensors read so.
    pub explained: SignalSet,
    /// Projection on unbalances, initial motion and uncertain parameters.
    pub projection: NuisanceProjection,
}

/// Unbalances at the loads, constant forces there, and forces at both ends twice a turn.
fn forces(rotor: &Rotor) -> Vec<SynchronousForce> {
    let at_loads = |grows: bool| {
        (rotor.loads.iter()).map(move |load| SynchronousForce {
            node: load.node,
            order: 1.0,
            grows,
        })
    };
    let at_ends = [0, rotor.nodes() - 1].into_iter().flat_map(|node| {
        [2.0, -2.0].map(|order| SynchronousForce {
            node,
            order,
            grows: false,
        })
    });
    at_loads(true)
        .chain(at_loads(false))
        .chain(at_ends)
        .collect()
}

impl RotorContext {
    /// How the shaft turned.
    pub fn turning(&self) -> &ShaftRotation {
        &self.recorded.turning
    }

    /// What `recorded`, less offsets, shows of `rotor`; `beside` are effects that it may hold, as
    /// columns with the standard deviations of their parameters, so that they are not mistaken for
    /// uncertain parameters.
    pub fn new(
        described: &Rotor,
        channels: &[Channel],
        recorded: &Arc<RotorRecording>,
        beside: impl Fn(&Arc<Self>) -> Vec<(SignalSet, f64)>,
    ) -> Result<Arc<Self>, DiagnoseError> {
        Self::settled(described, channels, recorded, &forces(described), beside)
    }

    /// Linearised repeatedly about the uncertain parameters that were found.
    fn settled(
        described: &Rotor,
        channels: &[Channel],
        recorded: &Arc<RotorRecording>,
        forces: &[SynchronousForce],
        beside: impl Fn(&Arc<Self>) -> Vec<(SignalSet, f64)>,
    ) -> Result<Arc<Self>, DiagnoseError> {
        let rough = nuisances(described, &recorded.turning);
        let mut off = vec![0.0; rough.len()];
        for _ in 1..ROUNDS {
            let context = Self::about(described, channels, recorded, forces, &rough, &off)?;
            let context = Arc::new(context);
            let further = beside(&context);
            let found = (context.projection.with(further)).parameters(&known(&recorded.readings));
            let steps = &found[context.projection.len() - off.len()..];
            for (off, step) in off.iter_mut().zip(steps) {
                *off = (*off + step).clamp(-MOST_OFF, MOST_OFF);
            }
        }
        let context = Self::about(described, channels, recorded, forces, &rough, &off)?;
        Ok(Arc::new(context))
    }

    /// With the uncertain parameters off by `off` standard deviations.
    fn about(
        described: &Rotor,
        channels: &[Channel],
        recorded: &Arc<RotorRecording>,
        forces: &[SynchronousForce],
        rough: &[UncertainParameter],
        off: &[f64],
    ) -> Result<Self, DiagnoseError> {
        let mut rotor = described.clone();
        for (rough, off) in rough.iter().zip(off) {
            rough.scale(&mut rotor, (rough.part() * off).exp());
        }
        let turning = &recorded.turning;
        let driven = ForcedRotor::new(&rotor, channels, forces, turning)?;
        let mut columns = driven.columns(turning);
        let begun = columns.split_off(2 * forces.len());
        let weights: SignalSet = (channels.iter().zip(&recorded.readings))
            .map(|(channel, readings)| {
                let weight = channel.to_si(channel.noise_std).powi(-2);
                (readings.iter())
                    .map(|y| if y.is_finite() { weight } else { 0.0 })
                    .collect()
            })
            .collect();
        let unbalances = 2 * rotor.loads.len();
        let mut free: Vec<SignalSet> = columns[..unbalances].to_vec();
        free.extend(begun);
        let stds = vec![f64::INFINITY; free.len()];
        let projection = NuisanceProjection::new(free.clone(), &stds, weights.clone());
        let found = projection.parameters(&known(&recorded.readings));
        let mut sizes = vec![0.0; columns.len()];
        sizes[..unbalances].copy_from_slice(&found[..unbalances]);
        sizes.extend(&found[unbalances..]);
        let mut context = Self {
            explained: driven.reading(turning, &sizes),
            described: described.clone(),
            channels: channels.to_vec(),
            recorded: Arc::clone(recorded),
            forces: forces.to_vec(),
            rotor,
            columns,
            sizes,
            projection,
        };
        let stds: Vec<f64> = stds.into_iter().chain(vec![1.0; rough.len()]).collect();
        for rough in rough {
            let mut other = context.rotor.clone();
            rough.scale(&mut other, rough.part().exp());
            free.push(context.change_to(&other));
        }
        context.projection = NuisanceProjection::new(free, &stds, weights);
        Ok(context)
    }

    /// What the sensors read of rotor `other` under the same forces, less what they read of this
    /// one; nothing where it is not held.
    fn change_to(&self, other: &Rotor) -> SignalSet {
        let turning = self.turning();
        let Ok(driven) = ForcedRotor::new(other, &self.channels, &self.forces, turning) else {
            return vec![Vec::new(); self.channels.len()];
        };
        let mut change = driven.reading(turning, &self.sizes);
        for (change, one) in change.iter_mut().zip(&self.explained) {
            change.iter_mut().zip(one).for_each(|(c, one)| *c -= one);
        }
        change
    }

    /// Residuals of the readings less those with `rotor` in place of the described one, each after
    /// its own best fit of unbalances and uncertain parameters; nothing where it is not held.
    pub fn explained_beyond(&self, rotor: &Rotor) -> SignalSet {
        let unbalances = &self.forces[..rotor.loads.len()];
        let other = Self::settled(rotor, &self.channels, &self.recorded, unbalances, |_| {
            Vec::new()
        });
        let Ok(other) = other else {
            return vec![Vec::new(); self.channels.len()];
        };
        let readings = known(&self.recorded.readings);
        let mut left = self.projection.annihilate(readings.clone());
        for (left, other) in left.iter_mut().zip(other.projection.annihilate(readings)) {
            left.iter_mut()
                .zip(other)
                .for_each(|(left, other)| *left -= other);
        }
        left
    }

    /// Residuals of the readings; NaN where there are none.
    pub fn residual(&self) -> SignalSet {
        let readings = &self.recorded.readings;
        let mut left = self.projection.annihilate(known(readings));
        for (left, readings) in left.iter_mut().zip(readings) {
            for (left, reading) in left.iter_mut().zip(readings) {
                if !reading.is_finite() {
                    *left = f64::NAN;
                }
            }
        }
        left
    }
}

/// Parameters that the recording determines better than the description.
fn nuisances(rotor: &Rotor, turning: &ShaftRotation) -> Vec<UncertainParameter> {
    let all = UncertainParameter::all(rotor).into_iter();
    all.filter(|rough| rough.is_nuisance())
        .filter(|rough| *rough != UncertainParameter::Acceleration || turning.accelerates())
        .collect()
}

/// 0 where nothing was measured.
fn known(readings: &SignalSet) -> SignalSet {
    let value = |y: &f64| if y.is_finite() { *y } else { 0.0 };
    readings
        .iter()
        .map(|of| of.iter().map(value).collect())
        .collect()
}
