//! Candidate effect: thermal drift of gauge offsets where no temperature is recorded: a first-order
//! lag of the mechanical power.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::each;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};
use loadtwin_machine::lag;

/// `scale a z`, `dz/dt = (|power| - z) / tau`: what friction and mesh losses
/// heat, where no thermometer is.
pub struct UnrecordedThermalDrift;

const HEATING: NonlinearParameter = NonlinearParameter {
    name: "time constant",
    unit: "s",
    bounds: (10.0, 5000.0),
    step: 0.7,
    logarithmic: true,
};

const INFO: EffectInfo = EffectInfo {
    name: "thermal-drift-unrecorded",
    description: "zeros move with a heating that is not recorded",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of full scale in the end at nominal power",
        prior_std: 1.0,
    }],
    nonlinear: &[HEATING],
    recommended_experiment: "a thermometer at the gauges, or a long run at power and then one without load",
};

impl Effect<DrivetrainResiduals> for UnrecordedThermalDrift {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        if recording.signals.warming.is_some() {
            Vec::new()
        } else {
            each(&[20.0, 60.0, 200.0, 600.0, 1800.0])
        }
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let signals = &recording.signals;
        let power = signals
            .level
            .iter()
            .zip(signals.relative_speed())
            .map(|(l, w)| (l * w).abs());
        vec![Regressor::Offset(lag(power, signals.dt_s, shape[0]))]
    }
}
