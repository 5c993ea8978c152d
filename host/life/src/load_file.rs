//! Reads load samples from a file of estimates or a recording with measured loads, and counts their
//! cycles (`LoadFile::count`): valid samples with standard deviation, gaps, and the advance of the
//! shafts (2^-32 turn) from the speed.

use std::f64::consts::TAU;
use std::path::Path;

use loadtwin_common::counting::SHAFTS;
use loadtwin_common::io::fault::Fault;
use loadtwin_recording::{Block, Reader, Unit, Wanted};

use crate::file_layout::layout;
use crate::{CountedLoad, LoadFileError, LoadSample, Loads};

/// The loads in a file and how many samples they take.
pub struct LoadFile<'a> {
    path: &'a Path,
    loads: &'a Loads,
    reader: Reader,
    /// Below 2^-32 turn, for each shaft.
    below: [f64; SHAFTS],
}

/// Columns of each load: itself, its fault, its standard deviation.
const COLUMNS: usize = 3;

/// Load `k` of sample `i` as the board counts it, where it is valid.
fn valid(block: &Block, k: usize, i: usize) -> Option<LoadSample> {
    let value = |column: usize| {
        let values = block.columns.get(COLUMNS * k + column)?.as_ref()?;
        values.get(i).copied()
    };
    let is_valid = value(1).is_none_or(|fault| fault == f64::from(Fault::None as u8));
    let load = value(0)? as f32;
    (is_valid && load.is_finite()).then(|| LoadSample {
        load,
        std: value(2).filter(|std| std.is_finite() && *std >= 0.0),
    })
}

/// What a file has next.
pub(crate) enum Sample<'a> {
    /// A sample: each load where it is valid, and the advance of each shaft (2^-32 turn).
    Taken(&'a [Option<LoadSample>], [u32; SHAFTS]),
    /// Samples that were never taken.
    Gap(u64),
}

impl<'a> LoadFile<'a> {
    /// Opens a file.
    ///
    /// # Errors
    /// When it cannot be read or lacks a column.
    pub fn open(path: &'a Path, loads: &'a Loads) -> Result<Self, LoadFileError> {
        let beside: Vec<[String; 2]> = (loads.loads.iter())
            .map(|(name, _)| ["fault", "std"].map(|what| format!("{name}_{what}")))
            .collect();
        let mut wanted = Vec::new();
        for ((name, unit), [fault, std]) in loads.loads.iter().zip(&beside) {
            wanted.push(Wanted {
                name,
                unit: *unit,
                required: true,
            });
            wanted.push(Wanted {
                name: fault,
                unit: Unit::ONE,
                required: false,
            });
            wanted.push(Wanted {
                name: std,
                unit: *unit,
                required: false,
            });
        }
        if let Some(name) = &loads.speed {
            wanted.push(Wanted {
                name,
                unit: Unit::RADIAN_PER_SECOND,
                required: true,
            });
        }
        Ok(Self {
            reader: Reader::open(path, &layout(), &wanted)?,
            path,
            loads,
            below: [0.0; SHAFTS],
        })
    }

    /// Time from sample to sample (s).
    pub fn period_s(&self) -> f64 {
        self.reader.period_s()
    }

    /// Counts all samples, each load in its own counts.
    ///
    /// # Errors
    /// When the file cannot be read, or a shaft turns too fast to be counted.
    pub fn count(self, counts: &mut [CountedLoad]) -> Result<(), LoadFileError> {
        self.each(|sample| {
            for (k, counts) in counts.iter_mut().enumerate() {
                match sample {
                    Sample::Taken(loads, advance) => counts.push(loads[k], *advance),
                    Sample::Gap(samples) => counts.gap(*samples),
                }
            }
        })?;
        counts.iter_mut().for_each(CountedLoad::end);
        Ok(())
    }

    /// Gives all that the file has, in its order.
    pub(crate) fn each(mut self, mut take: impl FnMut(&Sample)) -> Result<(), LoadFileError> {
        let mut loads = vec![None; self.loads.loads.len()];
        let mut missing = 0_u64;
        while let Some(block) = self.reader.next() {
            let block = block?;
            let mut bridged = block.bridged.iter().copied().peekable();
            for i in 0..block.len() {
                if bridged.next_if_eq(&i).is_some() {
                    missing += 1;
                    continue;
                }
                if missing > 0 {
                    take(&Sample::Gap(missing));
                    missing = 0;
                }
                let advance = self.advance(&block, i)?;
                for (k, load) in loads.iter_mut().enumerate() {
                    *load = valid(&block, k, i);
                }
                take(&Sample::Taken(&loads, advance));
            }
        }
        if missing > 0 {
            take(&Sample::Gap(missing));
        }
        Ok(())
    }

    /// By how much each shaft turned up to sample `i` (2^-32 turn).
    fn advance(&mut self, block: &Block, i: usize) -> Result<[u32; SHAFTS], LoadFileError> {
        let speed = (block.columns.get(COLUMNS * self.loads.loads.len()))
            .and_then(|column| column.as_ref())
            .map(|column| column[i])
            .filter(|speed| speed.is_finite());
        let Some(speed) = speed else {
            return Ok([0; SHAFTS]);
        };
        let turns = speed.abs() * self.reader.period_s() / TAU;
        let mut advance = [0; SHAFTS];
        for ((advance, below), ratio) in advance
            .iter_mut()
            .zip(&mut self.below)
            .zip([1.0, self.loads.ratio])
        {
            let turns = turns * ratio;
            if turns >= 1.0 {
                return Err(LoadFileError::Fast {
                    file: self.path.into(),
                    turns,
                });
            }
            let parts = turns * 4_294_967_296.0 + *below;
            *advance = parts as u32;
            *below = parts - f64::from(*advance);
        }
        Ok(advance)
    }
}
