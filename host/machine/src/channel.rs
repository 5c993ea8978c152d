//! Defines the description of an analogue channel (`[[channel]]`): what it senses, sensitivity,
//! noise, errors (drift, creep, hysteresis, delay, temperature, runout). Converts words to readings
//! and back; computes creep, hysteresis, lags and warming over time. Also defines reference and
//! auxiliary columns.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::adc::{Adc, Quantiser};
use crate::strain::{MV_PER_V, StrainBridge};
use crate::time_lag::{followed, lag};
use loadtwin_recording::{Quantity, Unit};

/// An analogue channel.
///
/// `y = offset + m(angle) * s + noise`, where `s` is what it senses and `m` the
/// sensitivity: a constant, or a periodic map over the carrier angle (the
/// reduced strain model).
///
/// Source: Bosmans et al. 2023, eq. (1) and section 4.1.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Column of the recording and name in reports.
    pub name: String,
    /// Unit of the measured quantity; `m/m` for strain, `Nm` for torque.
    pub unit: Unit,
    /// What the channel responds to.
    pub senses: Senses,
    /// Reading at zero load [unit].
    #[serde(default)]
    pub offset: f64,
    /// Reading per unit of what it senses, the mean over the carrier angle
    /// [unit/Nm, unit/(rad/s)]; not 0.
    pub sensitivity: Option<f64>,
    /// CSV file with the sensitivity over the carrier angle: a column
    /// `carrier_angle [rad]` with equal steps over one turn from 0, and a column
    /// `NAME [unit/Nm]` for each channel that names this file.
    pub sensitivity_map: Option<PathBuf>,
    /// Where on the housing a strain gauge sits; `loadtwin reduce` makes its map from this.
    pub place: Option<Place>,
    /// CSV file with the maps of all candidate nodes of the gauge's patch, columns
    /// `NAME/NODE [unit/Nm]`; `loadtwin calibrate` chooses among them.
    pub patch_map: Option<PathBuf>,
    /// Standard deviation of the reading about the model [unit], > 0.
    pub noise_std: f64,
    /// CSV file with the standard deviation over bins of the carrier angle, as
    /// `sensitivity_map`; eq. (15)-(18).
    pub noise_map: Option<PathBuf>,
    /// Slow drift of the zero that no load causes (creep, temperature), which the
    /// filter then estimates as a state of its own.
    pub drift: Option<Drift>,
    /// Reading of one unit of the `bending` load of its drivetrain [unit].
    #[serde(default)]
    pub bending: f64,
    /// Part of the reading by which it is larger at nominal torque than in proportion,
    /// -0.2 to 0.2: `map s (1 + n s / nominal)`, of a channel on a drivetrain.
    #[serde(default)]
    pub nonlinearity: f64,
    /// Creep of the zero under load, of a channel on a drivetrain.
    pub creep: Option<Creep>,
    /// What the zero remembers of the way on which the load came, of a channel on a drivetrain.
    pub hysteresis: Option<Hysteresis>,
    /// How old a reading is when it comes, 0 to 0.2 (s), of a channel on a drivetrain.
    #[serde(default)]
    pub late_s: f64,
    /// What warmth does to zero and reading, of a channel on a drivetrain; needs an
    /// `[[auxiliary]]` of a temperature with `adc`.
    pub thermal: Option<Thermal>,
    /// What a displacement sensor reads of a surface that is out of true [unit]: parts with the
    /// cosine and the sine of the encoder's angle, then of twice and three times that angle.
    #[serde(default)]
    pub runout: Vec<[f64; 2]>,
    /// Where the sensor sits, for tables: `torque arm`, `ring gear`, ...
    pub group: Option<Group>,
    /// The converter; a board and columns of words need it, recorded readings do not.
    pub adc: Option<Adc>,
    /// The strain bridge before the converter; `unit` is then a strain and
    /// `adc.lsb` in mV/V.
    pub bridge: Option<StrainBridge>,
}

impl Channel {
    /// Largest `nonlinearity`, of either sign.
    pub const MOST_NONLINEARITY: f64 = 0.2;

    /// A channel that reads what its converter has, without gauge, noise or effects.
    pub(crate) fn plain(name: &str, unit: Unit, senses: Senses, adc: Adc) -> Self {
        Self {
            name: name.into(),
            unit,
            senses,
            offset: 0.0,
            sensitivity: None,
            sensitivity_map: None,
            place: None,
            patch_map: None,
            noise_std: 0.0,
            noise_map: None,
            drift: None,
            bending: 0.0,
            nonlinearity: 0.0,
            creep: None,
            hysteresis: None,
            late_s: 0.0,
            thermal: None,
            runout: Vec::new(),
            group: None,
            adc: Some(adc),
            bridge: None,
        }
    }

    /// The inertia whose speed it senses.
    pub fn speed_of(&self) -> Option<&str> {
        match &self.senses {
            Senses::Speed(name) => Some(name),
            _ => None,
        }
    }

    /// The converter; where none is described, one that adds no noise to readings.
    pub fn converter(&self) -> Adc {
        self.adc.unwrap_or_else(|| Adc::of_readings(self.noise_std))
    }

    /// A value in the channel's unit, in SI.
    pub fn to_si(&self, value: f64) -> f64 {
        self.unit.to_si(value)
    }

    /// Its sensitivity without a map (SI); 1 where none is described: it reads what it senses, in a
    /// unit of that.
    pub fn sensitivity_si(&self) -> f64 {
        self.sensitivity.map_or(1.0, |own| self.to_si(own))
    }

    /// What it senses once its response is in proportion to it: `s (1 + n s / nominal)`.
    pub fn bent(&self, sensed: f64, nominal: f64) -> f64 {
        sensed * (1.0 + self.nonlinearity * sensed / nominal)
    }

    /// Runout in the reading at the shaft's `angle` [unit].
    ///
    /// `sum_k a_k cos(k angle) + b_k sin(k angle)`
    pub fn runout_at(&self, angle: f64) -> f64 {
        (self.runout.iter().zip(1..))
            .map(|([a, b], k)| {
                let (sine, cosine) = (f64::from(k) * angle).sin_cos();
                a * cosine + b * sine
            })
            .sum()
    }

    /// Reading of one count (SI).
    ///
    /// A bridge is taken as linear about its zero: at 1000 micrometre a metre
    /// that is off by 0.2 % of the reading for a quarter bridge and by nothing
    /// for full bridges I and II.
    pub fn lsb_si(&self) -> f64 {
        match &self.bridge {
            Some(bridge) => {
                let small = 1e-6;
                (bridge.strain(small) - bridge.strain(-small)) / (2.0 * small)
                    * self.ratio_of_count()
            }
            None => self.to_si(self.converter().lsb),
        }
    }

    /// The word at reading 0.
    pub fn zero_word(&self) -> i32 {
        let at_ratio_0 = self
            .bridge
            .as_ref()
            .map_or(0.0, |bridge| bridge.strain(0.0));
        self.converter().zero - (at_ratio_0 / self.lsb_si()).round() as i32
    }

    /// The reading of a converter's word (SI).
    pub fn reading(&self, word: f64) -> f64 {
        (word - f64::from(self.zero_word())) * self.lsb_si()
    }

    /// The converter's word for a reading in SI units.
    pub fn word(&self, value: f64) -> i32 {
        self.quantiser().word(value)
    }

    /// Conversion of readings in SI units to words.
    pub fn quantiser(&self) -> Quantiser {
        Quantiser {
            lsb: self.lsb_si(),
            zero: self.zero_word(),
            bits: self.converter().bits,
        }
    }

    /// The converter's word for a bridge's output [V/V].
    pub fn word_of_ratio(&self, ratio: f64) -> i32 {
        let quantiser = Quantiser {
            lsb: self.ratio_of_count(),
            zero: self.converter().zero,
            bits: self.converter().bits,
        };
        quantiser.word(ratio)
    }

    /// Bridge output of one count [V/V]; `adc.lsb` is in mV/V there.
    fn ratio_of_count(&self) -> f64 {
        self.converter().lsb * MV_PER_V
    }

    /// Equal words in a row after which the channel counts as stuck; 0: never.
    pub fn stuck_after(&self) -> u16 {
        let noise = self.to_si(self.noise_std) - self.to_si(0.0);
        let derived = || Adc::words_until_stuck((noise / self.lsb_si()).abs());
        self.converter().stuck_after.unwrap_or_else(derived)
    }
}

/// Where a strain gauge sits on the housing's finite-element model.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Position, in the coordinates of the finite-element model (m).
    pub position_m: [f64; 3],
    /// Direction of its grid; of any length but 0.
    pub direction: [f64; 3],
    /// Radius of the patch of nodes at which it may really sit (m), > 0.
    #[serde(default = "patch")]
    pub patch_m: f64,
}

fn patch() -> f64 {
    0.02
}

/// Drift of a channel's zero, or of a load that channels share: `b+ = a b + w`, `a = exp(-dt / time_s)`,
/// `var w = std^2 (1 - a^2)`.
///
/// The deviation is bounded by `std`, so that where nothing separates the drift from
/// a load, the load takes the change and its standard deviation grows by no
/// more than the drift's; where the sensitivity varies over the carrier angle,
/// or another sensor contradicts, the drift is found and taken out.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Drift {
    /// Standard deviation in the long run [the unit of what drifts], > 0.
    pub std: f64,
    /// Time constant (s), > 0.
    pub time_s: f64,
}

/// Creep of a zero: `a z`, `dz/dt = (s / nominal - z) / time_s`, `s` what is sensed.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Creep {
    /// `a`: what it comes to in the end at nominal load [the channel's unit].
    pub at_nominal: f64,
    /// Time constant (s), > 0.
    pub time_s: f64,
}

impl Creep {
    /// The zero for each of `levels`, parts of nominal `dt_s` (s) apart [the channel's unit].
    pub fn course(&self, levels: impl IntoIterator<Item = f64>, dt_s: f64) -> Vec<f64> {
        let course = lag(levels, dt_s, self.time_s);
        course.into_iter().map(|z| z * self.at_nominal).collect()
    }
}

/// Hysteresis of a strain: `a z`, `dz = (dl - |dl| z) / level`, `l` what is sensed as part of
/// nominal; `z` is 0 at the start, without load. What is sensed has moved once it is further than a
/// fiftieth of `level` from where it was: noise would forget the way on which the load came.
///
/// Source: Wen 1976 (Bouc-Wen with exponent 1).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hysteresis {
    /// `a`: half the width of the loop [the channel's unit].
    pub half_width: f64,
    /// Part of the nominal load over which it turns, 0.005 to 2.
    pub level: f64,
}

impl Hysteresis {
    /// Least and largest `level`.
    pub const LEVELS: [f64; 2] = [0.005, 2.0];

    /// The zero for each of `levels`, parts of nominal [the channel's unit].
    pub fn course(&self, levels: impl IntoIterator<Item = f64>) -> Vec<f64> {
        levels.into_iter().map(self.walk()).collect()
    }

    /// The zero from one level to the next.
    pub fn walk(self) -> impl FnMut(f64) -> f64 {
        /// Part of `level` by which the load has to be ahead before it counts as moved, as in the
        /// estimator.
        const LAG: f64 = 0.02;
        let (mut moved, mut z): (f64, f64) = (0.0, 0.0);
        move |level| {
            let ahead = (level - moved) / self.level;
            let step = ahead - ahead.clamp(-LAG, LAG);
            moved += step * self.level;
            z = (z + step - step.abs() * z).clamp(-1.0, 1.0);
            self.half_width * z
        }
    }
}

/// Longest `lag_s` of a thermometer (s).
pub const SLOWEST_S: f64 = 3600.0;

/// Longest `late_s` (s).
pub const LATEST_S: f64 = 0.2;

/// What a gauge reads beside `y` when it is `w` warmer than when its zero was taken:
/// `zero_per_k w + gain_per_k w (y - offset)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Thermal {
    /// [the channel's unit a kelvin].
    pub zero_per_k: f64,
    /// [part of the reading a kelvin].
    pub gain_per_k: f64,
}

/// A group of sensors that tables show together.
pub type Group = String;

/// What an analogue channel responds to.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Senses {
    /// The torque that the named shaft carries [N m].
    Shaft(String),
    /// The named load itself [N m].
    Load(String),
    /// The speed of the named inertia [rad/s].
    Speed(String),
    /// Nothing unknown: a measured torque that drives the named inertia
    /// [N m], a known input of the filter.
    Drive(String),
    /// The displacement of a rotor's shaft (m).
    Displacement(Displacement),
    /// The deformation of a bearing's outer ring at the named gauge.
    OuterRing(String),
    /// The temperature of the machine (K), an `[[auxiliary]]`.
    #[serde(skip)]
    Temperature,
}

/// Where and along what a displacement is measured.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Displacement {
    /// Node of the shaft.
    pub node: usize,
    /// Direction from x towards y (degrees): 0 is x, 90 is y.
    pub direction_deg: f64,
}

/// A reference load in recordings.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Column of the recording.
    pub name: String,
    /// The load that it measures.
    pub load: String,
    /// Unit of the column.
    pub unit: Unit,
    /// Factor from the column to the load's sign and size.
    #[serde(default = "one")]
    pub gain: f64,
    /// Value of the column at zero load [unit].
    #[serde(default)]
    pub zero: f64,
}

/// Another recorded quantity. The first temperature is that of the gauges.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Auxiliary {
    /// Column of the recording.
    pub name: String,
    /// Unit of the column.
    pub unit: Unit,
    /// The converter by which the board samples it, of a temperature that gauges' `thermal` needs.
    pub adc: Option<Adc>,
    /// Value at which the gauges' zeros hold [unit]; that of the first sample where absent, as
    /// of gauges that are zeroed before each recording.
    pub at_zero: Option<f64>,
    /// Time constant with which the gauges follow it (s): it sits elsewhere.
    #[serde(default)]
    pub lag_s: f64,
}

impl Auxiliary {
    /// Whether it is a temperature.
    pub fn is_temperature(&self) -> bool {
        self.unit.quantity() == Quantity::Temperature
    }

    /// Where the gauges' zeros hold (K); none where that is the first sample.
    pub fn zero_k(&self) -> Option<f64> {
        Some(self.unit.to_si(self.at_zero?))
    }

    /// How much warmer the gauges are than where zeros hold (K), of a recording's temperatures (K),
    /// one each `dt_s`; where one is missing, as before, and at the start as first known.
    pub fn warming(&self, temperatures: &[f64], dt_s: f64) -> Vec<f64> {
        let known = || temperatures.iter().copied().find(|t| t.is_finite());
        let zero = self.zero_k().or_else(known).unwrap_or(0.0);
        let mut last = known().unwrap_or(zero);
        let mut held = |temperature: &f64| {
            if temperature.is_finite() {
                last = *temperature;
            }
            last - zero
        };
        followed(temperatures.iter().map(&mut held), dt_s, self.lag_s)
    }

    /// As a channel that the board samples, in kelvin; none without converter.
    pub fn sampled(&self) -> Option<Channel> {
        let adc = self.adc.as_ref()?;
        let zero = (self.unit.to_si(0.0) / adc.lsb).round() as i32;
        let adc = Adc {
            zero: adc.zero.saturating_sub(zero),
            ..*adc
        };
        Some(Channel {
            sensitivity: Some(1.0),
            noise_std: adc.lsb.abs(),
            ..Channel::plain(&self.name, self.unit.si(), Senses::Temperature, adc)
        })
    }
}

fn one() -> f64 {
    1.0
}

#[cfg(test)]
mod tests {
    use super::Auxiliary;
    use crate::adc::Adc;
    use loadtwin_recording::Unit;

    #[test]
    fn the_board_samples_kelvins_of_a_thermometer_in_degrees() {
        let adc = Adc {
            lsb: 0.01,
            zero: 500,
            bits: 24,
            stuck_after: None,
            gain: None,
            converter: None,
            excitation_v: None,
        };
        let sampled = Auxiliary {
            name: "housing".into(),
            unit: "°C".parse::<Unit>().unwrap(),
            adc: Some(adc),
            at_zero: None,
            lag_s: 0.0,
        }
        .sampled()
        .unwrap();
        // 20 °C is 2000 counts above the word of 0 °C.
        assert_eq!(sampled.word(293.15), 2500);
        assert_eq!(sampled.lsb_si(), 0.01);
    }
}
