//! Classifies a column of a recording (`ColumnKind`: strain, torque, encoder counts, index pulse,
//! ...) by its unit, then by words in its name, then by its values.

use loadtwin_recording::{Quantity, SurveyedColumn, Unit};

use super::column_statistics::Statistics;

/// What a column is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnKind {
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
    /// Something that no machine is described by, as a set point.
    Other,
    /// Nothing that its unit, name or values show.
    Unknown,
}

/// Words in names, in lower case, and what a column without a telling unit is by them.
const WORDS: &[(&[&str], ColumnKind)] = &[
    (
        &["command", "target", "setpoint", "soll", "demand"],
        ColumnKind::Other,
    ),
    (&["torque", "moment"], ColumnKind::Torque),
    (&["temp"], ColumnKind::Temperature),
    (
        &["index", "z-pulse", "zpulse", "nullimpuls", "marker"],
        ColumnKind::Index,
    ),
    (
        &["encoder", "angle", "position", "winkel", "pos"],
        ColumnKind::Counts,
    ),
    (&["current", "strom", "iq"], ColumnKind::Current),
    (&["voltage", "spannung"], ColumnKind::Voltage),
    (&["force", "kraft"], ColumnKind::Force),
    (&["speed", "velocity", "drehzahl", "rpm"], ColumnKind::Speed),
    (&["strain", "gauge", "dms", "bridge"], ColumnKind::Words),
];

/// A column of a recording with its kind.
#[derive(Clone, Debug)]
pub struct ClassifiedColumn {
    /// Its name in the recording.
    pub name: String,
    /// Its unit; counts or 1 where the recording has none.
    pub unit: Unit,
    /// Whether the unit is the recording's.
    pub has_unit: bool,
    /// The unit as written.
    pub written_unit: Option<String>,
    /// Its kind.
    pub kind: ColumnKind,
    /// Figures of its values; none where it holds no numbers.
    pub statistics: Option<Statistics>,
    /// Its values.
    pub values: Vec<f64>,
}

impl ClassifiedColumn {
    /// Classifies a column.
    pub fn new(column: SurveyedColumn) -> Self {
        let unit = column.known_unit();
        let statistics = Statistics::of(&column.values);
        // Text, or a name that is there twice.
        let is_usable =
            !column.values.is_empty() || by_name(&column.name) == Some(ColumnKind::Index);
        let kind = if is_usable {
            classify(&column.name, unit, statistics.as_ref())
        } else {
            ColumnKind::Other
        };
        let is_index = kind == ColumnKind::Index;
        Self {
            name: column.name,
            has_unit: unit.is_some() || is_index,
            unit: unit.unwrap_or(Unit::COUNTS),
            written_unit: column.unit,
            kind,
            statistics,
            values: column.values,
        }
    }

    /// Whether it is one of `kinds`.
    pub fn is(&self, kinds: &[ColumnKind]) -> bool {
        kinds.contains(&self.kind)
    }
}

/// `statistics`: none where no value could be read.
fn classify(name: &str, unit: Option<Unit>, statistics: Option<&Statistics>) -> ColumnKind {
    let named = by_name(name);
    let valued = || statistics.map_or(ColumnKind::Unknown, by_values);
    match unit.map(Unit::quantity) {
        Some(Quantity::Strain) => ColumnKind::Strain,
        Some(Quantity::BridgeRatio) => ColumnKind::BridgeRatio,
        Some(Quantity::Torque) => ColumnKind::Torque,
        Some(Quantity::Force) => ColumnKind::Force,
        Some(Quantity::Angle) => ColumnKind::Angle,
        Some(Quantity::AngularSpeed) => ColumnKind::Speed,
        // A simulated recording of a rotor has what no sensor measures.
        Some(Quantity::Length) if is_true_displacement(name) => ColumnKind::Other,
        Some(Quantity::Length) => ColumnKind::Length,
        Some(Quantity::Speed) => ColumnKind::LinearSpeed,
        Some(Quantity::Temperature) => ColumnKind::Temperature,
        Some(Quantity::Current) => ColumnKind::Current,
        Some(Quantity::Voltage) if named == Some(ColumnKind::Index) => ColumnKind::Index,
        Some(Quantity::Voltage) => ColumnKind::Voltage,
        Some(Quantity::Counts) => named.unwrap_or_else(valued),
        Some(Quantity::Number) | None => named.unwrap_or_else(|| match valued() {
            found @ (ColumnKind::Index | ColumnKind::Counts) => found,
            _ => ColumnKind::Unknown,
        }),
        Some(_) => ColumnKind::Other,
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
fn by_name(name: &str) -> Option<ColumnKind> {
    let name = name.to_lowercase();
    let words = WORDS
        .iter()
        .flat_map(|(words, kind)| words.iter().map(move |word| (*word, *kind)));
    let places = words.filter_map(|(word, kind)| {
        let place = name.rfind(word)?;
        // A short word is a part of the name between separators.
        let around = |at: Option<char>| at.is_none_or(|c| !c.is_alphanumeric());
        let is_apart = around(name[..place].chars().last())
            && around(name[place + word.len()..].chars().next());
        (word.len() > 4 || is_apart || (word.len() == 4 && around(name[..place].chars().last())))
            .then_some((place, word.len(), kind))
    });
    let is_other = WORDS[0].0.iter().any(|word| name.contains(word));
    if is_other {
        return Some(ColumnKind::Other);
    }
    places
        .max_by_key(|(place, length, _)| (*place, *length))
        .map(|(_, _, kind)| kind)
}

fn by_values(statistics: &Statistics) -> ColumnKind {
    if statistics.is_sparse() {
        ColumnKind::Index
    } else if statistics.is_whole && statistics.moves_as_a_counter {
        ColumnKind::Counts
    } else {
        ColumnKind::Words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind_of_column(name: &str, unit: Option<&str>, values: Vec<f64>) -> ColumnKind {
        ClassifiedColumn::new(SurveyedColumn {
            name: name.into(),
            unit: unit.map(str::to_owned),
            values,
        })
        .kind
    }

    #[test]
    fn units_go_before_names_and_names_before_values() {
        let wave: Vec<f64> = (0..500).map(|i| f64::from((i * 7919) % 97) * 0.1).collect();
        let count: Vec<f64> = (0..500).map(|i| f64::from((i * 7) % 1024)).collect();
        let pulse: Vec<f64> = (0..500)
            .map(|i| f64::from(u8::from(i % 100 == 5)))
            .collect();
        for (name, unit, values, expected) in [
            ("torque", Some("µm/m"), &wave, ColumnKind::Strain),
            ("a", Some("mV/V"), &wave, ColumnKind::BridgeRatio),
            ("Measured Current", Some("Amps"), &wave, ColumnKind::Current),
            (
                "Front-end Encoder",
                Some("counts"),
                &wave,
                ColumnKind::Counts,
            ),
            ("Output Command", Some("counts"), &count, ColumnKind::Other),
            ("encoder_index", Some("counts"), &count, ColumnKind::Index),
            ("a", Some("counts"), &count, ColumnKind::Counts),
            ("a", Some("counts"), &wave, ColumnKind::Words),
            ("a", Some("1"), &pulse, ColumnKind::Index),
            ("a", None, &wave, ColumnKind::Unknown),
            ("a", None, &count, ColumnKind::Counts),
            ("Iq", Some("A"), &wave, ColumnKind::Current),
            ("unique", None, &wave, ColumnKind::Unknown),
            ("housing_temp", None, &wave, ColumnKind::Temperature),
            ("x5", Some("m"), &wave, ColumnKind::Length),
            ("node5_x", Some("m"), &wave, ColumnKind::Other),
        ] {
            assert_eq!(
                kind_of_column(name, unit, values.clone()),
                expected,
                "{name} {unit:?}"
            );
        }
    }
}
