//! Test program of CAN: frames, DBC, log formats, and the bus commands without a real bus.

mod dbc;
mod formats;
mod fuzz;
mod layout;
mod machine;
mod proof;
#[path = "../reference/python.rs"]
mod python;
mod slcan;
