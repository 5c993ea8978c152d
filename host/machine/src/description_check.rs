//! Checks a whole machine description after it is read: ranges of fields, and names that refer to
//! other parts of it. Gives the first field that is not allowed, as a `Violation`.

use std::collections::HashSet;

use loadtwin_recording::{Quantity, RATES_HZ, Unit};

use super::error::Violation;
use super::field_checks::{
    Checked, at_least, at_most, finite, names, nonzero, one_of, positive, range, refuse, within,
};
use super::{
    Bearing, Channel, Drivetrain, Hysteresis, Kind, LATEST_S, Machine, SLOWEST_S, Senses,
    UNKNOWN_LOAD,
};
use crate::adc::extreme_words;

/// Most channels of one sensor set.
const MAX_CHANNELS: usize = loadtwin_common::io::raw::MAX_CHANNELS;

/// Most encoders of one sensor set.
const MAX_ENCODERS: usize = loadtwin_common::io::raw::MAX_ENCODERS;

impl Machine {
    /// Checks every range and every name that refers to another part.
    ///
    /// # Errors
    /// The first field that is not allowed.
    pub fn check(&self) -> Result<(), Violation> {
        within("format", self.format, self.format == 1, "1")?;
        within("name", &self.name, !self.name.trim().is_empty(), "a name")?;
        range("rate_hz", self.rate_hz, *RATES_HZ.start(), *RATES_HZ.end())?;
        within(
            "can_base",
            self.can_base,
            self.can_base <= 0x7c0 && self.can_base.is_multiple_of(32),
            "a multiple of 32, 0 to 0x7c0",
        )?;
        range("tuning.parameter_std", self.tuning.parameter_std, 0.0, 1.0)?;
        positive("tuning.cutoff_hz", self.tuning.cutoff_hz)?;
        at_least("tuning.gate_nis", self.tuning.gate_nis, 1.0)?;
        if let Some(balance) = &self.balance {
            within(
                "balance",
                "another kind of machine beside it",
                matches!(self.kind(), Some(Kind::Drive(_))),
                "one table that says what kind of machine it is",
            )?;
            balance.check()?;
            self.check_drive_references()?;
            self.check_counts()?;
            return self.check_segments();
        }
        self.check_names()?;
        match self.kind() {
            Some(Kind::Drivetrain(drivetrain)) => {
                drivetrain.check()?;
                self.check_channels(drivetrain)?;
                self.check_encoders(drivetrain)?;
            }
            Some(Kind::Rotor(rotor)) => {
                rotor.check()?;
                self.check_rotor_sensors(rotor)?;
            }
            Some(Kind::Bearing(bearing)) => {
                bearing.check()?;
                self.check_outer_ring(bearing)?;
            }
            Some(Kind::Drive(_)) | None => {
                return refuse(
                    "drivetrain",
                    "nothing",
                    "a table that describes the machine",
                );
            }
        }
        if self.drivetrain.as_ref().is_none_or(|d| d.bending.is_none()) {
            for (i, channel) in self.channels.iter().enumerate() {
                let field = format!("channel[{}].bending", i + 1);
                let allowed = "0, or a [drivetrain] with `bending`";
                within(&field, channel.bending, channel.bending == 0.0, allowed)?;
            }
        }
        if self.drivetrain.is_none() {
            for channel in &self.channels {
                let field = format!("channel {:?}", channel.name);
                let straight = channel.nonlinearity == 0.0
                    && channel.creep.is_none()
                    && channel.hysteresis.is_none()
                    && channel.thermal.is_none()
                    && channel.late_s == 0.0;
                let found = "nonlinearity, creep, hysteresis, thermal or late_s";
                within(&field, found, straight, "these only on a drivetrain")?;
            }
        }
        self.check_references()?;
        self.check_counts()?;
        self.check_sets()?;
        self.check_thermometer()?;
        self.check_segments()
    }

    fn check_segments(&self) -> Checked {
        for (i, segment) in self.segments.iter().enumerate() {
            let field = format!("segment[{}]", i + 1);
            finite(&format!("{field}.from_s"), segment.from_s)?;
            if let Some(to_s) = segment.to_s {
                let allowed = format!("> from_s = {}", segment.from_s);
                within(
                    &format!("{field}.to_s"),
                    to_s,
                    to_s > segment.from_s,
                    &allowed,
                )?;
            }
        }
        Ok(())
    }

    fn check_thermometer(&self) -> Checked {
        for (i, auxiliary) in self.auxiliaries.iter().enumerate() {
            let field = |name: &str| format!("auxiliary[{}].{name}", i + 1);
            range(&field("lag_s"), auxiliary.lag_s, 0.0, SLOWEST_S)?;
            if let Some(at_zero) = auxiliary.at_zero {
                finite(&field("at_zero"), at_zero)?;
            }
            if let Some(sampled) = auxiliary.sampled() {
                let known = auxiliary.is_temperature();
                within(
                    &field("adc"),
                    "one",
                    known,
                    "nothing: this is no temperature",
                )?;
                check_reading(&field, &sampled)?;
            }
        }
        let sampled = self.thermometer().is_some_and(|t| t.adc.is_some());
        for (i, channel) in self.channels.iter().enumerate() {
            let without = channel.thermal.is_none();
            let allowed = "it only beside an [[auxiliary]] of a temperature with `adc`";
            within(
                &format!("channel[{}].thermal", i + 1),
                "one",
                without || sampled,
                allowed,
            )?;
        }
        Ok(())
    }

    fn check_names(&self) -> Checked {
        let mut names = HashSet::from(["t"]);
        let columns = (self
            .channels
            .iter()
            .map(|c| &c.name)
            .enumerate()
            .map(|n| ("channel", n)))
        .chain(
            self.encoders
                .iter()
                .map(|e| &e.name)
                .enumerate()
                .map(|n| ("encoder", n)),
        )
        .chain(
            self.references
                .iter()
                .map(|r| &r.name)
                .enumerate()
                .map(|n| ("reference", n)),
        )
        .chain(
            self.auxiliaries
                .iter()
                .map(|a| &a.name)
                .enumerate()
                .map(|n| ("auxiliary", n)),
        );
        for (table, (i, name)) in columns {
            let field = format!("{table}[{}].name", i + 1);
            within(&field, name, !name.trim().is_empty(), "a name")?;
            within(
                &field,
                name,
                names.insert(name),
                "a name that no other column has",
            )?;
        }
        if let Some(index) = &self.index {
            let fresh = names.insert(&index.name);
            within(
                "index.name",
                &index.name,
                fresh,
                "a name that no other column has",
            )?;
        }
        Ok(())
    }

    fn check_channels(&self, drivetrain: &Drivetrain) -> Checked {
        for (i, channel) in self.channels.iter().enumerate() {
            let field = |name: &str| format!("channel[{}].{name}", i + 1);
            let (kind, name, allowed) = match &channel.senses {
                Senses::Shaft(name) => ("shaft", name, names(&drivetrain.shafts, |s| &s.name)),
                Senses::Load(name) => ("load", name, names(&drivetrain.loads, |l| &l.name)),
                Senses::Speed(name) => ("speed", name, names(&drivetrain.inertias, |j| &j.name)),
                Senses::Drive(name) => ("drive", name, names(&drivetrain.inertias, |j| &j.name)),
                Senses::Displacement(_) | Senses::OuterRing(_) | Senses::Temperature => {
                    return refuse(
                        &field("senses"),
                        "a quantity of another kind of machine",
                        "shaft, load, speed, drive",
                    );
                }
            };
            one_of(&field(&format!("senses.{kind}")), name, &allowed)?;
            match (channel.sensitivity, &channel.sensitivity_map) {
                (Some(_), Some(_)) => {
                    refuse(
                        &field("sensitivity_map"),
                        "both",
                        "either sensitivity or sensitivity_map",
                    )?;
                }
                (Some(sensitivity), None) => nonzero(&field("sensitivity"), sensitivity)?,
                (None, Some(_)) => {}
                (None, None) => check_unit_sensitivity(&field("sensitivity"), channel)?,
            }
            self.check_homed(&field("sensitivity_map"), channel.sensitivity_map.is_some())?;
            self.check_homed(&field("noise_map"), channel.noise_map.is_some())?;
            if let Some(place) = &channel.place {
                for x in place.position_m {
                    finite(&field("place.position_m"), x)?;
                }
                let length = place.direction.iter().map(|x| x * x).sum::<f64>();
                positive(&field("place.direction (its length)"), length)?;
                positive(&field("place.patch_m"), place.patch_m)?;
            }
            check_reading(&field, channel)?;
        }
        Ok(())
    }

    /// A map needs an angle that is the same after each start.
    fn check_homed(&self, field: &str, has_map: bool) -> Checked {
        if has_map && self.index.is_none() {
            let allowed = "a constant, or a table [index]: without the pulse the angle begins anywhere \
                           at each start, and the map's phase is lost";
            return refuse(field, "a map over an angle that nothing homes", allowed);
        }
        Ok(())
    }

    /// One channel for each gauge, in the order of the gauges, and the wheel's encoder.
    fn check_outer_ring(&self, bearing: &Bearing) -> Checked {
        for (i, channel) in self.channels.iter().enumerate() {
            let field = |name: &str| format!("channel[{}].{name}", i + 1);
            let gauge = bearing.gauges.get(i).map_or("", |g| &g.name);
            let senses = match &channel.senses {
                Senses::OuterRing(name) => name.as_str(),
                _ => "another kind of quantity",
            };
            let allowed = match gauge {
                "" => "4 channels, one for each gauge".to_owned(),
                name => format!("outer_ring = {name:?}: channels in the order of the gauges"),
            };
            within(&field("senses"), senses, senses == gauge, &allowed)?;
            within(
                &field("unit"),
                channel.unit,
                channel.unit.quantity() == Quantity::Strain,
                "a unit of strain",
            )?;
            check_reading(&field, channel)?;
        }
        let channels = self.channels.len();
        within(
            "channel",
            channels,
            channels == bearing.gauges.len(),
            "4 tables, one for each gauge",
        )?;
        let encoders = self.encoders.len();
        within("encoder", encoders, encoders == 1, "1 table, the wheel's")?;
        for encoder in &self.encoders {
            one_of("encoder[1].inertia", &encoder.inertia, &["wheel"])?;
            encoder.check(|name| format!("encoder[1].{name}"), false)?;
        }
        Ok(())
    }

    fn check_encoders(&self, drivetrain: &Drivetrain) -> Checked {
        let inertias = names(&drivetrain.inertias, |j| &j.name);
        for (i, encoder) in self.encoders.iter().enumerate() {
            let field = |name: &str| format!("encoder[{}].{name}", i + 1);
            one_of(&field("inertia"), &encoder.inertia, &inertias)?;
            encoder.check(field, self.index_turns_with(encoder))?;
        }
        if let Some(index) = &self.index {
            if !self.encoders.is_empty() {
                let encoders = names(&self.encoders, |e| &e.name);
                one_of("index.encoder", &index.encoder, &encoders)?;
            }
            index.check()?;
        }
        Ok(())
    }

    fn check_references(&self) -> Checked {
        let loads: Vec<_> = self.loads().iter().map(|l| l.name).collect();
        for (i, reference) in self.references.iter().enumerate() {
            let field = |name: &str| format!("reference[{}].{name}", i + 1);
            one_of(&field("load"), &reference.load, &loads)?;
            nonzero(&field("gain"), reference.gain)?;
            finite(&field("zero"), reference.zero)?;
            torque_or_counts(&field("unit"), reference.unit)?;
        }
        Ok(())
    }

    /// References of a drive's unknown load, in any unit.
    fn check_drive_references(&self) -> Checked {
        for (i, reference) in self.references.iter().enumerate() {
            let field = |name: &str| format!("reference[{}].{name}", i + 1);
            one_of(&field("load"), &reference.load, &[UNKNOWN_LOAD])?;
            nonzero(&field("gain"), reference.gain)?;
            finite(&field("zero"), reference.zero)?;
        }
        Ok(())
    }

    fn check_sets(&self) -> Checked {
        let channels = names(&self.channels, |c| &c.name);
        let encoders = names(&self.encoders, |e| &e.name);
        let loads: Vec<_> = self.loads().iter().map(|l| l.name).collect();
        for (i, set) in self.sensor_sets.iter().enumerate() {
            let field = |name: &str| format!("sensor_set[{}].{name}", i + 1);
            let first = self
                .sensor_sets
                .iter()
                .position(|other| other.name == set.name)
                == Some(i);
            within(
                &field("name"),
                &set.name,
                first,
                "a name that no other set has",
            )?;
            for (name, walk) in &set.walk_nm_per_sqrt_s {
                one_of(&field("walk_nm_per_sqrt_s"), name, &loads)?;
                positive(&field("walk_nm_per_sqrt_s"), *walk)?;
            }
            for name in &set.channels {
                one_of(&field("channels"), name, &channels)?;
            }
            for name in set.encoders.iter().flatten() {
                one_of(&field("encoders"), name, &encoders)?;
            }
            at_most(&field("channels"), set.channels.len(), MAX_CHANNELS)?;
            at_most(
                &field("encoders"),
                set.encoders.as_ref().map_or(0, Vec::len),
                MAX_ENCODERS,
            )?;
        }
        Ok(())
    }
}

/// Without a sensitivity a channel reads what it senses, 1 unit in 1 unit. A gauge that `reduce` or
/// `calibrate` gives a map later needs none before.
fn check_unit_sensitivity(field: &str, channel: &Channel) -> Checked {
    let (sensed, of) = match channel.senses {
        Senses::Speed(_) => (Quantity::AngularSpeed, "rad/s"),
        _ => (Quantity::Torque, "Nm"),
    };
    let is_made_later = channel.place.is_some() || channel.patch_map.is_some();
    let allowed = format!("a number [{}/{of}], or sensitivity_map", channel.unit);
    within(
        field,
        "none",
        channel.unit.quantity() == sensed || is_made_later,
        &allowed,
    )
}

/// What holds for a channel whatever it senses.
fn check_reading(field: &dyn Fn(&str) -> String, channel: &Channel) -> Checked {
    finite(&field("offset"), channel.offset)?;
    finite(&field("bending"), channel.bending)?;
    positive(&field("noise_std"), channel.noise_std)?;
    within(
        &field("runout"),
        "one",
        channel.runout.is_empty(),
        "nothing: this is no displacement of a rotor",
    )?;
    if let Some(drift) = &channel.drift {
        positive(&field("drift.std"), drift.std)?;
        positive(&field("drift.time_s"), drift.time_s)?;
    }
    let most = Channel::MOST_NONLINEARITY;
    range(&field("nonlinearity"), channel.nonlinearity, -most, most)?;
    range(&field("late_s"), channel.late_s, 0.0, LATEST_S)?;
    if let Some(thermal) = &channel.thermal {
        finite(&field("thermal.zero_per_k"), thermal.zero_per_k)?;
        finite(&field("thermal.gain_per_k"), thermal.gain_per_k)?;
    }
    if let Some(creep) = &channel.creep {
        finite(&field("creep.at_nominal"), creep.at_nominal)?;
        positive(&field("creep.time_s"), creep.time_s)?;
    }
    if let Some(hysteresis) = &channel.hysteresis {
        finite(&field("hysteresis.half_width"), hysteresis.half_width)?;
        let [least, most] = Hysteresis::LEVELS;
        range(&field("hysteresis.level"), hysteresis.level, least, most)?;
    }
    if channel.bridge.is_some() {
        let strain = channel.unit.quantity() == Quantity::Strain;
        within(
            &field("unit"),
            channel.unit,
            strain,
            "a unit of strain, as there is a bridge",
        )?;
    }
    let Some(adc) = &channel.adc else {
        let allowed = "a converter, of whose words the bridge's output is made";
        return within(&field("adc"), "nothing", channel.bridge.is_none(), allowed);
    };
    if let Some(excitation_v) = adc.excitation_v {
        within(
            &field("adc.excitation_v"),
            excitation_v,
            channel.bridge.is_some(),
            "with a `bridge`; `per_volt` of another sensor",
        )?;
    }
    nonzero(&field("adc.lsb"), adc.lsb)?;
    let bits = adc.bits;
    within(
        &field("adc.bits"),
        bits,
        (8..=32).contains(&bits),
        "8 to 32",
    )?;
    let [lowest, highest] = extreme_words(bits);
    within(
        &field("adc.zero"),
        adc.zero,
        (lowest..=highest).contains(&adc.zero),
        "a word of so many bits",
    )
}

fn torque_or_counts(field: &str, unit: Unit) -> Checked {
    let is = matches!(
        unit.quantity(),
        Quantity::Torque | Quantity::Force | Quantity::Counts
    );
    within(field, unit, is, "a unit of torque or force, or counts")
}
