//! Classification of a recording's columns (strain, torque, encoder counts, index pulse, ...) by
//! unit, then name, then values.

use loadtwin_recording::{Quantity, SurveyedColumn, Unit};

use super::column_statistics::Statistics;

/// What a column is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// A strain.
    Strain,
    /// The output of a strain bridge over its excitation.
    BridgeRatio,
    /// Words of a converter.
    Words,
    /// Counts of an encoder.
    Counts,
    /// An angle.
    Angle,
    /// An index pulse.
    Index,
    /// A torque.
    Torque,
    /// A force.
    Force,
    /// A displacement or a position along a line.
    Length,
    /// An angular speed.
    Speed,
    /// A speed along a line.
    LinearSpeed,
    /// A temperature.
    Temperature,
    /// A motor current.
    Current,
    /// A voltage.
    Voltage,
    /// Something that no machine is described by.
    Other,
    /// Nothing that its unit, name or values show.
    Unknown,
}

/// Words in names, in lower case, and what a column without a telling unit is by them.
const WORDS: &[(&[&str], Look)] = &[
    (
        &["command", "target", "setpoint", "soll", "demand"],
        Look::Other,
    ),
    (&["torque", "moment"], Look::Torque),
    (&["temp"], Look::Temperature),
    (
        &["index", "z-pulse", "zpulse", "nullimpuls", "marker"],
        Look::Index,
    ),
    (
        &["encoder", "angle", "position", "winkel", "pos"],
        Look::Counts,
    ),
    (&["current", "strom", "iq"], Look::Current),
    (&["voltage", "spannung"], Look::Voltage),
    (&["force", "kraft"], Look::Force),
    (&["speed", "velocity", "drehzahl", "rpm"], Look::Speed),
    (&["strain", "gauge", "dms", "bridge"], Look::Words),
];

/// A column of a recording with what it looks like.
#[derive(Clone, Debug)]
pub struct LookedAt {
    /// Its name in the recording.
    pub name: String,
    /// Its unit; counts or 1 where the recording has none.
    pub unit: Unit,
    /// Whether the unit is the recording's.
    pub has_unit: bool,
    /// The unit as written.
    pub written_unit: Option<String>,
    /// What it looks like.
    pub look: Look,
    /// Figures of its values; none where it holds no numbers.
    pub statistics: Option<Statistics>,
    /// Its values.
    pub values: Vec<f64>,
}

impl LookedAt {
    /// Looks at a column.
    pub fn new(column: SurveyedColumn) -> Self {
        let unit = column.known_unit();
        let statistics = Statistics::of(&column.values);
        // Text, or a name that is there twice.
        let is_usable = !column.values.is_empty() || by_name(&column.name) == Some(Look::Index);
        let look = if is_usable {
            look(&column.name, unit, statistics.as_ref())
        } else {
            Look::Other
        };
        let is_index = look == Look::Index;
        Self {
            name: column.name,
            has_unit: unit.is_some() || is_index,
            unit: unit.unwrap_or(Unit::COUNTS),
            written_unit: column.unit,
            look,
            statistics,
            values: column.values,
        }
    }

    /// Whether it is one of `looks`.
    pub fn is(&self, looks: &[Look]) -> bool {
        looks.contains(&self.look)
    }
}

/// `statistics`: none where no value could be read.
fn look(name: &str, unit: Option<Unit>, statistics: Option<&Statistics>) -> Look {
    let named = by_name(name);
    let valued = || statistics.map_or(Look::Unknown, by_values);
    match unit.map(Unit::quantity) {
        Some(Quantity::Strain) => Look::Strain,
        Some(Quantity::BridgeRatio) => Look::BridgeRatio,
        Some(Quantity::Torque) => Look::Torque,
        Some(Quantity::Force) => Look::Force,
        Some(Quantity::Angle) => Look::Angle,
        Some(Quantity::AngularSpeed) => Look::Speed,
        // A simulated recording of a rotor has what no sensor measures.
        Some(Quantity::Length) if is_true_displacement(name) => Look::Other,
        Some(Quantity::Length) => Look::Length,
        Some(Quantity::Speed) => Look::LinearSpeed,
        Some(Quantity::Temperature) => Look::Temperature,
        Some(Quantity::Current) => Look::Current,
        Some(Quantity::Voltage) if named == Some(Look::Index) => Look::Index,
        Some(Quantity::Voltage) => Look::Voltage,
        Some(Quantity::Counts) => named.unwrap_or_else(valued),
        Some(Quantity::Number) | None => named.unwrap_or_else(|| match valued() {
            found @ (Look::Index | Look::Counts) => found,
            _ => Look::Unknown,
        }),
        Some(_) => Look::Other,
    }
}

/// Whether it is the displacement of a node, `node5_x`, with which `replay` compares its own.
fn is_true_displacement(name: &str) -> bool {
    let node = name
        .strip_prefix("node")
        .and_then(|rest| rest.split_once('_'));
    node.is_some_and(|(node, axis)| node.parse::<u32>().is_ok() && matches!(axis, "x" | "y"))
}

/// By the word that comes last in the name: `encoder index` is an index.
fn by_name(name: &str) -> Option<Look> {
    let name = name.to_lowercase();
    let words = WORDS
        .iter()
        .flat_map(|(words, look)| words.iter().map(move |word| (*word, *look)));
    let places = words.filter_map(|(word, look)| {
        let place = name.rfind(word)?;
        // A short word is a part of the name between separators.
        let around = |at: Option<char>| at.is_none_or(|c| !c.is_alphanumeric());
        let is_apart = around(name[..place].chars().last())
            && around(name[place + word.len()..].chars().next());
        (word.len() > 4 || is_apart || (word.len() == 4 && around(name[..place].chars().last())))
            .then_some((place, word.len(), look))
    });
    let is_other = WORDS[0].0.iter().any(|word| name.contains(word));
    if is_other {
        return Some(Look::Other);
    }
    places
        .max_by_key(|(place, length, _)| (*place, *length))
        .map(|(_, _, look)| look)
}

fn by_values(statistics: &Statistics) -> Look {
    if statistics.is_sparse() {
        Look::Index
    } else if statistics.is_whole && statistics.moves_as_a_counter {
        Look::Counts
    } else {
        Look::Words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look_of(name: &str, unit: Option<&str>, values: Vec<f64>) -> Look {
        LookedAt::new(SurveyedColumn {
            name: name.into(),
            unit: unit.map(str::to_owned),
            values,
        })
        .look
    }

    #[test]
    fn units_go_before_names_and_names_before_values() {
        let wave: Vec<f64> = (0..500).map(|i| f64::from((i * 7919) % 97) * 0.1).collect();
        let count: Vec<f64> = (0..500).map(|i| f64::from((i * 7) % 1024)).collect();
        let pulse: Vec<f64> = (0..500)
            .map(|i| f64::from(u8::from(i % 100 == 5)))
            .collect();
        for (name, unit, values, expected) in [
            ("torque", Some("µm/m"), &wave, Look::Strain),
            ("a", Some("mV/V"), &wave, Look::BridgeRatio),
            ("Measured Current", Some("Amps"), &wave, Look::Current),
            ("Front-end Encoder", Some("counts"), &wave, Look::Counts),
            ("Output Command", Some("counts"), &count, Look::Other),
            ("encoder_index", Some("counts"), &count, Look::Index),
            ("a", Some("counts"), &count, Look::Counts),
            ("a", Some("counts"), &wave, Look::Words),
            ("a", Some("1"), &pulse, Look::Index),
            ("a", None, &wave, Look::Unknown),
            ("a", None, &count, Look::Counts),
            ("Iq", Some("A"), &wave, Look::Current),
            ("unique", None, &wave, Look::Unknown),
            ("housing_temp", None, &wave, Look::Temperature),
            ("x5", Some("m"), &wave, Look::Length),
            ("node5_x", Some("m"), &wave, Look::Other),
        ] {
            assert_eq!(
                look_of(name, unit, values.clone()),
                expected,
                "{name} {unit:?}"
            );
        }
    }
}
