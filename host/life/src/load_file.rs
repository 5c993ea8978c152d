//! Loads of a file: estimates, or a recording with measured loads.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use loadtwin_common::counting::{LoadCounts, SHAFTS};
use loadtwin_common::io::fault::Fault;
use loadtwin_recording::{
    Block, CsvLayout, Reader, RecordingError, Unit, Wanted, WrittenNan, columns,
};
use thiserror::Error;

/// Samples in a row that a file may lack; they are counted as missing. A file
/// with a longer gap is to be split there.
const LARGEST_GAP: u32 = 1_000_000;

/// Why the loads of a file cannot be counted; one line.
#[derive(Debug, Error)]
pub enum LoadFileError {
    /// The file cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// It has no column with a fault beside it.
    #[error(
        "{}: no column NAME with NAME_std and NAME_fault, as estimates have; name a column to count with --load", .0.display()
    )]
    NoLoad(PathBuf),
    /// A column without a unit, or with an unknown one.
    #[error("{}: column {name:?} has no unit that is known; write it as `{name} [Nm]`", file.display())]
    Unit {
        /// The file.
        file: PathBuf,
        /// The column.
        name: String,
    },
    /// A column that is not there.
    #[error("{}: no column {name:?}; found: {found}", file.display())]
    Missing {
        /// The file.
        file: PathBuf,
        /// The column.
        name: String,
        /// The columns that are there.
        found: String,
    },
    /// A speed by which the advance from sample to sample is not known.
    #[error(
        "{}: shaft turns {turns:.2} times between two samples; allowed: less than 1; check --speed and --ratio", file.display()
    )]
    Fast {
        /// The file.
        file: PathBuf,
        /// Turns from sample to sample.
        turns: f64,
    },
}

/// Which loads of a file, and the speed beside them.
#[derive(Clone, Debug, PartialEq)]
pub struct Loads {
    /// Names and units.
    pub loads: Vec<(String, Unit)>,
    /// Column of the shaft's speed.
    pub speed: Option<String>,
    /// Turns of the second shaft for one of the first.
    pub ratio: f64,
}

/// The loads in a file and how many samples they take.
pub struct LoadFile<'a> {
    path: &'a Path,
    loads: &'a Loads,
    reader: Reader,
    /// Below 2^-32 turn, for each shaft.
    below: [f64; SHAFTS],
}

fn layout() -> CsvLayout {
    CsvLayout {
        written_nan: WrittenNan::Missing,
        largest_gap: LARGEST_GAP,
        ..CsvLayout::default()
    }
}

impl Loads {
    /// The columns `names` of a file; where none are given, those with a
    /// standard deviation and a fault beside them.
    ///
    /// # Errors
    /// When the file cannot be read, or has no such column or no unit of it.
    pub fn find(
        path: &Path,
        names: &[String],
        speed: Option<&str>,
        ratio: f64,
    ) -> Result<Self, LoadFileError> {
        let columns = columns(path, &layout(), &[])?;
        let has = |name: &str| columns.iter().any(|column| column.name == name);
        let estimated =
            |name: &String| has(&format!("{name}_std")) && has(&format!("{name}_fault"));
        let names: Vec<String> = if names.is_empty() {
            columns
                .iter()
                .map(|c| c.name.clone())
                .filter(estimated)
                .collect()
        } else {
            names.to_vec()
        };
        if names.is_empty() {
            return Err(LoadFileError::NoLoad(path.into()));
        }
        let unit = |name: String| {
            let column = columns.iter().find(|column| column.name == name);
            let Some(column) = column else {
                let found: Vec<_> = columns.iter().take(20).map(|c| c.name.as_str()).collect();
                let found = found.join(", ");
                return Err(LoadFileError::Missing {
                    file: path.into(),
                    name,
                    found,
                });
            };
            match column.unit.as_deref().map(str::parse::<Unit>) {
                Some(Ok(unit)) => Ok((name, unit.si())),
                _ => Err(LoadFileError::Unit {
                    file: path.into(),
                    name,
                }),
            }
        };
        Ok(Self {
            loads: names.into_iter().map(unit).collect::<Result<_, _>>()?,
            speed: speed.map(Into::into),
            ratio,
        })
    }

    /// Lowest and highest valid value of each load in a file; none where no sample is valid.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn extremes(&self, path: &Path) -> Result<Vec<Option<[f32; 2]>>, LoadFileError> {
        let mut found: Vec<Option<[f32; 2]>> = vec![None; self.loads.len()];
        let file = LoadFile::open(path, self)?;
        for block in file.reader {
            let block = block?;
            for (k, found) in found.iter_mut().enumerate() {
                for value in (0..block.len()).filter_map(|i| valid(&block, k, i)) {
                    let [low, high] = found.unwrap_or([value; 2]);
                    *found = Some([low.min(value), high.max(value)]);
                }
            }
        }
        Ok(found)
    }
}

/// Load `k` of sample `i` as the board counts it, where it is valid.
fn valid(block: &Block, k: usize, i: usize) -> Option<f32> {
    let value = |column: usize| block.columns.get(column)?.as_ref().map(|values| values[i]);
    let fault = value(2 * k + 1);
    let is_valid = fault.is_none_or(|fault| fault == f64::from(Fault::None as u8));
    let load = value(2 * k)? as f32;
    (is_valid && load.is_finite()).then_some(load)
}

fn gap(counts: &mut [LoadCounts], samples: u64) {
    for counts in counts {
        counts.gap(samples);
    }
}

impl<'a> LoadFile<'a> {
    /// Opens a file.
    ///
    /// # Errors
    /// When it cannot be read or lacks a column.
    pub fn open(path: &'a Path, loads: &'a Loads) -> Result<Self, LoadFileError> {
        let faults: Vec<String> = loads
            .loads
            .iter()
            .map(|(name, _)| format!("{name}_fault"))
            .collect();
        let mut wanted = Vec::new();
        for ((name, unit), fault) in loads.loads.iter().zip(&faults) {
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
    pub fn count(mut self, counts: &mut [LoadCounts]) -> Result<(), LoadFileError> {
        while let Some(block) = self.reader.next() {
            let block = block?;
            let mut bridged = block.bridged.iter().copied().peekable();
            let mut missing = 0_u64;
            for i in 0..block.len() {
                if bridged.next_if_eq(&i).is_some() {
                    missing += 1;
                    continue;
                }
                if missing > 0 {
                    gap(counts, missing);
                    missing = 0;
                }
                let advance = self.advance(&block, i)?;
                for (k, counts) in counts.iter_mut().enumerate() {
                    counts.push(valid(&block, k, i), advance);
                }
            }
            if missing > 0 {
                gap(counts, missing);
            }
        }
        Ok(())
    }

    /// By how much each shaft turned up to sample `i` [2^-32 turn].
    fn advance(&mut self, block: &Block, i: usize) -> Result<[u32; SHAFTS], LoadFileError> {
        let speed = (block.columns.get(2 * self.loads.loads.len()))
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
