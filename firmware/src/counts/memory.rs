//! Memory for the counts of a machine (`CountMemory`): counts as they are, as they were kept last,
//! and the increment between both on its way into flash.

use heapless::Vec;
use loadtwin_common::Error;
use loadtwin_common::counting::kept::CONTENT;
use loadtwin_common::counting::{ByteSink, CountedLoads, MachineCounts};

/// Longest increment (bytes); a longer one is kept as a whole state. A minute of white noise that
/// changes every counter of a load takes 2.7 kB.
pub const INCREMENT: usize = 3000;

/// Counts of up to `L` loads.
#[derive(Debug)]
pub struct CountMemory<const L: usize> {
    /// As they are.
    pub counts: MachineCounts<L>,
    /// As they were kept last.
    pub(super) kept: MachineCounts<L>,
    increment: Vec<u8, INCREMENT>,
}

impl<const L: usize> CountMemory<L> {
    /// No loads.
    pub const fn none() -> Self {
        Self {
            counts: MachineCounts::none(),
            kept: MachineCounts::none(),
            increment: Vec::new(),
        }
    }

    /// Begins with nothing counted, in place: counts are large.
    ///
    /// # Errors
    /// As [`MachineCounts::try_new`].
    pub fn begin(&mut self, counted: &CountedLoads) -> Result<(), Error> {
        self.counts.begin(counted)?;
        self.kept.begin(counted)
    }

    /// Makes the counts as they are those that are kept.
    pub(super) fn mark_kept(&mut self) {
        for (kept, counts) in (self.kept.loads_mut().iter_mut()).zip(self.counts.loads_mut()) {
            counts.settle();
            kept.clone_from(counts);
        }
    }

    /// Puts the increment since what was kept together; its pieces, none where it is too long.
    pub(super) fn begin_increment(&mut self) -> Option<u8> {
        let mut sink = Bounded {
            bytes: &mut self.increment,
            is_full: false,
        };
        sink.bytes.clear();
        for (counts, kept) in (self.counts.loads_mut().iter_mut()).zip(self.kept.loads()) {
            counts.settle();
            counts.increment(Some(kept), &mut sink);
        }
        let pieces = sink.bytes.len().div_ceil(CONTENT) as u8;
        (!sink.is_full).then_some(pieces)
    }

    /// The content of a piece of the increment.
    pub(super) fn increment_piece(&self, index: u8) -> &[u8] {
        let pieces = self.increment.chunks(CONTENT);
        pieces.into_iter().nth(index.into()).unwrap_or_default()
    }

    /// Adds the increment to what was kept; false where that is no state.
    pub(super) fn end_increment(&mut self) -> bool {
        let mut bytes = &self.increment[..];
        let all = self.kept.loads_mut().iter_mut();
        let mut added = all.map(|kept| kept.add_increment(&mut bytes));
        added.all(|added| added.is_ok())
    }

    /// The content of a piece of the whole state that is kept, and whether it is the last one.
    pub(super) fn state_piece(&self, index: u8) -> (Vec<u8, CONTENT>, bool) {
        let from = usize::from(index) * CONTENT;
        let mut sink = Window {
            bytes: Vec::new(),
            passed: 0,
            from,
        };
        for kept in self.kept.loads() {
            kept.increment(None, &mut sink);
        }
        let is_last = sink.passed <= from + CONTENT;
        (sink.bytes, is_last)
    }
}

/// Takes bytes as long as there is room.
struct Bounded<'a> {
    bytes: &'a mut Vec<u8, INCREMENT>,
    is_full: bool,
}

impl ByteSink for Bounded<'_> {
    fn put(&mut self, byte: u8) {
        self.is_full |= self.bytes.push(byte).is_err();
    }
}

/// Takes the bytes of one piece.
struct Window {
    bytes: Vec<u8, CONTENT>,
    passed: usize,
    from: usize,
}

impl ByteSink for Window {
    fn put(&mut self, byte: u8) {
        if self.passed >= self.from {
            // Full: it belongs to the next piece.
            _ = self.bytes.push(byte);
        }
        self.passed += 1;
    }
}
