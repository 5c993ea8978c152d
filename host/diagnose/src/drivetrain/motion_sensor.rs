//! Sensors from which the motion of the inertias is read: encoders, or without any the channels that
//! sense a speed, whose integral takes the place of an angle.

use loadtwin_machine::{Channel, Machine};

/// Name of the inertia that each sensor of the motion turns with.
pub(crate) fn moved_inertias(machine: &Machine) -> Vec<&str> {
    if machine.encoders.is_empty() {
        let speeds = machine.channels.iter().filter_map(Channel::speed_of);
        speeds.collect()
    } else {
        let encoders = machine.encoders.iter();
        encoders.map(|encoder| encoder.inertia.as_str()).collect()
    }
}

/// Angle of each inertia whose speed a channel senses, referred, from 0: the integral of the speed.
/// `readings` of all channels (SI), `dt_s` (s) apart; where one is missing the speed stays.
pub(crate) fn integrated_speeds(
    machine: &Machine,
    readings: &[Vec<f64>],
    dt_s: f64,
) -> Vec<Vec<f64>> {
    let ratio = |name: &str| {
        let inertias = machine.drivetrain.iter().flat_map(|d| &d.inertias);
        let named = inertias.clone().find(|inertia| inertia.name == name);
        named.map_or(1.0, |inertia| inertia.speed_ratio)
    };
    let channels = machine.channels.iter().zip(readings);
    channels
        .filter_map(|(channel, readings)| {
            let sensitivity = channel.sensitivity_si() * ratio(channel.speed_of()?);
            let offset = channel.to_si(channel.offset);
            let speeds = readings.iter().map(|y| (y - offset) / sensitivity);
            Some(integrated(speeds, dt_s))
        })
        .collect()
}

/// Trapezoidal integral from 0.
fn integrated(speeds: impl Iterator<Item = f64>, dt_s: f64) -> Vec<f64> {
    let (mut angle, mut last) = (0.0, None);
    speeds
        .map(|speed| {
            let before = last.unwrap_or(speed);
            let now = if speed.is_finite() { speed } else { before };
            if before.is_finite() {
                angle += 0.5 * (before + now) * dt_s;
            }
            last = now.is_finite().then_some(now);
            angle
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::integrated;

    #[test]
    fn a_missing_speed_stays_as_it_was() {
        let speeds = [f64::NAN, 2.0, 4.0, f64::NAN, 4.0];
        let angle = integrated(speeds.into_iter(), 0.5);
        assert_eq!(angle, [0.0, 1.0, 2.5, 4.5, 6.5]);
    }
}
