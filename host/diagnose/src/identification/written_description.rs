//! Writes the parameters of a drivetrain that were identified into its description, with their standard
//! deviations.

use std::path::Path;

use super::{Identification, Identified, Shown};
use crate::diagnosis::DiagnoseError;
use loadtwin_identification::calibrate::{CalibrateError, Description};
use loadtwin_machine::Machine;

/// Writes the description of `machine` with what `identification` accepts to `path`, its maps beside it.
///
/// The standard deviation of a parameter that only shows together with others is not written: their errors go
/// together, and what reads them counts them as independent.
///
/// # Errors
/// When a map cannot be read or a file cannot be written.
pub fn write_identified(
    machine: &Machine,
    identification: &Identification,
    path: &Path,
) -> Result<(), DiagnoseError> {
    let mut description = Description::read(&machine.path).map_err(CalibrateError::from)?;
    let accepted = identification.parameters.iter().filter(|p| p.accepted);
    for Identified {
        parameter,
        value,
        std,
        shown,
        ..
    } in accepted
    {
        let (list, part) = (parameter.quantity.list(), &parameter.part);
        let [key, deviation] = parameter.quantity.keys();
        description.set_number(list, part, key, *value);
        if *shown == Shown::Alone {
            description.set_number(list, part, deviation, *std);
        } else {
            description.remove(list, part, deviation);
        }
    }
    description.write_with_gauges(machine, machine, path)?;
    Ok(())
}
