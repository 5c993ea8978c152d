//! Frames, their description, and the commands on a bus without a bus.

mod dbc;
mod formats;
mod fuzz;
mod layout;
mod machine;
mod proof;
#[path = "../reference/python.rs"]
mod python;
mod slcan;
