//! Counts the load cycles in the estimates of a day on top of the counts of the days before, which
//! are saved as bytes for each load. Computes the damage of counts by the Palmgren-Miner rule and
//! an S-N curve with the slope of Haibach below its last point.

use std::collections::BTreeMap;

use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_common::counting::{LevelScale, LoadCounts, SHAFTS};
use loadtwin_common::io::estimate::Estimate;
use loadtwin_life::{Beyond, GATE_LEVELS, SnCurve, Spectrum, damage};
use loadtwin_machine::Machine;

/// Counts as bytes by load.
pub(crate) type SavedCounts = BTreeMap<String, Vec<u8>>;

struct Counted {
    /// Index among the loads of the machine.
    load: usize,
    name: String,
    counts: LoadCounts,
}

/// Counts of some loads of a machine.
pub(crate) struct LoadCounting(Vec<Counted>);

fn read(name: &str, bytes: &[u8]) -> Result<LoadCounts, String> {
    LoadCounts::continued(bytes).map_err(|error| format!("counts of {name}: {error}; count again"))
}

fn written(name: &str, counts: &mut LoadCounts) -> Result<Vec<u8>, String> {
    let mut bytes = vec![0; MAX_BYTES];
    let length = counts.save(&mut bytes);
    bytes.truncate(length.map_err(|error| format!("counts of {name}: {error}"))?);
    Ok(bytes)
}

impl LoadCounting {
    /// Goes on from the counts of those loads that the machine has; after a `restart` of the
    /// estimator, which is counted.
    ///
    /// # Errors
    /// In words, when counts are damaged.
    pub(crate) fn continued(
        machine: &Machine,
        saved: &SavedCounts,
        restart: bool,
    ) -> Result<Self, String> {
        let mut all = Vec::new();
        for (load, of) in machine.loads().into_iter().enumerate() {
            let Some(bytes) = saved.get(of.name) else {
                continue;
            };
            let mut counts = read(of.name, bytes)?;
            if restart && counts.observation().elapsed() > 0 {
                counts.restart();
            }
            all.push(Counted {
                load,
                name: of.name.to_owned(),
                counts,
            });
        }
        Ok(Self(all))
    }

    pub(crate) fn push(&mut self, estimate: &Estimate) {
        for counted in &mut self.0 {
            let load = estimate.loads.get(counted.load);
            let valid = load.filter(|load| load.fault.is_none());
            (counted.counts).push(valid.map(|load| load.value), [0; SHAFTS]);
        }
    }

    /// The counts as bytes.
    ///
    /// # Errors
    /// In words, when counts cannot be saved.
    pub(crate) fn save(self) -> Result<SavedCounts, String> {
        let saved = self.0.into_iter().map(|mut counted| {
            let bytes = written(&counted.name, &mut counted.counts)?;
            Ok((counted.name, bytes))
        });
        saved.collect()
    }
}

/// Counts with nothing in them, of levels over the range `from` to `to` (in the load's unit).
///
/// # Errors
/// In words, when the range is none.
pub(crate) fn empty_counts(load: &str, (from, to): (f64, f64)) -> Result<Vec<u8>, String> {
    let refused = |error| format!("range {from}:{to}: {error}; allowed: FROM below TO");
    let scale = LevelScale::covering(from as f32, to as f32).map_err(refused)?;
    let mut counts = LoadCounts::try_new(scale, GATE_LEVELS).map_err(refused)?;
    written(load, &mut counts)
}

/// Damage of counted cycles by an S-N curve through points of cycles and range.
///
/// # Errors
/// In words, when counts or curve cannot be used, or a load was beyond the range.
pub(crate) fn damage_of(load: &str, counts: &[u8], sn: &[(f64, f64)]) -> Result<f64, String> {
    let curve = SnCurve::through(sn, Beyond::Haibach).map_err(|error| error.to_string())?;
    let counts = read(load, counts)?;
    let spectrum = Spectrum::of(load, &counts).map_err(|error| error.to_string())?;
    Ok(damage(&spectrum, &curve))
}
