//! Lists the errors of description or recording that the cause search tests as hypotheses, each
//! with its correction of the readings and a remedy: sign, unit, zero, scale, exchanged sensors,
//! counts per turn, index angle, sample rate, sign of a reference.

use std::f64::consts::TAU;

use super::SensorConsistency;
use crate::reading_correction::Correction;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Channel, Machine, Senses};

/// Factors by which units, amplifiers and bridges are mistaken: decimal prefixes; quarter, half and
/// full bridge; kilogram-force; inch.
const FACTORS: [f64; 18] = [
    1e-9,
    1e-6,
    1e-3,
    1e-2,
    0.1,
    0.25,
    0.5,
    2.0,
    4.0,
    10.0,
    1e2,
    1e3,
    1e6,
    1e9,
    9.806_65,
    1.0 / 9.806_65,
    25.4,
    1.0 / 25.4,
];

/// Factors on the counts per turn: lines for edges, one channel for two.
const COUNTS: [f64; 4] = [0.25, 0.5, 2.0, 4.0];

/// Factors on the sample rate.
const RATES: [f64; 4] = [0.1, 0.5, 2.0, 10.0];

/// Turns of the index pulse that are compared first, parts of a turn: a map of the lowest orders
/// differs least between two of them.
pub(super) const SHIFTS: u32 = 16;

/// One possible cause.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    pub kind: &'static str,
    pub what: String,
    pub remedy: String,
    pub correction: Correction,
    /// Numbers of it that were fitted to the recording.
    pub fitted: u32,
    /// The channel whose zero or scale is fitted.
    pub fitted_channel: Option<usize>,
    /// Angle by which the index pulse is elsewhere than described [rad].
    pub index_rad: f64,
    /// Rate at which rows were taken over that of the description.
    pub rate: f64,
    /// Factor on each reference.
    pub references: Vec<f64>,
}

/// Everything as described, then all that may be wrong.
pub(super) fn all(
    machine: &Machine,
    sensors: &Sensors,
    found: &[SensorConsistency],
) -> Vec<Hypothesis> {
    let described = Hypothesis {
        kind: "none",
        what: String::new(),
        remedy: String::new(),
        correction: Correction::none(sensors),
        fitted: 0,
        fitted_channel: None,
        index_rad: 0.0,
        rate: 1.0,
        references: vec![1.0; machine.references.len()],
    };
    let mut all = vec![described.clone()];
    all.extend(of_channels(&described, machine, &sensors.channels));
    all.extend(fitted(&described, sensors, found));
    all.extend(of_encoders(&described, sensors));
    let is_map = |channel: &Channel| channel.sensitivity_map.is_some();
    if machine.index.is_some() && sensors.channels.iter().any(is_map) {
        let shifts = (1..SHIFTS).map(|k| TAU * f64::from(k) / f64::from(SHIFTS));
        all.extend(shifts.filter_map(|by| described.homed_at(machine, by)));
    }
    // Times in the file say the rate themselves.
    let rates = RATES.into_iter();
    let unstated = rates.filter(|_| machine.recording.row_period_ms.is_some());
    all.extend(unstated.map(|factor| Hypothesis {
        kind: "rate",
        what: format!(
            "rows at {} Hz, rate_hz {}",
            machine.rate_hz * factor,
            machine.rate_hz
        ),
        remedy: "set rate_hz and row_period_ms under [recording]".into(),
        rate: factor,
        ..described.clone()
    }));
    for (k, reference) in machine.references.iter().enumerate() {
        let mut other = Hypothesis {
            kind: "reference",
            what: format!("the sign of {}", reference.name),
            remedy: "set the reference's gain to the other sign".into(),
            ..described.clone()
        };
        other.references[k] = -1.0;
        all.push(other);
    }
    all
}

fn of_channels(described: &Hypothesis, machine: &Machine, channels: &[Channel]) -> Vec<Hypothesis> {
    let measured: Vec<usize> = (0..channels.len())
        .filter(|k| channels[*k].senses != Senses::Temperature)
        .collect();
    let mut groups: Vec<Vec<usize>> = measured.iter().map(|k| vec![*k]).collect();
    if measured.len() > 1 {
        groups.push(measured.clone());
    }
    let mut all = Vec::new();
    for group in &groups {
        let names: Vec<&str> = group.iter().map(|k| channels[*k].name.as_str()).collect();
        // Of all sensors and of all references cannot be distinguished.
        let all_of_some = group.len() > 1 && !machine.references.is_empty();
        let also = if all_of_some {
            ", or of each reference"
        } else {
            ""
        };
        let names = names.join(", ");
        let scaled = |factor: f64| {
            let mut correction = described.correction.clone();
            for k in group {
                correction.channels[*k].factor = factor;
            }
            correction
        };
        all.push(Hypothesis {
            kind: "sign",
            what: format!("the sign of {names}{also}"),
            remedy: "exchange the wires, or negate sensitivity and offset".into(),
            correction: scaled(-1.0),
            ..described.clone()
        });
        all.extend(FACTORS.into_iter().map(|factor| Hypothesis {
            kind: "unit",
            what: format!("the unit or scale of {names}, times {factor:.6}"),
            remedy: "correct the unit of the column, the gauge factor or the bridge".into(),
            correction: scaled(factor),
            ..described.clone()
        }));
    }
    for (i, a) in measured.iter().enumerate() {
        for b in &measured[i + 1..] {
            if channels[*a].unit.quantity() != channels[*b].unit.quantity() {
                continue;
            }
            let mut correction = described.correction.clone();
            correction.channels.swap(*a, *b);
            all.push(Hypothesis {
                kind: "swap",
                what: format!("{} and {} exchanged", channels[*a].name, channels[*b].name),
                remedy: "exchange connectors or columns".into(),
                correction,
                ..described.clone()
            });
        }
    }
    all
}

/// Zero and scale of each sensor that contradicts the model, as its readings over the predicted ones
/// have them.
fn fitted(
    described: &Hypothesis,
    sensors: &Sensors,
    found: &[SensorConsistency],
) -> Vec<Hypothesis> {
    let mut all = Vec::new();
    let of_channels = found.iter().take(sensors.channels.len());
    for (k, sensor) in of_channels.enumerate().filter(|(_, s)| s.disagrees()) {
        for (kind, fitted) in [("zero", 1), ("scale", 2)] {
            let as_described = Hypothesis {
                kind,
                fitted,
                fitted_channel: Some(k),
                remedy:
                    "check amplifier, gauge factor and zero, or fit them with `loadtwin calibrate`"
                        .into(),
                ..described.clone()
            };
            all.extend(as_described.refitted(sensors, sensor));
        }
    }
    all
}

impl Hypothesis {
    /// With the zero or the scale of its channel corrected once more, by what the corrected readings
    /// over the predicted ones still have.
    ///
    /// One round leaves the part of the error that the reading itself has put into the prediction.
    pub fn refitted(&self, sensors: &Sensors, found: &SensorConsistency) -> Option<Self> {
        let k = self.fitted_channel?;
        let [gain, offset] = match self.kind {
            "zero" => [1.0, found.zero?],
            _ => found.line?,
        };
        let mut refitted = self.clone();
        let correction = &mut refitted.correction.channels[k];
        correction.factor /= gain;
        correction.offset = (correction.offset - offset) / gain;
        let (channel, gain) = (&sensors.channels[k], 1.0 / correction.factor);
        let offset = -correction.offset * gain;
        let (name, unit) = (&channel.name, channel.unit);
        let shown = format!("{:.2e} {unit}", unit.from_si(offset));
        refitted.what = match self.kind {
            "zero" => format!("{name} reads {shown} too much"),
            _ => format!("{name} reads with gain {gain:.2} and an offset of {shown}"),
        };
        Some(refitted)
    }

    /// With the index pulse `by` [rad] elsewhere.
    pub fn homed_at(&self, machine: &Machine, by: f64) -> Option<Self> {
        let described = machine.index.as_ref()?.angle_rad;
        let angle = (described + by).rem_euclid(TAU);
        let off = by - TAU * (by / TAU).round();
        Some(Self {
            kind: "index",
            what: format!("the angle of the index pulse, off by {off:.2} rad"),
            remedy: format!(
                "check the place of the pulse, or set angle_rad = {angle:.3} of [index]"
            ),
            fitted: 1,
            index_rad: by,
            ..self.clone()
        })
    }
}

fn of_encoders(described: &Hypothesis, sensors: &Sensors) -> Vec<Hypothesis> {
    let mut all = Vec::new();
    for (k, encoder) in sensors.encoders.iter().enumerate() {
        let mut scaled = |kind, what: String, remedy: &str, factor: f64| {
            let mut correction = described.correction.clone();
            correction.encoders[k].1 = factor;
            all.push(Hypothesis {
                kind,
                what,
                remedy: String::from(remedy),
                correction,
                ..described.clone()
            });
        };
        let name = &encoder.name;
        scaled(
            "sign",
            format!("the direction of {name}"),
            "exchange its two channels, or negate the column",
            -1.0,
        );
        for factor in COUNTS {
            let counts = encoder.counts_per_turn / factor;
            let what = format!("{counts} counts a turn of {name}");
            scaled("counts", what, "set counts_per_turn", factor);
        }
    }
    if let [a, b] = sensors.encoders.as_slice() {
        let mut correction = described.correction.clone();
        correction.encoders.swap(0, 1);
        all.push(Hypothesis {
            kind: "swap",
            what: format!("{} and {} exchanged", a.name, b.name),
            remedy: "exchange connectors or columns".into(),
            correction,
            ..described.clone()
        });
    }
    all
}
