//! Ranges and references of a machine description.

use std::collections::HashSet;
use std::fmt::Display;

use crate::recording::{Quantity, Unit};

use super::error::Violation;
use super::{BEARING_LOADS, Balance, Bearing, Channel, Drivetrain, Kind, Machine, Regime, Senses};

pub(super) type Checked = Result<(), Violation>;

/// Channels and encoders of one sensor set.
const MAX_CHANNELS: usize = loadtwin_common::raw::MAX_CHANNELS;
const MAX_ENCODERS: usize = loadtwin_common::raw::MAX_ENCODERS;

impl Machine {
    /// Checks every range and every name that refers to another part.
    ///
    /// # Errors
    /// The first field that is not allowed.
    pub fn check(&self) -> Result<(), Violation> {
        within("format", self.format, self.format == 1, "1")?;
        within("name", &self.name, !self.name.trim().is_empty(), "a name")?;
        range("rate_hz", self.rate_hz, 1.0, 20_000.0)?;
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
                self.kind().is_none(),
                "one table that says what kind of machine it is",
            )?;
            return balance.check();
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
            None => {
                return refuse(
                    "drivetrain",
                    "nothing",
                    "a table that describes the machine",
                );
            }
        }
        self.check_references()?;
        self.check_sets()?;
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
                Senses::Displacement(_) | Senses::OuterRing(_) => {
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
                (None, _) => {}
            }
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
            nonzero("encoder[1].counts_per_turn", encoder.counts_per_turn)?;
            let bits = encoder.bits;
            within("encoder[1].bits", bits, (8..=32).contains(&bits), "8 to 32")?;
        }
        Ok(())
    }

    fn check_encoders(&self, drivetrain: &Drivetrain) -> Checked {
        let inertias = names(&drivetrain.inertias, |j| &j.name);
        for (i, encoder) in self.encoders.iter().enumerate() {
            let field = |name: &str| format!("encoder[{}].{name}", i + 1);
            one_of(&field("inertia"), &encoder.inertia, &inertias)?;
            nonzero(&field("counts_per_turn"), encoder.counts_per_turn)?;
            within(
                &field("bits"),
                encoder.bits,
                (8..=32).contains(&encoder.bits),
                "8 to 32",
            )?;
            if let Some(noise) = encoder.noise_std_counts {
                positive(&field("noise_std_counts"), noise)?;
            }
        }
        if let Some(index) = &self.index {
            if !self.encoders.is_empty() {
                let encoders = names(&self.encoders, |e| &e.name);
                one_of("index.encoder", &index.encoder, &encoders)?;
            }
            finite("index.angle_rad", index.angle_rad)?;
            positive("index.tolerance_rad", index.tolerance_rad)?;
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

impl Balance {
    fn check(&self) -> Checked {
        let mut names = HashSet::from(["t"]);
        for (key, signal) in self.signals() {
            let field = |name: &str| format!("balance.{key}.{name}");
            let fresh = names.insert(&signal.name);
            within(
                &field("name"),
                &signal.name,
                fresh && !signal.name.trim().is_empty(),
                "a name that no other column has",
            )?;
            nonzero(&field("gain"), signal.gain)?;
            finite(&field("zero"), signal.zero)?;
        }
        let (is, allowed) = match self.regime {
            Regime::Moving => (
                self.position.is_some() || self.speed.is_some(),
                "position or speed",
            ),
            Regime::Holding => (self.position.is_some(), "position"),
            Regime::Steady => (self.speed.is_some(), "speed"),
        };
        within("balance", "no such column", is, allowed)?;
        finite("balance.inertia", self.inertia)?;
        finite("balance.drag", self.drag)?;
        finite("balance.offset", self.offset)?;
        if let Some(turn) = self.turn {
            positive("balance.turn", turn)?;
        }
        for (i, effect) in self.effects.iter().enumerate() {
            let field = |name: &str| format!("balance.effect[{}].{name}", i + 1);
            let known: Vec<&str> = crate::balance::EFFECTS.iter().map(|e| e.name()).collect();
            one_of(&field("name"), &effect.name, &known)?;
            crate::balance::check_effect(effect, self.loads.len()).or_else(|(part, allowed)| {
                refuse(&field(part), "another number of values", &allowed)
            })?;
            for value in effect.shape.iter().chain(&effect.coefficients) {
                finite(&field("coefficients"), *value)?;
            }
        }
        Ok(())
    }
}

/// What holds for a channel whatever it senses.
fn check_reading(field: &dyn Fn(&str) -> String, channel: &Channel) -> Checked {
    finite(&field("offset"), channel.offset)?;
    positive(&field("noise_std"), channel.noise_std)?;
    if let Some(drift) = &channel.drift {
        positive(&field("drift.std"), drift.std)?;
        positive(&field("drift.time_s"), drift.time_s)?;
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
    nonzero(&field("adc.lsb"), channel.adc.lsb)?;
    let bits = channel.adc.bits;
    within(
        &field("adc.bits"),
        bits,
        (8..=32).contains(&bits),
        "8 to 32",
    )?;
    Ok(())
}

impl Bearing {
    fn check(&self) -> Checked {
        let field = |name: &str| format!("bearing.{name}");
        let balls = self.balls;
        within(&field("balls"), balls, (6..=40).contains(&balls), "6 to 40")?;
        positive(&field("ball_mm"), self.ball_mm)?;
        within(
            &field("pitch_mm"),
            self.pitch_mm,
            self.pitch_mm > self.ball_mm && self.pitch_mm.is_finite(),
            "more than ball_mm",
        )?;
        at_least(&field("rows_mm"), self.rows_mm, 0.0)?;
        range(
            &field("contact_angle_deg"),
            self.contact_angle_deg,
            5.0,
            60.0,
        )?;
        range(&field("conformity"), self.conformity, 0.505, 0.6)?;
        positive(
            &field("stiffness_n_per_mm_1_5"),
            self.stiffness_n_per_mm_1_5,
        )?;
        range(&field("preload_um"), self.preload_um, 0.0, 100.0)?;
        range(&field("row_coupling"), self.row_coupling, 0.0, 0.95)?;
        for (k, row) in self.compliance_um_per_kn.iter().enumerate() {
            for (l, value) in row.iter().enumerate() {
                let mirrored = self.compliance_um_per_kn[l][k];
                within(
                    &field("compliance_um_per_kn"),
                    value,
                    value.is_finite() && *value == mirrored,
                    "finite, and equal to its mirror in the diagonal",
                )?;
            }
        }
        for (name, [from, to]) in BEARING_LOADS.into_iter().zip(self.range.all()) {
            within(
                &format!("bearing.range.{}", name.to_lowercase()),
                format!("[{from}, {to}]"),
                from < to && from.is_finite() && to.is_finite(),
                "[smallest, largest]",
            )?;
        }
        let gauges = self.gauges.len();
        within(
            "bearing.gauge",
            gauges,
            gauges == loadtwin_common::bearing::GAUGES,
            "4 tables",
        )?;
        unique("bearing.gauge", &names(&self.gauges, |g| &g.name))?;
        for (i, gauge) in self.gauges.iter().enumerate() {
            let field = format!("bearing.gauge[{}].azimuth_deg", i + 1);
            range(&field, gauge.azimuth_deg, -360.0, 360.0)?;
        }
        let f = &self.filter;
        for (name, value) in [
            ("slip_std", f.slip_std),
            ("slip_time_s", f.slip_time_s),
            ("slip_limit", f.slip_limit),
            ("phase_walk", f.phase_walk),
            ("load_time_s", f.load_time_s),
            ("gain_std", f.gain_std),
            ("gain_time_s", f.gain_time_s),
            ("preload_std_um", f.preload_std_um),
            ("preload_walk_um", f.preload_walk_um),
            ("bias_std", f.bias_std),
            ("bias_time_s", f.bias_time_s),
            ("bulk_std", f.bulk_std),
            ("lowest_hz", f.lowest_hz),
        ] {
            positive(&format!("bearing.filter.{name}"), value)?;
        }
        Ok(())
    }
}

impl Drivetrain {
    fn check(&self) -> Checked {
        let n = self.inertias.len();
        within(
            "drivetrain.inertia",
            n,
            (1..=6).contains(&n),
            "1 to 6 tables",
        )?;
        let shafts = self.shafts.len();
        within(
            "drivetrain.shaft",
            shafts,
            shafts + 1 == n,
            &format!("{} tables, one fewer than inertias", n - 1),
        )?;
        let loads = self.loads.len();
        within(
            "drivetrain.load",
            loads,
            (1..=2).contains(&loads),
            "1 or 2 tables",
        )?;
        let inertias = names(&self.inertias, |j| &j.name);
        unique("drivetrain.inertia", &inertias)?;
        unique("drivetrain.shaft", &names(&self.shafts, |s| &s.name))?;
        unique("drivetrain.load", &names(&self.loads, |l| &l.name))?;
        for (i, inertia) in self.inertias.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.inertia[{}].{name}", i + 1);
            positive(&field("moment_kg_m2"), inertia.moment_kg_m2)?;
            nonzero(&field("speed_ratio"), inertia.speed_ratio)?;
            at_least(&field("drag_nm_s_per_rad"), inertia.drag_nm_s_per_rad, 0.0)?;
        }
        for (i, shaft) in self.shafts.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.shaft[{}].{name}", i + 1);
            positive(&field("stiffness_nm_per_rad"), shaft.stiffness_nm_per_rad)?;
            at_least(
                &field("damping_nm_s_per_rad"),
                shaft.damping_nm_s_per_rad,
                0.0,
            )?;
            nonzero(&field("speed_ratio"), shaft.speed_ratio)?;
        }
        for (i, load) in self.loads.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.load[{}].{name}", i + 1);
            one_of(&field("inertia"), &load.inertia, &inertias)?;
            positive(&field("nominal_nm"), load.nominal_nm)?;
            if let Some(walk) = load.walk_nm_per_sqrt_s {
                positive(&field("walk_nm_per_sqrt_s"), walk)?;
            }
            at_most(
                &field("name"),
                load.name.len(),
                loadtwin_common::image::MAX_NAME,
            )?;
        }
        positive("drivetrain.nominal_speed_rad_s", self.nominal_speed_rad_s)?;
        let carrier = self.carrier.as_deref().unwrap_or(inertias[0]);
        one_of("drivetrain.carrier", carrier, &inertias)?;
        let ratio = self
            .inertias
            .iter()
            .find(|j| j.name == carrier)
            .map_or(0.0, |j| j.speed_ratio);
        let allowed = "an inertia with speed_ratio 1, since strain maps are over its angle";
        within(
            "drivetrain.carrier",
            format!("speed_ratio {ratio}"),
            ratio == 1.0,
            allowed,
        )?;
        match (&self.gears, self.inertias.last()) {
            (Some(gears), Some(last)) => gears.check(last.speed_ratio),
            _ => Ok(()),
        }
    }
}

pub(super) fn names<T>(items: &[T], name: impl Fn(&T) -> &String) -> Vec<&str> {
    items.iter().map(|item| name(item).as_str()).collect()
}

pub(super) fn refuse(field: &str, found: impl Display, allowed: &str) -> Checked {
    Err(Violation {
        field: field.into(),
        found: found.to_string(),
        allowed: allowed.into(),
    })
}

pub(super) fn within(field: &str, found: impl Display, is: bool, allowed: &str) -> Checked {
    if is {
        Ok(())
    } else {
        refuse(field, found, allowed)
    }
}

pub(super) fn finite(field: &str, value: f64) -> Checked {
    within(field, value, value.is_finite(), "a finite number")
}

pub(super) fn positive(field: &str, value: f64) -> Checked {
    within(field, value, value > 0.0 && value.is_finite(), "> 0")
}

pub(super) fn nonzero(field: &str, value: f64) -> Checked {
    within(
        field,
        value,
        value != 0.0 && value.is_finite(),
        "a finite number other than 0",
    )
}

pub(super) fn at_least(field: &str, value: f64, least: f64) -> Checked {
    within(
        field,
        value,
        value >= least && value.is_finite(),
        &format!(">= {least}"),
    )
}

pub(super) fn at_most(field: &str, found: usize, most: usize) -> Checked {
    within(field, found, found <= most, &format!("at most {most}"))
}

pub(super) fn range(field: &str, value: f64, least: f64, most: f64) -> Checked {
    within(
        field,
        value,
        (least..=most).contains(&value),
        &format!("{least} to {most}"),
    )
}

pub(super) fn one_of(field: &str, name: &str, allowed: &[&str]) -> Checked {
    within(
        field,
        format!("{name:?}"),
        allowed.contains(&name),
        &listed(allowed),
    )
}

pub(super) fn unique(table: &str, names: &[&str]) -> Checked {
    for (i, name) in names.iter().enumerate() {
        let first = names[..i].iter().all(|other| other != name);
        within(
            &format!("{table}[{}].name", i + 1),
            name,
            first,
            "a name that no other one has",
        )?;
    }
    Ok(())
}

fn torque_or_counts(field: &str, unit: Unit) -> Checked {
    let is = matches!(
        unit.quantity(),
        Quantity::Torque | Quantity::Force | Quantity::Counts
    );
    within(field, unit, is, "a unit of torque or force, or counts")
}

pub(super) fn listed(names: &[&str]) -> String {
    if names.is_empty() {
        "nothing: there is none".into()
    } else {
        names.join(", ")
    }
}
