//! Candidate effects of a recorded temperature: offset and sensitivity of a gauge in proportion to
//! the temperature rise since zeroing, which the gauge follows with a lag.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, each};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};
use loadtwin_machine::{Machine, Thermal, followed};

/// How slowly gauges follow the thermometer, which sits elsewhere.
const LAG: NonlinearParameter = NonlinearParameter {
    name: "time in which gauges follow",
    unit: "s",
    bounds: (AT_ONCE_S, 300.0),
    step: 0.5,
    logarithmic: true,
};

/// A lag that is indistinguishable from none [s].
const AT_ONCE_S: f64 = 0.3;

/// What temperature rise does to a gauge, by `w` with `dw/dt = (T - T0 - w) / lag`.
pub struct ThermalEffect {
    info: EffectInfo,
    /// What changes with `w`.
    term: fn(Vec<f64>) -> Regressor,
    /// Applies its size to the thermal model of a gauge of that full scale.
    apply_to: fn(&mut Thermal, f64, f64),
}

/// `scale a w`.
pub const DRIFT: ThermalEffect = ThermalEffect {
    info: EffectInfo {
        name: "thermal-drift",
        description: "zeros move with the recorded temperature",
        scope: Scope::PerSignal,
        linear: &[LinearParameter {
            name: "part of full scale per kelvin",
            prior_std: 0.05,
        }],
        nonlinear: &[LAG],
        recommended_experiment: "warming up and cooling down without load",
    },
    term: Regressor::Offset,
    apply_to: |thermal, size, full_scale| thermal.zero_per_k += size * full_scale,
};

/// `reading a w`.
pub const GAIN: ThermalEffect = ThermalEffect {
    info: EffectInfo {
        name: "thermal-gain",
        description: "responses change with the recorded temperature",
        scope: Scope::PerSignal,
        linear: &[LinearParameter {
            name: "part of the reading per kelvin",
            prior_std: 0.05,
        }],
        nonlinear: &[LAG],
        recommended_experiment: "the same torque ramp, cold and warm",
    },
    term: Regressor::Gain,
    apply_to: |thermal, size, _| thermal.gain_per_k += size,
};

impl Effect<DrivetrainResiduals> for ThermalEffect {
    fn info(&self) -> &EffectInfo {
        &self.info
    }
    fn parameter_count(&self) -> usize {
        self.linear_parameters().len()
    }
    /// Lags, where a temperature was recorded.
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        match &recording.signals.warming {
            Some(_) => each(&[AT_ONCE_S, 4.0, 12.0, 40.0]),
            None => Vec::new(),
        }
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let signals = &recording.signals;
        let measured = signals.warming.iter().flatten().copied();
        vec![(self.term)(followed(measured, signals.dt_s, shape[0]))]
    }
    /// The reference temperature may be off by the noise of one reading.
    fn own_nuisances(&self, recording: &DrivetrainResiduals, _: &[f64]) -> Vec<Regressor> {
        let signals = &recording.signals;
        let off = self.info.linear[0].prior_std * signals.zero_noise_k;
        vec![(self.term)(vec![off; signals.len()])]
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let sampled = gauge.thermal.as_mut();
        sampled
            .map(|thermal| (self.apply_to)(thermal, parameters[0], gauge.full_scale))
            .is_some()
    }
    /// Two lags, one after the other, are one as long as both: that described and the longest found.
    fn apply_to_machine(
        &self,
        recording: &DrivetrainResiduals,
        shape: &[f64],
        _: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let sampled = machine.thermometer_mut().filter(|t| t.adc.is_some());
        let time_skew = if shape[0] > AT_ONCE_S { shape[0] } else { 0.0 };
        let both = recording.signals.lag_s + time_skew;
        sampled.map(|t| t.lag_s = t.lag_s.max(both)).is_some()
    }
}
