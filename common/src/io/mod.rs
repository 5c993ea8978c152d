//! Inputs and outputs of the estimator: raw samples, measurements, estimates, faults, CAN frames,
//! ISO-TP, UDS constants, signed images.

pub mod estimate;
pub mod fault;
pub mod frame;
pub mod isotp;
pub mod measurement;
pub mod raw;
pub mod signed_image;
pub mod uds;
