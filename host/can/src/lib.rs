//! CAN on the host: reads and writes interfaces, serial adapters and logs; signs and uploads model
//! images; runs the commands that send, estimate, recompute and watch the frames of a machine.
//! Here: the error type, a model with its estimator and frame encoder (`Model`), conversion of
//! frames, and the stop by a signal.
//!
//! [`estimator_node`] replaces the microcontroller, [`sample_sender`] puts raw samples on a bus,
//! [`twin_and_prove`] recomputes what the microcontroller sent and compares it bit for bit, on a
//! bus or in a log, [`monitor`] watches, [`upload`] sends a model image to a board, [`kept_counts`]
//! reads its counts of load cycles. All of them run on the [`bus::Bus`] trait: a socket, a serial
//! adapter, a log, or a simulated controller. [`dbc`] writes the description of the frames.
#![forbid(unsafe_code)]
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

pub mod bus;
pub mod bus_frame;
mod comparison_figures;
pub mod dbc;
pub mod estimator_node;
pub mod frame_comparison;
pub mod frame_source;
pub mod image;
pub mod kept_counts;
pub mod live_display;
pub mod log;
pub mod logging_bus;
pub mod monitor;
pub mod paced_bus;
mod raw_coverage;
pub mod raw_sampling;
pub mod sample_sender;
pub mod simulated_controller;
mod slcan;
#[cfg(target_os = "linux")]
pub mod socketcan;
mod terminal_view;
pub mod twin_and_prove;
pub mod upload;

pub use log::LOG;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::frame;
use loadtwin_common::io::frame::FrameEncoder;
use thiserror::Error;

use bus_frame::{BusFrame, FrameKind};

/// Why a command on the bus ends without its result.
#[derive(Debug, Error)]
pub enum CanError {
    /// The interface cannot be opened.
    #[error(
        "CAN interface {interface} cannot be opened ({}): {source}",
        other_ways(interface)
    )]
    Open {
        /// What was asked for.
        interface: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file that is no log.
    #[error(
        "{path}: found {found}, no log of a bus; allowed: candump (`-L` or as printed), ASC, BLF, TRC"
    )]
    NoLog {
        /// The file.
        path: std::path::PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// A serial adapter that is named wrong.
    #[error(
        "{found}: allowed: slcan:PORT@BIT_RATE, as slcan:/dev/ttyACM0@500000 or slcan:COM3@250000"
    )]
    Name {
        /// What was asked for.
        found: String,
    },
    /// The bus failed for good.
    #[error(transparent)]
    Bus(#[from] bus::BusError),
    /// The model is refused.
    #[error("the model image is refused: {0}")]
    Model(#[from] loadtwin_common::Error),
    /// The samples to send cannot be read.
    #[error("{0}")]
    Samples(Box<dyn std::error::Error + Send + Sync>),
    /// The board did not take the image.
    #[error("upload: {0}")]
    Upload(#[from] image::upload_protocol::UploadError),
    /// There are no kept counts.
    #[error("counts of load cycles: {0}")]
    Counts(#[from] kept_counts::KeptCountsError),
    /// Ended by the user before it was done.
    #[error("stopped before the end")]
    Stopped,
    /// The terminal cannot be drawn on.
    #[error("terminal: {0}")]
    Terminal(std::io::Error),
}

/// A duration from the command line.
///
/// # Errors
/// What is allowed, where it is none.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok();
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "allowed: seconds, 0 and above".to_owned())
}

/// A model that can run: image and the name it has in status frames.
#[derive(Clone, Debug)]
pub struct Model<'a> {
    /// The image.
    pub image: Image<'a>,
    /// First four bytes of the SHA-256 of its bytes, little endian.
    pub hash: u32,
}

impl<'a> Model<'a> {
    /// Reads the model from the bytes of its image, without their container.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn from_bytes(bytes: &'a [u8]) -> Result<Self, CanError> {
        use sha2::{Digest, Sha256};
        let digest: [u8; 32] = Sha256::digest(bytes).into();
        let [a, b, c, d, ..] = digest;
        let hash = u32::from_le_bytes([a, b, c, d]);
        Ok(Self {
            image: Image::from_bytes(bytes)?,
            hash,
        })
    }

    /// The estimator before its first sample, and the encoder of its frames.
    ///
    /// # Errors
    /// Why the model is refused.
    pub fn start(&self) -> Result<(Estimator<'a>, FrameEncoder), CanError> {
        let encoder = FrameEncoder::try_build(&self.image, self.hash)?;
        Ok((Estimator::try_build(self.image.clone())?, encoder))
    }
}

/// A flag that the first Ctrl-C, or a termination, sets.
///
/// # Errors
/// When the system refuses the handler.
pub fn stop_on_signal() -> Result<Arc<AtomicBool>, ctrlc::Error> {
    let stop = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&stop);
    ctrlc::set_handler(move || set.store(true, Ordering::Relaxed))?;
    Ok(stop)
}

/// The frame as a bus takes it.
#[expect(clippy::unreachable, reason = "the length is that of the type")]
pub fn to_bus(frame: &frame::Frame) -> BusFrame {
    let id = u32::from(frame.id & 0x7FF);
    BusFrame::new(FrameKind::Data, id, false, &frame.data)
        .unwrap_or_else(|| unreachable!("8 bytes fit a frame"))
}

/// The FD frame as a bus takes it.
#[expect(clippy::unreachable, reason = "the length is that of the type")]
pub fn to_bus_fd(frame: &frame::FdFrame) -> BusFrame {
    let id = u32::from(frame.id & 0x7FF);
    BusFrame::new(FrameKind::Fd { flags: 0 }, id, false, &frame.data)
        .unwrap_or_else(|| unreachable!("64 bytes fit an FD frame"))
}

/// Identifier and payload of a data frame with a standard identifier.
pub fn standard(frame: &BusFrame) -> Option<(u16, &[u8])> {
    match frame.kind() {
        FrameKind::Data | FrameKind::Fd { .. } if !frame.is_extended() => {
            Some((frame.id() as u16, frame.data()))
        }
        _ => None,
    }
}

/// Version of a board's firmware, as `1.20.3`.
fn firmware_version(info: &frame::BoardInfo) -> String {
    let [major, minor, patch] = info.firmware;
    format!("{major}.{minor}.{patch}")
}

/// What to do where an interface cannot be opened.
fn other_ways(interface: &str) -> String {
    if cfg!(target_os = "linux") && !interface.contains(['/', '\\']) {
        format!(
            "`ip link set {interface} up type can bitrate 500000`, or `ip link add dev {interface} type vcan` \
             without hardware; a serial adapter is slcan:/dev/ttyACM0@500000; a log of a bus is read as well"
        )
    } else {
        "instead: a serial adapter as slcan:PORT@500000, or a log of a bus".to_owned()
    }
}
