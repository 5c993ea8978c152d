//! Sweeps the process noise Qd of the loads of a simulated gearbox over twelve decades (`curve`),
//! and returns error and innovation norm of a set of sensors at each Qd, for the plots of
//! `loadtwin tables`.

use rayon::prelude::*;

use super::{Individual, TablesError};
use crate::image_build;
use crate::tune::{Method, Training, Trial, TuneError, tune_loads};

/// Decades of Qd around what eq. (23) gives at 10 Hz.
const REACH: i32 = 6;

/// The same sensors with other Qd, those of all loads in proportion.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Set of sensors.
    pub sensors: &'static str,
    /// In the order of rising Qd.
    pub points: Vec<Point>,
}

/// What one Qd gives.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// `log10 Qd` of the first load.
    pub log10_qd: f64,
    /// NMAE of the first load over the whole recording (% of nominal).
    pub nmae: f64,
    /// Innovation norm on the recordings tuned with: mean square over the noise's variance.
    pub innovation: f64,
}

/// Error and innovation norm of `individual` over Qd, two points a decade.
///
/// # Errors
/// When the machine lacks the set of sensors.
pub fn curve(individual: &Individual, set: &'static str) -> Result<Curve, TablesError> {
    let sensors = individual.sensors(set)?;
    let (machine, recordings) = (&individual.machine, &individual.fitted_to);
    let tuned = tune_loads(
        machine,
        &sensors,
        Training::whole(recordings),
        10.0,
        &[Method::Frf],
        |_| (),
    )?;
    let middle = &tuned.methods[0].1;
    let payload = image_build::image(machine, &sensors).map_err(TuneError::from)?;
    let trial = Trial::new(machine, &sensors, &payload, Training::whole(recordings))?;
    let loads: Vec<_> = machine.drivetrain.iter().flat_map(|d| &d.loads).collect();
    let points = (-2 * REACH..=2 * REACH)
        .into_par_iter()
        .map(|half_decades| {
            let decades = 0.5 * f64::from(half_decades);
            let walk: Vec<f64> = middle
                .walk
                .iter()
                .map(|walk| walk * 10.0_f64.powf(0.5 * decades))
                .collect();
            let variance: Vec<f64> = walk
                .iter()
                .zip(&loads)
                .map(|(walk, load)| (walk / load.nominal_nm).powi(2) / machine.rate_hz)
                .collect();
            Ok(Point {
                log10_qd: middle.log10_qd[0] + decades,
                nmae: individual.nmae(sensors.clone(), &walk)?[0],
                innovation: trial.run(&variance).innovation,
            })
        })
        .collect::<Result<_, TablesError>>()?;
    Ok(Curve {
        sensors: set,
        points,
    })
}
