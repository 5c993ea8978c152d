//! `loadtwin tune`: the noise of the filter, from measurements and from what is asked of it.

mod measurement_noise;

pub use measurement_noise::{MeasurementNoise, NOISE_BINS};
