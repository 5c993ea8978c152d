//! A cage that slips.

use crate::bearing::{BearingSession, Kind};
use crate::effect::{Effect, Linear};
use crate::taken::Readings;

/// A cage goes slower than rolling balls would take it by a part of its rate: each by its own.
pub struct CageSlip;

impl Effect<BearingSession> for CageSlip {
    fn name(&self) -> &'static str {
        "cage-slip"
    }
    fn about(&self) -> &'static str {
        "a cage lags behind rolling balls"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the cage's rate",
            prior_std: 0.03,
        }]
    }
    fn grid(&self, _: &BearingSession) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    fn terms(&self, session: &BearingSession, _: &[f64]) -> Vec<Readings> {
        let seen = &session.seen;
        vec![session.each(|kind, i| match (kind, seen.place(i)) {
            (Kind::Slip(row), Some(at)) => -seen.predicted[at].pace[row],
            _ => 0.0,
        })]
    }
    fn experiment(&self) -> &'static str {
        "the same loads with fresh grease, warm and cold"
    }
}
