//! Tests on hold-out data whether tuned noise is shown to be no worse than described noise
//! (non-inferiority): measured R with the tuned random walks of the loads, and where these are
//! refused, measured R with the described walks.

use std::collections::BTreeMap;
use std::path::PathBuf;

use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::{Comparison, Course, ReplayError};

/// Last part of each recording that is held out where no other recording is given.
pub const HOLDOUT_PART: f64 = 1.0 / 3.0;

/// Data that took no part.
#[derive(Clone, Copy, Debug)]
pub struct Holdout<'a> {
    /// The recordings.
    pub recordings: &'a [PathBuf],
    /// The last part of each, above 0 up to 1.
    pub part: f64,
}

/// A description with measured R, beside the one as described.
#[derive(Clone, Copy)]
pub struct Descriptions<'a> {
    /// As described.
    pub described: &'a Machine,
    /// With measured R; the same where R is kept.
    pub measured: &'a Machine,
}

/// One set of sensors on the hold-out data.
#[derive(Clone, Debug)]
pub struct Check {
    /// The set.
    pub sensors: String,
    /// With measured R and the tuned walks; none of a set that is not tuned.
    pub tuned: Option<Comparison>,
    /// With measured R and the described walks; only where the tuned walks are not used.
    pub measured: Option<Comparison>,
}

impl Check {
    /// Whether the tuned walks are used.
    pub fn takes_walks(&self) -> bool {
        (self.tuned.as_ref()).is_some_and(Comparison::is_shown_no_worse)
    }

    /// Whether measured R is not shown to make the set no worse, with the tuned walks and without.
    pub fn refuses_noise(&self) -> bool {
        !self.takes_walks()
            && (self.measured.as_ref()).is_some_and(|measured| !measured.is_shown_no_worse())
    }
}

impl Holdout<'_> {
    /// Evaluates the set called `name` with measured R and `walks` of the loads by name (in
    /// N m/sqrt(s)); where there are none, or they are not shown to make it no worse, with measured
    /// R and its described walks.
    ///
    /// # Errors
    /// When a machine or a recording cannot be used.
    pub fn check(
        &self,
        descriptions: Descriptions<'_>,
        name: Option<&str>,
        walks: Option<&BTreeMap<String, f64>>,
    ) -> Result<Check, ReplayError> {
        let before = Sensors::choose(descriptions.described, name)?;
        let mut after = Sensors::choose(descriptions.measured, name)?;
        let set = before.name.clone();
        let as_described = self.courses(descriptions.described, &before)?;
        let compared = |sensors: &Sensors| -> Result<Comparison, ReplayError> {
            let courses = self.courses(descriptions.measured, sensors)?;
            Ok(Comparison::new(&set, &as_described, &courses))
        };
        let tuned = match walks {
            Some(walks) => {
                let tuned = Sensors {
                    walks: walks.clone(),
                    ..after.clone()
                };
                Some(compared(&tuned)?)
            }
            None => None,
        };
        let mut check = Check {
            sensors: set.clone(),
            tuned,
            measured: None,
        };
        if !check.takes_walks() {
            after.walks = before.walks;
            check.measured = Some(compared(&after)?);
        }
        Ok(check)
    }

    /// The set called `name` with one description and with another that has the same sets.
    ///
    /// # Errors
    /// When a machine or a recording cannot be used.
    pub fn compare(
        &self,
        before: &Machine,
        after: &Machine,
        name: Option<&str>,
    ) -> Result<Comparison, ReplayError> {
        let sensors = Sensors::choose(before, name)?;
        let courses = [
            self.courses(before, &sensors)?,
            self.courses(after, &Sensors::choose(after, name)?)?,
        ];
        Ok(Comparison::new(&sensors.name, &courses[0], &courses[1]))
    }

    fn courses(&self, machine: &Machine, sensors: &Sensors) -> Result<Vec<Course>, ReplayError> {
        (self.recordings.iter())
            .map(|path| Ok(Course::run(machine, sensors, path)?.last(self.part)))
            .collect()
    }
}
