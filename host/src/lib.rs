//! The library of the command `loadtwin`: command line ([`cli`]), draft descriptions ([`init`]),
//! tables of the gearbox paper ([`paper_tables`]) and browser view of a CAN bus ([`browser_monitor`]). The other
//! library crates under `host/` are re-exported as its modules.
#![forbid(unsafe_code)]
// `cli::printing` prints, so that a closed pipe or a full disk is no panic.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

pub mod browser_monitor;
pub mod cli;
pub mod init;
mod origin;
pub mod paper_tables;

pub use loadtwin_archive as archive;
pub use loadtwin_can as can;
pub use loadtwin_can::image::{key, seal, upload_protocol};
pub use loadtwin_design::{bearing, gearbox, image_build, reduce, rotor};
pub use loadtwin_diagnose as diagnose;
pub use loadtwin_drive as balance;
pub use loadtwin_files as files;
pub use loadtwin_files::atomic_file;
pub use loadtwin_fmu as fmu;
pub use loadtwin_identification::{calibrate, error_band, rotor_tune, static_calibration, tune};
pub use loadtwin_life as life;
pub use loadtwin_machine as machine;
pub use loadtwin_machine::strain;
pub use loadtwin_math::{exponential, metrics, riccati};
pub use loadtwin_record as record;
pub use loadtwin_recording as recording;
pub use loadtwin_replay as replay;
pub use loadtwin_report as report;
pub use loadtwin_simulate as simulate;
