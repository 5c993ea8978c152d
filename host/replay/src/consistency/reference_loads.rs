//! Compares valid load estimates with the reference loads of the recording: normalised residual,
//! share of samples outside the band, mean error. Names the cause where a load is outside its band
//! or biased.

use loadtwin_common::io::estimate::Estimate;
use loadtwin_machine::Machine;

use super::{BEYOND, CONTRADICTING, Cause, SETTLED};

/// Part of the nominal load by which a reference and a valid estimate may differ, one standard
/// deviation beside that of the estimate, where causes are compared: a transducer of class 0.5 and
/// what models lack.
const REFERENCE: f64 = 0.1;

/// Part of the nominal load beyond three standard deviations by which a valid load is wrong.
const MARGIN: f64 = 0.03;

/// Mean error of a load from which it is biased [standard deviations]: as large as what is stated of
/// a single sample.
const BIASED: f64 = 1.0;

/// A reference and the load that it measures.
#[derive(Clone, Debug)]
pub(super) struct Reference {
    pub load: String,
    /// Place among the loads and nominal value; none where the machine has no such load.
    of: Option<(usize, f64)>,
}

/// A reference against a valid estimate.
pub(super) struct ReferenceResidual {
    /// Normalised residual squared.
    pub nis: f64,
    /// Logarithm of its variance.
    pub log_variance: f64,
    /// The load minus the reference [part of nominal], and over the load's standard deviation.
    pub error: f64,
    pub deviations: f64,
    /// Whether the load is outside its band: beyond three standard deviations by more than 3 % of
    /// nominal.
    pub is_beyond: bool,
}

impl Reference {
    /// Those of the machine, in its order.
    pub fn all(machine: &Machine) -> Vec<Self> {
        let loads = machine.loads();
        let of = |name: &str| {
            let place = loads.iter().position(|load| load.name == name)?;
            Some((place, loads[place].nominal))
        };
        (machine.references.iter())
            .map(|reference| Self {
                load: reference.load.clone(),
                of: of(&reference.load),
            })
            .collect()
    }

    /// `value` of the reference against the estimate; none where that is not valid.
    pub fn residual(&self, value: f64, estimate: &Estimate) -> Option<ReferenceResidual> {
        let (place, nominal) = self.of?;
        let load = estimate.loads.get(place)?;
        if !(load.fault.is_none() && value.is_finite()) {
            return None;
        }
        let deviation = f64::from(load.std);
        let variance = deviation.powi(2) + (REFERENCE * nominal).powi(2);
        let error = f64::from(load.value) - value;
        let band = f64::from(BEYOND).sqrt() * deviation + MARGIN * nominal;
        Some(ReferenceResidual {
            nis: error.powi(2) / variance,
            log_variance: variance.ln(),
            error: error / nominal,
            deviations: error / deviation,
            is_beyond: error.abs() > band,
        })
    }
}

/// One reference beside the valid estimates of a replay.
#[derive(Clone, Debug)]
pub(super) struct ReferenceConsistency {
    reference: Reference,
    compared: u64,
    pub beyond: u64,
    /// Sums of the error and of the error over its standard deviation.
    sums: [f64; 2],
}

impl ReferenceConsistency {
    /// Nothing compared yet, of each reference of the machine.
    pub fn all(machine: &Machine) -> Vec<Self> {
        let of = |reference| Self {
            reference,
            compared: 0,
            beyond: 0,
            sums: [0.0; 2],
        };
        Reference::all(machine).into_iter().map(of).collect()
    }

    /// Adds one sample.
    pub fn push(&mut self, value: f64, estimate: &Estimate) {
        if let Some(residual) = self.reference.residual(value, estimate) {
            self.compared += 1;
            self.beyond += u64::from(residual.is_beyond);
            self.sums[0] += residual.error;
            self.sums[1] += residual.deviations;
        }
    }

    /// Part of the valid samples in which the load is outside its band.
    pub fn part_beyond(&self) -> f64 {
        self.beyond as f64 / self.compared.max(1) as f64
    }

    /// Whether the load is outside its band more often than [`CONTRADICTING`].
    pub fn is_outside(&self) -> bool {
        self.beyond >= SETTLED && self.part_beyond() > CONTRADICTING
    }

    /// What the reference says against the load, if anything.
    pub fn cause(&self, machine: &Machine) -> Option<Cause> {
        let load = &self.reference.load;
        let [error, deviations] = self.sums.map(|sum| sum / self.compared.max(1) as f64);
        let what = if self.is_outside() {
            format!(
                "{load} is outside its band beside the reference in {:.0} % of its valid samples",
                100.0 * self.part_beyond()
            )
        } else if self.compared > SETTLED && deviations.abs() > BIASED && error.abs() > MARGIN {
            format!(
                "{load} is {:.1} % of nominal {} its reference on average",
                100.0 * error.abs(),
                if error > 0.0 { "above" } else { "below" }
            )
        } else {
            return None;
        };
        let remedy = if machine.balance.is_some() {
            "find what the model lacks with `loadtwin diagnose`"
        } else {
            "fit sensitivities with `loadtwin calibrate`"
        };
        Some(Cause {
            kind: "calibration",
            what,
            corrected_percent: None,
            remedy: format!("{remedy}, or check sign, zero and unit of the reference"),
        })
    }
}
