//! `loadtwin build`: machine description to model image.

pub(crate) mod encoder;

use std::collections::BTreeMap;

use clap::ValueEnum;
use loadtwin_common::image::{Image, Model, VERSION};
use thiserror::Error;

use crate::rotor::{RotorError, RotorPlan};
use crate::{bearing, gearbox};
use loadtwin_machine::{Auxiliary, Channel, Encoder, Kind, Machine, MachineError, SensorSet};

/// The channels and encoders of a machine that an estimator uses, in the
/// order of the raw words and counters.
#[derive(Clone, Debug)]
pub struct Sensors {
    /// Name of the set.
    pub name: String,
    /// Analogue channels; last the thermometer, where a gauge answers to warmth.
    pub channels: Vec<Channel>,
    /// Counting encoders.
    pub encoders: Vec<Encoder>,
    /// Random walk of loads by name, in place of the load's own [N m/sqrt(s)].
    pub walks: BTreeMap<String, f64>,
    /// What they are filtered by.
    pub filter: Filter,
}

/// The filters that an image can ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Filter {
    /// Augmented extended Kalman filter.
    #[default]
    Aekf,
    /// The same with gains computed beforehand over the carrier angle; start,
    /// standstill and faults by the full recursion.
    Steady,
}

impl Filter {
    /// What `--filter` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Aekf => "aekf",
            Self::Steady => "steady",
        }
    }
}

/// Why no image can be made.
#[derive(Debug, Error)]
pub enum BuildError {
    /// The machine is of a kind that has no estimator.
    #[error("{}: found no machine to estimate loads of, allowed: a table [drivetrain] (one with [balance] is for `loadtwin diagnose`)", .0.display())]
    NoEstimator(std::path::PathBuf),
    /// A file that the description names cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// There is no such set of sensors.
    #[error("no sensor set {found:?}; allowed: {allowed}")]
    NoSuchSet {
        /// What was asked for.
        found: String,
        /// What there is.
        allowed: String,
    },
    /// More than an image holds.
    #[error("{0} is larger than an image can hold")]
    TooLarge(&'static str),
    /// A bearing's phases were lost on the rig.
    #[error(
        "the phases of ball passing were followed in {part:.0} % of the recording; at least {least:.0} % is needed: check gauges, wheel encoder and number of balls"
    )]
    NotFollowed {
        /// Part that was followed [%].
        part: f64,
        /// Part that is needed [%].
        least: f64,
    },
    /// The model's numbers are refused by the estimator.
    #[error("the model is refused: {0}")]
    Model(loadtwin_common::Error),
    /// There are no steady gains.
    #[error(
        "no steady gains with these sensors: {0}; allowed: --filter aekf, or sensors that observe every load"
    )]
    NotSteady(&'static str),
    /// A rotor that cannot be computed.
    #[error("rotor: {0}")]
    Rotor(#[from] RotorError),
    /// A filter that only drivetrains have.
    #[error(
        "--filter: found steady, allowed on a rotor or a bearing: aekf (a rotor takes the steady \
         gains of its speed by itself)"
    )]
    OnlyDrivetrains,
    /// More modes than any filter of a rotor has.
    #[error(
        "rotor.reduction.modes: found {found}, allowed: at most {most} beside the {loads} loads"
    )]
    TooManyModes {
        /// Modes that were asked for.
        found: usize,
        /// Most that there are beside the loads.
        most: usize,
        /// Number of loads.
        loads: usize,
    },
    /// A mode's speed cannot be seen in its displacements.
    #[error(
        "rate_hz: found a rate that samples a mode at a multiple of half its period, allowed: \
         another rate, or fewer rotor.reduction.modes"
    )]
    Sampled,
    /// The sensors do not see what is to be estimated.
    #[error("no steady filter exists with these sensors: a load or a mode is not observed")]
    NotObserved,
    /// There are more sensors than one sample can carry.
    #[error(
        "{found} {what} without a sensor set; allowed: at most {most}, or a [[sensor_set]] that chooses"
    )]
    TooMany {
        /// Channels or encoders.
        what: &'static str,
        /// How many.
        found: usize,
        /// How many are allowed.
        most: usize,
    },
}

impl Sensors {
    /// The sensors of the set called `name`, of the first set where there is
    /// no name, or all where there are no sets.
    ///
    /// # Errors
    /// When there is no such set, or there are more sensors than a sample can carry.
    pub fn choose(machine: &Machine, name: Option<&str>) -> Result<Self, BuildError> {
        let set = match name {
            None => machine.sensor_sets.first(),
            Some(name) => Some(
                machine
                    .sensor_sets
                    .iter()
                    .find(|set| set.name == name)
                    .ok_or_else(|| {
                        let names: Vec<&str> = machine
                            .sensor_sets
                            .iter()
                            .map(|set| set.name.as_str())
                            .collect();
                        let allowed = if names.is_empty() {
                            "none is described".into()
                        } else {
                            names.join(", ")
                        };
                        BuildError::NoSuchSet {
                            found: name.into(),
                            allowed,
                        }
                    })?,
            ),
        };
        let mut sensors = set.map_or_else(
            || Self {
                name: "all".into(),
                channels: machine.channels.clone(),
                encoders: machine.encoders.clone(),
                walks: BTreeMap::new(),
                filter: Filter::default(),
            },
            |set| Self::of_set(machine, set),
        );
        if sensors.channels.iter().any(|c| c.thermal.is_some()) {
            let thermometer = machine.thermometer().and_then(Auxiliary::sampled);
            sensors.channels.extend(thermometer);
        }
        let too_many = |what, found, most| {
            if found > most {
                Err(BuildError::TooMany { what, found, most })
            } else {
                Ok(())
            }
        };
        too_many(
            "channels",
            sensors.channels.len(),
            loadtwin_common::raw::MAX_CHANNELS,
        )?;
        too_many(
            "encoders",
            sensors.encoders.len(),
            loadtwin_common::raw::MAX_ENCODERS,
        )?;
        Ok(sensors)
    }

    /// The same sensors with `filter`.
    #[must_use]
    pub fn filtered_by(self, filter: Filter) -> Self {
        Self { filter, ..self }
    }

    fn of_set(machine: &Machine, set: &SensorSet) -> Self {
        let channel = |name: &String| machine.channels.iter().find(|c| c.name == *name).cloned();
        let encoder = |name: &String| machine.encoders.iter().find(|e| e.name == *name).cloned();
        Self {
            name: set.name.clone(),
            channels: set.channels.iter().filter_map(channel).collect(),
            walks: set.walk_nm_per_sqrt_s.clone(),
            filter: Filter::default(),
            encoders: match &set.encoders {
                Some(names) => names.iter().filter_map(encoder).collect(),
                None => machine.encoders.clone(),
            },
        }
    }
}

/// The image's payload for `machine` with `sensors`.
///
/// # Errors
/// When a file that the description names cannot be used, or the model does
/// not fit an image.
pub fn image(machine: &Machine, sensors: &Sensors) -> Result<Vec<u8>, BuildError> {
    match machine.kind() {
        Some(Kind::Drivetrain(drivetrain)) => gearbox::image(machine, drivetrain, sensors),
        Some(_) if sensors.filter == Filter::Steady => Err(BuildError::OnlyDrivetrains),
        Some(Kind::Rotor(rotor)) => {
            RotorPlan::new(machine, rotor, &sensors.channels)?.image(machine, rotor, sensors)
        }
        Some(Kind::Bearing(bearing)) => bearing::image(machine, bearing, sensors),
        None => Err(BuildError::NoEstimator(machine.path.clone())),
    }
}

/// The image's payload for `machine` with its `model`.
pub(crate) fn packed(machine: &Machine, model: Model<'_>) -> Result<Vec<u8>, BuildError> {
    let image = Image {
        version: VERSION,
        machine: &machine.name,
        rate_hz: machine.rate_hz as f32,
        can_base: machine.can_base,
        model,
    };
    postcard::to_stdvec(&image).map_err(|_| BuildError::TooLarge("the image"))
}
