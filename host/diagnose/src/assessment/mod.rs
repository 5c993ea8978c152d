//! List of the modules that assess a diagnosis once effects are selected: excess and tests of the
//! residuals, consistency of the innovations, standard deviations of linear parameters, empirical
//! corrections, and the verdict.

pub mod binned_mean;
pub mod empirical_correction;
pub mod innovation_consistency;
pub mod parameter_std;
pub mod residual_excess;
pub mod residual_tests;
pub mod verdict;
