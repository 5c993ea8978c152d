//! Candidate effect, offset over speed: the bulk strain of a gauge changes with the square of the
//! speed.

use crate::bearing::{BearingResiduals, Kind};
use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::residual_model::SignalSet;

/// Speed at which it is reported [rad/s].
const SPEED: f64 = 100.0;

/// Part of the column, root of its square, that must remain beside an offset that warms up, or the
/// recording does not separate the two.
const OWN: f64 = 0.1;

/// `b (w / 100 rad/s)^2` in the bulk strain of a gauge: what turns with the ring's temperature rise or
/// with centrifugal forces.
pub struct SpeedOffset;

const INFO: EffectInfo = EffectInfo {
    name: "speed-offset",
    description: "the zero of a gauge moves with the square of the speed",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "strain at 100 rad/s [µm/m]",
        prior_std: 50.0,
    }],
    nonlinear: &[],
    recommended_experiment: "speeds well apart, each for less time than it takes to warm up",
};

impl Effect<BearingResiduals> for SpeedOffset {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &BearingResiduals) -> Vec<Vec<f64>> {
        let projection = &recording.context.projection;
        let column = column(recording);
        let whole = projection.square(&column);
        let left = projection.square(&projection.annihilate(column));
        if left > OWN * OWN * whole {
            vec![Vec::new()]
        } else {
            Vec::new()
        }
    }
    fn regressors(&self, recording: &BearingResiduals, _: &[f64]) -> Vec<SignalSet> {
        vec![column(recording)]
    }
}

fn column(recording: &BearingResiduals) -> SignalSet {
    let speed = &recording.context.recorded.course.speed;
    recording.each(|kind, i| match (kind, recording.context.place(i)) {
        (Kind::Bulk(_), Some(_)) => (speed[i] / SPEED).powi(2),
        _ => 0.0,
    })
}
