//! What a bearing's description and calibration may lack, a file for each effect; a new one is its
//! `impl` and a line in [`LIBRARY`].

mod loose;
mod preload;
mod slip;
mod speed;

use super::BearingSession;
use crate::effect::Effect;

/// Every effect that is tried.
pub static LIBRARY: &[&dyn Effect<BearingSession>] = &[
    &preload::Preload,
    &loose::LooseGauge,
    &slip::CageSlip,
    &speed::SpeedOffset,
];
