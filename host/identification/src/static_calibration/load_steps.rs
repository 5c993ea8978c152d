//! Loads that are held and the readings there: from tables of load steps or means, and from
//! recordings, whose plateaus are cut into pieces.

use std::path::PathBuf;

use super::plateaus::FEWEST;
use super::step_file::{Applied, Found, SHORTEST_S, Step, StepFile};
use crate::calibrate::CalibrateError;
use loadtwin_machine::Machine;

/// Readings of a channel at each step; NaN where there is none.
#[derive(Clone, Debug)]
pub struct Readings {
    /// Number of the channel in the machine.
    pub channel: usize,
    /// Readings (SI).
    pub values: Vec<f64>,
    /// Known variance of each: of its samples, or of one word of the converter.
    pub variance: Vec<f64>,
    /// Samples at an end of the converter's range, which are left out.
    pub saturated: usize,
}

/// Loads that are held, with the readings of all channels that were recorded.
#[derive(Clone, Debug)]
pub struct LoadSteps {
    /// In the order in which the loads were applied.
    pub steps: Vec<Step>,
    /// Of each channel that the files have.
    pub readings: Vec<Readings>,
    /// Whether the times are measured; else they are the numbers of rows.
    pub is_timed: bool,
    /// Whether they are means at speeds, in any order: loads have no history.
    pub are_means: bool,
    /// Number of the load in the drivetrain.
    pub load: usize,
}

impl LoadSteps {
    /// Reads tables and recordings with the applied load in `column`: a `[[reference]]` or a load
    /// of the machine.
    ///
    /// A file whose rows come at 1 Hz or faster is a recording: its plateaus are steps. Every other
    /// file is a table with one step a row.
    ///
    /// # Errors
    /// When a file cannot be read or says too little.
    pub fn read(
        machine: &Machine,
        column: &str,
        files: &[PathBuf],
    ) -> Result<Self, CalibrateError> {
        let applied = Applied::find(machine, column)?;
        let mut all = Self {
            steps: Vec::new(),
            readings: Vec::new(),
            is_timed: true,
            are_means: false,
            load: applied.load,
        };
        for (number, file) in files.iter().enumerate() {
            let refused = |reason: String| CalibrateError::TooLittle {
                recording: file.clone(),
                reason,
            };
            let read = StepFile::read(machine, &applied, file)?;
            all.is_timed &= read.is_timed;
            let are_means = read.are_means();
            if number > 0 && are_means != all.are_means {
                return Err(refused(
                    "rows with a speed are means in any order, those of other files are loads in order; allowed: \
                     files of one kind"
                        .into(),
                ));
            }
            all.are_means = are_means;
            let first = all.steps.len();
            let runs = all.steps.iter().map(|step| step.run + 1).max().unwrap_or(0);
            let found = read.steps(number).map_err(refused)?;
            all.append(machine, &read, found, runs);
            let steps = &all.steps[first..];
            let differ = steps.windows(2).any(|pair| pair[0].load != pair[1].load);
            if !differ {
                return Err(refused(match (steps.first(), read.is_recording) {
                    (Some(step), _) => format!(
                        "found one load in {column:?}, {} {}; allowed: two or more, better five up and five down",
                        applied.unit.from_si(step.load),
                        applied.unit.symbol()
                    ),
                    (None, true) => format!(
                        "{column:?} is held nowhere; allowed: loads that stay within 1 % of their range for {SHORTEST_S} s and {FEWEST} rows or more"
                    ),
                    (None, false) => format!("no row has a number in {column:?}"),
                }));
            }
        }
        Ok(all)
    }

    /// Adds the steps of a file, of which each has indices of rows that are averaged.
    fn append(&mut self, machine: &Machine, read: &StepFile, found: Vec<Found>, runs: usize) {
        let plateaus = self.steps.last().map_or(0, |step| step.plateau + 1);
        let before = self.steps.len();
        for (channel, described) in machine.channels.iter().enumerate() {
            let Some(values) = read.channel(channel) else {
                continue;
            };
            let encoding = read.encodings[channel];
            let place = self.readings.iter().position(|r| r.channel == channel);
            let place = place.unwrap_or_else(|| {
                self.readings.push(Readings {
                    channel,
                    values: vec![f64::NAN; before],
                    variance: vec![0.0; before],
                    saturated: 0,
                });
                self.readings.len() - 1
            });
            self.readings[place].saturated += read.saturated(channel);
            for step in &found {
                let (value, variance) = step.reading(described, encoding, values);
                self.readings[place].values.push(value);
                self.readings[place].variance.push(variance);
            }
        }
        self.steps.extend(found.into_iter().map(|found| Step {
            run: runs + found.step.run,
            plateau: plateaus + found.step.plateau,
            ..found.step
        }));
        for readings in &mut self.readings {
            readings.values.resize(self.steps.len(), f64::NAN);
            readings.variance.resize(self.steps.len(), 0.0);
        }
    }
}
