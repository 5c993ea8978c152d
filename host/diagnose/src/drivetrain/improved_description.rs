//! Writes the improved description of a drivetrain and its maps: effects found, as far as the
//! estimator can model them, in the parameters of gauges, inertias, shafts, encoders and
//! thermometer. Returns the names of the effects that it cannot model.

use std::path::Path;

use crate::candidate_effect::Scope;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosis::DiagnoseError;
use crate::diagnosis::Diagnosis;
use crate::drivetrain::candidate_effect::GaugeModel;
use crate::drivetrain::common_mode;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, ResidualSignal};

use loadtwin_identification::calibrate::{CalibrateError, Description, map_file};
use loadtwin_machine::{
    Channel, Creep, Drift, Encoder, Hysteresis, Inertia, MAP_ENTRIES, Machine, Shaft, Thermal,
    resampled, six_digits,
};

/// Writes `machine` with the effects found to `path`, maps beside it; gives
/// the names of the effects that the estimator cannot model.
///
/// # Errors
/// When a map cannot be read or a file cannot be written.
pub fn write(
    machine: &Machine,
    diagnosis: &Diagnosis<DrivetrainResiduals>,
    path: &Path,
) -> Result<Vec<&'static str>, DiagnoseError> {
    let mut description = Description::read(&machine.path).map_err(CalibrateError::from)?;
    let (changed, absent, _folder) = corrected(machine, diagnosis)?;
    if let (Some(was), Some(is)) = (&machine.drivetrain, &changed.drivetrain) {
        write_inertias(&mut description, &was.inertias, &is.inertias);
        write_shafts(&mut description, &was.shafts, &is.shafts);
    }
    let bending = |m: &Machine| m.drivetrain.as_ref().and_then(|d| d.bending);
    if let Some(Drift { std, time_s }) = bending(&changed).filter(|_| bending(machine).is_none()) {
        description.set_in("drivetrain.bending", "std", six_digits(std));
        description.set_in("drivetrain.bending", "time_s", six_digits(time_s));
    }
    write_encoders(&mut description, &machine.encoders, &changed.encoders);
    if let Some((was, is)) = machine.thermometer().zip(changed.thermometer())
        && was.lag_s != is.lag_s
    {
        description.set_number("auxiliary", &is.name, "lag_s", is.lag_s);
    }
    description.write_with_gauges(machine, &changed, path)?;
    Ok(absent)
}

/// What changed of the encoders.
fn write_encoders(description: &mut Description, was: &[Encoder], is: &[Encoder]) {
    for (was, is) in was.iter().zip(is) {
        if let (true, Some(eccentricity)) = (was.eccentricity != is.eccentricity, is.eccentricity) {
            let numbers = [
                ("amplitude_rad", eccentricity.amplitude_rad),
                ("ahead_at_rad", eccentricity.ahead_at_rad),
            ];
            description.set_numbers("encoder", &is.name, "eccentricity", numbers.into_iter());
        }
    }
}

/// What changed of the inertias; a new one before its neighbour.
fn write_inertias(description: &mut Description, was: &[Inertia], is: &[Inertia]) {
    const LIST: &str = "drivetrain.inertia";
    for (i, inertia) in is.iter().enumerate() {
        let name = &inertia.name;
        let Some(was) = was.iter().find(|was| was.name == *name) else {
            let next = is.get(i + 1).map_or("", |next| &next.name);
            let numbers = [
                ("moment_kg_m2", inertia.moment_kg_m2),
                ("speed_ratio", inertia.speed_ratio),
            ];
            description.insert_before(LIST, next, name, &numbers);
            continue;
        };
        if was.moment_kg_m2 != inertia.moment_kg_m2 {
            description.set_number(LIST, name, "moment_kg_m2", inertia.moment_kg_m2);
        }
        if was.drag_nm_s_per_rad != inertia.drag_nm_s_per_rad {
            let drag = inertia.drag_nm_s_per_rad;
            description.set_number(LIST, name, "drag_nm_s_per_rad", drag);
        }
        if was.friction != inertia.friction
            && let Some(friction) = &inertia.friction
        {
            let numbers = [
                ("coulomb_nm", friction.coulomb_nm),
                ("load_part", friction.load_part),
                ("stribeck_nm", friction.stribeck_nm),
                ("stribeck_rad_s", friction.stribeck_rad_s.unwrap_or(0.0)),
                ("presliding_rad", friction.presliding_rad),
            ];
            let given = numbers.into_iter().filter(|(_, value)| *value > 0.0);
            description.set_numbers(LIST, name, "friction", given);
        }
    }
}

/// What changed of the shafts; a new one before its neighbour.
fn write_shafts(description: &mut Description, was: &[Shaft], is: &[Shaft]) {
    const LIST: &str = "drivetrain.shaft";
    for (i, shaft) in is.iter().enumerate() {
        let numbers = [
            ("stiffness_nm_per_rad", shaft.stiffness_nm_per_rad),
            ("damping_nm_s_per_rad", shaft.damping_nm_s_per_rad),
            ("speed_ratio", shaft.speed_ratio),
        ];
        let Some(was) = was.iter().find(|was| was.name == shaft.name) else {
            let next = is.get(i + 1).map_or("", |next| &next.name);
            description.insert_before(LIST, next, &shaft.name, &numbers);
            continue;
        };
        if was.stiffness_nm_per_rad != shaft.stiffness_nm_per_rad {
            for (key, value) in &numbers[..2] {
                description.set_number(LIST, &shaft.name, key, *value);
            }
            let stated = [
                ("stiffness_std_nm_per_rad", shaft.stiffness_std_nm_per_rad),
                ("damping_std_nm_s_per_rad", shaft.damping_std_nm_s_per_rad),
            ];
            for (key, std) in stated {
                if let Some(std) = std {
                    description.set_number(LIST, &shaft.name, key, std);
                }
            }
        }
    }
}

/// The machine with the effects found, those that have no place, and the
/// folder in which its maps lie.
///
/// # Errors
/// When a map cannot be read or written.
pub fn corrected(
    machine: &Machine,
    diagnosis: &Diagnosis<DrivetrainResiduals>,
) -> Result<(Machine, Vec<&'static str>, loadtwin_files::scratch::Scratch), DiagnoseError> {
    let selection = &diagnosis.selection;
    let residuals = &diagnosis.recordings[0].residuals;
    let mut changed = machine.clone();
    let folder = loadtwin_files::scratch::Scratch::new()?;
    let map_path = folder.path().join("maps.csv");
    let mut maps = Vec::new();
    let mut applied = vec![false; selection.found.len()];
    let strains = residuals.iter().filter(|s| s.kind == Kind::Strain);
    let weights: f64 = strains.map(common_mode::weight).sum();
    for (k, signal) in residuals.iter().enumerate() {
        let Some(number) = machine.channels.iter().position(|c| c.name == signal.name) else {
            continue;
        };
        if signal.kind != Kind::Strain {
            continue;
        }
        let channel = &machine.channels[number];
        let mut gauge = described(machine, channel, signal)?;
        gauge.offset += selection.nuisance[k].first().copied().unwrap_or(0.0);
        gauge.weight = common_mode::weight(signal) / weights;
        let mut moved = false;
        for (found, applied) in selection.found.iter().zip(&mut applied) {
            let changes = apply(found, k, &mut gauge, machine.index.is_some());
            *applied |= changes;
            moved |= changes;
        }
        let slot = &mut changed.channels[number];
        set_gauge(slot, &gauge);
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
    let recording = &diagnosis.recordings[0];
    let mut absent = Vec::new();
    for (found, applied) in selection.found.iter().zip(applied) {
        let shared = found.parameters.iter().find(|p| !p.is_empty());
        let changes = shared.is_some_and(|parameters| {
            (found.effect).apply_to_machine(recording, &found.shape, parameters, &mut changed)
        });
        if !applied && !changes {
            absent.push(found.effect.name());
        }
    }
    Ok((changed, absent, folder))
}

/// The gauge of `channel` as described, in SI units, with no weight.
fn described(
    machine: &Machine,
    channel: &Channel,
    signal: &ResidualSignal,
) -> Result<GaugeModel, DiagnoseError> {
    let sampled = machine.thermometer().is_some_and(|t| t.adc.is_some());
    let thermal = channel.thermal.unwrap_or_default();
    Ok(GaugeModel {
        offset: channel.to_si(channel.offset),
        map: channel.sensitivity_over_angle(machine)?,
        full_scale: signal.scale,
        nonlinearity: channel.nonlinearity,
        creep: channel.creep.map(|creep| Creep {
            at_nominal: channel.to_si(creep.at_nominal),
            ..creep
        }),
        hysteresis: channel.hysteresis.map(|hysteresis| Hysteresis {
            half_width: channel.to_si(hysteresis.half_width),
            ..hysteresis
        }),
        bending: channel.to_si(channel.bending),
        late_s: channel.late_s,
        weight: 0.0,
        thermal: sampled.then(|| Thermal {
            zero_per_k: channel.to_si(thermal.zero_per_k),
            ..thermal
        }),
    })
}

/// Adds what was found of signal `k` to its gauge; whether that changes it.
fn apply(
    found: &FittedEffect<DrivetrainResiduals>,
    k: usize,
    gauge: &mut GaugeModel,
    is_homed: bool,
) -> bool {
    let own = &found.parameters[k];
    if own.is_empty() || found.effect.scope() != Scope::PerSignal {
        return false;
    }
    let before = gauge.map.clone();
    let changes = found.effect.apply_to(&found.shape, own, gauge);
    // Over an angle that nothing homes the phase is lost at the next start.
    if !is_homed && gauge.map.len() > 1 {
        gauge.map = before;
        return false;
    }
    changes
}

/// Writes all of `gauge` but its map, in the units of the channel.
fn set_gauge(channel: &mut Channel, gauge: &GaugeModel) {
    let unit = channel.unit;
    channel.offset = unit.from_si(gauge.offset);
    channel.nonlinearity = gauge.nonlinearity;
    channel.late_s = gauge.late_s;
    channel.bending = unit.from_si(gauge.bending);
    channel.creep = gauge.creep.map(|creep| Creep {
        at_nominal: unit.from_si(creep.at_nominal),
        ..creep
    });
    channel.hysteresis = gauge.hysteresis.map(|hysteresis| Hysteresis {
        half_width: unit.from_si(hysteresis.half_width),
        ..hysteresis
    });
    let known = gauge.thermal.filter(|t| *t != Thermal::default());
    channel.thermal = known.map(|thermal| Thermal {
        zero_per_k: unit.from_si(thermal.zero_per_k),
        ..thermal
    });
}
