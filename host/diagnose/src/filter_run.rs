//! Runs the described filter on a recording, and returns the estimated loads and the normalised
//! innovations of each sensor.

use std::path::Path;

use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::ReplayError;

/// Time at the start that does not count, in which the filter converges [s].
const SETTLING_S: f64 = 2.0;

/// Estimates of the filter with one set of sensors on a recording, sample by sample.
pub(crate) struct Filtered {
    /// Each load of the machine in its own unit.
    pub loads: Vec<Vec<f64>>,
    /// Name and innovations `nu / sqrt(S)` of each sensor; NaN where it was not used and before
    /// the filter has settled.
    pub innovations: Vec<(String, Vec<f64>)>,
}

impl Filtered {
    /// Runs the filter of `machine` with `sensors` on the recording in `path`.
    ///
    /// # Errors
    /// When the machine or the recording cannot be used.
    pub fn run(machine: &Machine, sensors: &Sensors, path: &Path) -> Result<Self, ReplayError> {
        let channels = sensors.channels.iter().map(|c| &c.name);
        let names = channels.chain(sensors.encoders.iter().map(|e| &e.name));
        let mut all = Self {
            loads: vec![Vec::new(); machine.loads().len()],
            innovations: names.map(|name| (name.clone(), Vec::new())).collect(),
        };
        let settled = (SETTLING_S * machine.rate_hz) as usize;
        loadtwin_replay::run(machine, sensors, path, |_, estimate, _| {
            for (load, estimated) in all.loads.iter_mut().zip(&estimate.loads) {
                load.push(f64::from(estimated.value));
            }
            for (sensor, (_, innovations)) in estimate.sensors.iter().zip(&mut all.innovations) {
                let variance = f64::from(sensor.innovation_variance);
                let used = sensor.fault.is_none() && variance > 0.0;
                innovations.push(if used && innovations.len() >= settled {
                    f64::from(sensor.innovation) / variance.sqrt()
                } else {
                    f64::NAN
                });
            }
        })?;
        // A filter need not take every sensor: that of a rotor takes its angle as measured.
        all.innovations.retain(|(_, of)| !of.is_empty());
        Ok(all)
    }
}
