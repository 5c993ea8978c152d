//! Defines the messages that a test sends to the emulated board (`Stimulus`): raw samples, and
//! commands for its converter, raw output, restart and end.
//!
//! Postcard messages in COBS frames, each ended by a zero byte.

use loadtwin_common::io::raw::RawSample;
use serde::{Deserialize, Serialize};

/// Longest frame with its zero byte; a test asserts it.
pub const LONGEST: usize = 96;

/// One message to the emulated board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stimulus {
    /// The converter's next conversion.
    Sample(RawSample),
    /// Whether the converter waits until the bus has room for a step's frames
    /// (as it does at start), or converts whatever happens, as a real one does.
    Wait(bool),
    /// Whether the board sends the raw samples too; not at start.
    SendRaw(bool),
    /// Nothing follows: stop with success once all is sent.
    End,
    /// Start anew, as after a reset: with the newest image, at the first sample.
    Restart,
    /// The sample clock stands still from here on.
    Stop,
    /// The messages follow that the test stored in the board's memory, then again those of the line.
    Stored,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_message_fits_its_frame() {
        let sample = Stimulus::Sample(RawSample {
            tick: u32::MAX,
            valid: u16::MAX,
            words: [i32::MIN; 8],
            encoders: [u32::MAX; 2],
            index: Some(u32::MAX),
        });
        let mut frame = [0; LONGEST];
        assert_eq!(
            postcard::to_slice_cobs(&sample, &mut frame).unwrap().len(),
            67
        );
    }
}
