//! Excludes a gauge of a bearing whose reading leaves its prediction from one block to the next
//! (`GaugeExclusion`), names the kind of its fault, and readmits it where it agrees with the other
//! gauges again.
//!
//! A block's readings of one gauge are refused where their normalised innovation squared, summed
//! over the rows, is beyond a gate. The gauges of a block are taken in one after the other, so that
//! the first one beyond the gate is the one at fault: those before it agree, and those after it are
//! predicted without it. What heat or a changed preload does stays within the gate, as it takes
//! seconds; a gauge that fails as slowly is excluded by the isolation of a contradiction
//! (`isolation`).
//!
//! Source: Bar-Shalom, Li and Kirubarajan 2001, section 5.4: validation gate.

use serde::{Deserialize, Serialize};

use crate::bearing::ekf::BlockInnovation;
use crate::bearing::harmonic_block::HarmonicBlock;
use crate::bearing::lock_detector::NOISE_SHARE;
use crate::bearing::{GAUGES, GaugeModel};
use crate::io::fault::Fault;

/// Normalised innovation squared of the seven rows of a gauge in a block beyond which its readings
/// are refused. On recordings without a fault its 99th percentile is 4 at most, its maximum 14,
/// but for 32 where `Mx` re-emerges with the wrong sign.
const GATE: f32 = 10.0;

/// As [`GATE`], beyond which one block excludes a gauge.
const CERTAIN: f32 = 16.0;

/// Blocks for which the loads have been valid before the gate acts, 0.5 s.
const ARMED_BLOCKS: u16 = 50;

/// Refused blocks, less those taken in, after which a gauge is excluded: 0.1 s.
const EXCLUDED: u8 = 10;

/// Mean of the normalised innovation squared below which an excluded gauge is readmitted: 1 is the
/// mean on recordings without a fault. Of two excluded gauges both have to agree.
const READMITTED: f32 = 2.0;

/// As [`READMITTED`], for a gauge that was excluded by an isolation: its innovation is small from
/// the beginning.
const READMITTED_SLOW: f32 = 0.4;

/// Time constant of the means that name a fault and end it, in blocks of 10 ms.
const MEAN_BLOCKS: f32 = 50.0;

/// Part of the predicted local strain's mean square up to which its innovation is an error of the
/// model: a third of the strain.
const AS_EXPECTED: f32 = 0.1;

/// Part of the predicted local strain's mean square up to which a gauge is silent: a seventh.
const SILENT: f32 = 0.02;

/// Part of the mean square read that no gain explains, from which the readings are erratic.
const UNRELATED: f32 = 0.5;

/// Refusals, and what an excluded gauge reads.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct GaugeExclusion {
    /// Blocks in a row with valid loads.
    valid_blocks: u16,
    refusals: [u8; GAUGES],
    fault: [Fault; GAUGES],
    /// Whether slow states contradicted, not the readings of a block.
    slow: [bool; GAUGES],
    mean: [Means; GAUGES],
}

/// Low-pass means over the blocks of one gauge.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Means {
    /// Normalised innovation squared.
    cost: f32,
    /// Mean square of local strain read, predicted, and of its innovation [(um/m)^2].
    read: f32,
    predicted: f32,
    left: f32,
}

impl GaugeExclusion {
    /// Whether the readings with these innovations are to be refused.
    pub fn refuses(&self, g: usize, innovation: &BlockInnovation) -> bool {
        self.valid_blocks > ARMED_BLOCKS
            && self.fault(g).is_none()
            && exceeds(innovation.cost, GATE)
    }

    /// Takes the innovations of a block; `refused`: which gauges' readings were; `valid`: whether
    /// the loads are valid, the slow states have settled and `Mx` is far from a reversal.
    pub fn update(
        &mut self,
        innovations: &[BlockInnovation; GAUGES],
        refused: [bool; GAUGES],
        block: &HarmonicBlock,
        gauges: &[GaugeModel; GAUGES],
        valid: bool,
    ) {
        self.valid_blocks = if valid {
            self.valid_blocks.saturating_add(1)
        } else {
            0
        };
        let complete = block.complete;
        let lacking = self.fault.iter().filter(|fault| !fault.is_none()).count() > 1;
        let all_agree = (0..GAUGES)
            .all(|g| self.fault[g].is_none() || complete[g] && self.mean[g].cost < READMITTED);
        for g in 0..GAUGES {
            if !complete[g] {
                continue;
            }
            let (mean, innovation) = (&mut self.mean[g], &innovations[g]);
            if self.fault[g].is_none() {
                self.refusals[g] = if refused[g] {
                    self.refusals[g].saturating_add(1)
                } else {
                    self.refusals[g].saturating_sub(1)
                };
                let certain = refused[g] && exceeds(innovation.cost, CERTAIN);
                if self.refusals[g] < EXCLUDED && !certain {
                    continue;
                }
                *mean = Means::of(innovation);
            } else {
                mean.follow(&Means::of(innovation), 1.0 / MEAN_BLOCKS);
            }
            let agrees = if self.slow[g] {
                READMITTED_SLOW
            } else {
                READMITTED
            };
            self.fault[g] = if mean.cost < agrees {
                self.slow[g] = false;
                Fault::None
            } else {
                mean.fault(&gauges[g])
            };
            if lacking && !all_agree && self.fault[g].is_none() {
                // Two gauges alone do not show that a third agrees.
                self.fault[g] = Fault::Erratic;
            }
            if self.fault[g].is_none() {
                self.refusals[g] = 0;
            }
        }
        let left_out = |g: &usize| !self.fault[*g].is_none() || refused[*g];
        if (0..GAUGES).filter(left_out).count() > 2 {
            // No gauge, but the wheel or the hypothesis.
            *self = Self::default();
        }
    }

    /// Excludes a gauge that an isolation has named.
    pub fn exclude(&mut self, g: usize) {
        self.fault[g] = Fault::Drift;
        self.slow[g] = true;
        self.mean[g] = Means {
            cost: 2.0 * CERTAIN,
            ..Means::default()
        };
    }

    /// A search starts: what two gauges and more contradict is not known to be their fault.
    pub fn restart(&mut self) {
        self.valid_blocks = 0;
        if self.fault.iter().filter(|fault| !fault.is_none()).count() > 1 {
            *self = Self::default();
        }
    }

    /// The fault of an excluded gauge, or none.
    pub fn fault(&self, g: usize) -> Fault {
        self.fault[g % GAUGES]
    }
}

/// Whether an innovation is beyond a limit, or no number.
fn exceeds(cost: f32, limit: f32) -> bool {
    cost.is_nan() || cost > limit
}

impl Means {
    fn of(innovation: &BlockInnovation) -> Self {
        let (read, predicted) = innovation.local;
        Self {
            cost: innovation.cost.min(2.0 * CERTAIN),
            read: read * read,
            predicted: predicted * predicted,
            left: innovation.left,
        }
    }

    /// Moves the means by `share` towards those of a block.
    fn follow(&mut self, other: &Self, share: f32) {
        self.cost += share * (other.cost.min(2.0 * CERTAIN) - self.cost);
        self.read += share * (other.read - self.read);
        self.predicted += share * (other.predicted - self.predicted);
        self.left += share * (other.left - self.left);
    }

    /// The kind of fault by the least squares of what was read on what was predicted; none where
    /// the two agree.
    fn fault(&self, gauge: &GaugeModel) -> Fault {
        let noise = NOISE_SHARE * gauge.resting_variance();
        let common = 0.5 * (self.read + self.predicted - self.left);
        let unrelated = self.read - common * common / self.predicted.max(noise);
        if self.left < AS_EXPECTED * self.predicted + noise {
            Fault::Offset
        } else if self.read < SILENT * self.predicted + noise {
            Fault::Dead
        } else if unrelated > UNRELATED * self.read {
            Fault::Erratic
        } else if common < 0.0 {
            Fault::Reversed
        } else {
            Fault::Gain
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gauge that reads `gain` times the local strain expected, with this normalised innovation.
    fn innovation(gain: f32, cost: f32) -> BlockInnovation {
        let strain = 40.0;
        BlockInnovation {
            local: (gain.abs() * strain, strain),
            left: (1.0 - gain) * (1.0 - gain) * strain * strain,
            cost,
            ..BlockInnovation::default()
        }
    }

    /// Blocks of 0.01 s with these innovations of gauge 2; the others agree.
    fn run(exclusion: &mut GaugeExclusion, blocks: usize, gain: f32, cost: f32) {
        let gauges = [0; GAUGES].map(|_| GaugeModel::plain());
        let block = HarmonicBlock {
            count: 20,
            complete: [true; GAUGES],
            ..HarmonicBlock::default()
        };
        for _ in 0..blocks {
            let mut innovations = [innovation(1.0, 1.0); GAUGES];
            innovations[2] = innovation(gain, cost);
            let mut refused = [false; GAUGES];
            refused[2] = exclusion.refuses(2, &innovations[2]);
            exclusion.update(&innovations, refused, &block, &gauges, true);
        }
    }

    #[test]
    fn a_gauge_beyond_the_gate_is_excluded_with_its_kind_and_readmitted() {
        for (gain, kind) in [
            (0.0, Fault::Dead),
            (0.5, Fault::Gain),
            (1.6, Fault::Gain),
            (-1.0, Fault::Reversed),
            (1.0, Fault::Offset),
        ] {
            let mut exclusion = GaugeExclusion::default();
            run(&mut exclusion, 60, 1.0, 1.0);
            run(&mut exclusion, 1, gain, 100.0);
            assert_eq!(exclusion.fault(2), kind, "{gain}");
            assert!((0..GAUGES).all(|g| g == 2 || exclusion.fault(g).is_none()));
            run(&mut exclusion, 200, gain, 100.0);
            assert_eq!(exclusion.fault(2), kind, "{gain}");
            // Readmitted between 1 and 2.5 s after it agrees.
            run(&mut exclusion, 100, 1.0, 1.0);
            assert!(!exclusion.fault(2).is_none(), "{gain}");
            run(&mut exclusion, 150, 1.0, 1.0);
            assert!(exclusion.fault(2).is_none(), "{gain}");
        }
    }

    #[test]
    fn doubtful_readings_exclude_a_gauge_where_they_last() {
        let mut exclusion = GaugeExclusion::default();
        run(&mut exclusion, 60, 1.0, 1.0);
        run(&mut exclusion, 9, 0.6, 12.0);
        assert!(exclusion.fault(2).is_none());
        run(&mut exclusion, 1, 0.6, 12.0);
        assert_eq!(exclusion.fault(2), Fault::Gain);
    }

    #[test]
    fn nothing_is_refused_before_the_loads_have_been_valid() {
        let mut exclusion = GaugeExclusion::default();
        run(&mut exclusion, 40, 0.2, 100.0);
        assert!(exclusion.fault(2).is_none());
    }
}
