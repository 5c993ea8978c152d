//! Parses units of measurement as written in column headers and machine descriptions (`Unit`:
//! symbol, alias, quantity), and converts values between units of one quantity, or to SI.
use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use Quantity as Q;

/// What a unit measures. Only units of one quantity convert into each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// Elongation over length, m/m.
    Strain,
    /// Output over excitation voltage of a bridge, V/V.
    BridgeRatio,
    /// Torque or bending moment, Nm.
    Torque,
    /// Force, N.
    Force,
    /// Angle, rad.
    Angle,
    /// Angular speed, rad/s.
    AngularSpeed,
    /// Time, s.
    Time,
    /// Temperature, K.
    Temperature,
    /// Displacement, m.
    Length,
    /// Speed along a line, m/s.
    Speed,
    /// Acceleration, m/s².
    Acceleration,
    /// Pressure or stress, Pa.
    Pressure,
    /// Power, W.
    Power,
    /// Frequency, Hz.
    Frequency,
    /// Voltage, V.
    Voltage,
    /// Current, A.
    Current,
    /// Resistance, ohm.
    Resistance,
    /// Raw words of a converter or counter.
    Counts,
    /// A pure number.
    Number,
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Q::Strain => "strain",
            Q::BridgeRatio => "bridge ratio",
            Q::Torque => "torque",
            Q::Force => "force",
            Q::Angle => "angle",
            Q::AngularSpeed => "angular speed",
            Q::Time => "time",
            Q::Temperature => "temperature",
            Q::Length => "length",
            Q::Speed => "speed",
            Q::Acceleration => "acceleration",
            Q::Pressure => "pressure",
            Q::Power => "power",
            Q::Frequency => "frequency",
            Q::Voltage => "voltage",
            Q::Current => "current",
            Q::Resistance => "resistance",
            Q::Counts => "raw counts",
            Q::Number => "number",
        })
    }
}

impl Quantity {
    /// Symbols of this quantity's units, the SI unit first.
    pub fn symbols(self) -> impl Iterator<Item = &'static str> {
        TABLE
            .iter()
            .filter(move |e| e.quantity == self)
            .map(|e| e.symbol)
    }
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    symbol: &'static str,
    quantity: Quantity,
    /// SI value of one unit is `over / under`: 1e6 is exact in f64 and 1e-6 is
    /// not, so the value is divided rather than multiplied.
    over: f64,
    under: f64,
    /// SI value of zero of this unit.
    offset: f64,
    aliases: &'static [&'static str],
}

const fn unit(
    symbol: &'static str,
    quantity: Quantity,
    over: f64,
    under: f64,
    aliases: &'static [&'static str],
) -> Entry {
    Entry {
        symbol,
        quantity,
        over,
        under,
        offset: 0.0,
        aliases,
    }
}

const PI: f64 = std::f64::consts::PI;

/// The SI unit of each quantity comes first. Symbols and aliases are given
/// without multiplication signs and with the micro sign U+00B5, see `FromStr`.
static TABLE: &[Entry] = &[
    unit("m/m", Q::Strain, 1.0, 1.0, &["strain", "ε"]),
    unit(
        "µm/m",
        Q::Strain,
        1.0,
        1e6,
        &[
            "um/m",
            "µε",
            "uε",
            "ue",
            "µstrain",
            "ustrain",
            "microstrain",
            "ppm",
        ],
    ),
    unit("V/V", Q::BridgeRatio, 1.0, 1.0, &[]),
    unit("mV/V", Q::BridgeRatio, 1.0, 1e3, &[]),
    unit("µV/V", Q::BridgeRatio, 1.0, 1e6, &["uV/V"]),
    unit("Nm", Q::Torque, 1.0, 1.0, &[]),
    unit("kNm", Q::Torque, 1e3, 1.0, &[]),
    unit("MNm", Q::Torque, 1e6, 1.0, &[]),
    unit("mNm", Q::Torque, 1.0, 1e3, &[]),
    unit("N", Q::Force, 1.0, 1.0, &[]),
    unit("kN", Q::Force, 1e3, 1.0, &[]),
    unit("mN", Q::Force, 1.0, 1e3, &[]),
    unit("rad", Q::Angle, 1.0, 1.0, &[]),
    unit("mrad", Q::Angle, 1.0, 1e3, &[]),
    unit("deg", Q::Angle, PI, 180.0, &["°", "degree", "degrees"]),
    unit("rev", Q::Angle, 2.0 * PI, 1.0, &["turn", "turns"]),
    unit("rad/s", Q::AngularSpeed, 1.0, 1.0, &[]),
    unit("deg/s", Q::AngularSpeed, PI, 180.0, &["°/s"]),
    unit(
        "rpm",
        Q::AngularSpeed,
        PI,
        30.0,
        &["1/min", "rev/min", "U/min", "min^-1", "min-1"],
    ),
    unit("rev/s", Q::AngularSpeed, 2.0 * PI, 1.0, &["rps"]),
    *Unit::SECOND.0,
    unit("ms", Q::Time, 1.0, 1e3, &[]),
    unit("µs", Q::Time, 1.0, 1e6, &["us"]),
    unit("ns", Q::Time, 1.0, 1e9, &[]),
    unit("min", Q::Time, 60.0, 1.0, &[]),
    unit("K", Q::Temperature, 1.0, 1.0, &[]),
    Entry {
        symbol: "°C",
        quantity: Q::Temperature,
        over: 1.0,
        under: 1.0,
        offset: 273.15,
        aliases: &["degC", "℃"],
    },
    unit("m", Q::Length, 1.0, 1.0, &[]),
    unit("mm", Q::Length, 1.0, 1e3, &[]),
    unit("µm", Q::Length, 1.0, 1e6, &["um"]),
    unit("m/s", Q::Speed, 1.0, 1.0, &[]),
    unit("mm/s", Q::Speed, 1.0, 1e3, &[]),
    unit("km/h", Q::Speed, 1.0, 3.6, &["kph"]),
    unit("m/s²", Q::Acceleration, 1.0, 1.0, &["m/s^2", "m/s2"]),
    unit("g", Q::Acceleration, 9.80665, 1.0, &[]),
    unit("Pa", Q::Pressure, 1.0, 1.0, &["N/m²", "N/m^2"]),
    unit("kPa", Q::Pressure, 1e3, 1.0, &[]),
    unit("MPa", Q::Pressure, 1e6, 1.0, &["N/mm²", "N/mm^2"]),
    unit("GPa", Q::Pressure, 1e9, 1.0, &[]),
    unit("bar", Q::Pressure, 1e5, 1.0, &[]),
    unit("W", Q::Power, 1.0, 1.0, &[]),
    unit("kW", Q::Power, 1e3, 1.0, &[]),
    unit("Hz", Q::Frequency, 1.0, 1.0, &["1/s"]),
    unit("kHz", Q::Frequency, 1e3, 1.0, &[]),
    unit("V", Q::Voltage, 1.0, 1.0, &[]),
    unit("mV", Q::Voltage, 1.0, 1e3, &[]),
    unit("µV", Q::Voltage, 1.0, 1e6, &["uV"]),
    unit("A", Q::Current, 1.0, 1.0, &[]),
    unit("mA", Q::Current, 1.0, 1e3, &[]),
    unit("ohm", Q::Resistance, 1.0, 1.0, &["Ω", "Ohm"]),
    unit("kohm", Q::Resistance, 1e3, 1.0, &["kΩ", "kOhm"]),
    *Unit::COUNTS.0,
    unit("1", Q::Number, 1.0, 1.0, &["-"]),
    unit("%", Q::Number, 1.0, 100.0, &[]),
];

/// One unit of the table below; written and parsed as its symbol.
///
/// | quantity | units, the SI unit first |
/// |---|---|
/// | strain | `m/m`, `µm/m` (`um/m`, `µε`, `ustrain`, `ppm`) |
/// | bridge ratio | `V/V`, `mV/V`, `µV/V` |
/// | torque | `Nm` (`N·m`, `N*m`, `N m`), `kNm`, `MNm`, `mNm` |
/// | force | `N`, `kN`, `mN` |
/// | angle | `rad`, `mrad`, `deg` (`°`), `rev` |
/// | angular speed | `rad/s`, `deg/s`, `rpm` (`1/min`), `rev/s` |
/// | time | `s`, `ms`, `µs` (`us`), `ns`, `min` |
/// | temperature | `K`, `°C` (`degC`) |
/// | length | `m`, `mm`, `µm` (`um`) |
/// | speed, acceleration | `m/s`, `mm/s`, `km/h`; `m/s²` (`m/s^2`), `g` |
/// | pressure, power | `Pa`, `kPa`, `MPa`, `GPa`, `bar`; `W`, `kW` |
/// | frequency | `Hz`, `kHz` |
/// | electrical | `V`, `mV`, `µV`; `A`, `mA`; `ohm`, `kohm` |
/// | raw, number | `counts`; `1` (`-`), `%` |
///
/// ```
/// use loadtwin_recording::Unit;
/// let unit: Unit = "kN·m".parse()?;
/// assert_eq!(unit.to_string(), "kNm");
/// assert_eq!(unit.to_si(2.5), 2500.0);
/// # Ok::<(), loadtwin_recording::UnknownUnit>(())
/// ```
#[derive(Clone, Copy)]
pub struct Unit(&'static Entry);

impl Unit {
    /// The second, unit of the time of every recording.
    pub const SECOND: Self = Self(&unit("s", Q::Time, 1.0, 1.0, &["sec"]));
    /// The radian.
    pub const RADIAN: Self = Self(&unit("rad", Q::Angle, 1.0, 1.0, &[]));
    /// The radian per second.
    pub const RADIAN_PER_SECOND: Self = Self(&unit("rad/s", Q::AngularSpeed, 1.0, 1.0, &[]));
    /// The newton.
    pub const NEWTON: Self = Self(&unit("N", Q::Force, 1.0, 1.0, &[]));
    /// The metre.
    pub const METRE: Self = Self(&unit("m", Q::Length, 1.0, 1.0, &[]));
    /// The newton metre.
    pub const NEWTON_METRE: Self = Self(&unit("Nm", Q::Torque, 1.0, 1.0, &[]));
    /// Bridge output over excitation.
    pub const VOLT_PER_VOLT: Self = Self(&unit("V/V", Q::BridgeRatio, 1.0, 1.0, &[]));
    /// A plain number.
    pub const ONE: Self = Self(&unit("1", Q::Number, 1.0, 1.0, &[]));
    /// Raw words of a converter or counter.
    pub const COUNTS: Self = Self(&unit(
        "counts",
        Q::Counts,
        1.0,
        1.0,
        &["count", "cnt", "LSB"],
    ));

    /// Symbol as this project writes it.
    pub fn symbol(self) -> &'static str {
        self.0.symbol
    }

    /// What it measures.
    pub fn quantity(self) -> Quantity {
        self.0.quantity
    }

    /// The SI unit of the same quantity (`counts` for raw words).
    #[must_use]
    pub fn si(self) -> Self {
        let quantity = self.quantity();
        // The table holds `self`, so a first entry of its quantity exists.
        TABLE
            .iter()
            .find(|e| e.quantity == quantity)
            .map_or(self, Unit)
    }

    /// `si = value * over / under + offset`, NaN stays NaN.
    pub fn to_si(self, value: f64) -> f64 {
        value * self.0.over / self.0.under + self.0.offset
    }

    /// `value = (si - offset) * under / over`.
    pub fn from_si(self, si: f64) -> f64 {
        (si - self.0.offset) * self.0.under / self.0.over
    }

    /// Conversion of values in this unit to `target`; none where the two
    /// measure different quantities.
    pub fn conversion_to(self, target: Self) -> Option<Conversion> {
        (self.quantity() == target.quantity()).then_some(if self == target {
            Conversion::Same
        } else {
            Conversion::Through(self, target)
        })
    }
}

/// How values of one unit become values of another of the same quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conversion {
    /// Both units are the same.
    Same,
    /// From the first unit over SI to the second.
    Through(Unit, Unit),
}

impl Conversion {
    /// Converts one value.
    pub fn apply(self, value: f64) -> f64 {
        match self {
            Self::Same => value,
            Self::Through(from, to) => to.from_si(from.to_si(value)),
        }
    }

    /// Converts a column in place.
    pub fn apply_to(self, values: &mut [f64]) {
        if self != Self::Same {
            for v in values {
                *v = self.apply(*v);
            }
        }
    }
}

impl PartialEq for Unit {
    fn eq(&self, other: &Self) -> bool {
        self.0.symbol == other.0.symbol
    }
}

impl Eq for Unit {}

impl std::hash::Hash for Unit {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        self.0.symbol.hash(state);
    }
}

impl fmt::Debug for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Unit({})", self.0.symbol)
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.0.symbol)
    }
}

/// A unit that the table of [`Unit`] does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unit `{found}` is not known; allowed: {}", all_symbols())]
pub struct UnknownUnit {
    /// What was written.
    pub found: String,
}

fn all_symbols() -> String {
    let symbols: Vec<_> = TABLE.iter().map(|e| e.symbol).collect();
    symbols.join(", ")
}

impl FromStr for Unit {
    type Err = UnknownUnit;

    /// Case matters (`mNm` is not `MNm`). Multiplication signs (`·`, `*`,
    /// space) may be written or left out, and either micro sign may be used.
    fn from_str(text: &str) -> Result<Self, UnknownUnit> {
        let plain: String = text
            .chars()
            .filter(|c| !matches!(c, ' ' | '·' | '⋅' | '*'))
            .map(|c| if c == 'μ' { 'µ' } else { c })
            .collect();
        TABLE
            .iter()
            .find(|e| e.symbol == plain || e.aliases.contains(&plain.as_str()))
            .map(Unit)
            .ok_or_else(|| UnknownUnit {
                found: super::shown(text),
            })
    }
}

impl Serialize for Unit {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.symbol)
    }
}

impl<'de> Deserialize<'de> for Unit {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?
            .parse()
            .map_err(serde::de::Error::custom)
    }
}

impl schemars::JsonSchema for Unit {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Unit".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        // No `enum`: the aliases and multiplication signs are allowed too.
        schemars::json_schema!({
            "type": "string",
            "description": format!("Unit of measurement: {}", all_symbols()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(text: &str) -> Unit {
        text.parse().unwrap()
    }

    #[test]
    fn spellings_of_the_trade() {
        for (text, symbol) in [
            ("N·m", "Nm"),
            ("N*m", "Nm"),
            ("kN m", "kNm"),
            ("um/m", "µm/m"),
            ("μm/m", "µm/m"),
            ("µε", "µm/m"),
            ("ppm", "µm/m"),
            ("1/min", "rpm"),
            ("°", "deg"),
            ("-", "1"),
            ("degC", "°C"),
        ] {
            assert_eq!(unit(text).symbol(), symbol, "{text}");
        }
        assert_ne!(unit("mNm"), unit("MNm"));
        assert!("".parse::<Unit>().is_err());
        assert!("furlong".parse::<Unit>().is_err());
    }

    #[test]
    fn conversion_to_si_by_hand() {
        assert_eq!(unit("µm/m").to_si(250.0), 250e-6);
        assert_eq!(unit("mV/V").to_si(2.0), 0.002);
        assert_eq!(unit("kNm").to_si(850.0), 850e3);
        assert_eq!(unit("°C").to_si(20.0), 293.15);
        assert!((unit("rpm").to_si(60.0) / (2.0 * PI) - 1.0).abs() < 1e-15);
        assert_eq!(unit("deg").to_si(180.0), PI);
        assert_eq!(unit("ms").to_si(2.0), 0.002);
        let c = unit("kNm").conversion_to(unit("mNm")).unwrap();
        assert_eq!(c.apply(1.5), 1.5e6);
        assert!(unit("mm").conversion_to(unit("µm/m")).is_none());
    }

    #[test]
    fn every_symbol_and_alias_names_one_unit_and_survives_a_round_trip() {
        let mut seen = std::collections::HashSet::new();
        for e in TABLE {
            for name in std::iter::once(&e.symbol).chain(e.aliases) {
                assert!(seen.insert(*name), "{name} twice");
                assert_eq!(unit(name).symbol(), e.symbol);
            }
            let u = Unit(e);
            let si = u.si();
            assert_eq!((si.to_si(1.0), si.quantity()), (1.0, u.quantity()));
            assert!((u.from_si(u.to_si(3.0)) - 3.0).abs() < 1e-12);
            let text = serde_json::to_string(&u).unwrap();
            assert_eq!(serde_json::from_str::<Unit>(&text).unwrap(), u);
        }
    }
}
