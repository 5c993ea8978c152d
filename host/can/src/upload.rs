//! Uploads a signed model image over a bus, for `loadtwin upload`: sends the frames of the state
//! machine in `image/upload_protocol.rs`, passes it the answers of the board, and returns bytes,
//! frames and time. Ends when the board has accepted or refused the image or
//! does not answer, or when a stop is asked for.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::uds::{ANSWER_ID, REQUEST_ID};
use serde::Serialize;

use super::bus::{Bus, BusError};
use super::{CanError, standard, to_bus};
use crate::image::upload_protocol::{Next, Uploader};

/// Longest wait for an answer before the state machine is asked again.
const PATIENCE: Duration = Duration::from_millis(20);

/// Summary of an upload.
#[derive(Clone, Debug, Serialize)]
pub struct UploadSummary {
    /// Bytes of the image.
    pub bytes: usize,
    /// Frames to the board.
    pub frames: u64,
    /// How long it took (s).
    pub seconds: f64,
}

/// Uploads until the board has accepted the image.
///
/// # Errors
/// Why the board, or this host, refused it; that the bus failed for good; that
/// `stop` was set.
pub fn run<B: Bus>(
    mut uploader: Uploader,
    mut bus: B,
    mut progress: impl FnMut(f64),
    stop: &AtomicBool,
) -> Result<UploadSummary, CanError> {
    let started = bus.now();
    let mut frames = 0;
    while !stop.load(Ordering::Relaxed) {
        // Microseconds wrap as the state machine expects.
        match uploader.poll(bus.now().saturating_sub(started).as_micros() as u32) {
            Next::Accepted => {
                return Ok(UploadSummary {
                    bytes: uploader.progress().1,
                    frames,
                    seconds: bus.now().saturating_sub(started).as_secs_f64(),
                });
            }
            Next::Failed(error) => return Err(error.into()),
            Next::Frame(data) => {
                let frame = to_bus(&Frame {
                    id: REQUEST_ID,
                    data,
                });
                loop {
                    match bus.send(&frame) {
                        Ok(()) => break,
                        Err(BusError::Full | BusError::Down) => bus.wait(Duration::from_millis(1)),
                        Err(error) => return Err(error.into()),
                    }
                    if stop.load(Ordering::Relaxed) {
                        return Err(CanError::Stopped);
                    }
                }
                frames += 1;
                let (sent, all) = uploader.progress();
                progress(sent as f64 / all.max(1) as f64);
            }
            Next::Wait(us) => {
                let wait = PATIENCE.min(Duration::from_micros(u64::from(us)));
                match bus.receive(wait) {
                    Ok(Some(received)) => {
                        if let Some((ANSWER_ID, data)) = standard(&received.frame) {
                            uploader.on_frame(
                                data,
                                bus.now().saturating_sub(started).as_micros() as u32,
                            );
                        }
                    }
                    Ok(None) | Err(BusError::Down) => {}
                    Err(error) => return Err(error.into()),
                }
            }
        }
    }
    Err(CanError::Stopped)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::Received;
    use crate::image::key::SigningKey;
    use crate::image::seal::seal;

    /// A bus on which nobody answers; time passes when one waits for an answer.
    #[derive(Default)]
    struct Silent {
        now: Duration,
        sent: Vec<u16>,
    }

    impl Bus for Silent {
        fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
            self.now += timeout;
            Ok(None)
        }

        fn send(&mut self, frame: &crate::bus_frame::BusFrame) -> Result<(), BusError> {
            self.sent.extend(standard(frame).map(|(id, _)| id));
            Ok(())
        }

        fn restart(&mut self) -> Result<(), BusError> {
            Ok(())
        }

        fn now(&self) -> Duration {
            self.now
        }

        fn wait(&mut self, time: Duration) {
            self.now += time;
        }
    }

    #[test]
    fn a_board_that_does_not_answer_is_given_up() {
        let key = SigningKey::generate().unwrap();
        let image = seal(&[7; 500], "bench", 1, None, Some(&key)).unwrap();
        let uploader = Uploader::new(image).unwrap();
        let error = run(uploader, Silent::default(), |_| (), &AtomicBool::new(false)).unwrap_err();
        assert!(matches!(error, CanError::Upload(_)), "{error}");
    }

    #[test]
    fn an_image_without_signature_is_not_sent() {
        let image = seal(&[7; 500], "bench", 1, None, None).unwrap();
        assert!(Uploader::new(image).is_err());
    }
}
