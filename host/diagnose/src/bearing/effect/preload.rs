//! A bearing that was set, or has worn, to another preload.

use crate::bearing::{BearingPlace, BearingSession, Kind};
use crate::effect::{Coupling, Effect, Linear};
use crate::taken::Readings;

/// Part of the preload by which it is varied where nothing is known of its change.
const SMALL: f64 = 0.1;

/// Most that is taken from it or added to it.
const MOST: f64 = 0.6;

/// What gauges and cages do with an approach that is larger by the part `q`, over `q`.
pub struct Preload;

impl Effect<BearingSession> for Preload {
    fn name(&self) -> &'static str {
        "preload"
    }
    fn about(&self) -> &'static str {
        "the rows are pressed together more or less than when calibrated"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the preload's approach",
            prior_std: 0.2,
        }]
    }
    fn grid(&self, _: &BearingSession) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    fn is_linear(&self) -> bool {
        false
    }
    fn terms(&self, session: &BearingSession, _: &[f64]) -> Vec<Readings> {
        vec![changed(session, SMALL)]
    }
    fn terms_about(
        &self,
        session: &BearingSession,
        _: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Readings> {
        let by = parameters.iter().flatten().next().copied().unwrap_or(0.0);
        let by = if by.abs() < SMALL { SMALL } else { by };
        vec![changed(session, by.clamp(-MOST, MOST))]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], place: &mut BearingPlace) -> bool {
        if let Some(bearing) = &mut place.bearing {
            bearing.preload_um *= 1.0 + parameters[0];
        }
        place.bearing.is_some()
    }
    fn experiment(&self) -> &'static str {
        "the same with moments of both signs, and a light load"
    }
}

/// What changes with the preload's approach by the part `by`, over that.
fn changed(session: &BearingSession, by: f64) -> Readings {
    let seen = &session.seen;
    let mut calibration = seen.calibration.clone();
    let preload = &mut calibration.physical.preload;
    *preload = (1.0 + *preload) * (1.0 + by) - 1.0;
    let Some(other) = seen.predicted_with(&calibration) else {
        return session.each(|_, _| 0.0);
    };
    session.each(|kind, i| {
        let difference = seen.place(i).and_then(|at| {
            let (is, was) = (&other[at], &seen.predicted[at]);
            let strain = |g: usize| std::array::from_fn(|k| is.strain[g][k] - was.strain[g][k]);
            match kind {
                Kind::Bulk(g) => Some(is.strain[g][0] - was.strain[g][0]),
                Kind::Local(g) => seen.along(at, g, &strain(g)),
                Kind::Slip(row) => Some(is.pace[row] - was.pace[row]),
            }
        });
        difference.unwrap_or(0.0) / by
    })
}
