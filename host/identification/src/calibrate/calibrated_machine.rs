//! Transfers fitted offsets, sensitivities and noise of gauges into the machine and its map files,
//! and writes the gauges that changed into its description.

use std::path::{Path, PathBuf};

use crate::calibrate::description_edits::{Description, DescriptionError, complete_map, map_file};
use crate::calibrate::measurement_noise::{MeasurementNoise, NOISE_BINS, rms, step_function};
use crate::calibrate::{CalibrateError, Gauge, MapSource};
use loadtwin_files::atomic_file::{Complete, publish};
use loadtwin_machine::{Channel, Creep, Hysteresis, MAP_ENTRIES, Machine, Thermal, resampled};

/// The machine with offset, sensitivity and noise of its gauges as fitted; its
/// maps lie in `folder`. Faulty gauges stay as described.
///
/// # Errors
/// When a map cannot be read or written.
pub fn calibrated(
    machine: &Machine,
    gauges: &[Gauge],
    source: MapSource,
    folder: &Path,
) -> Result<Machine, CalibrateError> {
    let mut changed = machine.clone();
    let path = folder.join("maps.csv");
    let mut maps = Vec::new();
    for gauge in gauges.iter().filter(|gauge| gauge.fault.is_none()) {
        let Some((offset, map)) = gauge.model(source) else {
            continue;
        };
        let own = |values: &[f64]| in_unit(&machine.channels[gauge.channel], values);
        // Over an angle that nothing homes a map's phase is lost at the next start: its mean stays.
        let mean = [map.iter().sum::<f64>() / map.len() as f64];
        let map = if machine.index.is_none() { &mean } else { map };
        let channel = &mut changed.channels[gauge.channel];
        channel.offset = channel.unit.from_si(offset);
        if map.len() == 1 {
            channel.sensitivity = own(map).first().copied();
            channel.sensitivity_map = None;
        } else {
            channel.sensitivity = None;
            channel.sensitivity_map = Some(path.clone());
            maps.push((
                &machine.channels[gauge.channel],
                resampled(&own(map), MAP_ENTRIES),
            ));
        }
    }
    map_file(&path, &maps, "/Nm")?;
    let noise = gauges
        .iter()
        .filter(|gauge| gauge.fault.is_none())
        .filter_map(|gauge| Some((gauge.channel, gauge.noise.as_ref()?)));
    with_noise(&changed, noise, folder)
}

/// The machine with the noise of channels, by their number, as measured; its
/// map lies in `folder`.
///
/// # Errors
/// When the map cannot be written.
pub fn with_noise<'a>(
    machine: &Machine,
    noise: impl Iterator<Item = (usize, &'a MeasurementNoise)>,
    folder: &Path,
) -> Result<Machine, CalibrateError> {
    let mut changed = machine.clone();
    let path = folder.join("noise.csv");
    let mut columns = Vec::new();
    for (i, noise) in noise {
        let channel = &mut changed.channels[i];
        channel.noise_std = channel.unit.from_si(rms(&noise.scaled));
        // As of sensitivities: a map needs an angle that is homed.
        if machine.index.is_none() {
            channel.noise_map = None;
            continue;
        }
        channel.noise_map = Some(path.clone());
        columns.push((
            &machine.channels[i],
            in_unit(&machine.channels[i], &noise.scaled),
        ));
    }
    map_file(&path, &columns, "")?;
    Ok(changed)
}

impl Description {
    /// Takes over the gauges of `changed` where they are not those of
    /// `described`, and writes the description to `path`, all maps beside it.
    ///
    /// # Errors
    /// When a map cannot be read or a file cannot be written.
    pub fn write_with_gauges(
        &mut self,
        described: &Machine,
        changed: &Machine,
        path: &Path,
    ) -> Result<(), CalibrateError> {
        let files = self.with_gauges(described, changed, path)?;
        Ok(publish(files).map_err(DescriptionError::from)?)
    }

    /// As [`Description::write_with_gauges`], but that the files have no names before
    /// they are published, the maps first.
    ///
    /// # Errors
    /// When a map cannot be read or a file cannot be written.
    pub fn with_gauges(
        &mut self,
        described: &Machine,
        changed: &Machine,
        path: &Path,
    ) -> Result<Vec<Complete>, CalibrateError> {
        let [map_path, noise_path] = maps_beside(path);
        let name = |path: &Path| {
            let name = path.file_name().unwrap_or_default();
            name.to_string_lossy().into_owned()
        };
        let (map_name, noise_name) = (name(&map_path), name(&noise_path));
        self.set_error_bands(described, changed);
        let (mut maps, mut noises) = (Vec::new(), Vec::new());
        for (was, is) in described.channels.iter().zip(&changed.channels) {
            let name = &was.name;
            if is.offset != was.offset {
                self.set_number("channel", name, "offset", is.offset);
            }
            if is.sensitivity_map.is_some() {
                let map = in_unit(is, &is.sensitivity_over_angle(changed)?);
                self.remove("channel", name, "sensitivity");
                self.set("channel", name, "sensitivity_map", map_name.as_str());
                maps.push((is, resampled(&map, MAP_ENTRIES)));
            } else if let Some(sensitivity) =
                is.sensitivity.filter(|_| is.sensitivity != was.sensitivity)
            {
                self.remove("channel", name, "sensitivity_map");
                self.set_number("channel", name, "sensitivity", sensitivity);
            }
            self.set_response(was, is);
            if is.noise_std != was.noise_std {
                self.set_number("channel", name, "noise_std", is.noise_std);
            }
            if is.noise_map.is_some() {
                let noise = in_unit(is, &is.noise_over_angle(changed)?);
                self.set("channel", name, "noise_map", noise_name.as_str());
                noises.push((is, step_function(&noise, NOISE_BINS)));
            }
        }
        let maps = complete_map(&map_path, &maps, "/Nm")?;
        let noises = complete_map(&noise_path, &noises, "")?;
        let description = self.complete(path)?;
        Ok(maps
            .into_iter()
            .chain(noises)
            .chain([description])
            .collect())
    }

    /// Sets what changed of a channel's response beyond its sensitivity.
    fn set_response(&mut self, was: &Channel, is: &Channel) {
        let name = &was.name;
        if is.bending != was.bending {
            self.set_number("channel", name, "bending", is.bending);
        }
        if is.nonlinearity != was.nonlinearity {
            self.set_number("channel", name, "nonlinearity", is.nonlinearity);
        }
        if is.late_s != was.late_s {
            self.set_number("channel", name, "late_s", is.late_s);
        }
        match is.creep {
            same if same == was.creep => {}
            Some(Creep { at_nominal, time_s }) => {
                let numbers = [("at_nominal", at_nominal), ("time_s", time_s)];
                self.set_numbers("channel", name, "creep", numbers.into_iter());
            }
            None => self.remove("channel", name, "creep"),
        }
        match is.hysteresis {
            same if same == was.hysteresis => {}
            Some(Hysteresis { half_width, level }) => {
                let numbers = [("half_width", half_width), ("level", level)];
                self.set_numbers("channel", name, "hysteresis", numbers.into_iter());
            }
            None => self.remove("channel", name, "hysteresis"),
        }
        if is.thermal != was.thermal
            && let Some(Thermal {
                zero_per_k,
                gain_per_k,
            }) = is.thermal
        {
            let numbers = [("zero_per_k", zero_per_k), ("gain_per_k", gain_per_k)];
            self.set_numbers("channel", name, "thermal", numbers.into_iter());
        }
    }
}

/// The maps beside a description that is written to `path`: sensitivity, noise.
pub fn maps_beside(path: &Path) -> [PathBuf; 2] {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    ["maps", "noise"].map(|what| path.with_file_name(format!("{stem}-{what}.csv")))
}

fn in_unit(channel: &Channel, si: &[f64]) -> Vec<f64> {
    si.iter()
        .map(|value| channel.unit.from_si(*value))
        .collect()
}
