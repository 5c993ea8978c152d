//! Reads a machine description from TOML and checks it (`Machine::load`). This file defines its top
//! level, sensor sets, segments and tuning, and finds sensors by role and the paths of named files.
//! The modules define the parts.
//!
//! Every unknown field is refused. Fields are checked for their range by
//! [`Machine::load`], and each error names the file, the line, the field and
//! what is allowed.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

mod adc;
mod angle_map;
mod bearing;
mod channel;
mod channel_encoding;
mod converter;
mod count;
mod description_check;
mod drive_balance;
mod drive_sensors;
mod drivetrain;
mod encoder;
mod error;
mod field_checks;
mod friction;
mod gears;
mod kind;
mod named_files;
mod ross;
mod rotor;
mod rotor_bearing;
mod rotor_sensors;
pub mod strain;
mod time_lag;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use adc::{Adc, AdcFields, Quantiser, extreme_words};
pub use angle_map::{
    MAP_ENTRIES, MAPS, complete_columns, read_column, read_columns, resampled, six_digits,
    write_columns,
};
pub use bearing::{
    BEARING_LOADS, Bearing, BearingFilter, LoadRanges, OuterRingGauge, PreloadAlong, SHAPES,
};
pub use channel::{
    Auxiliary, Channel, Creep, Displacement, Drift, Group, Hysteresis, LATEST_S, Place, Reference,
    SLOWEST_S, Senses, Thermal,
};
pub use channel_encoding::Encoding;
pub use converter::Converter;
pub use count::Count;
pub use drive_balance::{Balance, BalanceEffect, Estimated, Regime, Signal};
pub use drivetrain::{Direction, Drivetrain, ErrorBand, Inertia, Load, MOST_INERTIAS, Shaft};
pub use encoder::{Counter, Eccentricity, Encoder, Index, IndexSignal, QUANTISATION};
pub use error::{MachineError, Violation};
pub use friction::{CREEP, Friction};
pub use gears::{Gears, Helical, Planetary, ShaftBearing};
pub use kind::{Kind, NamedLoad, UNKNOWN_LOAD};
pub use named_files::named_files;
pub use ross::{RossError, read_ross};
pub use rotor::{Disc, LoadKind, MOST_LOADS, Material, Reduction, Rotor, RotorLoad, Section};
pub use rotor_bearing::{BearingAt, Coefficients, RotorBearing};
pub use time_lag::{earlier, followed, lag};

use loadtwin_files::file_kind::{self, FileKind};
use loadtwin_files::{bounded, mark};
use loadtwin_recording::CsvLayout;

/// A machine: its mechanics, its sensors, its recordings.
///
/// Exactly one of `drivetrain`, `rotor`, `bearing` and `balance` says what kind it is.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Version of this format; 1.
    pub format: u32,
    /// What the machine is called in reports.
    pub name: String,
    /// Which machine of its kind it is, as a serial number; `name` where absent. A board takes
    /// only images for the machine in its key page.
    pub id: Option<String>,
    /// Sample rate of the estimator (Hz), 1 to 20000.
    pub rate_hz: f64,
    /// First identifier of the machine's frames on the CAN bus, a multiple of 32, 0 to 0x7c0.
    #[serde(default = "can_base")]
    pub can_base: u16,
    /// A gearbox or another torsional drivetrain.
    pub drivetrain: Option<Drivetrain>,
    /// A flexible rotor on bearings.
    pub rotor: Option<Rotor>,
    /// A wheel bearing.
    pub bearing: Option<Bearing>,
    /// A measured drive without gauges.
    pub balance: Option<Balance>,
    /// Analogue channels: strain gauges, torque transducers, tachometers.
    #[serde(default, rename = "channel")]
    pub channels: Vec<Channel>,
    /// Counting encoders.
    #[serde(default, rename = "encoder")]
    pub encoders: Vec<Encoder>,
    /// The once-per-revolution pulse that homes the carrier angle.
    pub index: Option<Index>,
    /// Reference loads that a recording may carry; never seen by the estimator.
    #[serde(default, rename = "reference")]
    pub references: Vec<Reference>,
    /// Other quantities that a recording may carry, such as temperature.
    #[serde(default, rename = "auxiliary")]
    pub auxiliaries: Vec<Auxiliary>,
    /// Loads whose cycles a board is to count, at most 2.
    #[serde(default, rename = "count")]
    pub counts: Vec<Count>,
    /// Named sets of sensors; the first is the default.
    #[serde(default, rename = "sensor_set")]
    pub sensor_sets: Vec<SensorSet>,
    /// Time segments in which errors are reported apart.
    #[serde(default, rename = "segment")]
    pub segments: Vec<Segment>,
    /// How the filter is tuned.
    #[serde(default)]
    pub tuning: Tuning,
    /// How recordings are laid out, where it is not by the usual header.
    #[serde(default)]
    pub recording: CsvLayout,
    /// Where the description was read from; files that it names are relative to it.
    #[serde(skip)]
    pub path: PathBuf,
}

fn can_base() -> u16 {
    0x100
}

/// Channels and encoders that are used together.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorSet {
    /// What `--sensors` calls it.
    pub name: String,
    /// Channels by name, at most 8.
    pub channels: Vec<String>,
    /// Encoders by name, at most 2; all of the machine's where absent.
    pub encoders: Option<Vec<String>>,
    /// Random walk of each load by name with these sensors [N m/sqrt(s)], > 0, in
    /// place of the load's own. `loadtwin tune` finds it.
    #[serde(default)]
    pub walk_nm_per_sqrt_s: BTreeMap<String, f64>,
}

/// A stretch of the recording, from `from_s` up to but without `to_s`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Key of its figures in tables and in JSON.
    pub name: String,
    /// Start (s), in the recording's time; from its first row on where that lies beyond the last
    /// bound of a segment by more than they all span (times since 1970).
    pub from_s: f64,
    /// End (s); the end of the recording where absent.
    pub to_s: Option<f64>,
}

/// Noise levels that are not properties of a single sensor.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tuning {
    /// Relative standard deviation of the drivetrain's parameters, from which
    /// the process noise follows (paper: 0.1), 0 to 1.
    pub parameter_std: f64,
    /// Highest frequency at which a load is wanted (Hz), > 0, below half the
    /// sample rate: the pass band for which `loadtwin tune` chooses the random
    /// walks (paper: 10).
    pub cutoff_hz: f64,
    /// A channel is left out of a sample when its normalised innovation
    /// squared exceeds this, >= 1. 25 is five standard deviations.
    pub gate_nis: f64,
}

impl Default for Tuning {
    fn default() -> Self {
        Self {
            parameter_std: 0.1,
            cutoff_hz: 10.0,
            gate_nis: 25.0,
        }
    }
}

/// What is written as a machine description.
pub const DESCRIPTION: FileKind = FileKind {
    noun: "description",
    suffixes: &["toml"],
    is_same: |file| {
        Ok(mark::is_intact(
            DESCRIPTION.noun,
            &file.whole(bounded::DESCRIPTION)?,
        ))
    },
};

/// The text of the description in `path`.
///
/// # Errors
/// When it cannot be read, is too long, or is no text.
pub fn read_description(path: &Path) -> Result<String, MachineError> {
    let failed = |source| MachineError::Read {
        path: path.to_owned(),
        source,
    };
    let bytes = bounded::read(path, bounded::DESCRIPTION).map_err(failed)?;
    String::from_utf8(bytes).map_err(|error| {
        let bytes = error.as_bytes();
        let is_utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
        match file_kind::named(bytes) {
            file_kind::TOML | file_kind::OTHER => {
                MachineError::encoding(path, bytes, error.utf8_error().valid_up_to())
            }
            _ if is_utf16 => MachineError::encoding(path, bytes, 0),
            found => other_file(path, found),
        }
    })
}

fn other_file(path: &Path, found: &str) -> MachineError {
    MachineError::Syntax {
        path: path.to_owned(),
        line: 1,
        column: 1,
        message: format!(
            "found {found}, allowed: a machine description (TOML); it comes first, recordings after it"
        ),
    }
}

impl Machine {
    /// The temperature that the gauges respond to: the first that a recording may carry.
    pub fn thermometer(&self) -> Option<&Auxiliary> {
        self.auxiliaries.iter().find(|a| a.is_temperature())
    }

    /// The same, to change it.
    pub fn thermometer_mut(&mut self) -> Option<&mut Auxiliary> {
        self.auxiliaries.iter_mut().find(|a| a.is_temperature())
    }

    /// The encoder whose count the index pulse latches.
    pub fn homed_encoder(&self) -> Option<&Encoder> {
        let index = self.index.as_ref()?;
        self.encoders.iter().find(|e| e.name == index.encoder)
    }

    /// Whether the index pulse fixes the angle of that encoder's disc: it turns as the pulse does.
    pub fn index_turns_with(&self, encoder: &Encoder) -> bool {
        let latches = self.homed_encoder().is_some_and(|e| e.name == encoder.name);
        let mut inertias = self.drivetrain.iter().flat_map(|chain| &chain.inertias);
        latches && inertias.any(|i| i.name == encoder.inertia && i.speed_ratio == 1.0)
    }

    /// How far ahead that encoder reads at an angle, when the pulse has set it right (rad).
    pub fn homed_error(&self) -> impl Fn(f64) -> f64 + use<> {
        let eccentricity = self.homed_encoder().and_then(|e| e.eccentricity);
        let known = self.index.as_ref().zip(eccentricity);
        let known = known.map(|(index, disc)| (disc, disc.error(index.angle_rad)));
        move |angle| known.map_or(0.0, |(disc, at_pulse)| disc.error(angle) - at_pulse)
    }

    /// Reads and checks the description in `path`.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, has an unknown field or one
    /// out of its range; the error names file, line and field.
    pub fn load(path: &Path) -> Result<Self, MachineError> {
        let text = read_description(path)?;
        let mut machine: Self =
            toml::from_str(&text).map_err(|error| match file_kind::named(text.as_bytes()) {
                file_kind::TOML | file_kind::OTHER => MachineError::syntax(path, &text, &error),
                found => other_file(path, found),
            })?;
        machine
            .read_ross_model(path)
            .and_then(|()| machine.check())
            .map_err(|violation| MachineError::violation(path, &text, violation))?;
        machine.add_drive_sensors();
        path.clone_into(&mut machine.path);
        let folder = path.parent().unwrap_or(Path::new(""));
        machine.recording = machine.recording.resolved(folder).map_err(Box::new)?;
        machine.recording.rate_hz = Some(machine.rate_hz);
        Ok(machine)
    }

    /// The same with the recording layout in `path` in place of its own, of which only the
    /// `channels` are kept.
    ///
    /// # Errors
    /// When the file cannot be read, is no TOML, or has a field that is not known.
    pub fn with_layout(mut self, path: &Path) -> Result<Self, MachineError> {
        let channels = std::mem::take(&mut self.recording.channels);
        self.recording = CsvLayout::load(path).map_err(Box::new)?;
        self.recording.channels.extend(channels);
        self.recording.rate_hz = Some(self.rate_hz);
        Ok(self)
    }

    /// Fills in the rotor from the model of ROSS that it names.
    fn read_ross_model(&mut self, path: &Path) -> Result<(), Violation> {
        let Some(rotor) = &mut self.rotor else {
            return Ok(());
        };
        let Some(file) = rotor.ross_model.clone() else {
            return Ok(());
        };
        let refused = |found: String, allowed: &str| Violation {
            field: "rotor.ross_model".into(),
            found,
            allowed: allowed.into(),
        };
        if !(rotor.sections.is_empty() && rotor.discs.is_empty() && rotor.bearings.is_empty()) {
            let allowed = "either ross_model, or sections, discs and bearings";
            return Err(refused("both".into(), allowed));
        }
        let found = path.parent().unwrap_or(Path::new("")).join(&file);
        read_ross(&found, rotor).map_err(|error| {
            let allowed = "a rotor of cylinders, discs and bearings, saved by ROSS 2";
            refused(format!("{}: {error}", file.display()), allowed)
        })
    }

    /// The error of a field that is found wrong after reading, with its line in the file.
    pub fn refused(&self, violation: Violation) -> MachineError {
        let text = read_description(&self.path).unwrap_or_default();
        MachineError::violation(&self.path, &text, violation)
    }

    /// Identifies the machine to its board.
    pub fn id(&self) -> &str {
        self.id.as_deref().unwrap_or(&self.name)
    }

    /// A file that the description names, relative to the description.
    pub fn resolve(&self, file: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(file)
    }
}
