//! The report of a diagnosis: JSON and page.

pub mod html_page;
pub mod json;
mod shape_std;
