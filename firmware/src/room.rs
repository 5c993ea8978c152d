//! Memory that counts and images share (`Room`): loads are counted in it while no image is on its way.

use crate::counts::CountMemory;

/// Room for an image of `R` bytes, or for the counts of `L` loads.
///
/// A board has memory for one of them at a time: an image on its way needs the room for seconds,
/// once in a while, and the counts are in flash meanwhile.
#[derive(Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "both fill the memory, and there is no heap"
)]
pub enum Room<const R: usize, const L: usize> {
    /// Holds an image while it is checked and installed.
    Image([u8; R]),
    /// Holds the counts.
    Counts(CountMemory<L>),
}

impl<const R: usize, const L: usize> Room<R, L> {
    /// Room for an image.
    pub const fn new() -> Self {
        Self::Image([0; R])
    }

    /// The room for an image; what was counted is gone.
    // Inlined, its temporaries would stay on the stack while the image is checked.
    #[inline(never)]
    pub fn image(&mut self) -> &mut [u8] {
        if matches!(self, Self::Counts(_)) {
            *self = Self::Image([0; R]);
        }
        match self {
            Self::Image(bytes) => bytes,
            Self::Counts(_) => &mut [],
        }
    }

    /// The room for counts, of no loads where it was that of an image.
    #[inline(never)]
    pub fn counts(&mut self) -> Option<&mut CountMemory<L>> {
        if matches!(self, Self::Image(_)) {
            *self = Self::Counts(CountMemory::none());
        }
        self.counting()
    }

    /// The counts, where there are any.
    pub fn counting(&mut self) -> Option<&mut CountMemory<L>> {
        match self {
            Self::Counts(memory) => Some(memory),
            Self::Image(_) => None,
        }
    }
}

impl<const R: usize, const L: usize> Default for Room<R, L> {
    fn default() -> Self {
        Self::new()
    }
}
