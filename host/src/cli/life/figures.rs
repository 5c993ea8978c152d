//! Computes the results of `loadtwin life` from the counts of a load (`Figures`): damage-equivalent
//! loads and damage by an S-N curve, both also without the noise of the estimates, with a 90 %
//! interval; equivalent torque of a gear and rating life of a bearing.

use super::Life;
use super::count::Counted;
use crate::life::{
    Interval, LifeError, NoiseRemoved, RatingLife, SnCurve, Spectrum, damage, equivalent_load,
    equivalent_torque, rating_life, turns_at_load,
};

/// Results of one load; ranges and torques in its unit.
pub(super) struct Figures {
    /// Time with valid samples (s).
    pub(super) seen_s: f64,
    pub(super) equivalent_cycles: f64,
    pub(super) equivalent: Vec<Equivalent>,
    pub(super) damage: Option<f64>,
    /// Damage without the noise of the estimates, where the file has standard deviations.
    pub(super) damage_noise_removed: Option<Interval>,
    /// Equivalent torque of a gear on each shaft; empty without `--gear`.
    pub(super) torque: Vec<Option<f64>>,
    pub(super) bearing: Option<RatingLife>,
}

/// A damage-equivalent load.
pub(super) struct Equivalent {
    pub(super) exponent: f64,
    /// Of the load as estimated.
    pub(super) load: f64,
    /// Without the noise of the estimates, where the file has standard deviations.
    pub(super) noise_removed: Option<Interval>,
}

impl Equivalent {
    fn of(counted: &Counted, exponent: f64, cycles: f64) -> Result<Self, LifeError> {
        let figure = |spectrum: &Spectrum| equivalent_load(spectrum, exponent, cycles);
        let removed = counted.noise_removed.as_ref();
        Ok(Self {
            exponent,
            load: figure(&counted.spectrum)?,
            noise_removed: removed
                .map(|removed| removed.interval(figure))
                .transpose()?,
        })
    }
}

impl Life {
    pub(super) fn figures(
        &self,
        counted: &Counted,
        period_s: f64,
        curve: Option<&SnCurve>,
    ) -> anyhow::Result<Figures> {
        let seen: u64 = counted
            .machines
            .iter()
            .map(|machine| machine.counts.observation().seen)
            .sum();
        let seen_s = seen as f64 * period_s;
        let equivalent_cycles = self.equivalent_cycles.unwrap_or(seen_s);
        let equivalent = (self.exponents.iter())
            .map(|&exponent| Equivalent::of(counted, exponent, equivalent_cycles))
            .collect::<Result<_, _>>()?;
        let of_curve = |removed: &NoiseRemoved| {
            let curve = curve?;
            let figure = |spectrum: &Spectrum| Ok::<_, LifeError>(damage(spectrum, curve));
            Some(removed.interval(figure))
        };
        let damage_noise_removed = counted.noise_removed.as_ref().and_then(of_curve);
        let turns = |shaft: usize| -> Vec<(f64, f64)> {
            let machines = counted.machines.iter();
            machines
                .flat_map(|machine| turns_at_load(&machine.counts, shaft))
                .collect()
        };
        let torque = (self.gear.iter())
            .flat_map(|&exponent| [0, 1].map(|shaft| equivalent_torque(&turns(shaft), exponent)))
            .collect::<Result<_, _>>()?;
        let bearing = (self.bearing.as_ref())
            .map(|bearing| rating_life(&turns(0), bearing.0, bearing.1))
            .transpose()?;
        Ok(Figures {
            seen_s,
            equivalent_cycles,
            equivalent,
            damage_noise_removed: damage_noise_removed.transpose()?,
            damage: curve.map(|curve| damage(&counted.spectrum, curve)),
            torque,
            bearing: bearing.flatten(),
        })
    }
}
