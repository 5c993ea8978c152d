//! Wraps a `Bus` so that every frame received and sent is also written to a candump log
//! (`Recorded`). `NoBus` stands in where frames go to the log alone: it accepts every frame, and
//! its clock moves as it is waited for.

use std::io;
use std::time::Duration;

use super::bus::{Bus, BusError, Received};
use super::bus_frame::BusFrame;
use super::log::LogWriter;

/// A bus with all that it carries written to a log.
pub struct Recorded<B> {
    bus: B,
    log: LogWriter,
    /// Whether frames that are sent go into the log alone: the bus is a log, too.
    is_log: bool,
    /// Time of the frame that came last (us), and the clock of the bus then.
    last: Option<(u64, Duration)>,
    /// The first frame of a log, read for its time.
    ahead: Option<Received>,
}

impl<B: Bus> Recorded<B> {
    /// `bus` with all frames written to `log`; `is_log`: the bus is a log, which takes no frames.
    ///
    /// # Errors
    /// When the first frame of a log cannot be read.
    pub fn new(mut bus: B, log: LogWriter, is_log: bool) -> Result<Self, BusError> {
        let ahead = match is_log.then(|| bus.receive(Duration::ZERO)) {
            Some(Ok(first)) => first,
            None | Some(Err(BusError::Ended)) => None,
            Some(Err(error)) => return Err(error),
        };
        let last = ahead.map(|first| (first.t_us, bus.now()));
        Ok(Self {
            bus,
            log,
            is_log,
            last,
            ahead,
        })
    }

    fn write(&mut self, received: &Received) -> Result<(), BusError> {
        self.log
            .write(received)
            .map_err(|error| io::Error::other(error).into())
    }
}

impl<B: Bus> Bus for Recorded<B> {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        let received = match self.ahead.take() {
            Some(first) => Some(first),
            None => self.bus.receive(timeout)?,
        };
        if let Some(received) = &received {
            self.write(received)?;
            self.last = Some((received.t_us, self.bus.now()));
        }
        Ok(received)
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        if !self.is_log {
            self.bus.send(frame)?;
        }
        let now = self.bus.now();
        let (t_us, before) = self.last.unwrap_or((now.as_micros() as u64, now));
        let since = now.saturating_sub(before).as_micros() as u64;
        self.write(&Received {
            t_us: t_us + since,
            frame: *frame,
        })
    }

    fn restart(&mut self) -> Result<(), BusError> {
        self.bus.restart()
    }

    fn now(&self) -> Duration {
        self.bus.now()
    }

    fn wait(&mut self, time: Duration) {
        self.bus.wait(time);
    }

    fn foreign(&self) -> u64 {
        self.bus.foreign()
    }

    fn malformed(&self) -> (u64, Option<u64>) {
        self.bus.malformed()
    }

    fn refused(&self) -> u64 {
        self.bus.refused()
    }

    fn remark(&self) -> Option<&'static str> {
        self.bus.remark()
    }

    fn finish(&mut self) -> Result<(), BusError> {
        self.bus.finish()?;
        self.log
            .flush()
            .map_err(|error| io::Error::other(error).into())
    }
}

/// No bus: a clock that moves as it is waited for. With [`Recorded`], what would be sent becomes a
/// log.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoBus {
    now: Duration,
}

impl Bus for NoBus {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        self.now += timeout;
        Ok(None)
    }

    fn send(&mut self, _frame: &BusFrame) -> Result<(), BusError> {
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
