//! Shared parts of the tests that need more than one crate or a rig: boards, emulator, machines and
//! samples; length of a run from the environment.

pub mod bench;
pub mod descriptions;
pub mod emulator;
pub mod firmware;
pub mod gearbox;
pub mod rotor;
mod sample_faults;
pub mod sensor_line;
pub mod simulated;

/// Length of a run on a board (s): `LOADTWIN_SECONDS`, or `usual`.
///
/// # Panics
/// When the variable is no number.
pub fn seconds<T: std::str::FromStr>(usual: T) -> T {
    match std::env::var("LOADTWIN_SECONDS") {
        Ok(text) => text
            .parse()
            .unwrap_or_else(|_| panic!("LOADTWIN_SECONDS: found {text:?}, allowed: a number")),
        Err(_) => usual,
    }
}
