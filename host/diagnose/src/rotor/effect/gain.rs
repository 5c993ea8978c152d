//! A sensor that reads too much or too little.

use super::{RUN_UP, place, places};
use crate::effect::{Coupling, Effect, Linear, Shape};
use crate::rotor::{Readings, RotorPlace, RotorSession};

/// `g y` in one sensor.
pub struct GainError;

impl Effect<RotorSession> for GainError {
    fn name(&self) -> &'static str {
        "gain-error"
    }
    fn about(&self) -> &'static str {
        "a channel responds more or less than described"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the reading",
            prior_std: 0.1,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        const PLACE: &[Shape] = &[place("channel", "from 0")];
        PLACE
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        places(session.channels().len())
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        let channel = shape[0] as usize;
        vec![session.each(|k, i| {
            if k == channel {
                session.explained(k)[i]
            } else {
                0.0
            }
        })]
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        Some(session.channels()[shape[0] as usize].name.clone())
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], place: &mut RotorPlace) -> bool {
        if let Some(channel) = place.machine.channels.get_mut(shape[0] as usize) {
            let sensitivity = channel.sensitivity.unwrap_or(1.0);
            channel.sensitivity = Some(sensitivity * (1.0 + parameters[0]));
        }
        true
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}
