//! Candidate effect, eccentricity of an encoder disc: an angle error once per revolution.
//! Regressors: the contributions of its cosine, its sine and a constant to encoder angles, torque
//! balance and strains.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::order_regressors::fourier_pair;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, Regressor};
use loadtwin_machine::{Encoder, Machine};

/// Standard deviation of what errs twice per turn [rad of the main shaft].
const TWICE_RAD: f64 = 0.0005;

/// `a cos(r angle) + b sin(r angle) + c` on the angle of an inertia with speed
/// ratio `r`; `c` is the part that the index pulse removes, less the phase common to all maps.
pub struct Eccentricity;

const INFO: EffectInfo = EffectInfo {
    name: "encoder-eccentricity",
    description: "an encoder errs once per turn",
    scope: Scope::Machine,
    linear: &[
        LinearParameter {
            name: "cosine [rad of the main shaft]",
            prior_std: 0.005,
        },
        LinearParameter {
            name: "sine [rad of the main shaft]",
            prior_std: 0.005,
        },
        LinearParameter {
            name: "at the index [rad of the main shaft]",
            prior_std: 0.005,
        },
    ],
    nonlinear: &[NonlinearParameter {
        name: "inertia",
        unit: "number",
        bounds: (0.0, 6.0),
        step: 0.0,
        logarithmic: false,
    }],
    recommended_experiment: "constant speed over many turns with a second encoder",
};

impl Effect<DrivetrainResiduals> for Eccentricity {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        let mut bodies: Vec<usize> = recording
            .residuals
            .iter()
            .filter(|s| s.kind == Kind::Angle)
            .flat_map(|s| s.inertias)
            .collect();
        bodies.sort_unstable();
        bodies.dedup();
        bodies.iter().map(|b| vec![*b as f64]).collect()
    }
    fn is_linear(&self) -> bool {
        false
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        self.regressors_at(recording, shape, &[])
    }
    fn regressors_at(
        &self,
        recording: &DrivetrainResiduals,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Regressor> {
        let body = shape[0] as usize;
        let [cosine, sine] = fourier_pair(recording, recording.signals.ratios[body]);
        let u = [cosine, sine, vec![1.0; recording.signals.len()]];
        let now = parameters.iter().find(|p| !p.is_empty());
        let about: Vec<f64> = (0..recording.signals.len())
            .map(|i| now.map_or(0.0, |p| p.iter().zip(&u).map(|(p, u)| p * u[i]).sum()))
            .collect();
        u.map(|u| Regressor::EncoderError {
            body,
            u,
            about: about.clone(),
        })
        .into()
    }
    /// A disc that errs once per turn errs twice as well, a little.
    fn own_nuisances(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let body = shape[0] as usize;
        let fourier_pair = fourier_pair(recording, 2.0 * recording.signals.ratios[body]);
        let error = |wave: Vec<f64>| Regressor::EncoderError {
            body,
            u: wave.iter().map(|w| TWICE_RAD * w).collect(),
            about: vec![0.0; wave.len()],
        };
        fourier_pair.map(error).into()
    }
    fn apply_to_machine(
        &self,
        recording: &DrivetrainResiduals,
        shape: &[f64],
        parameters: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let inertia = recording.signals.inertias.get(shape[0] as usize);
        let has_place = |e: &Encoder| Some(&e.inertia) == inertia && machine.index_turns_with(e);
        let Some(at) = machine.encoders.iter().position(has_place) else {
            return false;
        };
        let encoder = &mut machine.encoders[at];
        let [cosine, sine] = encoder.eccentricity.map_or([0.0; 2], |e| e.parts_from(0.0));
        let found = [cosine + parameters[0], sine + parameters[1]];
        encoder.eccentricity = Some(loadtwin_machine::Eccentricity::from_parts(found));
        true
    }
}
