//! The machine's frames on CAN sockets and in `candump` logs.
//!
//! [`node`] replaces the microcontroller, [`send`] puts raw samples on a
//! bus, [`twin`] recomputes what the microcontroller sent and compares it bit
//! for bit, on a bus or in a log, [`monitor`] watches, [`dbc`] prints the
//! description of the frames. All of them run on the [`bus::Bus`] trait: a
//! socket, a log, or a simulated controller.
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
pub mod comparison;
pub mod controller;
pub mod dbc;
pub mod image;
pub mod log;
pub mod monitor;
pub mod node;
pub mod page;
mod screen;
pub mod send;
pub mod socket;
pub mod twin;
pub mod upload;

pub use log::LOG;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::frame;
use loadtwin_common::io::frame::FrameEncoder;
use socketcan::{CanAnyFrame, CanDataFrame, CanFdFrame, EmbeddedFrame, Frame, StandardId};
use thiserror::Error;

/// Why a command on the bus ends without its result.
#[derive(Debug, Error)]
pub enum CanError {
    /// The interface cannot be opened.
    #[error("CAN interface {interface}: {source}")]
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
    /// A log in which no line is a frame.
    #[error(
        "{path}: {lines} of {lines} lines are no candump log; allowed: what `candump -L` writes, as \
         `(1436509052.249713) can0 501#00112233`; BLF, ASC and TRC are converted by \
         `python -m can.logconvert IN OUT.log` of python-can"
    )]
    NoLog {
        /// The log.
        path: std::path::PathBuf,
        /// Its lines.
        lines: u64,
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
    Upload(#[from] image::upload::UploadError),
    /// Ended by the user before it was done.
    #[error("stopped before the end")]
    Stopped,
    /// The terminal cannot be drawn on.
    #[error("terminal: {0}")]
    Terminal(std::io::Error),
}

/// A duration from the command line.
fn seconds(text: &str) -> Result<Duration, String> {
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

/// The frame as the socket takes it.
#[expect(clippy::unreachable, reason = "the length is that of the type")]
pub fn to_bus(frame: &frame::Frame) -> CanAnyFrame {
    let id = StandardId::new(frame.id & 0x7FF).unwrap_or(StandardId::MAX);
    CanDataFrame::new(id, &frame.data)
        .map_or_else(|| unreachable!("8 bytes fit a frame"), CanAnyFrame::Normal)
}

/// The FD frame as the socket takes it.
#[expect(clippy::unreachable, reason = "the length is that of the type")]
pub fn to_bus_fd(frame: &frame::FdFrame) -> CanAnyFrame {
    let id = StandardId::new(frame.id & 0x7FF).unwrap_or(StandardId::MAX);
    CanFdFrame::new(id, &frame.data)
        .map_or_else(|| unreachable!("64 bytes fit an FD frame"), CanAnyFrame::Fd)
}

/// Identifier and payload of a data frame with a standard identifier.
pub fn standard(frame: &CanAnyFrame) -> Option<(u16, &[u8])> {
    match frame {
        CanAnyFrame::Normal(_) | CanAnyFrame::Fd(_) if !frame.is_extended() => {
            Some((frame.raw_id() as u16, frame.data()))
        }
        _ => None,
    }
}
