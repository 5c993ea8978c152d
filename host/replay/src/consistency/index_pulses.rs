//! Checks the index pulses of a replay against the encoder counts, and names the cause where there
//! is no pulse, where pulses are not `counts_per_turn` apart, or where pulses and counts often
//! disagree (slip).

use std::f64::consts::{PI, TAU};

use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;

use super::{CONTRADICTING, Cause, TURNS};
use crate::Sample;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;

/// Distances between pulses that are kept.
const KEPT: usize = 256;

/// Part of a turn by which a distance may differ from one.
const NEAR: f64 = 0.02;

/// Distances between pulses from which they are compared with the counts of a turn.
const LEAST: usize = 2;

/// Index pulses of one replay, gathered sample by sample.
#[derive(Clone, Debug)]
pub(super) struct IndexPulses {
    name: String,
    encoder: String,
    /// Counts in a turn of the pulse; none where the encoder turns at another speed.
    counts_per_turn: Option<f64>,
    bits: u32,
    last: Option<u32>,
    /// Counts from pulse to pulse, without those of a turn back.
    distances: Vec<f64>,
    pulses: u64,
    angle: f64,
    turned: f64,
    homed: u64,
    samples: u64,
    /// Samples in which pulses and counts are not at one.
    slipped: u64,
}

impl IndexPulses {
    /// Nothing gathered yet; none without an index pulse.
    pub fn new(machine: &Machine, sensors: &Sensors) -> Option<Self> {
        let index = machine.index.as_ref()?;
        let encoder = sensors.encoders.iter().find(|e| e.name == index.encoder)?;
        let alike = machine.rotor.is_some() || machine.index_turns_with(encoder);
        Some(Self {
            name: index.name.clone(),
            encoder: encoder.name.clone(),
            counts_per_turn: alike.then(|| encoder.counts_per_turn.abs()),
            bits: encoder.bits,
            last: None,
            distances: Vec::new(),
            pulses: 0,
            angle: 0.0,
            turned: 0.0,
            homed: 0,
            samples: 0,
            slipped: 0,
        })
    }

    /// Adds one sample.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        let angle = f64::from(estimate.angle_rad);
        self.turned += ((angle - self.angle + PI).rem_euclid(TAU) - PI).abs();
        self.angle = angle;
        self.homed += u64::from(estimate.homed);
        self.samples += 1;
        let loads = &estimate.loads;
        self.slipped += u64::from(loads.iter().any(|load| load.fault == Fault::Slipped));
        let Some(count) = sample.raw.index else {
            return;
        };
        self.pulses += 1;
        if let (Some(last), true) = (self.last, self.distances.len() < KEPT) {
            let turn = 1_i64 << self.bits;
            let ahead = i64::from(count.wrapping_sub(last)).rem_euclid(turn);
            let distance = ahead.min(turn - ahead) as f64;
            // A shaft that turns back passes the pulse at the same place.
            if self
                .counts_per_turn
                .is_some_and(|counts| distance > NEAR * counts)
            {
                self.distances.push(distance);
            }
        }
        self.last = Some(count);
    }

    /// What is wrong with pulse or counts, if anything.
    pub fn cause(&self) -> Option<Cause> {
        if self.pulses == 0 && self.homed == 0 {
            let turns = self.turned / TAU;
            return (turns > TURNS).then(|| Cause {
                kind: "index",
                what: format!("no pulse in column {} in {turns:.1} turns", self.name),
                corrected_percent: None,
                remedy: "check the column and its unit; loads stay not homed without it".into(),
            });
        }
        self.distance_of_pulses().or_else(|| self.slip())
    }

    /// Pulses that are not one turn apart.
    fn distance_of_pulses(&self) -> Option<Cause> {
        let counts = self.counts_per_turn?;
        // A pulse that is missed now and then makes two turns of one, not all of them.
        let is_whole = |distance: &&f64| (*distance / counts - 1.0).abs() < NEAR;
        let whole = self.distances.iter().filter(is_whole).count();
        if self.distances.len() < LEAST || 2 * whole > self.distances.len() {
            return None;
        }
        let mut sorted = self.distances.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        let alike = |d: &&f64| (*d / median - 1.0).abs() < NEAR;
        if 2 * sorted.iter().filter(alike).count() <= sorted.len() {
            return Some(Cause {
                kind: "index",
                what: format!(
                    "pulses in column {} come {:.0} to {:.0} counts apart, counts_per_turn {counts}",
                    self.name,
                    sorted[0],
                    sorted[sorted.len() - 1]
                ),
                corrected_percent: None,
                remedy: "check the column and its wiring for noise".into(),
            });
        }
        let turns = (median / counts).round();
        let is_whole = turns >= 2.0 && (median / counts - turns).abs() < NEAR;
        let or_else = if is_whole {
            format!(
                "; a pulse that is seen every {turns:.0} turns only (a level that changes with each \
                 pulse, a divider) looks the same"
            )
        } else {
            String::new()
        };
        Some(Cause {
            kind: "counts",
            what: format!(
                "{median:.0} counts of {} from one index pulse to the next, counts_per_turn {counts}",
                self.encoder
            ),
            corrected_percent: None,
            remedy: format!(
                "set counts_per_turn of {} to what is on its label{or_else}",
                self.encoder
            ),
        })
    }

    /// Pulses and counts that are often not at one.
    fn slip(&self) -> Option<Cause> {
        let part = self.slipped as f64 / self.samples.max(1) as f64;
        (part > CONTRADICTING).then(|| Cause {
            kind: "index",
            what: format!(
                "pulses in column {} and counts of {} do not agree in {:.0} % of the samples ({} pulses in \
                 {:.1} turns)",
                self.name,
                self.encoder,
                100.0 * part,
                self.pulses,
                self.turned / TAU
            ),
            corrected_percent: None,
            remedy: "look for missing or false pulses, lost counts and a slipping coupling; `signal` \
                     under [index] states what the column holds"
                .into(),
        })
    }
}
