//! Linear regression with priors and nuisances, independent of machine kinds and of the search for
//! effects.

pub mod cross_validation;
pub mod design_matrix;
pub mod joint_fit;
pub mod normal_equations;
pub mod projection;
pub mod shared_parameters;
