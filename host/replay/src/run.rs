//! Replays one recording through the estimator, block by block (`Run`). Its state can be saved, and
//! the replay of the next recording continued from it, with the estimates of one uninterrupted
//! replay.

use loadtwin_common::estimator::{Estimator, MAX_STATE_BYTES};
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_recording::Input;
use serde::{Deserialize, Serialize};

use super::lag_buffer::{DelayedSample, LagBuffer};
use super::samples::SavedSamples;
use super::{ReplayError, Sample, Samples};

/// First bytes of a saved state: name and version of its layout.
pub const STATE_MARK: &[u8] = b"loadtwin state 1\n";

/// No saved state is larger (bytes).
pub const LARGEST_STATE: u64 = 1 << 20;

const CRC: crc::Crc<u32, crc::Table<1>> =
    crc::Crc::<u32, crc::Table<1>>::new(&crc::CRC_32_ISO_HDLC);

/// Why there is no state.
const RESAMPLED: &str = "a replay whose rows are resampled (`timing = \"resample\"` under \
    [recording], or a [balance] of regime \"steady\") has no state: its last ticks wait for \
    rows after them; allowed: `timing = \"clocked\"`";

/// The estimator of a machine on a recording.
///
/// ```no_run
/// # use loadtwin_design::image_build::{self, Sensors};
/// # use loadtwin_replay::Run;
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let machine = loadtwin_machine::Machine::load("machine.toml".as_ref())?;
/// let sensors = Sensors::choose(&machine, None)?;
/// let image = image_build::image(&machine, &sensors)?;
/// let mut monday = Run::open(&machine, &sensors, &image, "monday.parquet")?;
/// while monday.next_block(|sample, estimate, _| println!("{} {estimate:?}", sample.t))? {}
/// let state = monday.save()?;
/// let mut tuesday = Run::continued(&machine, &sensors, &image, "tuesday.parquet", &state)?;
/// while tuesday.next_block(|sample, estimate, _| println!("{} {estimate:?}", sample.t))? {}
/// # Ok(())
/// # }
/// ```
pub struct Run<'a> {
    image: &'a [u8],
    line: LagBuffer<'a>,
    samples: Samples,
}

/// What a saved state holds beside mark and checksum.
#[derive(Serialize, Deserialize)]
struct State {
    line: Vec<u8>,
    samples: SavedSamples,
    held: Vec<DelayedSample>,
}

fn line(image: &[u8]) -> Result<Estimator<'_>, ReplayError> {
    let parsed = Image::from_bytes(image).map_err(ReplayError::Image)?;
    Estimator::try_build(parsed).map_err(ReplayError::Image)
}

impl<'a> Run<'a> {
    /// Opens a recording for `machine` with `sensors`, of which `image` was built.
    ///
    /// # Errors
    /// When machine, image or recording cannot be used.
    pub fn open<'i>(
        machine: &Machine,
        sensors: &Sensors,
        image: &'a [u8],
        input: impl Into<Input<'i>>,
    ) -> Result<Self, ReplayError> {
        Ok(Self {
            image,
            line: LagBuffer::new(line(image)?),
            samples: Samples::open(machine, sensors, input)?,
        })
    }

    /// As [`Self::open`], where the recording goes on from that of which `state` was saved.
    ///
    /// # Errors
    /// As [`Self::open`]; when `state` is none, is damaged, or is of another image; when rows are resampled.
    pub fn continued<'i>(
        machine: &Machine,
        sensors: &Sensors,
        image: &'a [u8],
        input: impl Into<Input<'i>>,
        state: &[u8],
    ) -> Result<Self, ReplayError> {
        let state = State::from_bytes(state)?;
        let mut line = line(image)?;
        line.restore(image, &state.line)
            .map_err(|error| ReplayError::State(refusal(error)))?;
        let samples = Samples::continued(machine, sensors, input.into(), state.samples)?;
        if samples.saved().is_none() {
            return Err(ReplayError::State(RESAMPLED));
        }
        Ok(Self {
            image,
            line: LagBuffer::continued(line, state.held, samples.tick()),
            samples,
        })
    }

    /// Part of the recording that was read so far, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.samples.progress()
    }

    /// What was recognised, joined, resampled or rounded to read the recording so far, one line
    /// each.
    pub fn notes(&self) -> Vec<String> {
        self.samples.notes()
    }

    /// Gives the samples of the next block and their estimates to `each`, with the estimator after
    /// its step; false at the end. Where estimates lag, a sample is given when its estimate is
    /// there.
    ///
    /// # Errors
    /// When the recording is not what it should be further on.
    pub fn next_block(
        &mut self,
        mut each: impl FnMut(&Sample<'_>, &Estimate, &Estimator<'_>),
    ) -> Result<bool, ReplayError> {
        let line = &mut self.line;
        (self.samples).next_block(|sample| line.push(sample, &mut each))
    }

    /// Whether estimates come some samples after their sample.
    pub fn lags(&self) -> bool {
        self.line.line().lag_samples() > 0
    }

    /// The state after the last block, with which another recording goes on to the bit. The
    /// samples that await their estimate are in it.
    ///
    /// # Errors
    /// When rows are brought onto ticks: the last ones wait for rows after them.
    pub fn save(&self) -> Result<Vec<u8>, ReplayError> {
        let samples = self.samples.saved();
        let samples = samples.ok_or(ReplayError::State(RESAMPLED))?;
        let mut line = vec![0; MAX_STATE_BYTES];
        let saved = self.line.line().save(self.image, &mut line);
        line.truncate(saved.map_err(ReplayError::Image)?);
        let state = State {
            line,
            samples,
            held: self.line.held().cloned().collect(),
        };
        let mut bytes = STATE_MARK.to_vec();
        let body = postcard::to_stdvec(&state);
        bytes.extend(body.map_err(|_| ReplayError::State("the state cannot be written"))?);
        bytes.extend(CRC.checksum(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// Shows the samples that still await their estimate, after which nothing is read.
    pub fn finish(self, each: impl FnMut(&Sample<'_>, &Estimate, &Estimator<'_>)) {
        self.line.finish(each);
    }
}

impl State {
    fn from_bytes(bytes: &[u8]) -> Result<Self, ReplayError> {
        const MALFORMED: &str = "no saved state of a replay, or damaged; allowed: a whole one, as \
            this version of loadtwin wrote it";
        let malformed = || ReplayError::State(MALFORMED);
        let (body, crc) = bytes.split_last_chunk::<4>().ok_or_else(malformed)?;
        if CRC.checksum(body) != u32::from_le_bytes(*crc) {
            return Err(malformed());
        }
        let body = body.strip_prefix(STATE_MARK).ok_or_else(malformed)?;
        match postcard::take_from_bytes(body) {
            Ok((state, [])) => Ok(state),
            _ => Err(malformed()),
        }
    }
}

/// Why the estimator does not take a state.
fn refusal(error: loadtwin_common::Error) -> &'static str {
    match error {
        loadtwin_common::Error::Malformed("image of the saved state") => {
            "the state was saved by another model: another description, set of sensors or filter, or \
             one that was changed since; allowed: the one that it was saved with"
        }
        loadtwin_common::Error::Malformed("version of the saved state") => {
            "the state is of another version of loadtwin; replay the recording before it again"
        }
        _ => "the state is damaged; replay the recording before it again",
    }
}
