//! Metrics of estimates: load errors, whiteness and consistency of the innovations in constant
//! memory; intervals of mean differences and of errors on other recordings.

mod autocorrelation;
mod histogram;
mod load_error;
mod nis;
mod paired_difference;
mod prediction_interval;

pub use autocorrelation::{Autocorrelation, LAGS};
pub use histogram::Histogram;
pub use load_error::{ErrorFigures, LoadError, Segment};
pub use nis::{NisConsistency, chi_squared_bounds, chi_squared_quantile};
pub use paired_difference::PairedDifference;
pub use prediction_interval::{Stretch, prediction_interval, relative_variance};
