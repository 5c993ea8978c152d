//! Counting of load cycles during a replay: counts as bytes that the next replay continues, and the
//! damage that follows from them.

use loadtwin::life::{Beyond, SnCurve, Spectrum, damage};
use loadtwin::machine::Machine;
use loadtwin_common::counting::{LEVELS, LevelScale, LoadCounts, SHAFTS, saved_counts::MAX_BYTES};
use loadtwin_common::io::estimate::Estimate;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::Error;

/// Gate where none is given (levels), as of `loadtwin life`.
const GATE_LEVELS: u8 = 2;

fn read(name: &str, bytes: &[u8]) -> PyResult<LoadCounts> {
    LoadCounts::continued(bytes)
        .map_err(|error| Error::new_err(format!("counts of {name}: {error}; count again")))
}

fn written(name: &str, counts: &mut LoadCounts) -> Result<Vec<u8>, String> {
    let mut bytes = vec![0; MAX_BYTES];
    let length = counts.save(&mut bytes);
    bytes.truncate(length.map_err(|error| format!("counts of {name}: {error}"))?);
    Ok(bytes)
}

/// Name of a load with its counts as bytes.
pub(crate) type Saved = Vec<(String, Vec<u8>)>;

struct Counted {
    load: usize,
    name: String,
    counts: LoadCounts,
}

/// Counts of some loads of a machine.
#[derive(Default)]
pub(crate) struct Counting(Vec<Counted>);

impl Counting {
    /// Goes on from saved counts; after a `restart` of the estimator, which is counted.
    pub(crate) fn continued(machine: &Machine, saved: Saved, restart: bool) -> PyResult<Self> {
        let loads = machine.loads();
        let mut all = Vec::new();
        for (name, bytes) in saved {
            let load = loads.iter().position(|load| load.name == name);
            let load = load.ok_or_else(|| {
                let known: Vec<&str> = loads.iter().map(|load| load.name).collect();
                let known = known.join(", ");
                Error::new_err(format!("counts: found load {name:?}, allowed: {known}"))
            })?;
            let mut counts = read(&name, &bytes)?;
            if restart && counts.observation().elapsed() > 0 {
                counts.restart();
            }
            all.push(Counted { load, name, counts });
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

    /// # Errors
    /// In words.
    pub(crate) fn save(self) -> Result<Saved, String> {
        let saved = self.0.into_iter().map(|mut counted| {
            let bytes = written(&counted.name, &mut counted.counts)?;
            Ok((counted.name, bytes))
        });
        saved.collect()
    }
}

/// Counts with nothing in them, of 128 levels over the range; `gate`: smallest range of a cycle.
#[pyfunction]
pub(crate) fn empty_counts(
    py: Python<'_>,
    from_load: f64,
    to_load: f64,
    gate: Option<f64>,
) -> PyResult<Bound<'_, PyBytes>> {
    let refused = |error: String| Error::new_err(format!("range {from_load}:{to_load}: {error}"));
    let scale = LevelScale::covering(from_load as f32, to_load as f32)
        .map_err(|error| refused(format!("{error}; allowed: FROM below TO")))?;
    let levels = gate.map_or(f64::from(GATE_LEVELS), |gate| {
        (gate / f64::from(scale.width())).ceil()
    });
    if !(1.0..LEVELS as f64).contains(&levels) {
        let width = to_load - from_load;
        let gate = gate.unwrap_or(0.0);
        return Err(refused(format!(
            "gate {gate}: allowed: above 0, below {width}"
        )));
    }
    let mut counts =
        LoadCounts::try_new(scale, levels as u8).map_err(|error| refused(error.to_string()))?;
    let bytes = written("a load", &mut counts).map_err(refused)?;
    Ok(PyBytes::new(py, &bytes))
}

/// Damage of counted cycles by an S-N curve through points of cycles and range.
#[pyfunction]
pub(crate) fn damage_of(counts: &[u8], sn: Vec<(f64, f64)>) -> PyResult<f64> {
    let refused = |error: loadtwin::life::LifeError| Error::new_err(error.to_string());
    let curve = SnCurve::through(&sn, Beyond::Haibach).map_err(refused)?;
    let counts = read("a load", counts)?;
    let spectrum = Spectrum::of("the load", &counts).map_err(refused)?;
    Ok(damage(&spectrum, &curve))
}
