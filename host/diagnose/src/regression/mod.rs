//! Linear regression with priors and nuisances: knows no machine and no search.

pub mod cross_validation;
pub mod design_matrix;
pub mod joint_fit;
pub mod normal_equations;
pub mod pooled;
pub mod projection;
