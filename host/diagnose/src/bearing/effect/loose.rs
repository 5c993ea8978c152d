//! A gauge that comes loose, or dies.

use loadtwin_common::bearing::GAUGES;

use crate::bearing::{BearingSession, Kind};
use crate::effect::{Coupling, Effect, Linear, Shape};
use crate::taken::Readings;

/// Moments that are tried first.
const MOMENTS: usize = 16;

/// From a moment on a gauge answers less by a part, all of it where it is dead, and its zero jumps.
pub struct LooseGauge;

impl Effect<BearingSession> for LooseGauge {
    fn name(&self) -> &'static str {
        "loose-gauge"
    }
    fn about(&self) -> &'static str {
        "a gauge answers less from a moment on; a part of 1 is a dead one"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "part of the answer that is lost",
                prior_std: 0.5,
            },
            Linear {
                name: "jump of the zero [µm/m]",
                prior_std: 30.0,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            Shape {
                name: "gauge",
                unit: "from 0",
                bounds: (0.0, f64::INFINITY),
                step: 0.0,
                logarithmic: false,
            },
            Shape {
                name: "moment",
                unit: "s",
                bounds: (0.0, f64::INFINITY),
                step: 0.5,
                logarithmic: false,
            },
        ]
    }
    fn grid(&self, session: &BearingSession) -> Vec<Vec<f64>> {
        let last = session.t.last().copied().unwrap_or(0.0);
        let moment = move |k: usize| last * k as f64 / MOMENTS as f64;
        (0..GAUGES)
            .flat_map(|g| (0..MOMENTS).map(move |k| vec![g as f64, moment(k)]))
            .collect()
    }
    fn terms(&self, session: &BearingSession, shape: &[f64]) -> Vec<Readings> {
        let seen = &session.seen;
        let own = shape[0] as usize;
        let since = |i: usize| session.t[i] >= shape[1];
        let answer = session.each(|kind, i| {
            let answer = (seen.place(i).filter(|_| since(i))).and_then(|at| {
                let strain = &seen.predicted[at].strain[own];
                match kind {
                    Kind::Bulk(g) if g == own => Some(strain[0] - seen.calibration.gauge[g].offset),
                    Kind::Local(g) if g == own => seen.along(at, g, strain),
                    _ => None,
                }
            });
            -answer.unwrap_or(0.0)
        });
        let jump = session.each(|kind, i| f64::from(u8::from(kind == Kind::Bulk(own) && since(i))));
        vec![answer, jump]
    }
    fn place(&self, session: &BearingSession, shape: &[f64]) -> Option<String> {
        Some(session.seen.bearing.gauges[shape[0] as usize].name.clone())
    }
    fn experiment(&self) -> &'static str {
        "shunt calibration of the gauge, and the same loads again"
    }
}
