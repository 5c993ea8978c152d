//! Strain measurement: conversion of bridge outputs to strain, zero and shunt calibration of a
//! bridge, rosettes. This file lists the modules and has the factors for µm/m and mV/V.
//!
//! Inside the program strain is in m/m and a bridge's output is a ratio in V/V. People write µm/m
//! and mV/V: multiply by [`MICROSTRAIN`] and [`MV_PER_V`] on the way in, divide on the way out.

mod bridge;
mod rosette;
mod zero_and_shunt;

pub use bridge::{BridgeKind, Calibration, StrainBridge, TensionReads, is_iso_date};
pub use rosette::{PlaneStrain, PrincipalStrains, Rosette};
pub use zero_and_shunt::{CalibrationError, ShuntReading, Simulates, calibrate};

/// One µm/m in m/m.
pub const MICROSTRAIN: f64 = 1e-6;

/// One mV/V in V/V.
pub const MV_PER_V: f64 = 1e-3;
