//! Figures of merit of an estimate, gathered sample by sample in constant memory.

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
