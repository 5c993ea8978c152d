//! The machine description with what was found, as far as the line has a
//! place for it: zeros, maps, drag.

use std::path::Path;

use super::DiagnoseError;
use super::Diagnosis;
use super::effect::{Coupling, GaugeModel};
use super::stream::Kind;
use crate::calibrate::{CalibrateError, Description, map_file};
use crate::machine::{MAP_ENTRIES, Machine, resampled};

/// Writes `machine` with the effects found to `path`, maps beside it; gives
/// the names of the effects that the line has no place for.
///
/// # Errors
/// When a map cannot be read or a file cannot be written.
pub fn write(
    machine: &Machine,
    diagnosis: &Diagnosis,
    path: &Path,
) -> Result<Vec<&'static str>, DiagnoseError> {
    let mut description = Description::read(&machine.path).map_err(CalibrateError::from)?;
    let (changed, absent, _folder) = corrected(machine, diagnosis)?;
    if let (Some(was), Some(is)) = (&machine.drivetrain, &changed.drivetrain) {
        for (was, is) in was.inertias.iter().zip(&is.inertias) {
            if was.drag_nm_s_per_rad != is.drag_nm_s_per_rad {
                description.set_number(
                    "drivetrain.inertia",
                    &is.name,
                    "drag_nm_s_per_rad",
                    is.drag_nm_s_per_rad,
                );
            }
        }
    }
    description.write_with_gauges(machine, &changed, path)?;
    Ok(absent)
}

/// The machine with the effects found, those that have no place, and the
/// folder in which its maps lie.
///
/// # Errors
/// When a map cannot be read or written.
pub fn corrected(
    machine: &Machine,
    diagnosis: &Diagnosis,
) -> Result<(Machine, Vec<&'static str>, tempfile::TempDir), DiagnoseError> {
    let selection = &diagnosis.selection;
    let streams = &diagnosis.sessions[0].streams;
    let mut changed = machine.clone();
    let mut absent = Vec::new();
    let folder = tempfile::tempdir()?;
    let map_path = folder.path().join("maps.csv");
    let mut maps = Vec::new();
    for (k, stream) in streams.iter().enumerate() {
        let Some(number) = machine.channels.iter().position(|c| c.name == stream.name) else {
            continue;
        };
        if stream.kind != Kind::Strain {
            continue;
        }
        let channel = &machine.channels[number];
        let mut gauge = GaugeModel {
            offset: channel.to_si(channel.offset)
                + selection.nuisance[k].first().copied().unwrap_or(0.0),
            map: channel.sensitivity_over_angle(machine)?,
            full_scale: stream.scale,
        };
        let mut moved = false;
        for found in &selection.found {
            if !found.parameters[k].is_empty() && found.effect.coupling() == Coupling::Own {
                moved |= found
                    .effect
                    .mend(&found.shape, &found.parameters[k], &mut gauge);
            }
        }
        let slot = &mut changed.channels[number];
        slot.offset = slot.unit.from_si(gauge.offset);
        if moved {
            let own: Vec<f64> = gauge.map.iter().map(|m| slot.unit.from_si(*m)).collect();
            if own.len() == 1 {
                slot.sensitivity = own.first().copied();
                slot.sensitivity_map = None;
            } else {
                slot.sensitivity = None;
                slot.sensitivity_map = Some(map_path.clone());
                maps.push((channel, resampled(&own, MAP_ENTRIES)));
            }
        }
    }
    map_file(&map_path, &maps, "/Nm").map_err(CalibrateError::from)?;
    for found in &selection.found {
        let mut scratch = GaugeModel {
            offset: 0.0,
            map: vec![1.0],
            full_scale: 1.0,
        };
        let zero = vec![0.0; found.effect.linear().len()];
        let shared = found.parameters.iter().find(|p| !p.is_empty());
        let drag = shared.and_then(|p| found.effect.drag(&found.shape, p));
        if let (Some((body, part)), Some(drivetrain)) = (drag, &mut changed.drivetrain) {
            let signals = &diagnosis.sessions[0].signals;
            let inertia = &mut drivetrain.inertias[body];
            let referred = part * signals.nominal_torque / signals.nominal_speed;
            inertia.drag_nm_s_per_rad =
                (inertia.drag_nm_s_per_rad + referred / inertia.speed_ratio.powi(2)).max(0.0);
        } else if !found.effect.mend(&found.shape, &zero, &mut scratch) {
            absent.push(found.effect.name());
        }
    }
    Ok((changed, absent, folder))
}
