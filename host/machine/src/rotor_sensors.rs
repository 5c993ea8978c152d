//! Checks the sensors of a rotor's description: displacement channels (node, unit, range, runout),
//! shaft encoder, index pulse, and a sample rate above two samples a turn.

use loadtwin_common::rotor::WAVES;

use super::field_checks::{Checked, at_most, finite, nonzero, one_of, positive, refuse, within};
use super::{Channel, Machine, Rotor, Senses};
use loadtwin_recording::Quantity;

/// Largest standard deviation, of noise and of drift, and coarsest count of a sensor [m].
const COARSEST_M: f64 = 1e-3;

/// Longest range of a displacement sensor [m].
const LONGEST_RANGE_M: f64 = 0.1;

impl Machine {
    /// Displacements at nodes of `rotor`, and at most one encoder on its shaft.
    pub(super) fn check_rotor_sensors(&self, rotor: &Rotor) -> Checked {
        let turns_hz = rotor.schedule()[1] / std::f64::consts::TAU;
        within(
            "rate_hz",
            self.rate_hz,
            self.rate_hz > 2.0 * turns_hz,
            &format!("more than two samples a turn, {:.1}", 2.0 * turns_hz),
        )?;
        for (i, channel) in self.channels.iter().enumerate() {
            self.check_displacement(i, channel, rotor)?;
        }
        within(
            "channel",
            self.channels.len(),
            !self.channels.is_empty(),
            "at least 1 table",
        )?;
        at_most("encoder", self.encoders.len(), 1)?;
        for (i, encoder) in self.encoders.iter().enumerate() {
            let field = |name: &str| format!("encoder[{}].{name}", i + 1);
            within(
                &field("inertia"),
                &encoder.inertia,
                encoder.inertia.is_empty(),
                "nothing: a rotor has one shaft",
            )?;
            encoder.check(field, false)?;
        }
        if let Some(index) = &self.index {
            if let [encoder] = self.encoders.as_slice() {
                one_of("index.encoder", &index.encoder, &[&encoder.name])?;
            }
            index.check()?;
        }
        Ok(())
    }

    /// Channel `i` as a displacement at a node of `rotor`.
    fn check_displacement(&self, i: usize, channel: &Channel, rotor: &Rotor) -> Checked {
        let field = |name: &str| format!("channel[{}].{name}", i + 1);
        let Senses::Displacement(at) = &channel.senses else {
            return refuse(&field("senses"), "another quantity", "displacement");
        };
        rotor.check_node(&field("senses.displacement.node"), at.node)?;
        finite(
            &field("senses.displacement.direction_deg"),
            at.direction_deg,
        )?;
        let length = channel.unit.quantity() == Quantity::Length;
        within(
            &field("unit"),
            channel.unit,
            length,
            "a unit of length: m, mm, µm",
        )?;
        positive(&field("noise_std"), channel.noise_std)?;
        finite(&field("offset"), channel.offset)?;
        self.check_runout(&field("runout"), channel)?;
        if let Some(adc) = &channel.adc {
            nonzero(&field("adc.lsb"), adc.lsb)?;
            let allowed = (8..=32).contains(&adc.bits);
            within(&field("adc.bits"), adc.bits, allowed, "8 to 32")?;
        }
        if let Some(sensitivity) = channel.sensitivity {
            positive(&field("sensitivity"), sensitivity)?;
        }
        for (name, given) in [
            ("sensitivity_map", channel.sensitivity_map.is_some()),
            ("noise_map", channel.noise_map.is_some()),
            ("bridge", channel.bridge.is_some()),
        ] {
            within(&field(name), "one", !given, "nothing: this is a rotor")?;
        }
        check_range(channel, field)
    }

    /// Waves that an image has room for, about an angle that is known.
    fn check_runout(&self, field: &str, channel: &Channel) -> Checked {
        let waves = &channel.runout;
        within(
            field,
            format!("{} waves", waves.len()),
            waves.len() <= WAVES,
            &format!("at most {WAVES}"),
        )?;
        let allowed = waves.is_empty() || !self.encoders.is_empty();
        within(
            field,
            "one",
            allowed,
            "nothing where no encoder is described",
        )?;
        let small = |part: &f64| channel.to_si(part.abs()) <= COARSEST_M;
        within(
            field,
            format!("{waves:?} {}", channel.unit),
            waves.iter().flatten().all(small),
            "at most 1 mm: is it in another unit than `unit`?",
        )
    }
}

/// Drift, noise and range of a channel: a value in mm under the unit m is too large by a thousand.
fn check_range(channel: &Channel, field: impl Fn(&str) -> String) -> Checked {
    if let Some(drift) = &channel.drift {
        within(
            &field("drift.std"),
            format!("{} {}", drift.std, channel.unit),
            channel.to_si(drift.std) <= COARSEST_M,
            "at most 1 mm: is it in another unit than `unit`?",
        )?;
    }
    let noise_m = channel.to_si(channel.noise_std);
    let unit = channel.unit;
    within(
        &field("noise_std"),
        format!("{} {unit}", channel.noise_std),
        noise_m <= COARSEST_M,
        "at most 1 mm: is it in another unit than `unit`?",
    )?;
    let Some(adc) = &channel.adc else {
        return Ok(());
    };
    let count_m = channel.to_si(adc.lsb).abs();
    let range_m = count_m * 2.0_f64.powi(adc.bits as i32 - 1);
    within(
        &field("adc.lsb"),
        format!("{} {unit}, a range of {range_m} m", adc.lsb),
        count_m <= COARSEST_M && range_m <= LONGEST_RANGE_M,
        "a range of at most 0.1 m: is it in another unit than `unit`?",
    )
}
