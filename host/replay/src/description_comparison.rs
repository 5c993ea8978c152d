//! Compares an old and a new description of a machine on the same recordings, for `loadtwin tune`
//! and `diagnose`: changes of NMAE, log-likelihood and NIS with 95 % intervals. Decides whether the
//! new one is worse, or shown not to be worse.

use std::collections::BTreeMap;
use std::path::Path;

use loadtwin_common::io::estimate::Estimate;
use serde::Serialize;

use super::{ReplayError, Sample, run};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_math::metrics::PairedDifference;

/// Length of the blocks in which sums are kept [s].
const BLOCK_S: f64 = 0.25;

/// Time at the start that does not count, in which the filter converges (s).
pub const SETTLING_S: f64 = 2.0;

/// Rise of the NMAE of a load that counts as worse [% of its nominal load]: a third of the
/// effect on the load that matters by default (0.3 %).
const WORSE_PERCENT: f64 = 0.1;

/// Least standard deviation of a load from which its error shows how the estimator follows it [% of its
/// nominal load]; as [`WORSE_PERCENT`] is a fiftieth of that, a filter that lags by a fiftieth shows.
const LEAST_VARIATION_PERCENT: f64 = 5.0;

/// Sums of one load over a block.
#[derive(Clone, Copy, Default)]
struct LoadSums {
    absolute: f64,
    samples: f64,
    reference: f64,
    reference_squared: f64,
}

/// Sums over a block of samples.
#[derive(Clone, Default)]
struct Block {
    loads: Vec<LoadSums>,
    /// `-1/2 (ln(2 pi S) + nu^2 / S)`, SI units.
    log_likelihood: f64,
    nis: f64,
    readings: f64,
}

/// Sums of a replay of one recording with one description and set of sensors, in blocks.
pub struct Course {
    /// Name and nominal value of each load.
    loads: Vec<(String, f64)>,
    blocks: Vec<Block>,
}

impl Course {
    /// Runs `machine` with `sensors` on the recording in `path`.
    ///
    /// # Errors
    /// When the machine or the recording cannot be used.
    pub fn run(machine: &Machine, sensors: &Sensors, path: &Path) -> Result<Self, ReplayError> {
        let loads: Vec<(String, f64)> = (machine.loads().iter())
            .map(|load| (load.name.to_owned(), load.nominal))
            .collect();
        let load_of = machine.load_of_references();
        let per_block = ((BLOCK_S * machine.rate_hz) as usize).max(1);
        let settling = (SETTLING_S * machine.rate_hz) as usize;
        let mut course = Self {
            loads,
            blocks: Vec::new(),
        };
        let mut count = 0;
        run(machine, sensors, path, |sample, estimate, _| {
            if count / per_block == course.blocks.len() {
                course.blocks.push(Block {
                    loads: vec![LoadSums::default(); course.loads.len()],
                    ..Block::default()
                });
            }
            if count >= settling
                && let Some(block) = course.blocks.last_mut()
            {
                block.push(sample, estimate, &load_of);
            }
            count += 1;
        })?;
        Ok(course)
    }

    /// Its last `part`, 0 to 1 of its length; the estimator ran over what is before.
    #[must_use]
    pub fn last(mut self, part: f64) -> Self {
        let first = ((1.0 - part) * self.blocks.len() as f64).round() as usize;
        self.blocks.drain(..first.min(self.blocks.len()));
        self
    }
}

impl Block {
    fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate, load_of: &[Option<usize>]) {
        for (reference, load) in sample.references.iter().zip(load_of) {
            let Some(j) = *load else { continue };
            if let (Some(sums), Some(load)) = (self.loads.get_mut(j), estimate.loads.get(j)) {
                let error = f64::from(load.value) - reference;
                if error.is_finite() && load.std < f32::MAX {
                    sums.absolute += error.abs();
                    sums.samples += 1.0;
                    sums.reference += reference;
                    sums.reference_squared += reference * reference;
                }
            }
        }
        for sensor in &estimate.sensors {
            let variance = f64::from(sensor.innovation_variance);
            let nis = f64::from(sensor.innovation).powi(2) / variance;
            if variance > 0.0 && nis.is_finite() {
                self.log_likelihood -= 0.5 * ((std::f64::consts::TAU * variance).ln() + nis);
                self.nis += nis;
                self.readings += 1.0;
            }
        }
    }
}

/// A figure with the description as it was and with the new one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Change {
    /// As it was.
    pub before: f64,
    /// With the new one.
    pub after: f64,
    /// 95 % interval of the mean of `after - before`; none where there is too little.
    pub interval: Option<[f64; 2]>,
}

/// Direction in which a new description changes an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tendency {
    /// Smaller errors, or readings that are more likely.
    Better,
    /// Larger errors, or readings that are less likely.
    Worse,
}

/// Figures of one set of sensors on the same samples with two descriptions.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The set of sensors.
    pub sensors: String,
    /// NMAE of each load with a reference [% of its nominal load].
    pub nmae_percent: BTreeMap<String, Change>,
    /// Standard deviation of each load with a reference [% of its nominal load].
    pub variation_percent: BTreeMap<String, f64>,
    /// Mean logarithm of the likelihood of a reading, SI units.
    pub log_likelihood: Option<Change>,
    /// Mean normalised innovation squared of a reading; 1 in a consistent filter.
    pub nis: Option<Change>,
}

impl Comparison {
    /// Of the same recordings `before` and `after`, in the same order.
    pub fn new(sensors: &str, before: &[Course], after: &[Course]) -> Self {
        let pairs: Vec<(&Block, &Block)> = (before.iter().zip(after))
            .flat_map(|(b, a)| b.blocks.iter().zip(&a.blocks))
            .collect();
        let loads = before.first().map_or(&[][..], |course| &course.loads);
        let nmae = loads.iter().enumerate().filter_map(|(j, (name, nominal))| {
            let of = |block: &Block| {
                let sums = block.loads.get(j).copied().unwrap_or_default();
                (100.0 * sums.absolute / nominal, sums.samples)
            };
            Some((name.clone(), change(&pairs, of)?))
        });
        let variation = loads.iter().enumerate().filter_map(|(j, (name, nominal))| {
            Some((name.clone(), 100.0 * deviation(&pairs, j)? / nominal))
        });
        Self {
            sensors: sensors.to_owned(),
            nmae_percent: nmae.collect(),
            variation_percent: variation.collect(),
            log_likelihood: change(&pairs, |block| (block.log_likelihood, block.readings)),
            nis: change(&pairs, |block| (block.nis, block.readings)),
        }
    }

    /// Whether the new description is worse: by the loads where there are references, by more than
    /// 0.1 % of nominal; else by the likelihood, beyond its interval. A rise that may be chance, by
    /// its interval, does not count where the likelihood rises beyond its own.
    pub fn is_worse(&self) -> bool {
        if self.nmae_percent.is_empty() {
            return (self.log_likelihood).is_some_and(|l| {
                l.interval
                    .map_or(l.after < l.before, |[_, high]| high < 0.0)
            });
        }
        let lowest = |c: &Change| c.interval.map_or(c.after - c.before, |[low, _]| low);
        let likelier = self
            .log_likelihood
            .as_ref()
            .is_some_and(|l| lowest(l) > 0.0);
        (self.nmae_percent.values())
            .any(|c| c.after - c.before > WORSE_PERCENT && (lowest(c) > 0.0 || !likelier))
    }

    /// Whether the NMAE of some load or the likelihood changes in that direction beyond its interval.
    pub fn tends(&self, tendency: Tendency) -> bool {
        let sign = match tendency {
            Tendency::Better => 1.0,
            Tendency::Worse => -1.0,
        };
        let least = |c: &Change, sign: f64| {
            let [low, high] = c.interval.unwrap_or([c.after - c.before; 2]);
            (sign * low).min(sign * high)
        };
        self.nmae_percent.values().any(|c| least(c, -sign) > 0.0)
            || (self.log_likelihood.as_ref()).is_some_and(|l| least(l, sign) > 0.0)
    }

    /// Largest change of the NMAE of a load, for better or worse [% of nominal]; 0 without references.
    pub fn largest_change_percent(&self) -> f64 {
        (self.nmae_percent.values())
            .map(|c| (c.after - c.before).abs())
            .fold(0.0, f64::max)
    }

    /// Whether the new description is shown not to be worse: the NMAE of no load rises by more than 0.1 % of
    /// nominal at the upper end of its interval (a test of non-inferiority), and each load varies so much that
    /// an estimate that does not follow it would show; without references, whether it is not less likely.
    pub fn is_shown_no_worse(&self) -> bool {
        let highest = |c: &Change| c.interval.map_or(c.after - c.before, |[_, high]| high);
        let mut loads = self.nmae_percent.values();
        !self.is_worse()
            && !self.is_empty()
            && self.steady_load().is_none()
            && loads.all(|c| highest(c) <= WORSE_PERCENT)
    }

    /// Whether nothing could be compared: neither an NMAE nor a likelihood, as of recordings that end
    /// before the filter has settled.
    pub fn is_empty(&self) -> bool {
        self.nmae_percent.is_empty() && self.log_likelihood.is_none()
    }

    /// A load that varies too little to show whether it is followed, and its standard deviation [% of nominal].
    pub fn steady_load(&self) -> Option<(&str, f64)> {
        (self.variation_percent.iter())
            .find(|(_, percent)| **percent < LEAST_VARIATION_PERCENT)
            .map(|(load, percent)| (load.as_str(), *percent))
    }

    /// Name of each figure, and its values before and after.
    pub fn rows(&self) -> Vec<[String; 2]> {
        let nmae =
            (self.nmae_percent.iter()).map(|(load, c)| [format!("NMAE {load}"), c.text(2, " %")]);
        let likelihood = (self.log_likelihood).map(|c| ["log-likelihood".into(), c.text(3, "")]);
        let nis = (self.nis).map(|c| ["NIS".into(), c.text(2, "")]);
        nmae.chain(likelihood).chain(nis).collect()
    }

    /// Before and after in one line.
    pub fn line(&self) -> String {
        let rows = self.rows().into_iter();
        let figures: Vec<String> = rows
            .map(|[name, change]| format!("{name} {change}"))
            .collect();
        format!("{}: {}", self.sensors, figures.join(", "))
    }
}

impl Change {
    /// Before, after with its unit, and the interval of the change in brackets.
    pub fn text(&self, digits: usize, unit: &str) -> String {
        let interval = self.interval.map_or_else(String::new, |[low, high]| {
            format!(" ({low:+.digits$} to {high:+.digits$})")
        });
        let (before, after) = (self.before, self.after);
        format!("{before:.digits$} -> {after:.digits$}{unit}{interval}")
    }
}

/// Standard deviation of the reference of load `j`; none without reference.
fn deviation(pairs: &[(&Block, &Block)], j: usize) -> Option<f64> {
    let [n, sum, squares] = (pairs.iter())
        .filter_map(|(block, _)| block.loads.get(j))
        .fold([0.0; 3], |[n, sum, squares], load| {
            [
                n + load.samples,
                sum + load.reference,
                squares + load.reference_squared,
            ]
        });
    (n > 0.0).then(|| (squares / n - (sum / n).powi(2)).max(0.0).sqrt())
}

/// Mean of a figure before and after, by its sum and count in each block.
fn change(pairs: &[(&Block, &Block)], of: impl Fn(&Block) -> (f64, f64)) -> Option<Change> {
    let sums: Vec<[(f64, f64); 2]> = pairs.iter().map(|(b, a)| [of(b), of(a)]).collect();
    let mean = |which: usize| {
        let (sum, count) = (sums.iter()).fold((0.0, 0.0), |(sum, count), pair| {
            (sum + pair[which].0, count + pair[which].1)
        });
        (count > 0.0).then(|| sum / count)
    };
    let differences: Vec<(f64, f64)> = sums
        .iter()
        .filter(|[before, after]| before.1 > 0.0 && after.1 > 0.0)
        .map(|[before, after]| (after.0 * before.1 / after.1 - before.0, before.1))
        .collect();
    Some(Change {
        before: mean(0)?,
        after: mean(1)?,
        interval: PairedDifference::of(&differences).and_then(|d| d.interval),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of a load of 100 whose reference alternates by 20.
    fn course(errors: &[f64]) -> Course {
        let block = |(i, e): (usize, &f64)| Block {
            loads: vec![LoadSums {
                absolute: *e,
                samples: 1.0,
                reference: if i % 2 == 0 { 60.0 } else { 100.0 },
                reference_squared: if i % 2 == 0 { 3_600.0 } else { 10_000.0 },
            }],
            log_likelihood: -e,
            nis: 1.0,
            readings: 1.0,
        };
        Course {
            loads: vec![("shaft".into(), 100.0)],
            blocks: errors.iter().enumerate().map(block).collect(),
        }
    }

    /// Errors of 1 and 2 in turn become 1.05 (0.05 % more, too little) and 1.2 and 2.2.
    #[test]
    fn a_rise_of_a_tenth_of_a_percent_is_worse() {
        let before: Vec<f64> = (0..32).map(|i| 1.0 + f64::from(i % 2)).collect();
        let risen = |by: f64| course(&before.iter().map(|e| e + by).collect::<Vec<_>>());
        let compared = |by| Comparison::new("set", &[course(&before)], &[risen(by)]);
        assert!(!compared(0.05).is_worse() && compared(0.2).is_worse());
        assert!(compared(0.05).is_shown_no_worse() && !compared(0.2).is_shown_no_worse());
        // Rises and falls of 1 in turn, half a recording each: a mean of 0 that may as well be 0.5.
        let uneven: Vec<f64> = (0..32).map(|i| 1.0 + f64::from(u8::from(i < 16))).collect();
        let unsure = Comparison::new("set", &[course(&[1.5; 32])], &[course(&uneven)]);
        assert!(!unsure.is_worse() && !unsure.is_shown_no_worse());
        let empty = Comparison::new("set", &[course(&[])], &[course(&[])]);
        assert!(empty.is_empty() && !empty.is_shown_no_worse());
        assert!((compared(0.0).variation_percent["shaft"] - 20.0).abs() < 1e-9);
        let mut steady = compared(0.0);
        steady.variation_percent.insert("shaft".into(), 1.5);
        assert!(!steady.is_worse() && !steady.is_shown_no_worse());
        let change = compared(0.2).nmae_percent["shaft"];
        assert!((change.before - 1.5).abs() < 1e-12 && (change.after - 1.7).abs() < 1e-12);
        let [low, high] = change.interval.unwrap();
        assert!((low - 0.2).abs() < 1e-9 && (high - 0.2).abs() < 1e-9);
        assert!(compared(0.05).tends(Tendency::Worse) && !compared(0.05).tends(Tendency::Better));
        assert!(compared(-0.05).tends(Tendency::Better) && !compared(-0.05).tends(Tendency::Worse));
        assert!(!unsure.tends(Tendency::Better) && !unsure.tends(Tendency::Worse));
        assert!((compared(-0.05).largest_change_percent() - 0.05).abs() < 1e-9);
        let mut blind = compared(0.05);
        blind.nmae_percent.clear();
        assert!(blind.is_worse(), "the likelihood falls in every block");
        assert_eq!(course(&before).last(0.25).blocks.len(), 8);
    }
}
