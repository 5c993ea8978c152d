//! Metrics of estimates: load errors, whiteness and consistency of the innovations in constant
//! memory; intervals of mean differences and of errors on other recordings.

mod autocorrelation;
mod error;
mod histogram;
mod nis;
mod paired;
mod prediction;

pub use autocorrelation::{Autocorrelation, LAGS};
pub use error::{ErrorFigures, LoadError, Segment};
pub use histogram::Histogram;
pub use nis::{NisConsistency, chi_squared_bounds, chi_squared_quantile};
pub use paired::PairedDifference;
pub use prediction::{Stretch, prediction_interval, relative_variance};
