//! What follows from the counts of a load.

use super::Life;
use super::count::Counted;
use crate::life::{
    RatingLife, SnCurve, damage, equivalent_load, equivalent_torque, rating_life, turns_at_load,
};

/// What follows for a load.
pub(super) struct Figures {
    pub(super) seen_s: f64,
    pub(super) equivalent_cycles: f64,
    pub(super) equivalent: Vec<(f64, f64)>,
    pub(super) damage: Option<f64>,
    /// For each shaft.
    pub(super) torque: Vec<Option<f64>>,
    pub(super) bearing: Option<RatingLife>,
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
            .map(|counts| counts.observation().seen)
            .sum();
        let seen_s = seen as f64 * period_s;
        let equivalent_cycles = self.equivalent_cycles.unwrap_or(seen_s);
        let equivalent = (self.exponents.iter())
            .map(|&m| Ok((m, equivalent_load(&counted.spectrum, m, equivalent_cycles)?)))
            .collect::<anyhow::Result<_>>()?;
        let turns = |shaft: usize| -> Vec<(f64, f64)> {
            let machines = counted.machines.iter();
            machines
                .flat_map(|counts| turns_at_load(counts, shaft))
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
            damage: curve.map(|curve| damage(&counted.spectrum, curve)),
            torque,
            bearing: bearing.flatten(),
        })
    }
}
