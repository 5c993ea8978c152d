//! Corrects the states of up to four samples before the last one by the innovations of later
//! samples, with steady gains (`FixedLagSmoother`), so that the rotor's estimate may lag by some
//! samples and is more accurate.
//!
//! A force moves a sensor only samples later, so that those samples have most of the information on
//! it.
//! By the steady gains `G_j` for the `j`-th sample before,
//!
//! `x(k-j | k) = x(k-j | k-1) + G_j nu_k`, `G_j = P (F (I - K H))^j' H' S^-1`, `G_0 = K`
//!
//! Source: Anderson and Moore 1979, Optimal Filtering, section 7.3.

use serde::{Deserialize, Serialize};

use crate::io::raw::MAX_CHANNELS;
use crate::rotor::filter::{FORCES, StateEstimate};

/// Most samples by which an estimate lags.
pub const MAX_LAG: usize = 4;

/// Gain by which each channel's innovation corrects a state, by channels.
pub type Gain<const NX: usize> = [[f32; NX]; MAX_CHANNELS];

/// The smoothed state of one sample.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct LaggedState<const NX: usize> {
    /// The filter's state, in the image's scale.
    #[serde(with = "crate::matrix_serde")]
    pub state: [f32; NX],
    /// Variances of the forces by the filter, as the last full recursion left them.
    pub variances: [f32; FORCES],
    /// The tracked speed [rad/s].
    pub speed: f32,
}

impl<const NX: usize> LaggedState<NX> {
    /// Copies the state of the sample that `posterior` is of; `speed` (rad/s).
    #[inline]
    pub fn capture<const NZ: usize>(&mut self, posterior: &StateEstimate<f32, NX>, speed: f32) {
        const { assert!(2 * NZ + FORCES <= NX, "states of a rotor") };
        // In halves: more than 64 bytes are copied by a call, word by word.
        let (low, high) = self.state.split_at_mut(NX / 2);
        low.copy_from_slice(&posterior.state[..NX / 2]);
        high.copy_from_slice(&posterior.state[NX / 2..]);
        for (j, variance) in self.variances.iter_mut().enumerate() {
            *variance = posterior.covariance[2 * NZ + j][2 * NZ + j];
        }
        self.speed = speed;
    }

    /// Of a sample before the first one.
    pub fn diffuse(speed: f32) -> Self {
        Self {
            state: [0.0; NX],
            variances: [f32::INFINITY; FORCES],
            speed,
        }
    }

    /// `x + G nu`.
    fn correct(&mut self, gain: &Gain<NX>, innovations: &[f32]) {
        for (column, nu) in gain.iter().zip(innovations) {
            for (x, k) in self.state.iter_mut().zip(column) {
                *x += k * nu;
            }
        }
    }
}

/// The samples before the last one, a ring.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FixedLagSmoother<const NX: usize> {
    states: [LaggedState<NX>; MAX_LAG],
    /// Place of the one before the last.
    latest: usize,
}

impl<const NX: usize> FixedLagSmoother<NX> {
    /// Before the first sample: all are `moment`.
    pub fn new(moment: LaggedState<NX>) -> Self {
        Self {
            states: [moment; MAX_LAG],
            latest: 0,
        }
    }

    /// Place for the one before the last.
    #[inline]
    pub fn advance(&mut self) -> &mut LaggedState<NX> {
        self.latest = (self.latest + 1) % MAX_LAG;
        &mut self.states[self.latest % MAX_LAG]
    }

    fn slot(&self, back: usize) -> usize {
        (self.latest + 1 + MAX_LAG - back % MAX_LAG) % MAX_LAG
    }

    /// The one `back` samples before the last, 1 to [`MAX_LAG`].
    pub fn lagged(&self, back: usize) -> &LaggedState<NX> {
        &self.states[self.slot(back)]
    }

    /// Corrects the one before the last by the first gain, the one before by the second and so on.
    pub fn update(&mut self, gains: &[Gain<NX>], innovations: &[f32]) {
        for (j, gain) in gains.iter().enumerate() {
            let place = self.slot(j + 1);
            self.states[place].correct(gain, innovations);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sample_before_is_corrected_by_the_gain_of_its_place() {
        let mut past = FixedLagSmoother::<1>::new(LaggedState::diffuse(0.0));
        let moment = |k: u8| LaggedState {
            state: [f32::from(k)],
            variances: [0.0; FORCES],
            speed: f32::from(k),
        };
        let mut gains = [[[0.0; 1]; MAX_CHANNELS]; MAX_LAG];
        for (j, gain) in gains.iter_mut().enumerate() {
            (gain[0][0], gain[1][0]) = (0.25 * (j + 1) as f32, 1.0);
        }
        for k in 1..=9 {
            *past.advance() = moment(k);
            for back in 1..=MAX_LAG.min(k.into()) {
                assert_eq!(past.lagged(back).speed, f32::from(k) - (back - 1) as f32);
            }
        }
        past.update(&gains[..3], &[2.0, 0.125]);
        let result = [1, 2, 3, 4].map(|back| past.lagged(back).state[0]);
        assert_eq!(result, [9.0 + 0.625, 8.0 + 1.125, 7.0 + 1.625, 6.0]);
        // A correction goes with its sample.
        *past.advance() = moment(10);
        assert_eq!(past.lagged(2).state[0], 9.625);
    }
}
