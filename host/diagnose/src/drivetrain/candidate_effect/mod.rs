//! Lists the candidate effects of drivetrains (`LIBRARY`), one file each, and defines `GaugeModel`,
//! the parameters of a gauge that they change in the improved description. A new effect is its
//! `impl` and a line in `LIBRARY`.

mod backlash;
mod bending_load;
mod carrier_order;
mod data_faults;
mod delay;
mod eccentricity;
mod friction;
mod gain_error;
mod gauge_creep;
mod gauge_drift;
mod gauge_position;
mod mains_interference;
mod order_regressors;
mod planet_sharing;
mod resonance;
mod shaft_order;
mod strain_hysteresis;
mod strain_nonlinearity;
mod sudden_change;
mod thermal;
mod torque_ripple;
mod unrecorded_thermal_drift;

use super::residual_signals::DrivetrainResiduals;
use crate::candidate_effect::Effect;
use loadtwin_machine::{Creep, Hysteresis, MAP_ENTRIES, Thermal};

/// A gauge as the estimator models it [SI].
pub struct GaugeModel {
    /// Reading at no torque.
    pub offset: f64,
    /// Sensitivity over the carrier angle, in equal steps; one value where it
    /// is the same everywhere.
    pub map: Vec<f64>,
    /// Reading at nominal torque, root mean square.
    pub full_scale: f64,
    /// Part of the reading by which it is larger at nominal torque than in proportion.
    pub nonlinearity: f64,
    /// Creep of the zero.
    pub creep: Option<Creep>,
    /// Its hysteresis: memory of the load's history.
    pub hysteresis: Option<Hysteresis>,
    /// Reading of a load that all gauges read and that is not torque, of which one unit is a
    /// mean reading of full scale; 0 where none is described.
    pub bending: f64,
    /// Its weight in that mean.
    pub weight: f64,
    /// How old its readings are [s].
    pub late_s: f64,
    /// What temperature rise does; none where the board samples no temperature.
    pub thermal: Option<Thermal>,
}

impl GaugeModel {
    /// Changes the sensitivity over the angle: each value, by its angle.
    pub fn over_angle(&mut self, change: impl Fn(f64, f64) -> f64) {
        if self.map.len() == 1 {
            self.map = vec![self.map[0]; MAP_ENTRIES];
        }
        let step = std::f64::consts::TAU / self.map.len() as f64;
        for (i, m) in self.map.iter_mut().enumerate() {
            *m = change(*m, i as f64 * step);
        }
    }

    /// Root mean square of the map.
    pub fn rms(&self) -> f64 {
        (self.map.iter().map(|m| m * m).sum::<f64>() / self.map.len() as f64).sqrt()
    }
}

/// Every effect that is tried.
pub static LIBRARY: &[&dyn Effect<DrivetrainResiduals>] = &[
    &gain_error::GainError,
    &gauge_position::GaugePosition,
    &strain_nonlinearity::StrainNonlinearity,
    &thermal::DRIFT,
    &unrecorded_thermal_drift::UnrecordedThermalDrift,
    &thermal::GAIN,
    &gauge_creep::GaugeCreep,
    &gauge_drift::GaugeDrift,
    &strain_hysteresis::StrainHysteresis,
    &sudden_change::STEP,
    &sudden_change::DEBONDING,
    &carrier_order::CarrierOrder,
    &planet_sharing::PlanetSharing,
    &shaft_order::ShaftOrder,
    &bending_load::BendingLoad,
    &friction::COULOMB,
    &friction::STRIBECK,
    &friction::VISCOUS,
    &friction::LOAD_DEPENDENT,
    &friction::PRESLIDING,
    &backlash::Backlash,
    &torque_ripple::TorqueRipple,
    &resonance::Resonance,
    &delay::Delay,
    &eccentricity::Eccentricity,
    &mains_interference::MainsInterference,
    &data_faults::DROPPED_BITS,
    &data_faults::STUCK,
];

/// The grid of an effect without shape.
fn one_shape() -> Vec<Vec<f64>> {
    vec![Vec::new()]
}

/// The grid of one parameter.
fn each(values: &[f64]) -> Vec<Vec<f64>> {
    values.iter().map(|v| vec![*v]).collect()
}
