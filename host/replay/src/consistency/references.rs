//! Reference loads beside the estimates.

use loadtwin_common::io::estimate::Estimate;
use loadtwin_machine::Machine;

use super::BEYOND;

/// Part of the nominal load by which a reference and a valid estimate may differ, one standard
/// deviation beside that of the estimate, where causes are compared: a transducer of class 0.5 and
/// what models lack.
const REFERENCE: f64 = 0.1;

/// Part of the nominal load beyond three standard deviations by which a valid load is wrong.
const MARGIN: f64 = 0.03;

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
        let error = (value - f64::from(load.value)).abs();
        let band = f64::from(BEYOND).sqrt() * deviation + MARGIN * nominal;
        Some(ReferenceResidual {
            nis: error * error / variance,
            log_variance: variance.ln(),
            is_beyond: error > band,
        })
    }
}
