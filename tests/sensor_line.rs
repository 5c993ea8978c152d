//! The line to the sensors of the emulated board: messages over it, and those that lie in the board's
//! memory.

use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::thread::{self, JoinHandle};

use loadtwin_common::io::raw::RawSample;
use loadtwin_firmware::stimulus::Stimulus;

/// Content of `STORED` in memory/emulated.x: the length of the messages, then the messages.
pub(crate) fn stored_messages(samples: &[RawSample]) -> Vec<u8> {
    let messages: Vec<u8> = samples
        .iter()
        .flat_map(|sample| message(&Stimulus::Sample(*sample)))
        .collect();
    let length = u32::try_from(messages.len()).expect("no more than the memory has");
    [&length.to_le_bytes(), messages.as_slice()].concat()
}

/// The frame of a message.
fn message(stimulus: &Stimulus) -> Vec<u8> {
    postcard::to_stdvec_cobs(stimulus).expect("a message has a frame")
}

/// The world that the board's sensors see.
pub struct Sensors(pub(crate) UnixStream);

impl Sensors {
    /// Sends one message.
    ///
    /// # Panics
    /// Where the board is gone.
    pub fn send(&mut self, stimulus: &Stimulus) {
        let frame = message(stimulus);
        self.0.write_all(&frame).expect("the board takes it");
    }

    /// Sends bytes as they are.
    ///
    /// # Panics
    /// Where the board is gone.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.0.write_all(bytes).expect("the board takes them");
    }

    /// Sends what is stored in the board's memory, and then the end.
    pub fn send_stored(mut self) {
        self.send(&Stimulus::Stored);
        self.send(&Stimulus::End);
    }

    /// Sends samples and then the end, from a thread of its own.
    pub fn send_all(mut self, samples: Vec<RawSample>) -> JoinHandle<()> {
        thread::spawn(move || {
            for sample in samples {
                self.send(&Stimulus::Sample(sample));
            }
            self.send(&Stimulus::End);
        })
    }
}
