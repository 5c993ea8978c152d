//! Chooses the channels and encoders that an estimator uses, by the name of a sensor set in the
//! description, and the kind of filter (`Sensors`, `Filter`). Refuses more sensors than a sample
//! carries, and maps over an angle that no index pulse homes.

use std::collections::BTreeMap;

use clap::ValueEnum;

use crate::error::BuildError;
use loadtwin_machine::{Auxiliary, Channel, Encoder, Machine, SensorSet};

/// The channels and encoders of a machine that an estimator uses, in the
/// order of the raw words and counters.
#[derive(Clone, Debug)]
pub struct Sensors {
    /// Name of the set.
    pub name: String,
    /// Analogue channels; last the thermometer, where a gauge responds to temperature.
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

/// Name of the set of all sensors, where the description has none of that name.
const ALL: &str = "all";

impl Sensors {
    /// Names of the sets of `machine`; `all` where it describes none.
    pub fn set_names(machine: &Machine) -> Vec<&str> {
        let names = machine.sensor_sets.iter().map(|set| set.name.as_str());
        match machine.sensor_sets.len() {
            0 => vec![ALL],
            _ => names.collect(),
        }
    }

    /// The sensors of the set called `name`, of the first set where there is
    /// no name, or all where there are no sets.
    ///
    /// # Errors
    /// When there is no such set, or there are more sensors than a sample can carry.
    pub fn choose(machine: &Machine, name: Option<&str>) -> Result<Self, BuildError> {
        let set = match name {
            None => machine.sensor_sets.first(),
            // The name that a machine without sets has for all of its sensors.
            Some(ALL) if machine.sensor_sets.iter().all(|set| set.name != ALL) => None,
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
                name: ALL.into(),
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
            loadtwin_common::io::raw::MAX_CHANNELS,
        )?;
        too_many(
            "encoders",
            sensors.encoders.len(),
            loadtwin_common::io::raw::MAX_ENCODERS,
        )?;
        sensors.check_homed(machine)?;
        Ok(sensors)
    }

    /// A map needs an angle that is the same after each start.
    fn check_homed(&self, machine: &Machine) -> Result<(), BuildError> {
        let Some(index) = &machine.index else {
            return Ok(());
        };
        let has_encoder = self.encoders.iter().any(|e| e.name == index.encoder);
        let has_map = |c: &&Channel| c.sensitivity_map.is_some() || c.noise_map.is_some();
        match self.channels.iter().find(has_map) {
            Some(channel) if !has_encoder && !self.encoders.is_empty() => {
                Err(BuildError::NotHomed {
                    set: self.name.clone(),
                    channel: channel.name.clone(),
                    encoder: index.encoder.clone(),
                })
            }
            _ => Ok(()),
        }
    }

    /// Their names in the order of the estimates: channels, then encoders.
    pub fn names(&self) -> Vec<String> {
        let encoders = self.encoders.iter().map(|encoder| encoder.name.clone());
        (self.channels.iter().map(|channel| channel.name.clone()))
            .chain(encoders)
            .collect()
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
