//! List of the effects that the description and calibration of a bearing may lack, one file each. A
//! new effect is an `impl` of [`crate::candidate_effect::Effect`] and a line in `LIBRARY`.

mod cage_slip;
mod loose_gauge;
mod preload;
mod speed_offset;

use crate::bearing::BearingResiduals;
use crate::candidate_effect::Effect;

/// Every effect that is tried.
pub static LIBRARY: &[&dyn Effect<BearingResiduals>] = &[
    &preload::Preload,
    &loose_gauge::LooseGauge,
    &cage_slip::CageSlip,
    &speed_offset::SpeedOffset,
];
