//! Estimator design for a drive without strain gauges: builds its model image from the balance of
//! forces in the description. This file lists the modules.

mod effect_terms;
mod filter_noise;
mod model_image;

pub use model_image::image;
