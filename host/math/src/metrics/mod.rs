//! Metrics of estimates: load errors, whiteness, spectra and consistency of the innovations in
//! constant memory; intervals of mean differences and of errors on other recordings; Student's t.

mod autocorrelation;
mod cross_correlation;
mod histogram;
mod load_error;
mod nis;
mod paired_difference;
mod prediction_interval;
mod spectra;
mod student;

pub use autocorrelation::{Autocorrelation, LAGS};
pub use cross_correlation::CrossCorrelation;
pub use histogram::Histogram;
pub use load_error::{ErrorFigures, LoadError, Segment};
pub use nis::{NisConsistency, chi_squared_bounds, chi_squared_quantile};
pub use paired_difference::PairedDifference;
pub use prediction_interval::{Stretch, prediction_interval, relative_variance};
pub use spectra::{Coherence, Density, Spectra};
pub use student::{student_both_tails, student_quantile};
