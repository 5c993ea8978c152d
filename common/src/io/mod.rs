//! What crosses the boundary: raw samples, measurements, estimates, frames, signed images.

pub mod estimate;
pub mod fault;
pub mod frame;
pub mod isotp;
pub mod measurement;
pub mod raw;
pub mod signed_image;
pub mod uds;
