//! Counts the loads of all files for `loadtwin life`: chooses range and gate of each load, counts
//! the files of one machine or several (rainflow cycles, time, turns), and makes the spectrum of
//! the cycles (`Counted`).

use anyhow::Context;
use loadtwin_common::counting::{LEVELS, LevelScale, LoadCounts};

use super::Life;
use super::board_counts::Boards;
use crate::cli::progress::Progress;
use crate::life::{CountedLoad, GATE_LEVELS, LoadFile, LoadSurvey, Loads, NoiseRemoved, Spectrum};
use crate::machine::Machine;
use crate::recording::Unit;

/// Counts of one load in one machine or several.
pub(super) struct Counted {
    pub(super) name: String,
    pub(super) unit: Unit,
    /// One for each machine.
    pub(super) machines: Vec<CountedLoad>,
    pub(super) spectrum: Spectrum,
    /// Spectrum without the noise of the estimates, where the file has standard deviations.
    pub(super) noise_removed: Option<NoiseRemoved>,
}

impl Life {
    /// Counts with nothing in them yet, one for each load.
    pub(super) fn empty_counts(&self, loads: &Loads) -> anyhow::Result<Vec<CountedLoad>> {
        let mut surveys = vec![LoadSurvey::default(); loads.loads.len()];
        for path in &self.files {
            for (all, found) in surveys.iter_mut().zip(LoadSurvey::of(path, loads)?) {
                all.add(&found);
            }
        }
        let ranges = match &self.range {
            Some(range) => vec![[range.0 as f32, range.1 as f32]; loads.loads.len()],
            None => self.found_ranges(loads, &surveys)?,
        };
        let mut empty = Vec::new();
        for (((name, unit), [from, to]), survey) in loads.loads.iter().zip(ranges).zip(&surveys) {
            let scale = LevelScale::covering(from, to)
                .with_context(|| format!("range of {name} {from}:{to}: allowed: FROM below TO"))?;
            let gate = match self.gate {
                None => GATE_LEVELS,
                Some(gate) => {
                    let levels = (gate / f64::from(scale.width())).ceil().max(1.0);
                    anyhow::ensure!(
                        gate > 0.0 && levels < LEVELS as f64,
                        "--gate {gate}: allowed for {name}: above 0, below {:.4} {unit}",
                        to - from
                    );
                    levels as u8
                }
            };
            let counts = LoadCounts::try_new(scale, gate)?;
            empty.push(CountedLoad::new(counts, survey.steps.mean()));
        }
        Ok(empty)
    }

    /// By the machine's nominal loads, widened to what the files reach.
    fn found_ranges(&self, loads: &Loads, surveys: &[LoadSurvey]) -> anyhow::Result<Vec<[f32; 2]>> {
        let machine = self.machine.as_deref().map(Machine::load).transpose()?;
        let nominal = |name: &str| {
            let machine = machine.as_ref()?;
            let load = machine.loads().into_iter().find(|load| load.name == name)?;
            Some([-load.nominal as f32, load.nominal as f32])
        };
        let widened = |((name, _), survey): (&(String, Unit), &LoadSurvey)| {
            let both = nominal(name).into_iter().chain(survey.extremes);
            let [from, to] = both
                .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
                .with_context(|| format!("{name}: no valid sample in the files"))?;
            // The highest load lies inside the last level; a constant load has a range as well.
            let margin = ((to - from) / LEVELS as f32)
                .max(1e-3 * from.abs().max(to.abs()))
                .max(1e-6);
            Ok([from - margin, to + margin])
        };
        loads.loads.iter().zip(surveys).map(widened).collect()
    }

    /// Period of a sample (s), and the counts of each load.
    pub(super) fn count(
        &self,
        loads: &Loads,
        empty: &[CountedLoad],
        boards: &Boards,
    ) -> anyhow::Result<(f64, Vec<Counted>)> {
        let progress = Progress::new("life");
        let mut machines: Vec<Vec<CountedLoad>> = vec![empty.to_vec()];
        let mut period_s = None;
        for (done, path) in self.files.iter().enumerate() {
            let (found_s, counts) = if let Some(board) = boards.at(done) {
                (board.period_s, board.counts())
            } else {
                let file = LoadFile::open(path, loads)?;
                let found_s = file.period_s();
                let mut counts = empty.to_vec();
                file.count(&mut counts)?;
                (found_s, counts)
            };
            let period = *period_s.get_or_insert(found_s);
            anyhow::ensure!(
                (found_s / period - 1.0).abs() < 1e-3,
                "{}: a sample every {found_s} s, and every {period} s in the files before; allowed: one rate",
                path.display()
            );
            match machines.last_mut() {
                Some(machine) if done > 0 && !self.machines => {
                    for (earlier, later) in machine.iter_mut().zip(counts) {
                        earlier.append(later)?;
                    }
                }
                Some(first) if done == 0 => *first = counts,
                _ => machines.push(counts),
            }
            progress.show((done + 1) as f64 / self.files.len() as f64);
        }
        let counted = loads.loads.iter().enumerate().map(|(k, (name, unit))| {
            let machines: Vec<CountedLoad> =
                machines.iter().map(|counts| counts[k].clone()).collect();
            let mut spectrum = Spectrum::of(name, &machines[0].counts)?;
            for machine in &machines[1..] {
                spectrum.merge(name, &Spectrum::of(name, &machine.counts)?)?;
            }
            Ok(Counted {
                name: name.clone(),
                unit: *unit,
                noise_removed: NoiseRemoved::of(name, &machines, &spectrum)?,
                machines,
                spectrum,
            })
        });
        let counted = counted.collect::<anyhow::Result<_>>()?;
        Ok((period_s.unwrap_or_default(), counted))
    }
}
