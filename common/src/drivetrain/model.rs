//! Defines the parameters of a gearbox in a model image (`GearboxModel`: transition, noise, loads,
//! channels, encoders), checks their lengths and ranges, and groups the channels that sense the
//! same quantity.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::drivetrain::error_band::ErrorBand;
use crate::drivetrain::fault_isolation::{Consistency, Direction};
use crate::drivetrain::friction::{Friction, MAX_FRICTIONS};
use crate::drivetrain::gauge_response::GaugeResponse;
use crate::drivetrain::steady_gain::SteadyGains;
use crate::error::{Error, finite, positive};
use crate::io::measurement::{AdcScaling, EncoderScaling, IndexPulse};
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS};
use crate::load_signal::{LoadSignal, MAX_STATES, StateVec};
use crate::signal::periodic_lookup::PeriodicLookup;

/// Loads of a gearbox: main shaft and high-speed shaft. A drivetrain with one
/// load carries the second as a constant 0.
pub const LOADS: usize = 2;

/// Most states that are added to one reading: its own drift, and a load that it shares.
const MAX_BIASES: usize = 2;

/// Most rows of `F` above the loads.
const MAX_ROWS: usize = (MAX_STATES - LOADS) * MAX_STATES;

/// Most entries of the lower triangle of the process noise.
const MAX_NOISE: usize = (MAX_STATES - LOADS) * (MAX_STATES - LOADS + 1) / 2;

/// The numbers of a gearbox in a model image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GearboxModel<'a> {
    /// Unit of each state (SI): the filter's state times this is SI.
    pub scale: StateVec<f32>,
    /// `[A B]`, the rows of the transition above the loads, row by row.
    pub transition: Vec<f32, MAX_ROWS>,
    /// Lower triangle of Q above the loads, row by row.
    pub process_noise: Vec<f32, MAX_NOISE>,
    /// Variance of each load's step in one sample.
    pub load_noise: [f32; LOADS],
    /// State at start; the angle is taken from the first encoder.
    pub initial_state: StateVec<f32>,
    /// Its standard deviation.
    pub initial_std: StateVec<f32>,
    /// NIS above which a reading is left out, >= 1.
    pub gate_nis: f32,
    /// The loads, 1 or 2.
    pub loads: Vec<LoadSignal, LOADS>,
    /// Errors of each load in a calibration.
    pub bands: [ErrorBand; LOADS],
    /// Analogue channels in the order of the raw words.
    #[serde(borrow)]
    pub channels: Vec<Channel<'a>, MAX_CHANNELS>,
    /// Encoders in the order of the raw counters.
    pub encoders: Vec<Encoder, MAX_ENCODERS>,
    /// The pulse that homes the carrier angle.
    pub index: Option<IndexPulse>,
    /// Dry friction, inertia by inertia.
    pub frictions: Vec<Friction, MAX_FRICTIONS>,
    /// What the consistency tests allow.
    pub consistency: Consistency,
    /// Gains computed beforehand; without them every sample takes the full recursion.
    #[serde(borrow)]
    pub steady: Option<SteadyGains<'a>>,
}

/// An analogue channel in the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel<'a> {
    /// Raw word to reading, in `unit`s.
    pub converter: AdcScaling,
    /// Size of the reading's unit (SI), > 0: strain is read in micrometres a metre.
    pub unit: f32,
    /// Row `c` in the filter's scale, or the column `B` of a measured drive torque.
    pub row: StateVec<f32>,
    /// What the channel does.
    #[serde(borrow)]
    pub role: Role<'a>,
}

/// What an analogue channel does in the filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Role<'a> {
    /// A measurement.
    Measure {
        /// Reading at zero load.
        offset: f32,
        /// Sensitivity over the carrier angle.
        #[serde(borrow)]
        map: PeriodicLookup<'a>,
        /// Mean of the map over a turn, used until the angle is homed.
        map_mean: f32,
        /// Standard deviation of the map over a turn.
        map_deviation: f32,
        /// Variance of the reading over bins of the carrier angle; eq. (16).
        variance: PeriodicLookup<'a>,
        /// States that are added to the reading.
        biases: Vec<Bias, MAX_BIASES>,
        /// Creep, hysteresis, temperature and delay.
        response: GaugeResponse,
        /// Standard deviation of the model's error at any load, and in parts of what is sensed
        /// at nominal load.
        error: [f32; 2],
    },
    /// A measured torque that drives the train: a known input.
    Drive,
    /// The temperature that gauges answer to (K): a known input.
    Temperature {
        /// Temperature at which their zeros hold; that of the first sample where absent.
        at_zero: Option<f32>,
        /// Part of what is new that is taken in at each sample, above 0 to 1.
        rate: f32,
    },
}

/// A state that is added to a reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// Which state.
    pub state: u8,
    /// What the reading has of it.
    pub factor: f32,
}

/// An encoder in the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Encoder {
    /// Count to carrier angle.
    pub counter: EncoderScaling,
    /// Row of the angle (rad).
    pub row: StateVec<f32>,
    /// Variance of the angle [rad^2], > 0.
    pub variance: f32,
    /// State that a shift of its counts goes into: the carrier angle for the
    /// first encoder, its zero for a further one.
    pub offset_state: u8,
}

// Not generic over the number of states: compiled once, not for each of them.
impl GearboxModel<'_> {
    /// What the channels sense: the first channel of each direction, and the
    /// direction of each channel; known inputs have none, `u8::MAX`.
    ///
    /// Channels whose rows are equal share a direction.
    pub fn directions(&self) -> (Vec<u8, MAX_CHANNELS>, Vec<u8, MAX_CHANNELS>) {
        let mut firsts = Vec::<u8, MAX_CHANNELS>::new();
        let mut of = Vec::new();
        for (i, channel) in self.channels.iter().enumerate() {
            let mut direction = u8::MAX;
            if matches!(channel.role, Role::Measure { .. }) {
                let same = |first: &u8| {
                    let first = self.channels.get(usize::from(*first));
                    first.is_some_and(|first| first.row == channel.row)
                };
                let found = firsts.iter().position(same).unwrap_or(firsts.len());
                if found == firsts.len() {
                    let _ = firsts.push(i as u8);
                }
                direction = found as u8;
            }
            let _ = of.push(direction);
        }
        (firsts, of)
    }

    /// The first channel that is a thermometer, the temperature at which zeros hold, and its rate.
    pub(crate) fn thermometer(&self) -> Option<(u8, Option<f32>, f32)> {
        (self.channels.iter().zip(0..)).find_map(|(channel, i)| match channel.role {
            Role::Temperature { at_zero, rate } => Some((i, at_zero, rate)),
            _ => None,
        })
    }

    /// The gauges of each direction.
    pub(crate) fn members(&self) -> Vec<Direction, MAX_CHANNELS> {
        let (firsts, of) = self.directions();
        (0..firsts.len())
            .map(|d| Direction {
                members: (0..of.len() as u8)
                    .filter(|i| of.get(usize::from(*i)) == Some(&(d as u8)))
                    .collect(),
            })
            .collect()
    }

    /// Whether a channel drives the train, or the zero of one remembers the load.
    #[inline(never)]
    pub(crate) fn has_predicting_channel(&self) -> bool {
        self.channels.iter().any(|channel| match &channel.role {
            Role::Measure { response, .. } => response.has_state(),
            Role::Drive => true,
            Role::Temperature { .. } => false,
        })
    }

    /// Checks every length and range for `states` states.
    pub(crate) fn check(&self, states: usize) -> Result<(), Error> {
        let top = states - LOADS;
        finite(&self.scale, states, "scale")?;
        positive(self.scale.iter().copied(), "scale")?;
        finite(&self.transition, top * states, "transition")?;
        finite(&self.process_noise, top * (top + 1) / 2, "process_noise")?;
        finite(&self.load_noise, LOADS, "load_noise")?;
        finite(&self.initial_state, states, "initial_state")?;
        finite(&self.initial_std, states, "initial_std")?;
        if self.loads.is_empty() {
            return Err(Error::OutOfRange("loads"));
        }
        for load in &self.loads {
            positive([load.full_scale, load.valid_std], "load")?;
        }
        for band in &self.bands {
            band.check()?;
        }
        for channel in &self.channels {
            channel.check(states)?;
        }
        for encoder in &self.encoders {
            finite(&encoder.row, states, "encoder row")?;
            positive([encoder.variance], "encoder variance")?;
            if !(1..=32).contains(&encoder.counter.bits) {
                return Err(Error::OutOfRange("encoder bits"));
            }
            let offset = encoder.row.get(usize::from(encoder.offset_state));
            if !offset.is_some_and(|c| *c != 0.0) {
                return Err(Error::OutOfRange("encoder offset"));
            }
        }
        for friction in &self.frictions {
            friction.check(states, LOADS)?;
        }
        if let Some(index) = &self.index {
            index.check()?;
        }
        self.consistency.check()?;
        match &self.steady {
            Some(gains) => self.check_steady(gains, states),
            None => Ok(()),
        }
    }

    fn check_steady(&self, gains: &SteadyGains<'_>, states: usize) -> Result<(), Error> {
        // A bias is a direction of its own at every angle, a late reading is one at another
        // angle; without an encoder nothing measures the angle.
        let unsteady = |channel: &Channel<'_>| channel.has_bias() || channel.late().is_some();
        if self.channels.iter().any(unsteady) || self.encoders.is_empty() {
            return Err(Error::OutOfRange("steady gains"));
        }
        gains.check(states, self.encoders.len() + self.directions().0.len())
    }
}

impl Channel<'_> {
    fn check(&self, states: usize) -> Result<(), Error> {
        finite(&self.row, states, "channel row")?;
        positive([self.unit], "channel unit")?;
        if !(self.converter.gain.is_finite() && self.converter.gain != 0.0) {
            return Err(Error::OutOfRange("channel gain"));
        }
        if let Role::Temperature { at_zero, rate } = self.role {
            finite(&[at_zero.unwrap_or(0.0)], 1, "temperature")?;
            let known = rate > 0.0 && rate <= 1.0;
            return if known {
                Ok(())
            } else {
                Err(Error::OutOfRange("temperature rate"))
            };
        }
        let Role::Measure {
            offset,
            map,
            map_mean,
            map_deviation,
            variance,
            biases,
            response,
            error,
        } = &self.role
        else {
            return Ok(());
        };
        response.check()?;
        finite(error, 2, "channel error")?;
        finite(&[*offset, *map_mean, *map_deviation], 3, "channel map")?;
        map.validate("channel map")?;
        variance.validate("channel variance")?;
        positive(
            (0..variance.len()).map(|bin| variance.entry(bin)),
            "channel variance",
        )?;
        for bias in biases {
            finite(&[bias.factor], 1, "bias")?;
            // The angle is no bias, the loads are none either.
            if !(1..states - LOADS).contains(&usize::from(bias.state)) {
                return Err(Error::OutOfRange("bias state"));
            }
        }
        Ok(())
    }

    /// Samples by which its readings are old when they come, where they are.
    pub fn late(&self) -> Option<f32> {
        match &self.role {
            Role::Measure { response, .. } if response.late != 0.0 => Some(response.late),
            _ => None,
        }
    }

    /// Standard deviation of its model's error, 0 of a known input.
    pub(crate) fn error(&self) -> [f32; 2] {
        match &self.role {
            Role::Measure { error, .. } => *error,
            Role::Drive | Role::Temperature { .. } => [0.0; 2],
        }
    }

    /// Whether a state is added to its reading.
    pub fn has_bias(&self) -> bool {
        matches!(&self.role, Role::Measure { biases, .. } if !biases.is_empty())
    }
}
