//! Test program of the Kalman filters: comparison with filterpy and scipy, statistical
//! consistency, numerical robustness.

mod consistency;
mod endurance;
mod model;
mod reference;
