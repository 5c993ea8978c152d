//! The report of a diagnosis: JSON and page.

pub mod json;
pub mod page;
mod shape_std;
