//! Wraps the `Bus` of a log so that its frames come as they did when it was recorded, faster by a
//! constant factor (`Paced`); `monitor --web` shows logs by it. After the last frame nothing comes
//! any more.

use std::thread;
use std::time::{Duration, Instant};

use super::bus::{Bus, BusError, Received};
use super::bus_frame::BusFrame;

/// A log whose frames come at the recorded intervals, divided by a speed.
pub struct Paced<B> {
    bus: B,
    /// How many times faster.
    speed: f64,
    /// The time of the first frame (us), and when it was handed out.
    start: Option<(u64, Instant)>,
    ahead: Option<Received>,
    ended: bool,
    opened: Instant,
}

impl<B: Bus> Paced<B> {
    /// `speed` times faster than recorded. After its end nothing comes any more.
    pub fn new(bus: B, speed: f64) -> Self {
        Self {
            bus,
            speed,
            start: None,
            ahead: None,
            ended: false,
            opened: Instant::now(),
        }
    }

    fn fill(&mut self) -> Result<(), BusError> {
        if self.ahead.is_none() && !self.ended {
            match self.bus.receive(Duration::ZERO) {
                Ok(received) => self.ahead = received,
                Err(BusError::Ended) => self.ended = true,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

impl<B: Bus> Bus for Paced<B> {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        self.fill()?;
        let Some(received) = self.ahead else {
            thread::sleep(timeout);
            return Ok(None);
        };
        let (first_us, began) = *self.start.get_or_insert((received.t_us, Instant::now()));
        let since = Duration::from_micros(received.t_us.saturating_sub(first_us));
        let due = began + since.div_f64(self.speed);
        let wait = due.saturating_duration_since(Instant::now());
        if wait > timeout {
            thread::sleep(timeout);
            return Ok(None);
        }
        thread::sleep(wait);
        self.ahead = None;
        Ok(Some(received))
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        self.bus.send(frame)
    }

    fn restart(&mut self) -> Result<(), BusError> {
        self.bus.restart()
    }

    fn now(&self) -> Duration {
        self.opened.elapsed()
    }

    fn wait(&mut self, time: Duration) {
        thread::sleep(time);
    }

    fn malformed(&self) -> (u64, Option<u64>) {
        self.bus.malformed()
    }
}
