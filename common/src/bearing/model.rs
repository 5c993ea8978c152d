//! Defines the parameters of a bearing in a model image (`BearingModel`: loads, gauge responses,
//! encoder, geometry, tuning of the filter) and checks their ranges before the estimator is built.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::bearing::contact::Geometry;
use crate::bearing::{FEATURES, GAUGES, HARMONICS, LOADS, ROWS};
use crate::error::finite;
use crate::io::estimate::MAX_LOADS;
use crate::io::measurement::{AdcScaling, EncoderScaling};
use crate::load_signal::LoadSignal;

/// A model of a bearing, as the image holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BearingModel {
    /// `Fx, Fy, Fz, Mx, Mz`; forces (N), moments [N m].
    pub loads: Vec<LoadSignal, MAX_LOADS>,
    /// The gauges in the order of the board's words.
    pub gauges: [GaugeModel; GAUGES],
    /// The wheel's encoder.
    pub counter: EncoderScaling,
    /// Balls that pass a point of the outer ring in a turn of the wheel, not 0.
    pub passes_per_turn: f32,
    /// The bearing.
    pub geometry: Geometry,
    /// The filter's tuning.
    pub tuning: Tuning,
}

/// Parameters of one gauge's response: bulk strain and local strain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaugeModel {
    /// Word to strain [um/m].
    pub converter: AdcScaling,
    /// `N psi_g`: phase of ball passing at the gauge (rad).
    pub passing: f32,
    /// Standard deviation of a reading [um/m], > 0.
    pub noise_std: f32,
    /// Error of the local strain's model where there is no strain (um/m), >= 0.
    pub resting_error: f32,
    /// Error of the local strain's model, as part of the strain, >= 0.
    pub model_error: f32,
    /// Bulk strain at no load when calibrated [um/m].
    pub offset: f32,
    /// Bulk strain by the loads [um/m / kN].
    pub bulk_load: [f32; LOADS],
    /// Bulk strain by the features of each row [um/m / kN].
    pub bulk_feature: [[f32; FEATURES]; ROWS],
    /// Local strain by row, harmonic and feature: real and imaginary part [um/m / kN].
    pub local: [[[[f32; 2]; FEATURES]; HARMONICS]; ROWS],
}

/// Tuning of the joint filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tuning {
    /// Time constant of the slip (s), > 0.
    pub slip_time_s: f32,
    /// Standard deviation of slip, relative, > 0.
    pub slip_std: f32,
    /// Slip of a cage, relative, beyond which the loads are reported as `Slipped`, > 0.
    pub slip_limit: f32,
    /// Random walk of the phase (rad/sqrt(rad)), >= 0.
    pub phase_walk: f32,
    /// Mean of the loads that are expected (kN).
    pub load_mean: [f32; LOADS],
    /// Lower factor of their covariance (kN): those on the rig.
    pub load_factor: [[f32; LOADS]; LOADS],
    /// Time constant with which the loads return to their mean (s), > 0.
    pub load_time_s: f32,
    /// Standard deviation of the preload (um), > 0.
    pub preload_std: f32,
    /// Random walk of the preload (um/sqrt(s)), >= 0.
    pub preload_walk: f32,
    /// Standard deviation of the biases (um/m), > 0.
    pub bias_std: f32,
    /// Time constant of the biases (s), > 0.
    pub bias_time_s: f32,
    /// Error of the bulk strain's model from block to block (um/m), > 0.
    pub bulk_std: f32,
    /// Frequency of ball passing below which bulk and local strain cannot be separated (Hz), > 0.
    pub lowest_hz: f32,
}

impl BearingModel {
    /// Checks all numbers but those of the geometry, which [`Contacts`] checks; the error has the
    /// name of the first that is out of its range.
    ///
    /// [`Contacts`]: crate::bearing::contact::Contacts
    pub(crate) fn check(&self) -> Result<(), Error> {
        if self.loads.len() != LOADS {
            return Err(Error::OutOfRange("number of loads"));
        }
        let t = &self.tuning;
        let positive = [
            ("slip_time_s", t.slip_time_s),
            ("slip_std", t.slip_std),
            ("load_time_s", t.load_time_s),
            ("slip_limit", t.slip_limit),
            ("preload_std", t.preload_std),
            ("bias_std", t.bias_std),
            ("bias_time_s", t.bias_time_s),
            ("bulk_std", t.bulk_std),
            ("lowest_hz", t.lowest_hz),
        ];
        let noise = (self.gauges.iter()).map(|gauge| ("noise_std", gauge.noise_std));
        for (name, value) in positive.into_iter().chain(noise) {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::NotPositive(name));
            }
        }
        for (i, row) in t.load_factor.iter().enumerate() {
            if !(row[i] > 0.0 && row.iter().all(|value| value.is_finite())) {
                return Err(Error::NotPositive("load_factor"));
            }
        }
        let not_negative = [t.phase_walk, t.preload_walk];
        let of_gauges = (self.gauges.iter()).flat_map(|g| [g.resting_error, g.model_error]);
        let mut all = not_negative.into_iter().chain(of_gauges);
        if !all.all(|value| value >= 0.0 && value.is_finite()) {
            return Err(Error::OutOfRange("bearing noise"));
        }
        finite(&t.load_mean, LOADS, "load_mean")?;
        self.gauges.iter().try_for_each(GaugeModel::check)?;
        if !(self.passes_per_turn != 0.0 && self.passes_per_turn.is_finite()) {
            return Err(Error::OutOfRange("passes_per_turn"));
        }
        Ok(())
    }
}

#[cfg(test)]
impl GaugeModel {
    /// A gauge with noise of 0.8, without offset, errors of the model or answer to a load.
    pub(crate) fn plain() -> Self {
        Self {
            converter: AdcScaling {
                zero: 0,
                gain: 1.0,
                lowest: -1,
                highest: 1,
                stuck_after: 0,
            },
            passing: 0.0,
            noise_std: 0.8,
            resting_error: 0.0,
            model_error: 0.0,
            offset: 0.0,
            bulk_load: Default::default(),
            bulk_feature: Default::default(),
            local: Default::default(),
        }
    }
}

impl GaugeModel {
    fn check(&self) -> Result<(), Error> {
        let gain = self.converter.gain;
        finite(&[gain, self.passing, self.offset], 3, "gauge")?;
        if gain == 0.0 {
            return Err(Error::OutOfRange("channel gain"));
        }
        finite(&self.bulk_load, LOADS, "bulk_load")?;
        finite(
            self.bulk_feature.as_flattened(),
            ROWS * FEATURES,
            "bulk_feature",
        )?;
        let local = self.local.as_flattened().as_flattened().as_flattened();
        finite(local, ROWS * HARMONICS * FEATURES * 2, "local strain")
    }

    /// Variance of a reading about the model where there is no local strain [(um/m)^2].
    pub(crate) fn resting_variance(&self) -> f32 {
        self.noise_std * self.noise_std + self.resting_error * self.resting_error
    }
}
