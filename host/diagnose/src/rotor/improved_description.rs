//! Writes the improved description of a rotor: effects found, in the offset, runout and sensitivity
//! of channels and in the stiffness of bearings. Returns the names of the effects that the
//! description has no place for.

use std::path::Path;

use crate::candidate_effect::Scope;
use crate::diagnosis::{DiagnoseError, Diagnosis};
use crate::rotor::{RotorResiduals, RotorTarget};
use loadtwin_identification::calibrate::{CalibrateError, Description};
use loadtwin_machine::Machine;

/// Writes `machine` with the effects found to `path`; gives the names of the effects that the
/// description has no place for, or whose place the recordings do not determine.
///
/// # Errors
/// When a file cannot be read or written.
pub(crate) fn write(
    machine: &Machine,
    diagnosis: &Diagnosis<RotorResiduals>,
    path: &Path,
) -> Result<Vec<&'static str>, DiagnoseError> {
    let mut place = RotorTarget {
        machine: machine.clone(),
        channel: None,
    };
    let channels = diagnosis.recordings[0].channels();
    let mut absent = Vec::new();
    for found in &diagnosis.selection.found {
        let acting = (found.parameters.iter().enumerate()).filter(|(_, own)| !own.is_empty());
        let count = match found.effect.scope() {
            Scope::Machine => 1,
            Scope::PerSignal => usize::MAX,
        };
        // Where several locations are equivalent, none is changed.
        let mut is_applied = found.equivalent_locations.is_empty();
        for (k, own) in acting
            .take(count)
            .filter(|_| found.equivalent_locations.is_empty())
        {
            place.channel = machine
                .channels
                .iter()
                .position(|c| c.name == channels[k].name);
            is_applied &= found.effect.apply_to(&found.shape, own, &mut place);
        }
        if !is_applied {
            absent.push(found.effect.name());
        }
    }
    let mut description = Description::read(&machine.path).map_err(CalibrateError::from)?;
    for (was, is) in machine.channels.iter().zip(&place.machine.channels) {
        if was.offset != is.offset {
            description.set_number("channel", &is.name, "offset", is.offset);
        }
        if was.runout != is.runout {
            description.set_matrix("channel", &is.name, "runout", &is.runout);
        }
        if let Some(sensitivity) = is.sensitivity.filter(|_| was.sensitivity != is.sensitivity) {
            description.set_number("channel", &is.name, "sensitivity", sensitivity);
        }
    }
    if let (Some(was), Some(is)) = (&machine.rotor, &place.machine.rotor) {
        for (i, (was, is)) in was.bearings.iter().zip(&is.bearings).enumerate() {
            if let Some(k) = is.stiffness_n_per_m.filter(|_| was != is) {
                description.set_matrix_at("rotor.bearing", i, "stiffness_n_per_m", &k);
            }
        }
    }
    description.write(path).map_err(CalibrateError::from)?;
    Ok(absent)
}
