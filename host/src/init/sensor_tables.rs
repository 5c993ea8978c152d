//! Writes the tables of sensors of a drivetrain, rotor or bearing into a draft description:
//! channels with their converters, encoders with counts per turn by the index pulse, references and
//! temperatures, from the columns of the recording.

use loadtwin_machine::six_digits;
use loadtwin_recording::{Quantity, Unit};

use super::Source;
use super::column_kind::{ClassifiedColumn, ColumnKind};
use super::toml_text::{Text, in_toml, number, quoted, rounded_up};

/// Counts of an encoder until its own are filled in.
pub(super) const COUNTS_PER_TURN: f64 = 4096.0;

/// Counts that an angle is read as, until the board's encoder is filled in.
const ANGLE_COUNTS: f64 = 65_536.0;

/// Words of a converter in the noise, where values show no step.
const WORDS_OF_NOISE: f64 = 16.0;

/// Width of converters, most of them first (bit).
const BITS: [u32; 2] = [24, 32];

/// Part by which distances from pulse to pulse differ at most from a turn.
const SAME_TURN: f64 = 0.02;

/// Part of a turn within which a latched count is behind the encoder's.
const NEAR: f64 = 0.25;

/// Pulses that show a turn.
const PULSES: usize = 3;

impl ClassifiedColumn {
    /// The unit in which a description states the column.
    pub(super) fn described_unit(&self) -> Unit {
        match self.kind {
            ColumnKind::BridgeRatio | ColumnKind::Words => "µm/m".parse().unwrap_or(self.unit),
            _ => self.unit,
        }
    }

    /// Half the range of its values.
    pub(super) fn half_range(&self) -> f64 {
        self.statistics
            .as_ref()
            .map_or(1.0, |s| 0.5 * (s.most - s.least))
    }

    /// The largest size of its values.
    pub(super) fn largest(&self) -> f64 {
        self.statistics
            .as_ref()
            .map_or(1.0, |s| s.most.abs().max(s.least.abs()))
    }

    /// White noise of its values, above 0.
    pub(super) fn noise_std(&self) -> f64 {
        let noise = self.statistics.as_ref().map_or(0.0, |s| s.noise_std);
        let least = 1e-6 * self.largest();
        if noise > least {
            noise
        } else if least > 0.0 {
            least
        } else {
            1.0
        }
    }
}

impl Source<'_> {
    /// An encoder; `inertia`: where it is, on a drivetrain.
    pub(super) fn encoder(
        &self,
        text: &mut Text,
        column: &ClassifiedColumn,
        inertia: Option<&str>,
    ) {
        text.table("[[encoder]]");
        text.set("name", quoted(&column.name));
        match inertia {
            Some("wheel") => text.set("inertia", "\"wheel\""),
            Some(inertia) => {
                text.fill_in("inertia", quoted(inertia), "the inertia that it turns with");
            }
            None => {}
        }
        let found = self.homed(column).map(|turn| number(turn.round()));
        if found.is_some() {
            text.comment("From pulse to pulse of the index.");
        }
        let (counts, what) = if column.kind == ColumnKind::Counts {
            (
                COUNTS_PER_TURN,
                "lines per turn times four; negative where it counts down in forward turning",
            )
        } else {
            (ANGLE_COUNTS, "counts per turn of the board's encoder")
        };
        text.set_or_fill_in("counts_per_turn", found, number(counts), what);
        let found = column
            .statistics
            .as_ref()
            .filter(|_| column.kind == ColumnKind::Counts);
        match found.map(|found| found.wraps_at_bits) {
            Some(Some(bits)) => text.set("bits", bits),
            Some(None) => text.comment("No wrap in this recording; `bits` is the width of a counter that wraps, 32 without."),
            None => {}
        }
    }

    /// The index pulse.
    pub(super) fn index(&self, text: &mut Text, encoders: &[&ClassifiedColumn]) {
        let Some(index) = self.of_kind(&[ColumnKind::Index]).first().copied() else {
            return;
        };
        text.table("[index]");
        text.set("name", quoted(&index.name));
        let homed = encoders
            .iter()
            .find(|encoder| self.homed(encoder).is_some());
        let encoder = homed
            .or(encoders.first())
            .map_or("\"\"".into(), |encoder| quoted(&encoder.name));
        text.set_or_fill_in(
            "encoder",
            homed.map(|encoder| quoted(&encoder.name)),
            encoder,
            "the encoder whose count the pulse latches",
        );
        text.fill_in("angle_rad", "0", "the carrier angle at the pulse (rad)");
    }

    /// Counts of the encoder from pulse to pulse, where they are the same.
    fn homed(&self, encoder: &ClassifiedColumn) -> Option<f64> {
        let index = self.of_kind(&[ColumnKind::Index]).first().copied()?;
        let found = encoder
            .statistics
            .as_ref()
            .filter(|_| encoder.kind == ColumnKind::Counts)?;
        let modulus = found.wraps_at_bits.map(|bits| f64::from(bits).exp2());
        let apart = |from: f64, to: f64| match modulus {
            Some(modulus) => (to - from) - ((to - from) / modulus).round() * modulus,
            None => to - from,
        };
        let pulses = pulses(index, encoder, apart)?;
        let mut turns: Vec<f64> = pulses
            .windows(2)
            .map(|pair| apart(pair[0].0, pair[1].0).abs())
            .filter(|turn| *turn > 1.0)
            .collect();
        turns.sort_unstable_by(f64::total_cmp);
        let middle = *turns.get(turns.len() / 2)?;
        let same = turns
            .iter()
            .filter(|turn| (*turn / middle - 1.0).abs() < SAME_TURN)
            .count();
        // Counts of another encoder are anywhere beside the present one.
        let near = pulses
            .iter()
            .filter(|(_, behind)| behind.abs() < NEAR * middle);
        if 4 * near.count() < 3 * pulses.len() {
            return None;
        }
        // A turn at standstill or a lost pulse is another distance.
        (turns.len() + 1 >= PULSES && 4 * same >= 3 * turns.len()).then_some(middle)
    }

    /// Temperatures.
    pub(super) fn auxiliaries(&self, text: &mut Text) {
        for column in self.of_kind(&[ColumnKind::Temperature]) {
            text.table("[[auxiliary]]");
            text.set("name", quoted(&column.name));
            let unit = column.unit.quantity() == Quantity::Temperature;
            let unit = unit.then(|| quoted(column.unit.symbol()));
            text.set_or_fill_in(
                "unit",
                unit,
                quoted(column.unit.symbol()),
                "the unit of the temperature",
            );
        }
    }
}

/// A channel that senses `senses`; `sensitivity`: that until it is filled in, and of what.
pub(super) fn channel(
    text: &mut Text,
    column: &ClassifiedColumn,
    senses: (&str, Option<&str>),
    sensitivity: Option<(f64, &str)>,
) {
    text.table("[[channel]]");
    text.set("name", quoted(&column.name));
    let unit = column.described_unit();
    text.set("unit", quoted(unit.symbol()));
    match senses {
        (senses, Some(what)) => text.fill_in("senses", senses, what),
        (senses, None) => text.set("senses", senses),
    }
    if let Some((sensitivity, per)) = sensitivity {
        text.fill_in(
            "sensitivity",
            number(sensitivity),
            format_args!("{unit} per {per}, with its sign"),
        );
    }
    // Words and ratios become strains only by the bridge.
    let is_reading = unit == column.unit;
    let noise = if is_reading { column.noise_std() } else { 1.0 };
    let what = if is_reading {
        "what the model lacks as well; this is the white noise of the column alone"
    } else {
        "the standard deviation of the reading"
    };
    text.fill_in("noise_std", number(noise), what);
    converter(text, column);
    if column.kind == ColumnKind::BridgeRatio {
        text.fill_in(
            "bridge",
            "{ bridge = \"full-1\", gauge_factor = 2, gauge_resistance_ohm = 350, tension_reads = \"positive\" }",
            "type and gauge factor of the bridge",
        );
    }
}

fn converter(text: &mut Text, column: &ClassifiedColumn) {
    let entry =
        |lsb: f64, bits: u32| format!("{{ lsb = {}, bits = {bits} }}", in_toml(six_digits(lsb)));
    if column.kind == ColumnKind::Words {
        text.fill_in(
            "adc",
            entry(1.0, 32),
            "the value of one word, and the word at zero (`zero`)",
        );
        return;
    }
    let mut step = column.statistics.as_ref().and_then(|s| s.step);
    if column.kind == ColumnKind::BridgeRatio {
        // In mV/V, whatever the unit of the column.
        let scale = column.unit.to_si(1.0) * 1e3;
        step = step.map(|step| step * scale);
        text.set_or_fill_in(
            "adc",
            step.map(|step| entry(step, 32)),
            entry(1e-6, 32),
            "one count of the converter (mV/V)",
        );
        return;
    }
    let fits = |lsb: f64, bits: u32| column.largest() * 2.0 < lsb * f64::from(bits - 1).exp2();
    let guess = step.unwrap_or(column.noise_std() / WORDS_OF_NOISE);
    let bits = BITS.into_iter().find(|bits| fits(guess, *bits));
    let lsb = if bits.is_some() {
        guess
    } else {
        column.largest().max(1e-30) / 2.0_f64.powi(29)
    };
    let bits = bits.unwrap_or(32);
    let what = format!("one count of the board's converter ({})", column.unit);
    text.set_or_fill_in(
        "adc",
        step.map(|_| entry(lsb, bits)),
        entry(lsb, bits),
        what,
    );
}

/// References of torques or forces for `loads`, in their order.
pub(super) fn references(text: &mut Text, columns: &[&ClassifiedColumn], loads: &[&str]) {
    for (i, column) in columns.iter().enumerate() {
        let Some(load) = loads.get(i).or(loads.last()) else {
            return;
        };
        text.table("[[reference]]");
        text.set("name", quoted(&column.name));
        text.fill_in("load", quoted(load), "the load that it measures");
        text.set("unit", quoted(column.unit.symbol()));
        if !matches!(column.unit.quantity(), Quantity::Torque | Quantity::Force) {
            text.fill_in("gain", "1", "Nm or N per count, with the sign of the load");
            text.fill_in("zero", "0", "the count at zero load");
        }
    }
}

/// Counts at which the pulses came, and how far the encoder was past them.
fn pulses(
    index: &ClassifiedColumn,
    encoder: &ClassifiedColumn,
    apart: impl Fn(f64, f64) -> f64,
) -> Option<Vec<(f64, f64)>> {
    let found = index.statistics.as_ref()?;
    let is_level = found.different <= 2 && found.empty < 0.5;
    let high = 0.5 * (found.least + found.most);
    let mut counts = Vec::new();
    let mut position: Option<(f64, f64)> = None;
    let mut last = f64::NAN;
    for (value, count) in index.values.iter().zip(&encoder.values) {
        if count.is_finite() {
            let moved = position.map_or(*count, |(at, before)| at + apart(before, *count));
            position = Some((moved, *count));
        }
        let is_new = if is_level {
            last < high && *value >= high
        } else {
            value.is_finite() && *value != 0.0 && *value != last
        };
        if value.is_finite() {
            last = *value;
        } else if !is_level {
            last = f64::NAN;
        }
        if is_new {
            let (at, present) = position.unwrap_or((f64::NAN, f64::NAN));
            counts.push(if is_level {
                (at, 0.0)
            } else {
                (*value, apart(*value, present))
            });
        }
    }
    Some(counts)
}

/// Nominal value of a load (N m or N), by the largest value of its reference.
pub(super) fn nominal(column: Option<&&ClassifiedColumn>) -> String {
    column.map_or("1".into(), |column| {
        rounded_up((column.unit.to_si(column.largest()) - column.unit.to_si(0.0)).abs())
    })
}
