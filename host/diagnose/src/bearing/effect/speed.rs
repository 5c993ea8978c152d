//! Strain that goes with the speed.

use crate::bearing::{BearingSession, Kind};
use crate::effect::{Effect, Linear};
use crate::taken::Readings;

/// Speed at which it is told [rad/s].
const SPEED: f64 = 100.0;

/// Part that must be left beside an offset that warms up, or that does the same.
const OWN: f64 = 0.1;

/// `b (w / 100 rad/s)^2` in the bulk strain of a gauge: what turns with the ring's warmth or
/// with centrifugal forces.
pub struct SpeedOffset;

impl Effect<BearingSession> for SpeedOffset {
    fn name(&self) -> &'static str {
        "speed-offset"
    }
    fn about(&self) -> &'static str {
        "the zero of a gauge moves with the square of the speed"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "strain at 100 rad/s [µm/m]",
            prior_std: 50.0,
        }]
    }
    fn grid(&self, session: &BearingSession) -> Vec<Vec<f64>> {
        let taken = &session.seen.taken;
        let column = column(session);
        let whole = taken.square(&column);
        let left = taken.square(&taken.left_of(column));
        if left > OWN * OWN * whole {
            vec![Vec::new()]
        } else {
            Vec::new()
        }
    }
    fn terms(&self, session: &BearingSession, _: &[f64]) -> Vec<Readings> {
        vec![column(session)]
    }
    fn experiment(&self) -> &'static str {
        "speeds well apart, each for less time than it takes to warm up"
    }
}

fn column(session: &BearingSession) -> Readings {
    let speed = &session.seen.recorded.course.speed;
    session.each(|kind, i| match (kind, session.seen.place(i)) {
        (Kind::Bulk(_), Some(_)) => (speed[i] / SPEED).powi(2),
        _ => 0.0,
    })
}
