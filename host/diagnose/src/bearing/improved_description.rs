//! Writes the improved description of a bearing: the original text with the preload found and, in
//! another folder, the absolute path of the calibration. Returns the names of the effects that the
//! description has no place for.

use std::path::Path;

use crate::bearing::BearingResiduals;
use crate::diagnosis::{DiagnoseError, Diagnosis};
use loadtwin_identification::calibrate::{CalibrateError, Description};
use loadtwin_machine::Machine;

/// Writes `machine` with the effects found to `path`; gives the names of the effects that the
/// description has no place for.
///
/// # Errors
/// When a file cannot be read or written.
pub(crate) fn write(
    machine: &Machine,
    diagnosis: &Diagnosis<BearingResiduals>,
    path: &Path,
) -> Result<Vec<&'static str>, DiagnoseError> {
    let mut improved = machine.clone();
    let mut absent = Vec::new();
    for found in &diagnosis.selection.found {
        let own = found.parameters.iter().find(|own| !own.is_empty());
        let is_applied =
            own.is_some_and(|own| found.effect.apply_to(&found.shape, own, &mut improved));
        if !is_applied {
            absent.push(found.effect.name());
        }
    }
    let mut description = Description::read(&machine.path).map_err(CalibrateError::from)?;
    if let (Some(was), Some(is)) = (&machine.bearing, &improved.bearing) {
        if was.preload_um != is.preload_um {
            description.set_in("bearing", "preload_um", is.preload_um);
        }
        // From another folder the calibration has another name.
        if let Some(file) = &was.calibration
            && path.parent() != machine.path.parent()
        {
            let file = std::fs::canonicalize(machine.resolve(file))?;
            description.set_in("bearing", "calibration", file.display().to_string());
        }
    }
    description.write(path).map_err(CalibrateError::from)?;
    Ok(absent)
}
