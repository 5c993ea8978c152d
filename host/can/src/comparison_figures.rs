//! Result of a comparison of a machine's frames with recomputed ones: counts (`Figures`), the first
//! difference, the verdict.

use serde::Serialize;

/// What the comparison says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every frame that came was compared, none lost, every bit equal.
    Identical,
    /// A bit differs although the machine's state is known.
    Different,
    /// Nothing that was compared differs, but not everything could be compared.
    Incomplete,
    /// The machine runs another model.
    OtherModel,
    /// There was nothing to compare.
    Nothing,
}

/// The first frame that differs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Tick of the sample.
    pub tick: u32,
    /// Identifier.
    pub id: u16,
    /// What differs, in words.
    pub what: String,
    /// Payload by this recomputation.
    pub expected: String,
    /// Payload on the bus.
    pub received: String,
}

/// What was found so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Whole raw samples.
    pub samples: u64,
    /// Load and sensor frames compared.
    pub compared_frames: u64,
    /// Payload bits compared.
    pub compared_bits: u64,
    /// Frames that differ.
    pub differing_frames: u64,
    /// Bits that differ.
    pub differing_bits: u64,
    /// Frames that differ where the machine's state is not known: it had samples
    /// that were not received, before the first one here or lost, and has not started anew.
    pub unsettled_frames: u64,
    /// The first frame that differs.
    pub first_difference: Option<Difference>,
    /// Recomputed frames that the machine did not send, or that were lost.
    pub lost_frames: u64,
    /// Frames of the machine without raw sample to recompute them from.
    pub unverifiable_frames: u64,
    /// Recomputed frames still waiting for the machine's.
    pub waiting_frames: u64,
    /// Frames of the machine outside its bursts of raw samples.
    pub outside_frames: u64,
    /// Bursts of raw samples received to their end.
    pub bursts: u64,
    /// Bursts that the machine dropped because the bus did not carry them away.
    pub dropped_bursts: u64,
    /// Ticks missing between raw samples.
    pub missing_ticks: u64,
    /// Raw samples of which a frame was lost or out of order.
    pub incomplete_samples: u64,
    /// Frames whose check or content is wrong.
    pub damaged_frames: u64,
    /// Frames with an identifier of the machine but another length or format.
    pub malformed_frames: u64,
    /// Frames sent twice.
    pub repeated_frames: u64,
    /// Frames of others.
    pub foreign_frames: u64,
    /// Error frames of the controller.
    pub error_frames: u64,
    /// Status frames missing by their counter.
    pub lost_status: u64,
    /// Times that the machine started anew.
    pub restarts: u64,
    /// Name of the model that the machine runs, where it was reported.
    pub machine_model: Option<u32>,
    /// Version of the board's firmware, where it was reported.
    pub firmware: Option<String>,
    /// Time from a raw sample to a load or sensor frame that the machine made from it, mean (ms).
    /// The delay of the estimates in samples is not part of it.
    pub lag_mean_ms: f64,
    /// The largest such time (ms).
    pub lag_max_ms: f64,
    /// Frames compared, for the mean.
    #[serde(skip)]
    pub(crate) lags: u64,
}

/// How far a comparison is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Whole raw samples.
    pub samples: u64,
    /// Recomputed frames still waiting for the machine's.
    pub waiting_frames: u64,
}
