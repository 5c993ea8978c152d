//! A sensor that is off.

use crate::effect::{Coupling, Effect, Linear};
use crate::rotor::{Readings, RotorPlace, RotorSession};

/// `b`: a constant in each reading.
pub struct SensorBias;

impl Effect<RotorSession> for SensorBias {
    fn name(&self) -> &'static str {
        "sensor-bias"
    }
    fn about(&self) -> &'static str {
        "a sensor reads something where the shaft rests on its axis"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Own
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "offset [m]",
            prior_std: 1e-4,
        }]
    }
    fn grid(&self, _: &RotorSession) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    fn terms(&self, session: &RotorSession, _: &[f64]) -> Vec<Readings> {
        vec![session.each(|_, _| 1.0)]
    }
    /// A constant; but it may settle: a tenth of it, over half a recording, leaves so much.
    fn form(&self, _: &RotorSession) -> f64 {
        0.03
    }
    fn mend(&self, _: &[f64], parameters: &[f64], place: &mut RotorPlace) -> bool {
        if let Some(channel) = place.channel() {
            channel.offset += channel.unit.from_si(parameters[0]);
        }
        true
    }
    fn experiment(&self) -> &'static str {
        "the rotor at rest, then turning"
    }
}
