//! Defines the file `machine.toml` in the resources of an FMU (`Interface`): channels and encoders
//! with their quantisation, loads with nominal values, sample rate (Hz). Makes it from a machine
//! description; writes, reads and checks it.

use loadtwin_machine::{Channel, Counter, Encoder, Machine, Quantiser, Rotor};
use loadtwin_recording::{Quantity, Unit};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use loadtwin_common::io::estimate::MAX_LOADS;
use loadtwin_common::io::raw::{MAX_CHANNELS, MAX_ENCODERS};

/// Version of the layout; another one is refused.
const FORMAT: u32 = 1;

/// Why a description in an FMU is refused.
#[derive(Debug, Error)]
pub enum InterfaceError {
    /// No TOML, or not the fields of this version.
    #[error("{0}")]
    Malformed(#[from] toml::de::Error),
    /// A number that the command never writes.
    #[error("{field}: found {found}, allowed: {allowed}")]
    OutOfRange {
        /// The field.
        field: &'static str,
        /// What it holds.
        found: String,
        /// What it may hold.
        allowed: &'static str,
    },
}

/// Sensors and loads of a machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    format: u32,
    /// The machine's name.
    pub machine: String,
    /// Sample rate (Hz), > 0.
    pub rate_hz: f64,
    /// Samples by which the estimates of loads lag.
    pub lag_samples: u32,
    /// Loads in the order of the estimates.
    #[serde(default, rename = "load")]
    pub loads: Vec<Load>,
    /// Analogue channels in the order of the words.
    #[serde(default, rename = "channel")]
    pub channels: Vec<ChannelInput>,
    /// Counting encoders in the order of the counters.
    #[serde(default, rename = "encoder")]
    pub encoders: Vec<EncoderInput>,
    /// The index pulse.
    pub index: Option<IndexInput>,
}

/// A load.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// Nominal value or range (in `unit`), > 0.
    pub nominal: f64,
}

/// An analogue channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelInput {
    /// Its name.
    pub name: String,
    /// SI unit of its reading.
    pub unit: Unit,
    /// From the reading to the word.
    pub quantiser: Quantiser,
}

/// A counting encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncoderInput {
    /// Its name.
    pub name: String,
    /// Unit of its angle or travel; `counts` where that is described in counts.
    pub unit: Unit,
    /// From the angle to the counter.
    pub counter: Counter,
}

/// The index pulse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IndexInput {
    /// Its name.
    pub name: String,
    /// The encoder whose counter it latches; none on a machine without.
    pub encoder: Option<usize>,
}

impl EncoderInput {
    /// The counter's value at an angle, travel or count `at` (in [`Self::unit`]).
    pub fn count(&self, at: f64) -> u32 {
        if self.unit == Unit::COUNTS {
            self.counter.at_count(at)
        } else {
            self.counter.at_angle(at)
        }
    }
}

impl Interface {
    /// That of `machine` with the channels and encoders of its estimator.
    pub fn new(machine: &Machine, channels: &[Channel], encoders: &[Encoder]) -> Self {
        let travel = match machine.travel_unit().map(Unit::quantity) {
            Some(Quantity::Length) => Unit::METRE,
            Some(Quantity::Counts) => Unit::COUNTS,
            _ => Unit::RADIAN,
        };
        let index = machine.index.as_ref().and_then(|index| {
            let encoder = encoders.iter().position(|e| e.name == index.encoder);
            (encoder.is_some() || encoders.is_empty()).then(|| IndexInput {
                name: index.name.clone(),
                encoder,
            })
        });
        Self {
            format: FORMAT,
            machine: machine.name.clone(),
            rate_hz: machine.rate_hz,
            lag_samples: machine.rotor.as_ref().map_or(0, Rotor::lag).into(),
            loads: (machine.loads().iter())
                .map(|load| Load {
                    name: load.name.to_owned(),
                    unit: load.unit,
                    nominal: load.nominal,
                })
                .collect(),
            channels: (channels.iter())
                .map(|channel| ChannelInput {
                    name: channel.name.clone(),
                    unit: channel.unit.si(),
                    quantiser: channel.quantiser(),
                })
                .collect(),
            encoders: (encoders.iter())
                .map(|encoder| EncoderInput {
                    name: encoder.name.clone(),
                    unit: travel,
                    counter: encoder.counter(),
                })
                .collect(),
            index,
        }
    }

    /// Time between two samples (s).
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// As the resource of an FMU.
    ///
    /// # Errors
    /// When a name or number has no TOML.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }

    /// Reads the resource of an FMU.
    ///
    /// # Errors
    /// [`InterfaceError`].
    pub fn from_toml(text: &str) -> Result<Self, InterfaceError> {
        let interface: Self = toml::from_str(text)?;
        interface.check()?;
        Ok(interface)
    }

    fn check(&self) -> Result<(), InterfaceError> {
        let require = |is_allowed, field, found: &dyn std::fmt::Display, allowed| {
            if is_allowed {
                return Ok(());
            }
            Err(InterfaceError::OutOfRange {
                field,
                found: found.to_string(),
                allowed,
            })
        };
        require(self.format == FORMAT, "format", &self.format, "1")?;
        let rate = self.rate_hz;
        let is_rate = rate > 0.0 && rate.is_finite();
        require(is_rate, "rate_hz", &rate, "above 0")?;
        let few = |n, most| n <= most;
        let (loads, channels) = (self.loads.len(), self.channels.len());
        require(few(loads, MAX_LOADS), "load", &loads, "at most 6")?;
        require(
            few(channels, MAX_CHANNELS),
            "channel",
            &channels,
            "at most 8",
        )?;
        let encoders = self.encoders.len();
        require(
            few(encoders, MAX_ENCODERS),
            "encoder",
            &encoders,
            "at most 2",
        )?;
        let words = self
            .channels
            .iter()
            .map(|c| (c.quantiser.bits, c.quantiser.lsb));
        let counters = (self.encoders.iter()).map(|e| (e.counter.bits, e.counter.counts_per_turn));
        for (bits, size) in words.chain(counters) {
            require((8..=32).contains(&bits), "bits", &bits, "8 to 32")?;
            let is_size = size != 0.0 && size.is_finite();
            require(is_size, "lsb or counts_per_turn", &size, "not 0")?;
        }
        let latched = self.index.as_ref().and_then(|index| index.encoder);
        let latched = latched.unwrap_or(0);
        let is_encoder = latched == 0 || latched < encoders;
        require(is_encoder, "index.encoder", &latched, "an encoder")
    }
}

#[cfg(test)]
mod tests {
    use super::Interface;

    const MACHINE: &str = r#"
        format = 1
        machine = "bench"
        rate_hz = 2000
        lag_samples = 2
        [[channel]]
        name = "ta1"
        unit = "m/m"
        quantiser = { lsb = 1.862645149230957e-9, zero = -3, bits = 24 }
        [[encoder]]
        name = "main"
        unit = "rad"
        counter = { counts_per_turn = 1024.1, bits = 16 }
    "#;

    #[test]
    fn what_is_written_is_read_to_the_bit() {
        let mut interface = Interface::from_toml(MACHINE).unwrap();
        for k in 1..1000 {
            interface.channels[0].quantiser.lsb = f64::from(k).sqrt() * 1e-9;
            interface.encoders[0].counter.counts_per_turn = 1e6 / f64::from(k);
            let read = Interface::from_toml(&interface.to_toml().unwrap()).unwrap();
            assert_eq!(read, interface);
        }
    }

    #[test]
    fn numbers_that_the_command_never_writes_are_refused() {
        for (from, to) in [
            ("format = 1", "format = 2"),
            ("2000", "0"),
            ("2000", "nan"),
            ("bits = 24", "bits = 7"),
            ("bits = 16", "bits = 33"),
            ("1024.1", "0"),
            ("1.862645149230957e-9", "inf"),
            ("lag_samples = 2", ""),
            (
                "[[encoder]]",
                "[index]\nname = \"i\"\nencoder = 1\n[[encoder]]",
            ),
        ] {
            let wrong = MACHINE.replace(from, to);
            assert_ne!(wrong, MACHINE, "{from}");
            assert!(Interface::from_toml(&wrong).is_err(), "{to}");
        }
        let many = format!(
            "{MACHINE}{}",
            "[[load]]\nname = \"l\"\nunit = \"N\"\nnominal = 1\n".repeat(7)
        );
        assert!(Interface::from_toml(&many).is_err());
    }
}
