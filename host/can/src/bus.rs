//! Defines the trait `Bus` (receive, send, restart, clock) that interfaces, serial adapters, logs
//! and the simulated controller implement, and its errors. `Link` sends frames through a bus: it
//! repeats a send after a full queue or a fault, with bounded back-off and up to a time limit, and
//! counts the faults.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use serde::Serialize;
use thiserror::Error;

use super::bus_frame::BusFrame;

/// A frame and when it came (us).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received {
    /// Time, since the epoch or since the start of the bus (us).
    pub t_us: u64,
    /// The frame; error frames report what the controller met.
    pub frame: BusFrame,
}

/// Why a frame did not come or go.
#[derive(Debug, Error)]
pub enum BusError {
    /// The queue to the bus is full; it empties by itself.
    #[error("the queue to the bus is full")]
    Full,
    /// The interface is down or gone; it may come back.
    #[error("the interface is down")]
    Down,
    /// The controller has left the bus after too many errors.
    #[error("the controller is bus-off")]
    Off,
    /// The serial adapter was unplugged.
    #[error("the serial adapter is gone")]
    Gone,
    /// There will never be another frame: the log has ended.
    #[error("the log has ended")]
    Ended,
    /// Anything else.
    #[error("CAN: {0}")]
    Io(#[from] io::Error),
}

/// A CAN bus: a socket, a serial adapter, a log, a simulated controller.
pub trait Bus {
    /// The next frame; `None` when none came within `timeout`.
    ///
    /// # Errors
    /// Why there is none.
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError>;

    /// Puts a frame into the queue to the bus.
    ///
    /// # Errors
    /// Reason of the rejection.
    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError>;

    /// Asks a controller that is bus-off to come back.
    ///
    /// # Errors
    /// `Off` while it cannot.
    fn restart(&mut self) -> Result<(), BusError>;

    /// Time on a clock that never goes back.
    fn now(&self) -> Duration;

    /// Lets time pass.
    fn wait(&mut self, time: Duration);

    /// Frames of others that the bus carried but did not deliver here.
    fn foreign(&self) -> u64 {
        0
    }

    /// Lines of a log that are no frame, and the number of the first.
    fn malformed(&self) -> (u64, Option<u64>) {
        (0, None)
    }

    /// Frames that the bus took at first and then refused.
    fn refused(&self) -> u64 {
        0
    }

    /// What a user should know of the bus before the first frame.
    fn remark(&self) -> Option<&'static str> {
        None
    }

    /// Brings what was written onto the disk.
    ///
    /// # Errors
    /// When it cannot be written.
    fn finish(&mut self) -> Result<(), BusError> {
        Ok(())
    }
}

/// The next of what a reading thread received, within `timeout`.
pub(crate) fn next_within(
    received: &Receiver<Result<Received, BusError>>,
    timeout: Duration,
) -> Result<Option<Received>, BusError> {
    match received.recv_timeout(timeout) {
        Ok(message) => message.map(Some),
        Err(RecvTimeoutError::Timeout) => Ok(None),
        Err(RecvTimeoutError::Disconnected) => Err(BusError::Ended),
    }
}

impl<B: Bus + ?Sized> Bus for Box<B> {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        (**self).receive(timeout)
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        (**self).send(frame)
    }

    fn restart(&mut self) -> Result<(), BusError> {
        (**self).restart()
    }

    fn now(&self) -> Duration {
        (**self).now()
    }

    fn wait(&mut self, time: Duration) {
        (**self).wait(time);
    }

    fn foreign(&self) -> u64 {
        (**self).foreign()
    }

    fn malformed(&self) -> (u64, Option<u64>) {
        (**self).malformed()
    }

    fn refused(&self) -> u64 {
        (**self).refused()
    }

    fn remark(&self) -> Option<&'static str> {
        (**self).remark()
    }

    fn finish(&mut self) -> Result<(), BusError> {
        (**self).finish()
    }
}

/// Delays that double from the first to the last.
#[derive(Clone, Copy, Debug)]
pub struct Backoff {
    first: Duration,
    last: Duration,
    next: Duration,
}

impl Backoff {
    /// From `first` to `last`.
    pub fn new(first: Duration, last: Duration) -> Self {
        Self {
            first,
            last,
            next: first,
        }
    }

    /// How long to wait this time.
    pub fn delay(&mut self) -> Duration {
        let delay = self.next;
        self.next = (2 * self.next).min(self.last);
        delay
    }

    /// Starts over.
    pub fn reset(&mut self) {
        self.next = self.first;
    }
}

/// Counts of a link: frames sent and dropped, and faults of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounts {
    /// Frames that the bus took.
    pub sent: u64,
    /// Frames given up after the time limit of the link, and those that the bus refused.
    pub dropped: u64,
    /// Times that the queue was full.
    pub full: u64,
    /// Times that the interface went down.
    pub down: u64,
    /// Times that the controller went bus-off.
    pub bus_off: u64,
    /// Times that it came back from either.
    pub recovered: u64,
}

/// A bus on which sending is retried with bounded back-off.
#[derive(Debug)]
pub struct Link<B> {
    bus: B,
    patience: Duration,
    queue: Backoff,
    fault: Backoff,
    faulty: bool,
    counts: LinkCounts,
}

impl<B: Bus> Link<B> {
    /// A link that gives a frame up after `patience`, the time limit of a send.
    pub fn new(bus: B, patience: Duration) -> Self {
        Self {
            bus,
            patience,
            queue: Backoff::new(Duration::from_micros(100), Duration::from_millis(10)),
            fault: Backoff::new(Duration::from_millis(10), Duration::from_secs(1)),
            faulty: false,
            counts: LinkCounts::default(),
        }
    }

    /// Counts so far.
    pub fn counts(&self) -> LinkCounts {
        let refused = self.bus.refused();
        LinkCounts {
            sent: self.counts.sent.saturating_sub(refused),
            dropped: self.counts.dropped + refused,
            ..self.counts
        }
    }

    /// The bus below.
    pub fn bus(&self) -> &B {
        &self.bus
    }

    /// The bus below.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Sends a frame; `false` when it was given up or `stop` was set.
    ///
    /// # Errors
    /// Any but `Full`, `Down` and `Off`, which are waited for.
    pub fn send(&mut self, frame: &BusFrame, stop: &AtomicBool) -> Result<bool, BusError> {
        let deadline = self.bus.now() + self.patience;
        loop {
            let delay = match self.bus.send(frame) {
                Ok(()) => {
                    self.counts.sent += 1;
                    self.counts.recovered += u64::from(self.faulty);
                    self.faulty = false;
                    self.queue.reset();
                    self.fault.reset();
                    return Ok(true);
                }
                Err(BusError::Full) => {
                    self.counts.full += 1;
                    self.queue.delay()
                }
                Err(BusError::Down) => {
                    self.counts.down += u64::from(!self.faulty);
                    self.faulty = true;
                    self.fault.delay()
                }
                Err(BusError::Off) => {
                    self.counts.bus_off += u64::from(!self.faulty);
                    self.faulty = true;
                    let delay = self.fault.delay();
                    self.bus.wait(delay);
                    match self.bus.restart() {
                        Ok(()) | Err(BusError::Off) => Duration::ZERO,
                        Err(error) => return Err(error),
                    }
                }
                Err(error) => return Err(error),
            };
            if self.bus.now() + delay >= deadline || stop.load(Ordering::Relaxed) {
                self.counts.dropped += 1;
                return Ok(false);
            }
            self.bus.wait(delay);
        }
    }

    /// The next frame; `None` when none came within `timeout`, or the
    /// interface is down.
    ///
    /// # Errors
    /// Any but `Down`: `Ended` at the end of a log.
    pub fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        match self.bus.receive(timeout) {
            Err(BusError::Down) => {
                self.counts.down += u64::from(!self.faulty);
                self.faulty = true;
                Ok(None)
            }
            Ok(Some(received)) => {
                if !received.frame.is_error() {
                    self.counts.recovered += u64::from(self.faulty);
                    self.faulty = false;
                }
                Ok(Some(received))
            }
            other => other,
        }
    }
}
