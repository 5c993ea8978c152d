//! Counts of all counted loads of a machine (`MachineCounts`), sample by sample; ticks that are
//! left out count as a gap.

use heapless::Vec;

use super::counted_load::{CountSample, CountedLoad};
use super::load_counts::LoadCounts;
use crate::Error;

/// Counts of up to `L` loads.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineCounts<const L: usize> {
    loads: Vec<LoadCounts, L>,
    ratios: Vec<f32, L>,
}

impl<const L: usize> MachineCounts<L> {
    /// Nothing counted yet.
    ///
    /// # Errors
    /// `Error::OutOfRange` for more than `L` loads; as [`CountedLoad::check`].
    pub fn try_new(counted: &[CountedLoad]) -> Result<Self, Error> {
        let mut counts = Self::none();
        counts.begin(counted)?;
        Ok(counts)
    }

    /// No loads.
    pub const fn none() -> Self {
        Self {
            loads: Vec::new(),
            ratios: Vec::new(),
        }
    }

    /// Begins with nothing counted, in place: counts are large.
    ///
    /// # Errors
    /// As [`Self::try_new`].
    // Inlined, its temporaries would stay on the stack.
    #[inline(never)]
    pub fn begin(&mut self, counted: &[CountedLoad]) -> Result<(), Error> {
        self.loads.clear();
        self.ratios.clear();
        for counted in counted {
            let is_full = self.loads.push(counted.empty()?).is_err()
                || self.ratios.push(counted.ratio).is_err();
            if is_full {
                return Err(Error::OutOfRange("counted loads"));
            }
        }
        Ok(())
    }

    /// Takes a sample, and the number of those that are missing before it.
    pub fn push(&mut self, sample: &CountSample, missing: u32) {
        for ((counts, ratio), load) in self.loads.iter_mut().zip(&self.ratios).zip(sample.loads) {
            if missing > 0 {
                counts.gap(missing.into());
            }
            // Beyond 32 bits the cast stays at the largest number.
            let own = (sample.advance as f32 * ratio) as u32;
            counts.push(Some(load), [own, sample.advance]);
        }
    }

    /// Counts a restart.
    pub fn restart(&mut self) {
        for counts in &mut self.loads {
            counts.restart();
        }
    }

    /// The counts of each load, in the order of the image.
    pub fn loads(&self) -> &[LoadCounts] {
        &self.loads
    }

    /// The same, to change them.
    pub fn loads_mut(&mut self) -> &mut [LoadCounts] {
        &mut self.loads
    }
}
