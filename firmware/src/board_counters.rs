//! Atomic counters of the board: overruns, missed samples, transitions of the CAN controller to
//! bus-off, and frames dropped because the transmit queue was full.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Counters since start, written at the priority where the event is seen and
/// read at any other; each wraps.
#[derive(Debug, Default)]
pub struct Counters {
    /// Data-ready came while the step before was still running.
    pub overruns: AtomicU32,
    /// Samples lost before the step, by the difference of their ticks.
    pub missed: AtomicU32,
    /// Times the CAN controller went bus-off.
    pub bus_off: AtomicU32,
    /// Frames that found the queue to the bus full.
    pub queue_overflow: AtomicU32,
}

impl Counters {
    /// All zero; for a `static`.
    pub const fn new() -> Self {
        Self {
            overruns: AtomicU32::new(0),
            missed: AtomicU32::new(0),
            bus_off: AtomicU32::new(0),
            queue_overflow: AtomicU32::new(0),
        }
    }
}

/// Whether the CAN controller is off the bus, for its counter.
#[derive(Clone, Copy, Debug, Default)]
pub struct BusState {
    off: bool,
}

impl BusState {
    /// Counts each time that the controller has gone bus-off since the last call.
    pub fn follow(&mut self, off: bool, counters: &Counters) {
        if off && !self.off {
            count(&counters.bus_off);
        }
        self.off = off;
    }
}

/// Counts one event.
pub fn count(counter: &AtomicU32) {
    counter.fetch_add(1, Relaxed);
}
