//! Replays a recording with a rotor's description, and computes its figures as `loadtwin replay`
//! has them: mean NIS, largest displacement error (um), NMAE of each load (%).

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::{Displacements, Figures, ReplayError, run_line};

/// Figures of a description on a recording.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Mean normalised innovation squared; 1 in a consistent filter.
    pub nis_mean: Option<f64>,
    /// Largest error of a displacement at any node, full and by segment (µm); empty where the
    /// recording has none.
    pub displacement_um: BTreeMap<String, f64>,
    /// Mean absolute error of each load, full and by segment [% of the nominal load].
    pub nmae_percent: BTreeMap<String, BTreeMap<String, Option<f64>>>,
}

/// Replays `recording` with `machine` and the set of sensors called `set`.
///
/// # Errors
/// When the machine or the recording cannot be used.
pub fn evaluate(
    machine: &Machine,
    set: Option<&str>,
    recording: &Path,
) -> Result<Evaluation, ReplayError> {
    let sensors = Sensors::choose(machine, set)?;
    let mut figures = Figures::new(machine);
    let mut displacements = Displacements::new(machine, &sensors)?;
    run_line(machine, &sensors, recording, |sample, estimate, line, _| {
        figures.push(sample, estimate);
        displacements.push(sample, line);
    })?;
    Ok(Evaluation {
        nis_mean: figures.nis_mean(),
        displacement_um: (displacements.worst_m().into_iter())
            .map(|(segment, worst)| (segment, 1e6 * worst))
            .collect(),
        nmae_percent: (figures.loads())
            .map(|(name, load)| (name.to_owned(), load.nmae_percent))
            .collect(),
    })
}
