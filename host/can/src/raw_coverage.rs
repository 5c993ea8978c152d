//! Follows which raw samples a machine sends (`RawCoverage`), by what its board says: all, those of a
//! burst that begins with the estimator, or none. Load and sensor frames of other samples cannot be
//! recomputed, and are no loss.

use loadtwin_common::io::frame::{BoardInfo, BoardPage, RawOutput};

/// Raw samples of a machine since its estimator started.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RawCoverage {
    /// What the board says; nothing was said yet, or it is none that says it.
    raw: Option<RawOutput>,
    /// Samples received from tick 0 on.
    received: u32,
    /// Count of dropped bursts, as last reported.
    dropped: Option<u32>,
    /// The burst under way was dropped by the machine.
    is_dropped: bool,
    /// Bursts received to their last sample.
    pub(crate) bursts: u64,
    /// Bursts dropped by the machine meanwhile.
    pub(crate) dropped_bursts: u64,
}

impl RawCoverage {
    /// The machine's estimator begins anew.
    pub(crate) fn restart(&mut self) {
        self.raw = None;
        self.received = 0;
        self.is_dropped = false;
    }

    /// A raw sample came.
    pub(crate) fn sample(&mut self, tick: u32) {
        self.received = tick.saturating_add(1);
        if self.raw
            == Some(RawOutput::Burst(
                self.received.try_into().unwrap_or(u16::MAX),
            ))
        {
            self.bursts += 1;
        }
    }

    /// Takes what the board says of itself; whether it is that not all samples come.
    pub(crate) fn follow(&mut self, info: &BoardInfo, page: BoardPage) -> bool {
        if page != BoardPage::Raw {
            return false;
        }
        self.raw = Some(info.raw);
        let before = self.dropped.replace(info.dropped_bursts);
        let dropped = info
            .dropped_bursts
            .saturating_sub(before.unwrap_or(info.dropped_bursts));
        self.dropped_bursts += u64::from(dropped);
        self.is_dropped |= dropped > 0;
        info.raw != RawOutput::All
    }

    /// Samples of the burst are still to come.
    pub(crate) fn is_in_burst(&self) -> bool {
        matches!(self.raw, Some(RawOutput::Burst(samples)) if self.received < u32::from(samples))
            && !self.is_dropped
    }

    /// Whether ticks are counted from the start of the estimator.
    pub(crate) fn has_burst(&self) -> bool {
        matches!(self.raw, Some(RawOutput::Burst(_)))
    }

    /// Whether the raw sample of a tick is one that comes or came.
    pub(crate) fn covers(&self, tick: u32) -> bool {
        match self.raw {
            Some(RawOutput::None) => false,
            Some(RawOutput::Burst(_)) if self.is_dropped => tick < self.received,
            Some(RawOutput::Burst(samples)) => tick < u32::from(samples),
            Some(RawOutput::All) | None => true,
        }
    }
}
