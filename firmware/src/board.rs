//! Defines the trait `Board`, by which the application takes raw samples and the overrun flag from
//! a board, queues frames to the bus, hands on loads to be counted, and counts events. Each board's
//! program implements it.

use loadtwin_common::counting::CountSample;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;

use crate::board_counters::Counters;
use crate::raw_burst::RawWriter;

/// A board at the priority of the sample clock; no call waits.
///
/// What happens on the bus is below that priority and not the application's:
/// it takes frames from a queue, and counts its faults in the same counters.
pub trait Board {
    /// What data-ready latched: converter words, encoder counts, index pulse.
    ///
    /// `None` where there was no conversion.
    fn acquire(&mut self) -> Option<RawSample>;

    /// Queues a frame for the bus.
    ///
    /// # Errors
    /// The frame, where the queue is full.
    fn queue(&mut self, frame: Frame) -> Result<(), Frame>;

    /// Hands a sample of the counted loads on to where counts are, below the priority of the sample
    /// clock; one that finds no place is a gap in the counts.
    fn count(&mut self, sample: CountSample);

    /// Whether data-ready has come again since [`Self::acquire`].
    fn overrun(&mut self) -> bool;

    /// Where bursts of raw samples wait for the bus; `None` on a board that sends none.
    fn raw_writer(&mut self) -> Option<&mut RawWriter<'static>>;

    /// The counters that the board's other parts count in.
    fn counters(&self) -> &Counters;
}
