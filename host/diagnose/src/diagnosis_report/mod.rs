//! Report of a diagnosis: JSON object, HTML page, and the standard deviations of nonlinear
//! parameters for both.

pub mod html_page;
pub mod json;
mod shape_std;
