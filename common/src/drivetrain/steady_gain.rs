//! Updates the drivetrain filter without its covariance recursion: forms the gain from settled
//! covariances in a table over the carrier angle in the model image (`SteadyGains`), with the same
//! gates and fault isolation of the sensors. Decides after each sample how the next one is taken: so once
//! the covariance has settled, while the speed is in range, the angle homed and every sensor used.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::drivetrain::carrier_angle::reason;
use crate::drivetrain::fault_isolation::{Gauge, Prior};
use crate::drivetrain::{DrivetrainEstimator, DrivetrainState, LOADS, dot, to_sensor_estimate};
use crate::io::estimate::{Estimate, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::Measurement;
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS};
use crate::kalman::innovation::{Gate, Innovation, Outcome};
use crate::signal::periodic_lookup::MAX_LOG2_LEN;
use crate::signal::phase::{Phase, wrap_rad};

/// Share of the steady variance of a load by which that of the full recursion
/// may still exceed it when the steady gains take over.
const CONVERGED: f32 = 1.1;

/// What the covariance of the filter comes to over one turn of the carrier.
///
/// Sensors with equal rows `c` sense the same and are one direction; each
/// encoder is one of its own. A bin holds, for the encoders and then for each
/// direction of the channels, `g = P c'` in as many entries as there are states,
/// and `v = c P c'`, where `P` is the covariance of the prediction after the
/// directions before; then the variances of the loads after all of them.
/// Entries are f32, little endian, read where the image lies.
///
/// The gain is not in the table. With the sensitivities `m_i` and variances
/// `r_i` of the channels used, taken at the very angle,
///
/// `x+ = x + g a / (1 + v J)`, `a = sum m_i nu_i / r_i`, `J = sum m_i^2 / r_i`
///
/// is the exact update by all channels of a direction; between a bin's P and
/// the true one it cannot overshoot, and a channel that is missing is left
/// out of both sums.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SteadyGains<'a> {
    #[serde(borrow)]
    bytes: &'a [u8],
    log2_bins: u8,
    /// Turn of the carrier in one sample, lowest and highest, between which
    /// the table is near the best gain [rad].
    turn: [f32; 2],
}

/// One bin of a table.
#[derive(Clone, Copy)]
struct Bin<'a> {
    entries: &'a [[u8; 4]],
}

impl<'a> SteadyGains<'a> {
    /// A table of 2^`log2_bins` bins in `bytes`, for turns of the carrier
    /// between `turn[0]` and `turn[1]` in a sample (rad).
    pub fn new(bytes: &'a [u8], log2_bins: u8, turn: [f32; 2]) -> Self {
        Self {
            bytes,
            log2_bins,
            turn,
        }
    }

    /// Turn of the carrier in one sample, lowest and highest, that the table is for (rad).
    pub fn turn(&self) -> [f32; 2] {
        self.turn
    }

    /// Entries of a bin.
    pub fn width(states: usize, directions: usize) -> usize {
        directions * (states + 1) + LOADS
    }

    /// Checks a table that came out of an image.
    pub(crate) fn check(&self, states: usize, directions: usize) -> Result<(), Error> {
        let width = Self::width(states, directions);
        if u32::from(self.log2_bins) > MAX_LOG2_LEN
            || self.bytes.len() != (width << self.log2_bins) * 4
        {
            return Err(Error::OutOfRange("steady gains"));
        }
        let (entries, _) = self.bytes.as_chunks::<4>();
        for bin in entries.chunks_exact(width) {
            for (i, bytes) in bin.iter().enumerate() {
                let value = f32::from_le_bytes(*bytes);
                let variance = i >= width - LOADS || i % (states + 1) == states;
                if !value.is_finite() {
                    return Err(Error::NotFinite("steady gains"));
                }
                if variance && value < 0.0 {
                    return Err(Error::NotPositive("steady gains"));
                }
            }
        }
        if self.turn[0] < self.turn[1] {
            Ok(())
        } else {
            Err(Error::OutOfRange("steady turn"))
        }
    }

    fn bin(&self, angle: Phase) -> Bin<'a> {
        let (entries, _) = self.bytes.as_chunks::<4>();
        let width = entries.len() >> self.log2_bins;
        let first = angle.table_index(u32::from(self.log2_bins)).0 * width;
        Bin {
            entries: entries.get(first..first + width).unwrap_or(&[]),
        }
    }
}

impl<'a> Bin<'a> {
    /// `g` and `v` of a direction; without effect beyond the end.
    fn direction<const NX: usize>(&self, d: usize) -> Option<(&'a [[u8; 4]; NX], f32)> {
        let rest = self.entries.get(d * (NX + 1)..)?;
        let g = rest.first_chunk::<NX>()?;
        Some((g, f32::from_le_bytes(*rest.get(NX)?)))
    }

    /// Variances of the loads.
    fn load_variances(&self) -> [f32; LOADS] {
        self.entries
            .last_chunk::<LOADS>()
            .map_or([0.0; LOADS], |entries| entries.map(f32::from_le_bytes))
    }
}

impl<const NX: usize> DrivetrainEstimator<'_, NX> {
    /// One sample by the steady gains: corrects the state, fills in the
    /// sensors, and gives the variances of the loads.
    pub(crate) fn update_steady_gain(
        &self,
        gains: &SteadyGains<'_>,
        state: &mut DrivetrainState<NX>,
        m: &Measurement,
        estimate: &mut Estimate,
    ) -> [f32; LOADS] {
        let bin = gains.bin(Phase::from_rad(state.posterior.state[0]));
        let encoders = self.model.encoders.len();
        self.open_sensors(state, m, estimate);
        for (k, (encoder, row)) in (self.model.encoders.iter())
            .zip(&self.encoder_rows)
            .enumerate()
        {
            let mut sensor = SensorEstimate {
                fault: reason(m.angles.get(k)),
                ..SensorEstimate::default()
            };
            if let (Some(Ok(angle)), Some((g, v))) = (m.angles.get(k), bin.direction(k)) {
                let angle = angle.to_rad();
                let nu = wrap_rad(angle - dot(row, &state.posterior.state));
                let track = &mut state.tracks[k % MAX_ENCODERS];
                let stuck = track.stuck(angle, state.turned, encoder.variance);
                let mut shut = Gate::closed();
                let gate = if stuck {
                    &mut shut
                } else {
                    &mut state.gates[MAX_CHANNELS + k % MAX_ENCODERS]
                };
                let update = gate_innovation(nu, v + encoder.variance, gate);
                if update.used() {
                    add_scaled(&mut state.posterior.state, g, nu / update.variance);
                }
                let refused = if stuck { Fault::Stuck } else { Fault::Slipped };
                sensor = to_sensor_estimate(angle, &update, 1.0, refused);
            }
            let _ = estimate.sensors.push(sensor);
        }
        let mut gauges = [Gauge::default(); MAX_CHANNELS];
        for (d, direction) in self.directions.iter().enumerate() {
            let Some((g, v)) = bin.direction(encoders + d) else {
                continue;
            };
            let Some(row) = self.row(direction.members.first()) else {
                continue;
            };
            let now = Phase::from_rad(state.posterior.state[0]);
            let prior = Prior {
                sensed: dot(row, &state.posterior.state),
                variance: v,
            };
            self.fill_gauges(state, direction, m, prior, (now, true), &mut gauges);
            (self.fault_isolation).weigh(&mut state.isolation, d, direction, &gauges, prior);
            let inflation = self.fault_isolation.inflation(&state.isolation, d);
            let (mut surprise, mut information) = (0.0, 0.0);
            for i in &direction.members {
                let i = usize::from(*i) % MAX_CHANNELS;
                let (Some(value), Some(channel), Some(slot)) = (
                    gauges[i].value,
                    self.model.channels.get(i),
                    estimate.sensors.get_mut(i),
                ) else {
                    continue;
                };
                let m = gauges[i].sensitivity;
                let r = gauges[i].variance * inflation;
                let left_out = state.isolation.fault(i);
                let mut shut = Gate::closed();
                let gate = match left_out {
                    Some(_) => &mut shut,
                    None => &mut state.gates[i],
                };
                let update = gate_innovation(gauges[i].innovation, m * m * v + r, gate);
                if update.used() {
                    let weight = m / r;
                    surprise += weight * update.value;
                    information += weight * m;
                    state.age = 0;
                }
                let refused = left_out.unwrap_or(Fault::Erratic);
                *slot = to_sensor_estimate(value, &update, channel.unit, refused);
                if slot.fault.is_none() && state.isolation.contradicts(d) {
                    slot.fault = Fault::Contradicted;
                }
            }
            add_scaled(
                &mut state.posterior.state,
                g,
                surprise / (1.0 + v * information),
            );
        }
        bin.load_variances()
    }

    /// Chooses by what the next sample is taken: by the steady gains where the
    /// machine is as they were computed for and the full recursion has come to
    /// their covariance, else by the full recursion.
    ///
    /// The covariance is left as it is while the steady gains are in use; it is one
    /// of their cycle. Where a load is less certain at this angle than it was at
    /// that one, all of it is inflated by as much.
    pub(crate) fn try_enter_steady(
        &self,
        gains: &SteadyGains<'_>,
        state: &mut DrivetrainState<NX>,
        m: &Measurement,
        estimate: &Estimate,
    ) {
        let as_computed = m.lost == 0
            && estimate.homed
            && !m.slipped
            && (gains.turn[0]..=gains.turn[1]).contains(&state.turned)
            && estimate.sensors.iter().all(|s| s.fault.is_none());
        if as_computed == state.steady {
            return;
        }
        let steady = gains
            .bin(Phase::from_rad(state.posterior.state[0]))
            .load_variances();
        let full = state.posterior.load_variances::<LOADS>();
        if state.steady {
            let ratio = (0..self.model.loads.len())
                .map(|j| steady[j % LOADS] / full[j % LOADS])
                .fold(1.0, f32::max);
            for p in state.posterior.upper.as_flattened_mut() {
                *p *= ratio;
            }
            state.steady = false;
        } else {
            state.steady = (0..self.model.loads.len())
                .all(|j| full[j % LOADS] <= CONVERGED * steady[j % LOADS]);
        }
    }
}

/// `x += g factor`.
fn add_scaled<const NX: usize>(x: &mut SVector<f32, NX>, g: &[[u8; 4]; NX], factor: f32) {
    for i in 0..NX {
        x[i] += f32::from_le_bytes(g[i]) * factor;
    }
}

/// Whether a channel's innovation of variance `s` is used.
pub(crate) fn gate_innovation(nu: f32, s: f32, gate: &mut Gate) -> Innovation {
    let nis = nu * nu / s;
    // Fails on NaN.
    if !(s > 0.0 && nis <= f32::MAX) {
        return Innovation::INVALID;
    }
    Innovation {
        value: nu,
        variance: s,
        nis,
        outcome: if gate.accepts(nis) {
            Outcome::Used
        } else {
            Outcome::Gated
        },
    }
}
