//! Counts of a recorder: frames and samples received, written, missing, damaged and repeated; files
//! deleted.

use std::ops::AddAssign;

use serde::{Deserialize, Serialize};

/// Counts, of a part or since the first start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Frames of the machine.
    pub frames: u64,
    /// Frames or samples whose check or content is wrong, and samples without all of their frames.
    pub damaged: u64,
    /// Raw samples received.
    pub samples_received: u64,
    /// Raw samples in files.
    pub samples_written: u64,
    /// Raw samples received that could not be written.
    pub samples_not_written: u64,
    /// Raw samples missing by their ticks, those of a recorder that was killed among them.
    pub samples_missing: u64,
    /// Gaps that these missing samples make.
    pub gaps: u64,
    /// Raw samples that came again.
    pub samples_repeated: u64,
    /// Times that the machine started anew, or its clock was set anew.
    pub restarts: u64,
    /// Rows of estimates in files.
    pub estimates_written: u64,
    /// Rows of estimates that could not be written.
    pub estimates_not_written: u64,
    /// Files of this recorder that were deleted to bound the disk.
    pub files_deleted: u64,
    /// Bytes of these.
    pub bytes_deleted: u64,
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.damaged += other.damaged;
        self.samples_received += other.samples_received;
        self.samples_written += other.samples_written;
        self.samples_not_written += other.samples_not_written;
        self.samples_missing += other.samples_missing;
        self.gaps += other.gaps;
        self.samples_repeated += other.samples_repeated;
        self.restarts += other.restarts;
        self.estimates_written += other.estimates_written;
        self.estimates_not_written += other.estimates_not_written;
        self.files_deleted += other.files_deleted;
        self.bytes_deleted += other.bytes_deleted;
    }
}
