//! Sums up the days of a machine in one row (`Overview`): verdict and worst sensor of the last day
//! with samples, NIS over all days, damage, faults. Computes the time until the damage is 1 (s), at
//! the mean rate so far and by the design spectrum.

use loadtwin_life::{Beyond, LoadCycle, SnCurve, damage_of_cycles};
use serde::{Deserialize, Serialize};

use crate::day::{Day, Days};
use crate::description_table::{self, Entry};
use crate::verdict::{Verdict, worst};

/// Seconds of an hour.
const SECONDS: f64 = 3600.0;

/// A fault of a day or of one of its recordings.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// The day; empty for a fault of the machine.
    pub day: String,
    /// Name of the recording; empty for a fault of the day.
    pub recording: String,
    /// What is wrong.
    pub fault: String,
}

/// A machine with its faults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overview {
    /// Its name in the archive.
    pub machine: String,
    /// Its name by the description.
    pub name: Option<String>,
    /// State on the last day with samples.
    pub verdict: Verdict,
    /// First day of this state without a day of another one since.
    pub since: Option<String>,
    /// Number of days.
    pub days: u64,
    /// Days that were replayed in this run.
    pub replayed_days: u64,
    /// First day.
    pub first_day: Option<String>,
    /// Last day.
    pub last_day: Option<String>,
    /// Samples.
    pub samples: u64,
    /// Time that the recordings span (s).
    pub seconds: f64,
    /// Part of the samples in which some load is valid (%).
    pub valid_percent: Option<f64>,
    /// Mean normalised innovation squared over all days and sensors, 1 in a consistent filter.
    pub nis: Option<f64>,
    /// On the last day with samples, the sensor that contradicts most.
    pub sensor: Option<String>,
    /// Part of its readings that contradict the description (%).
    pub contradicting_percent: Option<f64>,
    /// Its mean innovation (standard deviations).
    pub bias: Option<f64>,
    /// Days that contradict the description.
    pub contradicting_days: u64,
    /// Load that is counted.
    pub load: Option<String>,
    /// Damage since the first day; failure is expected at 1.
    pub damage: Option<f64>,
    /// Recorded time until the damage is 1, at the mean rate so far (s).
    pub remaining_s: Option<f64>,
    /// Time until the damage is 1, by the design spectrum of the table of descriptions (s).
    pub remaining_by_design_s: Option<f64>,
    /// Description of the last day with samples.
    pub description: Option<String>,
    /// Recordings of the last day with samples, relative to the archive.
    pub recordings: Vec<String>,
    /// Faults of days and recordings.
    pub faults: Vec<Fault>,
}

impl Overview {
    /// Sums up the days of a machine, of which so many were replayed.
    pub(crate) fn of(machine: &str, days: &Days, replayed: u64) -> Self {
        let with_samples = || days.iter().rev().filter(|(_, day)| day.sums.samples > 0);
        let last = with_samples().next();
        let of_last = last.map(|(_, day)| day);
        let verdict = of_last.map_or(Verdict::NoData, |day| day.verdict);
        let same = with_samples().take_while(|(_, day)| day.verdict == verdict);
        let sum = |of: fn(&Day) -> u64| days.values().map(of).sum::<u64>();
        let (samples, valid) = (sum(|day| day.sums.samples), sum(|day| day.sums.valid));
        let sensors = || days.values().flat_map(|day| &day.sums.sensors);
        let used: u64 = sensors().map(|sensor| sensor.used).sum();
        let nis: f64 = sensors().map(|sensor| sensor.nis).sum();
        let worst = of_last.and_then(|day| worst(&day.sums.sensors));
        let damage = of_last.and_then(Day::damage);
        let recordings = last.into_iter().flat_map(|(name, day)| {
            let replayed = day.recordings.iter().filter(|of| of.samples > 0);
            let path = move |of: &str| format!("recordings/machine={machine}/day={name}/{of}");
            replayed.map(move |of| path(&of.name))
        });
        Self {
            machine: machine.to_owned(),
            name: of_last.and_then(|day| day.name.clone()),
            verdict,
            since: same.last().map(|(name, _)| name.clone()),
            days: days.len() as u64,
            replayed_days: replayed,
            first_day: days.keys().next().cloned(),
            last_day: days.keys().next_back().cloned(),
            samples,
            seconds: recorded_s(days.values()),
            valid_percent: (samples > 0).then(|| 100.0 * valid as f64 / samples as f64),
            nis: (used > 0).then(|| nis / used as f64),
            sensor: worst.map(|sensor| sensor.name.clone()),
            contradicting_percent: worst.map(|sensor| 100.0 * sensor.share()),
            bias: (worst.filter(|sensor| sensor.used > 0))
                .map(|sensor| sensor.bias / sensor.used as f64),
            contradicting_days: sum(|day| u64::from(day.verdict == Verdict::Contradicts)),
            load: damage.map(|(load, _)| load.to_owned()),
            damage: damage.map(|(_, damage)| damage),
            remaining_s: damage.and_then(|(load, damage)| remaining_s(load, damage, days)),
            remaining_by_design_s: None,
            description: of_last.and_then(|day| day.description.clone()),
            recordings: recordings.collect(),
            faults: faults(days),
        }
    }

    /// With the time that remains by the design spectrum, where the description of the last day has one.
    pub(crate) fn against_design(self, entries: &[Entry]) -> Self {
        let last = self.last_day.as_ref();
        let entry = last.and_then(|day| description_table::at(entries, day).ok());
        let rate = entry.and_then(|entry| design_damage(&entry.design, &entry.sn));
        let remaining_s = |(rate, damage): (f64, f64)| SECONDS * (1.0 - damage).max(0.0) / rate;
        Self {
            remaining_by_design_s: rate.zip(self.damage).map(remaining_s),
            ..self
        }
    }

    /// The row of a machine that could not be replayed at all.
    pub(crate) fn failed(machine: &str, fault: String) -> Self {
        let fault = Fault {
            day: String::new(),
            recording: String::new(),
            fault,
        };
        Self {
            faults: vec![fault],
            ..Self::of(machine, &Days::new(), 0)
        }
    }
}

/// The faults of a machine's days and recordings.
pub(crate) fn faults(days: &Days) -> Vec<Fault> {
    let of_day = |(name, day): (&String, &Day)| {
        let fault = |recording: &str, fault: &Option<String>| {
            Some(Fault {
                day: name.clone(),
                recording: recording.to_owned(),
                fault: fault.clone()?,
            })
        };
        let mut found: Vec<Fault> = fault("", &day.fault).into_iter().collect();
        let recordings = day.recordings.iter();
        found.extend(recordings.filter_map(|of| fault(&of.name, &of.fault)));
        found
    };
    days.iter().flat_map(of_day).collect()
}

/// Recorded time until the damage is 1, at the mean rate of the days so far (s).
///
/// `T (1 - D) / D` with the damage `D` after the time `T`; 0 where the damage is 1 or more, and none
/// where there is no damage.
///
/// Source: Palmgren 1924, Miner 1945: linear accumulation.
fn remaining_s(load: &str, damage: f64, days: &Days) -> Option<f64> {
    if damage == 0.0 {
        return None;
    }
    let has_load = |day: &&Day| day.sums.loads.iter().any(|of| of.name == load);
    let counted_s = recorded_s(days.values().filter(has_load));
    Some(counted_s * (1.0 - damage).max(0.0) / damage)
}

/// Damage an hour by a design spectrum and an S-N curve, where there is any: `sum n_i / N(S_i)`.
fn design_damage(design: &[(f64, f64)], sn: &[(f64, f64)]) -> Option<f64> {
    let curve = SnCurve::through(sn, Beyond::Haibach).ok()?;
    let cycles = design
        .iter()
        .map(|&(range, count)| LoadCycle { range, count });
    let damage = damage_of_cycles(cycles, &curve);
    (damage > 0.0).then_some(damage)
}

/// Time that the recordings of some days span (s).
fn recorded_s<'a>(days: impl Iterator<Item = &'a Day>) -> f64 {
    // An empty sum of floats is -0.
    days.fold(0.0, |sum, day| sum + day.sums.seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_time_remains_after_a_damage_of_one_and_none_is_known_without_damage() {
        assert_eq!(remaining_s("shaft", 1.5, &Days::new()), Some(0.0));
        assert_eq!(remaining_s("shaft", 0.0, &Days::new()), None);
        let seconds = Overview::failed("g", String::new()).seconds;
        assert!(seconds.is_sign_positive(), "{seconds:?}");
    }
}
