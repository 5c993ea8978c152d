//! Converts the values of an encoder's column in a recording to values of its hardware counter,
//! where the column holds counts, an angle or travel, or a speed, which is integrated.

use std::f64::consts::TAU;

use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Encoder, Kind, Machine};
use loadtwin_recording::{Quantity, Unit};

/// What the column of an encoder holds.
#[derive(Clone, Copy)]
pub(super) enum Motion {
    /// Counts.
    Count,
    /// The angle or travel [rad, m].
    Angle { unit: Unit },
    /// The speed [rad/s], with the turns since the recording began: angles of rotors and wheel bearings have no zero.
    Speed { turns: f64 },
}

impl Motion {
    /// Unit of the column.
    pub(super) fn unit(self) -> Unit {
        match self {
            Self::Count => Unit::COUNTS,
            Self::Angle { unit } => unit,
            Self::Speed { .. } => Unit::RADIAN_PER_SECOND,
        }
    }

    /// Count of `encoder` after a row with `value`, `period_s` after the row before.
    pub(super) fn count(&mut self, value: f64, period_s: f64, encoder: &Encoder) -> u32 {
        let counter = encoder.counter();
        match self {
            Self::Count => counter.at_count(value),
            Self::Angle { .. } => counter.at_angle(value),
            Self::Speed { turns } => {
                *turns += value * period_s / TAU;
                counter.at_count(*turns * encoder.counts_per_turn)
            }
        }
    }
}

/// How the recording has each encoder: counts, an angle or travel, a speed.
pub(super) fn motions(
    machine: &Machine,
    sensors: &Sensors,
    quantity: impl Fn(&str) -> Option<Quantity>,
) -> Vec<Motion> {
    let turns_freely = matches!(machine.kind(), Some(Kind::Bearing(_) | Kind::Rotor(_)));
    // What the description says, as for all signals of a drive: a header may have no units.
    let travel = (machine.travel_unit())
        .map(Unit::quantity)
        .filter(|quantity| *quantity != Quantity::Counts);
    let motion = |quantity| match quantity {
        Some(Quantity::Angle) => Motion::Angle { unit: Unit::RADIAN },
        Some(Quantity::AngularSpeed) if turns_freely => Motion::Speed { turns: 0.0 },
        Some(Quantity::Length) => Motion::Angle { unit: Unit::METRE },
        _ => Motion::Count,
    };
    let encoders = sensors.encoders.iter();
    encoders
        .map(|encoder| motion(travel.or_else(|| quantity(&encoder.name))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_turns_the_counter_as_far_as_its_angle_would() {
        let encoder = Encoder {
            name: "wheel".into(),
            inertia: String::new(),
            counts_per_turn: 192.0,
            bits: 16,
            noise_std_counts: None,
            eccentricity: None,
        };
        let mut speed = Motion::Speed { turns: 0.0 };
        let mut angle = 0.0;
        for k in 0..200_000 {
            let rad_per_s = 60.0 + 40.0 * f64::sin(1e-3 * f64::from(k));
            angle += rad_per_s * 5e-4;
            let by_angle = Motion::Angle { unit: Unit::RADIAN }.count(angle, 5e-4, &encoder);
            let by_speed = speed.count(rad_per_s, 5e-4, &encoder);
            let apart = by_speed.wrapping_sub(by_angle) & 0xffff;
            assert!(
                matches!(apart, 0 | 1 | 0xffff),
                "{k}: {by_speed}, {by_angle}"
            );
        }
    }
}
