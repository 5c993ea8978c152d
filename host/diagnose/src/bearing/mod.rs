//! Diagnosis of bearings: the types of its residual signals (bulk and local strain of each gauge,
//! slip of each cage, given the measured loads), of a recording, and of the description that an
//! effect changes.
//!
//! Phases are followed as on the rig, with the loads given. Of each gauge there is then the
//! mean strain less its prediction by the calibration (bulk), and the strain that goes with the
//! balls, along its prediction (local); of each row the lag of its cage. An
//! offset that warms up is projected out of the bulk strain and of the regressors alike.

mod candidate_effect;
mod diagnosable;
mod improved_description;
mod null_simulation;
mod recorded_blocks;
mod residual_computation;

use std::sync::Arc;

use loadtwin_common::bearing::{GAUGES, ROWS};

use crate::bearing::residual_computation::BearingContext;
use loadtwin_machine::Machine;

use crate::residual_model::SignalSet;

/// Signals: bulk and local strain of each gauge, slip of each cage.
const STREAMS: usize = 2 * GAUGES + ROWS;

/// What a residual is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Mean strain of a gauge [um/m].
    Bulk(usize),
    /// Strain of a gauge that goes with the balls, along the predicted one [um/m].
    Local(usize),
    /// Part by which the cage of a row goes faster than predicted from its contacts.
    Slip(usize),
}

impl Kind {
    fn of(k: usize) -> Self {
        match k {
            0..GAUGES => Self::Bulk(k),
            _ if k < 2 * GAUGES => Self::Local(k - GAUGES),
            _ => Self::Slip(k - 2 * GAUGES),
        }
    }
}

/// A residual.
#[derive(Clone, Debug)]
pub struct BearingSignal {
    name: String,
    residual: Vec<f64>,
    /// Residual of a fault-free bearing, root mean square.
    noise_std: f64,
}

/// A recording of a bearing as residuals.
#[derive(Clone)]
pub struct BearingResiduals {
    context: Arc<BearingContext>,
    residuals: Vec<BearingSignal>,
    /// Since the first recording's start [s].
    t: Vec<f64>,
}

/// The part of a description that an effect changes: the machine.
pub type BearingTarget = Machine;

impl BearingResiduals {
    /// A column by residual and block.
    fn each(&self, of: impl Fn(Kind, usize) -> f64) -> SignalSet {
        (0..STREAMS)
            .map(|k| (0..self.t.len()).map(|i| of(Kind::of(k), i)).collect())
            .collect()
    }
}
