//! Simulates the sensors of angle: value of an encoder's counter at an angle, with an eccentric
//! disc and noise, and the moment at which the carrier passes the index pulse.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use loadtwin_machine::{Eccentricity, QUANTISATION};

/// A counter that turns with one inertia.
pub(crate) struct Encoder {
    /// Name of the encoder.
    pub name: String,
    /// The inertia of the machine description that it turns with.
    pub inertia: usize,
    /// Amplitude of the error once per turn of that inertia [rad].
    pub eccentricity: f64,
    /// Where the disc sits furthest out [rad].
    pub eccentric_at: f64,
    described: Option<Eccentricity>,
    ratio: f64,
    counts_per_rad: f64,
    start: f64,
    modulus: f64,
    jitter: f64,
    /// Whether it counts in whole numbers.
    counts: bool,
    rng: ChaCha8Rng,
}

impl Encoder {
    pub(crate) fn new(
        encoder: &loadtwin_machine::Encoder,
        inertia: usize,
        ratio: f64,
        mut rng: ChaCha8Rng,
    ) -> Self {
        let noise = encoder.noise_std_counts();
        Self {
            name: encoder.name.clone(),
            inertia,
            eccentricity: 0.0,
            eccentric_at: 0.0,
            described: encoder.eccentricity,
            ratio,
            counts_per_rad: encoder.counts_per_turn / TAU,
            // Wherever the counter stood when the recording began.
            start: rng.random_range(0.0..200.0),
            modulus: f64::from(encoder.bits).exp2(),
            // The noise without its part from rounding.
            jitter: (noise * noise - QUANTISATION * QUANTISATION)
                .max(0.0)
                .sqrt(),
            counts: true,
            rng,
        }
    }

    /// Without noise, and in parts of a count.
    pub(crate) fn exact(&mut self) {
        self.counts = false;
        self.jitter = 0.0;
    }

    /// The counter at the inertia's `angle`, referred [rad].
    pub(crate) fn count(&mut self, angle: f64) -> f64 {
        let own = angle * self.ratio;
        let mut count = self.start + own * self.counts_per_rad;
        if self.eccentricity != 0.0 {
            let error = self.eccentricity * (own - self.eccentric_at).cos();
            count += error * self.counts_per_rad;
        }
        if let Some(described) = self.described {
            count += described.error(own) * self.counts_per_rad;
        }
        if self.jitter > 0.0 {
            count += self.jitter * self.rng.sample::<f64, _>(StandardNormal);
        }
        if self.counts {
            count = count.floor();
        }
        count.rem_euclid(self.modulus)
    }
}

/// The pulse once per turn of the carrier.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Index {
    /// The encoder that it latches.
    pub encoder: usize,
    /// Carrier angle at the pulse [rad].
    angle: f64,
}

impl Index {
    pub(crate) fn new(index: &loadtwin_machine::Index, encoder: usize) -> Self {
        Self {
            encoder,
            angle: index.angle_rad,
        }
    }

    /// When the carrier passes the pulse on its way from `before` to `after`,
    /// as part of the way.
    pub(crate) fn passed(&self, before: f64, after: f64) -> Option<f64> {
        let turns = |angle: f64| (angle - self.angle) / TAU;
        let (from, to) = (turns(before), turns(after));
        let pulse = from.floor().max(to.floor());
        (from.floor() != to.floor()).then(|| (pulse - from) / (to - from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pulse_comes_at_its_angle_both_ways() {
        let index = Index {
            encoder: 0,
            angle: 1.0,
        };
        let part = index.passed(0.9, 1.3).unwrap();
        assert!((part - 0.25).abs() < 1e-12);
        let part = index.passed(1.3, 0.9).unwrap();
        assert!((part - 0.75).abs() < 1e-12);
        assert!((index.passed(6.9, 7.4).unwrap() - (1.0 + TAU - 6.9) / 0.5).abs() < 1e-12);
        assert_eq!(index.passed(1.1, 1.3), None);
        assert_eq!(index.passed(-1.1, 0.3), None);
    }
}
