//! Estimator design for a drive without strain gauges: model
//! image, effects and filter noise from the balance of forces.

mod effect_terms;
mod filter_noise;
mod model_image;

pub use model_image::image;
