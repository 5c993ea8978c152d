//! Converts the output ratio (V/V) of a Wheatstone bridge with strain gauges to strain (m/m) and
//! back, for seven bridge types, with lead resistance. Defines the description of bridge and latest
//! calibration, with checks.

use super::MV_PER_V;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};

/// Which arms of the bridge are gauges and what they see.
///
/// The names are those of National Instruments. In the formulas `vr` is the output ratio less the
/// ratio at rest [V/V], `gf` the gauge factor, `nu` Poisson's ratio, `rl` the lead resistance and
/// `rg` the nominal gauge resistance (ohm). Tension gives a negative `vr`.
///
/// Source: National Instruments, Strain Gauge Configuration Types; each formula follows from the
/// two voltage dividers `vr = R3/(R3 + R4) - R2/(R1 + R2)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum BridgeKind {
    /// One gauge along the strain; axial or bending.
    /// `strain = -4 vr / (gf (1 + 2 vr)) (1 + rl/rg)`
    #[serde(rename = "quarter-1")]
    Quarter1,
    /// One gauge along the strain and one for temperature that sees none; axial or bending.
    /// `strain = -4 vr / (gf (1 + 2 vr)) (1 + rl/rg)`
    #[serde(rename = "quarter-2")]
    Quarter2,
    /// One gauge along and one across the strain; axial or bending.
    /// `strain = -4 vr / (gf ((1 + nu) - 2 vr (nu - 1))) (1 + rl/rg)`
    #[serde(rename = "half-1")]
    Half1,
    /// One gauge on each side of a bent beam; bending only.
    /// `strain = -2 vr / gf (1 + rl/rg)`
    #[serde(rename = "half-2")]
    Half2,
    /// Two gauges on each side of a bent beam, all along it; bending only.
    /// `strain = -vr / gf`
    #[serde(rename = "full-1")]
    Full1,
    /// On each side of a bent beam one gauge along and one across; bending only.
    /// `strain = -2 vr / (gf (1 + nu))`
    #[serde(rename = "full-2")]
    Full2,
    /// Two gauges along and two across the strain; axial only.
    /// `strain = -2 vr / (gf ((nu + 1) - vr (nu - 1)))`
    #[serde(rename = "full-3")]
    Full3,
}

/// Sign of the output ratio under tension.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TensionReads {
    /// Tension lowers the ratio, as in the circuit diagrams of National Instruments.
    #[default]
    Negative,
    /// Tension raises the ratio: the signal wires are the other way round.
    Positive,
}

/// A strain channel's bridge, as it stands in the machine description.
///
/// ```
/// use loadtwin_machine::strain::{MICROSTRAIN, MV_PER_V, StrainBridge};
/// let bridge: StrainBridge = toml::from_str(r#"bridge = "half-2"
/// gauge_factor = 2.0
/// gauge_resistance_ohm = 350.0"#).unwrap();
/// let strain = bridge.strain(-0.5 * MV_PER_V);
/// assert!((strain / MICROSTRAIN - 500.0).abs() < 1e-9);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StrainBridge {
    /// Bridge type, National Instruments nomenclature.
    pub bridge: BridgeKind,
    /// Gauge factor on the gauge's data sheet, 0.5 to 200: metals have about 2, semiconductors up to
    /// 200. A calibration never changes it.
    #[serde(deserialize_with = "gauge_factor")]
    #[schemars(range(min = 0.5, max = 200.0))]
    pub gauge_factor: f64,
    /// Nominal resistance of one gauge (ohm), 10 to 100 000; 120, 350 and 1000 are usual.
    #[serde(deserialize_with = "gauge_resistance")]
    #[schemars(range(min = 10.0, max = 1e5))]
    pub gauge_resistance_ohm: f64,
    /// Resistance of one lead wire (ohm), >= 0. Quarter and half bridges only: the formulas of
    /// the full bridges do not contain it.
    #[serde(default, deserialize_with = "not_negative")]
    #[schemars(range(min = 0.0))]
    pub lead_resistance_ohm: f64,
    /// Poisson's ratio of the specimen, 0 to 0.5. Used by half-1, full-2 and full-3.
    #[serde(default = "steel_poisson_ratio", deserialize_with = "poisson_ratio")]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub poisson_ratio: f64,
    /// Output of the unstrained bridge [mV/V].
    #[serde(default, deserialize_with = "finite")]
    pub initial_mv_per_v: f64,
    /// Sign of the output under tension.
    #[serde(default)]
    pub tension_reads: TensionReads,
    /// Latest zero or shunt calibration; where present it takes the place of `initial_mv_per_v`
    /// and `gauge_factor`, which stay as they were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// What a zero (tare) or shunt calibration found, and when.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Day of the calibration, ISO 8601: `"2026-03-31"`.
    #[serde(deserialize_with = "iso_date")]
    #[schemars(extend("format" = "date"))]
    pub date: String,
    /// Output of the unloaded bridge [mV/V].
    #[serde(deserialize_with = "finite")]
    pub zero_mv_per_v: f64,
    /// Adjusted gauge factor, > 0; absent after a zero alone.
    #[serde(
        default,
        deserialize_with = "some_positive",
        skip_serializing_if = "Option::is_none"
    )]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub gauge_factor: Option<f64>,
    /// Shunt resistor that gave the adjusted gauge factor (ohm), > 0.
    #[serde(
        default,
        deserialize_with = "some_positive",
        skip_serializing_if = "Option::is_none"
    )]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub shunt_ohm: Option<f64>,
}

impl StrainBridge {
    /// Strain [m/m] at an output ratio [V/V], by the formula of the bridge's type.
    pub fn strain(&self, ratio: f64) -> f64 {
        let (zero, gauge_factor) = self.zero_and_gauge_factor();
        self.relative_change(self.sign() * (ratio - zero)) * self.lead_factor() / gauge_factor
    }

    /// Output ratio [V/V] at a strain [m/m]: the inverse of [`Self::strain`].
    pub fn ratio(&self, strain: f64) -> f64 {
        let (zero, gauge_factor) = self.zero_and_gauge_factor();
        let x = strain * gauge_factor / self.lead_factor();
        let nu = self.poisson_ratio;
        let vr = match self.bridge {
            BridgeKind::Quarter1 | BridgeKind::Quarter2 => -x / (4.0 + 2.0 * x),
            BridgeKind::Half1 => -(1.0 + nu) * x / (4.0 + 2.0 * (1.0 - nu) * x),
            BridgeKind::Half2 => -x / 2.0,
            BridgeKind::Full1 => -x,
            BridgeKind::Full2 => -(1.0 + nu) * x / 2.0,
            BridgeKind::Full3 => -(1.0 + nu) * x / (2.0 + (1.0 - nu) * x),
        };
        zero + self.sign() * vr
    }

    /// Size of the change of the output ratio [V/V] by a tension of `strain` [m/m], with the raw gauge factor.
    pub(super) fn output_change(&self, strain: f64) -> f64 {
        let raw = Self {
            calibration: None,
            initial_mv_per_v: 0.0,
            ..self.clone()
        };
        raw.ratio(strain).abs()
    }

    /// Relative resistance change of a gauge along the strain, `gf strain`, seen at the terminals.
    pub(super) fn relative_change(&self, vr: f64) -> f64 {
        let nu = self.poisson_ratio;
        match self.bridge {
            BridgeKind::Quarter1 | BridgeKind::Quarter2 => -4.0 * vr / (1.0 + 2.0 * vr),
            BridgeKind::Half1 => -4.0 * vr / ((1.0 + nu) - 2.0 * vr * (nu - 1.0)),
            BridgeKind::Half2 => -2.0 * vr,
            BridgeKind::Full1 => -vr,
            BridgeKind::Full2 => -2.0 * vr / (1.0 + nu),
            BridgeKind::Full3 => -2.0 * vr / ((nu + 1.0) - vr * (nu - 1.0)),
        }
    }

    /// `1 + rl/rg`, or 1 for a full bridge.
    pub(super) fn lead_factor(&self) -> f64 {
        match self.bridge {
            BridgeKind::Full1 | BridgeKind::Full2 | BridgeKind::Full3 => 1.0,
            _ => 1.0 + self.lead_resistance_ohm / self.gauge_resistance_ohm,
        }
    }

    /// 1 where tension gives a negative ratio, else -1.
    pub(super) fn sign(&self) -> f64 {
        match self.tension_reads {
            TensionReads::Negative => 1.0,
            TensionReads::Positive => -1.0,
        }
    }

    /// Ratio at rest [V/V] and gauge factor in force: the calibration's, else the raw ones.
    fn zero_and_gauge_factor(&self) -> (f64, f64) {
        match &self.calibration {
            None => (self.initial_mv_per_v * MV_PER_V, self.gauge_factor),
            Some(c) => (
                c.zero_mv_per_v * MV_PER_V,
                c.gauge_factor.unwrap_or(self.gauge_factor),
            ),
        }
    }
}

fn steel_poisson_ratio() -> f64 {
    0.3
}

// Ranges are checked while reading, so that the message points at the number's place in the file.

fn in_range<'de, D: Deserializer<'de>>(
    deserializer: D,
    allowed: &str,
    test: impl Fn(f64) -> bool,
) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    if value.is_finite() && test(value) {
        Ok(value)
    } else {
        Err(D::Error::custom(format_args!(
            "found {value}, allowed is {allowed}"
        )))
    }
}

fn finite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    in_range(deserializer, "a finite number", |_| true)
}

fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    in_range(deserializer, "a number > 0", |v| v > 0.0)
}

fn some_positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    positive(deserializer).map(Some)
}

fn not_negative<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    in_range(deserializer, "a number >= 0", |v| v >= 0.0)
}

fn gauge_factor<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    in_range(deserializer, "0.5 to 200 (about 2 of metals)", |v| {
        (0.5..=200.0).contains(&v)
    })
}

fn gauge_resistance<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    in_range(deserializer, "10 to 100000 (ohm)", |v| {
        (10.0..=1e5).contains(&v)
    })
}

fn poisson_ratio<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    in_range(deserializer, "0 to 0.5", |v| (0.0..=0.5).contains(&v))
}

fn iso_date<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let date = String::deserialize(deserializer)?;
    if is_iso_date(&date) {
        Ok(date)
    } else {
        Err(D::Error::custom(format_args!(
            "found {date:?}, allowed is a date as \"2026-03-31\""
        )))
    }
}

/// Whether `date` is a day of the calendar written `YYYY-MM-DD`.
pub fn is_iso_date(date: &str) -> bool {
    let number = |range: std::ops::Range<usize>| {
        date.get(range)
            .filter(|digits| digits.bytes().all(|b| b.is_ascii_digit()))
            .and_then(|digits| digits.parse::<u32>().ok())
    };
    let (Some(year), Some(month), Some(day)) = (number(0..4), number(5..7), number(8..10)) else {
        return false;
    };
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = match month {
        2 => 28 + u32::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => 0,
    };
    date.len() == 10
        && date.get(4..5) == Some("-")
        && date.get(7..8) == Some("-")
        && (1..=days).contains(&day)
}

#[cfg(test)]
mod tests {
    use super::super::MICROSTRAIN;
    use super::*;

    fn bridge(kind: BridgeKind) -> StrainBridge {
        StrainBridge {
            bridge: kind,
            gauge_factor: 2.0,
            gauge_resistance_ohm: 120.0,
            lead_resistance_ohm: 0.6,
            poisson_ratio: 0.25,
            initial_mv_per_v: 0.0,
            tension_reads: TensionReads::Negative,
            calibration: None,
        }
    }

    const ALL: [BridgeKind; 7] = [
        BridgeKind::Quarter1,
        BridgeKind::Quarter2,
        BridgeKind::Half1,
        BridgeKind::Half2,
        BridgeKind::Full1,
        BridgeKind::Full2,
        BridgeKind::Full3,
    ];

    /// By hand with vr = -1 mV/V, gf = 2, nu = 0.25, rl/rg = 0.005, e.g. quarter:
    /// 4e-3 / (2 * 0.998) * 1.005 = 2014.028 um/m.
    #[test]
    fn worked_examples_of_each_type() {
        for (kind, microstrain) in [
            (BridgeKind::Quarter1, 2_014.028_056),
            (BridgeKind::Quarter2, 2_014.028_056),
            // 4e-3 / (2 (1.25 - 0.0015)) * 1.005
            (BridgeKind::Half1, 1_609.931_918),
            // 2e-3 / 2 * 1.005
            (BridgeKind::Half2, 1_005.0),
            // 1e-3 / 2
            (BridgeKind::Full1, 500.0),
            // 2e-3 / (2 * 1.25)
            (BridgeKind::Full2, 800.0),
            // 2e-3 / (2 (1.25 - 0.00075))
            (BridgeKind::Full3, 800.480_288),
        ] {
            let found = bridge(kind).strain(-1e-3) / MICROSTRAIN;
            assert!((found - microstrain).abs() < 1e-5, "{kind:?}: {found}");
        }
    }

    /// The four arms as resistors in two voltage dividers, gauges placed as each type says.
    #[test]
    fn formulas_agree_with_the_circuit() {
        for kind in ALL {
            let mut b = bridge(kind);
            b.lead_resistance_ohm = 0.0;
            for strain in [-3e-3, -1e-6, 2e-4, 5e-3] {
                let (x, nu) = (2.0 * strain, 0.25);
                // Relative change of R1 to R4.
                let change = match kind {
                    BridgeKind::Quarter1 | BridgeKind::Quarter2 => [0.0, 0.0, 0.0, x],
                    BridgeKind::Half1 => [0.0, 0.0, -nu * x, x],
                    BridgeKind::Half2 => [0.0, 0.0, -x, x],
                    BridgeKind::Full1 => [-x, x, -x, x],
                    BridgeKind::Full2 => [-nu * x, nu * x, -x, x],
                    BridgeKind::Full3 => [-nu * x, x, -nu * x, x],
                };
                let [r1, r2, r3, r4] = change.map(|c| 120.0 * (1.0 + c));
                let ratio = r3 / (r3 + r4) - r2 / (r1 + r2);
                let found = b.strain(ratio);
                assert!((found - strain).abs() < 1e-12, "{kind:?} {strain}: {found}");
            }
        }
    }

    #[test]
    fn ratio_inverts_strain() {
        for kind in ALL {
            for tension_reads in [TensionReads::Negative, TensionReads::Positive] {
                let b = StrainBridge {
                    initial_mv_per_v: 0.7,
                    tension_reads,
                    ..bridge(kind)
                };
                for strain in [-4e-3, 0.0, 1e-6, 2.5e-3] {
                    let back = b.strain(b.ratio(strain));
                    assert!((back - strain).abs() < 1e-14, "{kind:?} {strain}: {back}");
                }
                assert_eq!(b.ratio(0.0), 0.7e-3);
                let rises = b.ratio(1e-3) > b.ratio(0.0);
                assert_eq!(rises, tension_reads == TensionReads::Positive);
            }
        }
    }

    #[test]
    fn description_names_the_place_of_a_wrong_number() {
        let good = "bridge = \"full-2\"\ngauge_factor = 2.08\ngauge_resistance_ohm = 350\n";
        let read: StrainBridge = toml::from_str(good).unwrap();
        assert_eq!((read.bridge, read.poisson_ratio), (BridgeKind::Full2, 0.3));
        let again: StrainBridge = toml::from_str(&toml::to_string(&read).unwrap()).unwrap();
        assert_eq!(again, read);
        let calibration = "[calibration]\ndate = \"2025-02-29\"\nzero_mv_per_v = 0.1\n";
        for (text, line, says) in [
            (
                good.replace("2.08", "-1"),
                2,
                "found -1, allowed is 0.5 to 200",
            ),
            // A point that is missing, and a value in kilohms.
            (good.replace("2.08", "208"), 2, "allowed is 0.5 to 200"),
            (good.replace("350", "0.35"), 3, "allowed is 10 to 100000"),
            (good.replace("2.08", "nan"), 2, "found NaN"),
            (
                good.replace("full-2", "full-4"),
                1,
                "unknown variant `full-4`",
            ),
            (
                format!("{good}poisson_ratio = 0.7"),
                4,
                "allowed is 0 to 0.5",
            ),
            (
                format!("{good}poison_ratio = 0.3"),
                4,
                "unknown field `poison_ratio`",
            ),
            (format!("{good}{calibration}"), 5, "found \"2025-02-29\""),
        ] {
            let error = toml::from_str::<StrainBridge>(&text)
                .unwrap_err()
                .to_string();
            assert!(error.contains(says), "{error}");
            assert!(error.contains(&format!("line {line},")), "{error}");
        }
    }

    #[test]
    fn days_of_the_calendar() {
        for day in ["2024-02-29", "2000-02-29", "2026-12-31"] {
            assert!(is_iso_date(day), "{day}");
        }
        for day in [
            "2023-02-29",
            "1900-02-29",
            "2026-13-01",
            "2026-4-1",
            "2026-04-31",
            "",
            "+026-01-01",
            "2026/01/01",
        ] {
            assert!(!is_iso_date(day), "{day}");
        }
    }
}
