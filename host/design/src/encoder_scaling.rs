//! Converts encoder and index pulse of a description to the integers of the model image: a count
//! and the pulse's angle become 64-bit fractions of a revolution.

use std::f64::consts::TAU;

use loadtwin_common::io::measurement::{Eccentricity, EncoderScaling, IndexPulse};
use loadtwin_common::signal::phase::{Phase, PhaseStep};

use loadtwin_machine::{Encoder, Index};

/// The encoder as the estimator counts it, where its inertia turns `ratio` times as fast as the
/// angle.
pub(crate) fn counter(encoder: &Encoder, ratio: f64) -> EncoderScaling {
    EncoderScaling {
        step: phase_step(1.0 / (encoder.counts_per_turn * ratio)),
        bits: encoder.bits as u8,
    }
}

/// The pulse as the estimator has it, which latches encoder `number` of the set; `encoder`: that
/// encoder, none in a set without encoders.
pub(crate) fn pulse(index: &Index, number: u8, encoder: Option<&Encoder>) -> IndexPulse {
    let eccentricity = encoder.and_then(|encoder| encoder.eccentricity);
    IndexPulse {
        encoder: number,
        angle: phase(index.angle_rad),
        tolerance_rad: index.tolerance_rad as f32,
        eccentricity: eccentricity.map(|eccentricity| {
            let [cosine, sine] = eccentricity.parts_from(index.angle_rad);
            Eccentricity {
                cosine_rad: cosine as f32,
                sine_rad: sine as f32,
            }
        }),
    }
}

fn phase(rad: f64) -> Phase {
    let turns = rad / TAU;
    phase_step(turns - turns.floor()).into_phase()
}

/// The step of `turns`.
fn phase_step(turns: f64) -> PhaseStep {
    // Beyond the range of i64 the two's complement wraps as the phase does.
    PhaseStep((turns * 18_446_744_073_709_551_616.0) as i128 as u64)
}
