//! Counts the loads of the running image (`Counting`), below the priority of the sample clock: takes
//! samples, has the counts kept in flash every 50 s of running, and makes way for an image.

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::counting::CountSample;

use crate::counts::{CountKeeper, CountsLayout, INTERVAL_S, Owner};
use crate::room::Room;

/// Work after which an image does not wait any longer for the counts to be kept: that of writing a
/// whole state, and more.
const MOST_WORK: u32 = 300;

/// Counts the loads of one image.
#[derive(Debug)]
pub struct Counting {
    layout: CountsLayout,
    /// None where nothing is counted.
    keeper: Option<CountKeeper>,
    /// Tick of the next sample, where one was taken before.
    next_tick: Option<u32>,
    /// Samples since the counts were kept last.
    since: u32,
    making_way: MakingWay,
}

/// How far the counts are from making way for an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MakingWay {
    /// They are not asked to.
    No,
    /// They are kept first; so much work was done.
    Keeping(u32),
    /// They have.
    Done,
}

impl Counting {
    /// Counts nothing.
    pub const fn new(layout: CountsLayout) -> Self {
        Self {
            layout,
            keeper: None,
            next_tick: None,
            since: 0,
            making_way: MakingWay::No,
        }
    }

    /// Where counts are kept.
    pub fn layout(&self) -> CountsLayout {
        self.layout
    }

    /// Begins to count after a start of the board, from what was kept where there is something.
    pub fn start<F: NorFlash, const R: usize, const L: usize>(
        &mut self,
        owner: Owner,
        flash: &mut F,
        room: &mut Room<R, L>,
    ) {
        if self.read(owner, flash, room)
            && let Some(memory) = room.counting()
        {
            memory.counts.restart();
        }
    }

    /// Begins to count, from what was kept where there is something: whether there was.
    #[inline(never)]
    fn read<F: NorFlash, const R: usize, const L: usize>(
        &mut self,
        owner: Owner,
        flash: &mut F,
        room: &mut Room<R, L>,
    ) -> bool {
        let Some(memory) = room.counts() else {
            return false;
        };
        // The image was checked: it counts no more loads than the board has memory for.
        if memory.begin(&owner.counted).is_err() {
            return false;
        }
        let mut keeper = CountKeeper::open(flash, self.layout, owner);
        let is_kept = keeper.load(flash, memory);
        if !is_kept && memory.begin(&keeper.owner().counted).is_err() {
            return false;
        }
        self.keeper = Some(keeper);
        self.since = 0;
        is_kept
    }

    /// Takes a sample. While an image has the room, samples are missing.
    pub fn count<const R: usize, const L: usize>(
        &mut self,
        sample: &CountSample,
        room: &mut Room<R, L>,
    ) {
        if self.keeper.is_none() {
            return;
        }
        let Some(memory) = room.counting() else {
            return;
        };
        let missing = self
            .next_tick
            .map_or(0, |next| sample.tick.wrapping_sub(next));
        // Repeated, or late.
        if missing > u32::MAX / 2 {
            return;
        }
        memory.counts.push(sample, missing);
        self.next_tick = Some(sample.tick.wrapping_add(1));
        self.since = self.since.saturating_add(1);
    }

    /// Does the next piece of work. Gives whether the room is free for an image, where one `needs`
    /// it: its counts are kept then.
    // Inlined, its temporaries would stay on the stack while images are checked.
    #[inline(never)]
    pub fn poll<F: NorFlash, const R: usize, const L: usize>(
        &mut self,
        needs: bool,
        flash: &mut F,
        room: &mut Room<R, L>,
    ) -> bool {
        let Some(keeper) = &mut self.keeper else {
            return true;
        };
        if !needs && self.making_way == MakingWay::Done {
            self.making_way = MakingWay::No;
            // The image is gone or installed: what was kept is read again.
            let owner = keeper.owner().clone();
            self.keeper = None;
            self.read(owner, flash, room);
            return false;
        }
        if self.making_way == MakingWay::Done {
            return true;
        }
        let Some(memory) = room.counting() else {
            return true;
        };
        let is_busy = keeper.is_busy();
        if is_busy {
            keeper.poll(flash, memory);
        }
        self.making_way = match self.making_way {
            _ if !needs => {
                if !is_busy && self.since as f32 >= INTERVAL_S * keeper.owner().rate_hz {
                    self.since = 0;
                    keeper.begin(memory);
                }
                MakingWay::No
            }
            MakingWay::No if is_busy => MakingWay::No,
            MakingWay::No => {
                keeper.begin(memory);
                MakingWay::Keeping(0)
            }
            MakingWay::Keeping(work) if is_busy && work < MOST_WORK => MakingWay::Keeping(work + 1),
            _ => MakingWay::Done,
        };
        self.making_way == MakingWay::Done
    }
}
