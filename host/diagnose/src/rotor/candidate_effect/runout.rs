//! Candidate effect: runout (order 1) and lobes (orders 2 and 3) of the surface that displacement
//! sensors measure: of the same size at every speed.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::residual_model::SignalSet;
use crate::rotor::candidate_effect::{RUN_UP, location_grid, location_parameter};
use crate::rotor::{RotorResiduals, RotorTarget, displacement, nodes};

/// `a cos(k (angle - d)) + b sin(k (angle - d))` in the sensors at one node, along their
/// directions `d`, for each order `k`: of the same size at every speed.
pub struct SurfaceHarmonics {
    info: EffectInfo,
    /// The first of the orders, each with two amplitudes.
    first: u8,
}

/// Once a turn.
pub const RUNOUT: SurfaceHarmonics = SurfaceHarmonics {
    info: EffectInfo {
        name: "runout",
        description: "the surface that sensors look at is out of true",
        scope: Scope::Machine,
        linear: &[metres("cosine [m]", 5e-5), metres("sine [m]", 5e-5)],
        nonlinear: NODE,
        recommended_experiment: RUN_UP,
    },
    first: 1,
};

/// Two and three times a revolution: further waves of a surface, which no unbalance makes.
pub const SURFACE_LOBES: SurfaceHarmonics = SurfaceHarmonics {
    info: EffectInfo {
        name: "surface-lobes",
        description: "the surface that sensors look at is not round",
        scope: Scope::Machine,
        linear: &[
            metres("twice a turn, cosine [m]", 5e-6),
            metres("twice a turn, sine [m]", 5e-6),
            metres("three times a turn, cosine [m]", 5e-6),
            metres("three times a turn, sine [m]", 5e-6),
        ],
        nonlinear: NODE,
        recommended_experiment: RUN_UP,
    },
    first: 2,
};

const NODE: &[NonlinearParameter] = &[location_parameter("node", "of those with sensors")];

impl Effect<RotorResiduals> for SurfaceHarmonics {
    fn info(&self) -> &EffectInfo {
        &self.info
    }
    fn initial_values(&self, recording: &RotorResiduals) -> Vec<Vec<f64>> {
        location_grid(recording.nodes().len())
    }
    fn regressors(&self, recording: &RotorResiduals, shape: &[f64]) -> Vec<SignalSet> {
        let node = recording.nodes()[shape[0] as usize];
        let wave = |order: f64, of: fn(f64) -> f64| {
            recording.each(|k, i| match recording.place(k) {
                (at, direction) if at == node => {
                    of(order * (recording.turning().angle[i] - direction))
                }
                _ => 0.0,
            })
        };
        self.orders()
            .map(f64::from)
            .flat_map(|order| [wave(order, f64::cos), wave(order, f64::sin)])
            .collect()
    }
    fn location(&self, recording: &RotorResiduals, shape: &[f64]) -> Option<String> {
        Some(format!("node {}", recording.nodes()[shape[0] as usize]))
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], target: &mut RotorTarget) -> bool {
        let nodes = nodes(&target.machine.channels);
        for channel in &mut target.machine.channels {
            let (at, direction) = displacement(channel);
            if at != nodes[shape[0] as usize] {
                continue;
            }
            let unit = channel.unit;
            for (order, wave) in self.orders().zip(parameters.chunks_exact(2)) {
                // cos(k (angle - d)) = cos(k d) cos(k angle) + sin(k d) sin(k angle)
                let (sine, cosine) = (f64::from(order) * direction).sin_cos();
                let order = usize::from(order);
                if channel.runout.len() < order {
                    channel.runout.resize(order, [0.0; 2]);
                }
                channel.runout[order - 1][0] += unit.from_si(wave[0] * cosine - wave[1] * sine);
                channel.runout[order - 1][1] += unit.from_si(wave[0] * sine + wave[1] * cosine);
            }
        }
        !target.machine.encoders.is_empty()
    }
}

impl SurfaceHarmonics {
    fn orders(&self) -> impl Iterator<Item = u8> {
        (self.first..).take(self.info.linear.len() / 2)
    }
}

const fn metres(name: &'static str, prior_std: f64) -> LinearParameter {
    LinearParameter { name, prior_std }
}
