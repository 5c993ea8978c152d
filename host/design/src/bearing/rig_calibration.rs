//! Calibrates a bearing from a recording with known loads, for `loadtwin calibrate`: in four passes
//! it tracks the ball-pass phases, fits the gauge responses and, in the middle two, the physical
//! parameters. Then come standard deviations and the baseline algorithms.
//!
//! The filter itself follows the phases with the loads given; for given phases and
//! contacts, the response of a gauge is linear in its coefficients, so that their fit is
//! one linear least-squares problem. The deviations of the bearing from its description follow from
//! the residual of that fit.
//!
//! Source: Kerst et al. 2019, section VI-D, modified.

use loadtwin_common::bearing::{GAUGES, LOADS};
use loadtwin_common::io::raw::RawSample;

use crate::bearing::baseline::Baseline;
use crate::bearing::cage_slip::mean_cage_slip;
use crate::bearing::calibration_file::Calibration;
use crate::bearing::gauge_calibration::{fit_gauges, uncertainty};
use crate::bearing::phase_tracking::{CalibrationBlock, check_followed, track_phases};
use crate::bearing::physical_fit::refine;
use crate::error::BuildError;
use crate::sensor_set::Sensors;
use loadtwin_machine::{Bearing, Machine};

/// Times that phases are followed and gauges fitted in turn.
const ITERATIONS: usize = 4;
/// Least part of the blocks that must have been followed in the last iteration.
const LEAST_FOLLOWED: f64 = 0.5;

/// The same in the iterations before, whose responses are not yet fitted.
const LEAST_AT_FIRST: f64 = 0.1;
/// Error of responses before their first fit, as part of the strain.
const INITIAL_MODEL_ERROR: f32 = 0.7;
/// Factor by which the standard deviations of model errors are enlarged: they last for many blocks,
/// where the filter takes them for new ones in each. 4 is an error of 16 blocks, 0.16 s.
pub(crate) const ERROR_CORRELATION_FACTOR: f64 = 4.0;

/// A sample on the rig: raw words, and `Fx, Fy, Fz` (N), `Mx, Mz` [N m].
pub type RigSample = (RawSample, [f64; LOADS]);

/// A machine on its rig.
#[derive(Clone, Copy, Debug)]
pub struct Rig<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Its bearing.
    pub bearing: &'a Bearing,
    /// Its sensors.
    pub sensors: &'a Sensors,
}

impl Rig<'_> {
    /// Phase of ball passing at gauge `g` when it is 0 at azimuth 0 [rad].
    pub(crate) fn passing(&self, g: usize) -> f64 {
        f64::from(self.bearing.balls) * self.bearing.gauges[g].azimuth_deg.to_radians()
    }
}

/// Fits the responses of the gauges and the bearing's own parameters to `samples`, with their
/// uncertainty, and the paper's algorithms. Calls `each` with the part of the work that is done, 0 to 1.
///
/// # Errors
/// As [`fit`].
pub fn calibrate(
    rig: &Rig<'_>,
    samples: &[RigSample],
    mut each: impl FnMut(f64),
) -> Result<Calibration, BuildError> {
    // Passes of the fit, uncertainty, the paper's algorithms.
    let mut part = |step: usize| each(step as f64 / (ITERATIONS + 2) as f64);
    let (mut calibration, known) = fit_reporting(rig, samples, &mut part)?;
    uncertainty(rig, &known, &mut calibration)?;
    part(ITERATIONS + 1);
    calibration.baseline = Some(Baseline::fit(rig, samples, &known)?);
    Ok(calibration)
}

/// Fits what the filter needs to `samples`; gives the phases that it followed, too.
///
/// # Errors
/// When the description does not make a model, or the phases cannot be followed.
pub fn fit(
    rig: &Rig<'_>,
    samples: &[RigSample],
) -> Result<(Calibration, Vec<CalibrationBlock>), BuildError> {
    fit_reporting(rig, samples, &mut |_| ())
}

/// As [`fit`]; calls `each` with the number of passes that are done.
fn fit_reporting(
    rig: &Rig<'_>,
    samples: &[RigSample],
    each: &mut impl FnMut(usize),
) -> Result<(Calibration, Vec<CalibrationBlock>), BuildError> {
    let mut calibration = Calibration::guess(GAUGES);
    expect(samples, &mut calibration);
    let mut known = Vec::new();
    for pass in 0..ITERATIONS {
        known = track_phases(rig, samples, &calibration, |model| {
            for gauge in model.gauges.iter_mut().filter(|_| pass == 0) {
                gauge.model_error = INITIAL_MODEL_ERROR;
            }
        })?;
        let last = pass + 1 == ITERATIONS;
        let least = if last { LEAST_FOLLOWED } else { LEAST_AT_FIRST };
        check_followed(rig, samples, &known, least)?;
        fit_gauges(rig, &known, &mut calibration)?;
        if (1..ITERATIONS - 1).contains(&pass) {
            refine(rig, &known, &mut calibration)?;
        }
        each(pass + 1);
    }
    calibration.cage_slip = mean_cage_slip(rig, &known, &calibration)?;
    Ok((calibration, known))
}

/// Prior mean and covariance of the loads, for times at which readings contain little information.
fn expect(samples: &[RigSample], calibration: &mut Calibration) {
    let known = || {
        (samples.iter().map(|sample| &sample.1))
            .filter(|loads| loads.iter().all(|load| load.is_finite()))
    };
    let count = known().count().max(1) as f64;
    let mut mean = [0.0; LOADS];
    for loads in known() {
        for (sum, load) in mean.iter_mut().zip(loads) {
            *sum += load / count;
        }
    }
    let mut covariance = [[0.0; LOADS]; LOADS];
    for loads in known() {
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, sum) in row.iter_mut().enumerate() {
                *sum += (loads[i] - mean[i]) * (loads[j] - mean[j]) / count;
            }
        }
    }
    calibration.load_mean = mean;
    calibration.load_covariance = covariance;
}
