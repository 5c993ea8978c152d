//! Report of a diagnosis: JSON object, HTML page, and the standard deviations of nonlinear
//! parameters for both.

mod findings;
pub mod html_page;
pub mod json;
mod nonlinear_parameter_std;
