//! Calibrates a drivetrain (`loadtwin calibrate`): fits offset, sensitivity over the carrier angle,
//! noise and faults of each channel to recordings with reference loads.
//!
//! Reads recordings in two passes, the motion first and then the readings,
//! and keeps sums over the carrier angle instead of samples.

mod calibrated_machine;
mod channel_moments;
mod description_edits;
mod fit_inputs;
mod gauge_fault;
mod gauge_selection;
mod map_placement;
mod map_selection;
mod measurement_noise;
mod recorded_motion;
mod report_page;
mod surface_fit;
mod torque_balance;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use thiserror::Error;

pub use crate::calibrate::calibrated_machine::{calibrated, maps_beside, with_noise};
pub use crate::calibrate::channel_moments::{BINS, Moments, Sums};
pub use crate::calibrate::description_edits::{Description, DescriptionError, map_file};
pub use crate::calibrate::gauge_fault::GaugeFault;
pub use crate::calibrate::gauge_selection::{Candidate, fronts, select};
pub use crate::calibrate::map_placement::{Placement, fine};
pub use crate::calibrate::map_selection::MapSource;
pub use crate::calibrate::recorded_motion::Motion;
pub use crate::calibrate::report_page::{Proposal, page};
pub use crate::calibrate::surface_fit::Surface;
pub use crate::calibrate::torque_balance::TorqueBalance;
pub use measurement_noise::{MeasurementNoise, NOISE_BINS, measure_noise, rms, step_function};

use self::fit_inputs::FitInputs;
use loadtwin_machine::{Channel, Encoding, Machine, MachineError, Senses};
use loadtwin_recording::{Column, Reader, RecordingError, Wanted, columns};
use loadtwin_replay::ReplayError;

/// Least standard deviation of what a gauge senses, as part of its root mean
/// square, from which offset and sensitivity are separable.
const LEAST_VARIATION: f64 = 0.05;

/// Why nothing can be calibrated.
#[derive(Debug, Error)]
pub enum CalibrateError {
    /// The machine is none whose gauges are over a carrier angle.
    #[error(
        "the machine has no [drivetrain]; allowed: a drivetrain, for calibrate also a bearing, for tune also a rotor"
    )]
    NoDrivetrain,
    /// A file cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The recording cannot be used.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The recording does not say enough.
    #[error("{}: {reason}", recording.display())]
    TooLittle {
        /// The recording.
        recording: PathBuf,
        /// What it lacks and what is needed.
        reason: String,
    },
    /// The description cannot be written.
    #[error(transparent)]
    Description(#[from] DescriptionError),
}

/// What the recordings say about the channels of a machine.
pub struct Observations {
    /// Sums of each channel, in the order of the machine; none for a channel
    /// that measures no load, or for one that has no reference.
    pub channels: Vec<Option<Moments>>,
    /// The same of the even and of the odd turns of the carrier.
    pub turn_parity: Vec<Option<[Moments; 2]>>,
    /// Balance of all loads, for the references and the counting direction of the encoder.
    pub balance: TorqueBalance,
    /// Samples read.
    pub samples: u64,
    /// Turns of the carrier that were used.
    pub turns: f64,
}

impl Observations {
    /// Reads `recordings`; reports the part done, 0 to 1.
    ///
    /// # Errors
    /// When a recording cannot be read, has no reference load, or its index
    /// pulse never came.
    pub fn read(
        machine: &Machine,
        recordings: &[PathBuf],
        progress: impl FnMut(f64),
    ) -> Result<Self, CalibrateError> {
        Self::read_part(machine, recordings, 1.0, progress)
    }

    /// As [`Observations::read`], of the first `part` of each recording, 0 to 1.
    ///
    /// # Errors
    /// As [`Observations::read`].
    pub fn read_part(
        machine: &Machine,
        recordings: &[PathBuf],
        part: f64,
        mut progress: impl FnMut(f64),
    ) -> Result<Self, CalibrateError> {
        let mut all = Self {
            channels: machine.channels.iter().map(|_| None).collect(),
            turn_parity: machine.channels.iter().map(|_| None).collect(),
            balance: TorqueBalance::default(),
            samples: 0,
            turns: 0.0,
        };
        for (i, recording) in recordings.iter().enumerate() {
            let done = |part: f64| (i as f64 + part) / recordings.len() as f64;
            let mut motion = Motion::read(machine, recording, |part| progress(done(0.3 * part)))?;
            motion.use_first(part);
            if !motion.homed() {
                return Err(CalibrateError::TooLittle {
                    recording: recording.clone(),
                    reason:
                        "the index pulse never came: less than one turn of the carrier, or no pulse"
                            .into(),
                });
            }
            all.balance.add(machine, &motion);
            all.add(machine, recording, &motion, |part| {
                progress(done(0.3 + 0.7 * part));
            })?;
        }
        Ok(all)
    }

    fn add(
        &mut self,
        machine: &Machine,
        recording: &Path,
        motion: &Motion,
        mut progress: impl FnMut(f64),
    ) -> Result<(), CalibrateError> {
        let mut known: Vec<(&Senses, Option<Vec<f64>>)> = Vec::new();
        for channel in &machine.channels {
            if !known.iter().any(|(senses, _)| *senses == &channel.senses) {
                known.push((&channel.senses, motion.sensed(machine, &channel.senses)));
            }
        }
        if known.iter().all(|(_, sensed)| sensed.is_none()) {
            let columns: Vec<&str> = machine.references.iter().map(|r| r.name.as_str()).collect();
            return Err(CalibrateError::TooLittle {
                recording: recording.to_owned(),
                reason: format!(
                    "no reference load for any channel: the columns [{}] are absent, or have no value at its \
                     samples",
                    columns.join(", ")
                ),
            });
        }
        let sensed = |channel: &Channel| {
            known
                .iter()
                .find(|(senses, _)| *senses == &channel.senses)?
                .1
                .as_deref()
        };
        let angles: Vec<f64> = (0..motion.len())
            .map(|i| motion.angle(i).unwrap_or(f64::NAN))
            .collect();
        let warming = warming(machine, recording)?;
        let mut jobs: Vec<Reading<'_>> = machine
            .channels
            .iter()
            .zip(self.channels.iter_mut().zip(&mut self.turn_parity))
            .filter_map(|(channel, (slot, turn_parity))| {
                let sensed = sensed(channel)?;
                let inputs = FitInputs::new(machine, channel, &angles, sensed, warming.as_deref());
                Some(Reading {
                    channel,
                    moments: slot.get_or_insert_default(),
                    turn_parity: turn_parity.get_or_insert_default(),
                    inputs,
                })
            })
            .collect();
        let mut reader = open(machine, recording, jobs.iter().map(|job| job.channel))?;
        let encodings: Vec<Encoding> = jobs
            .iter()
            .map(|job| Encoding::of(job.channel, reader.columns()))
            .collect();
        let mut row = 0;
        while let Some(block) = reader.next().transpose()? {
            jobs.par_iter_mut()
                .zip(&encodings)
                .zip(&block.columns)
                .for_each(|((job, encoding), column)| {
                    if let Some(column) = column {
                        job.push(column, *encoding, row, machine.rate_hz);
                    }
                });
            row += block.len();
            progress(reader.progress());
        }
        self.samples += row as u64;
        let used = || angles.iter().filter(|angle| angle.is_finite());
        if let (Some(first), Some(last)) = (used().next(), used().next_back()) {
            self.turns += (last - first).abs() / std::f64::consts::TAU;
        }
        Ok(())
    }
}

/// A channel while a recording is read.
struct Reading<'a> {
    channel: &'a Channel,
    moments: &'a mut Moments,
    turn_parity: &'a mut [Moments; 2],
    inputs: FitInputs<'a>,
}

impl Reading<'_> {
    /// Adds the values of a block, whose first one is sample `row`.
    fn push(&mut self, column: &[f64], encoding: Encoding, row: usize, rate_hz: f64) {
        let (channel, inputs) = (self.channel, &self.inputs);
        let stuck_after = match channel.stuck_after() {
            0 => (gauge_fault::STUCK_AFTER_S * rate_hz) as u32,
            words => u32::from(words),
        };
        for (i, value) in column.iter().enumerate() {
            let y = encoding.reading(channel, *value);
            self.moments.watch(y, stuck_after);
            let k = row + i;
            if !y.is_nan() && k < inputs.angle.len() {
                let (angle, bent) = (inputs.angle[k], inputs.bent[k]);
                let y = y - inputs.zero[k];
                self.moments.push(angle, bent, y);
                let turn = (angle / std::f64::consts::TAU).floor();
                self.turn_parity[usize::from(turn.rem_euclid(2.0) == 1.0)].push(angle, bent, y);
            }
        }
    }
}

/// Temperature rise of each sample of `recording` above the reference temperature [K]; none where
/// no gauge responds to it, or no temperature was recorded.
fn warming(machine: &Machine, recording: &Path) -> Result<Option<Vec<f64>>, CalibrateError> {
    let Some(thermometer) = machine.thermometer() else {
        return Ok(None);
    };
    if machine.channels.iter().all(|c| c.thermal.is_none()) {
        return Ok(None);
    }
    // Beside a gauge: a thermometer may have a rate of its own.
    let layout = &machine.recording;
    let names: Vec<_> = (machine.channels.iter())
        .map(|c| (c.name.as_str(), true))
        .collect();
    let found = columns(recording, layout, &names)?;
    let is_there = |channel: &&Channel| found.iter().any(|column| column.name == channel.name);
    let gauge = machine.channels.iter().find(is_there);
    let mut wanted: Vec<Wanted<'_>> = gauge.map(|g| as_written(g, &found)).into_iter().collect();
    wanted.push(Wanted {
        name: &thermometer.name,
        unit: thermometer.unit.si(),
        required: false,
    });
    let mut temperatures = Vec::new();
    let reader = Reader::open(recording, layout, &wanted)?.expect_period(1.0 / machine.rate_hz)?;
    for block in reader {
        let mut block = block?;
        let Some(column) = block.columns.pop().flatten() else {
            return Ok(None);
        };
        temperatures.extend(column);
    }
    Ok(Some(
        thermometer.warming(&temperatures, 1.0 / machine.rate_hz),
    ))
}

/// A channel as a recording of the columns `found` has it.
fn as_written<'a>(channel: &'a Channel, found: &[Column]) -> Wanted<'a> {
    Wanted {
        name: &channel.name,
        unit: Encoding::of(channel, found).unit(channel),
        required: true,
    }
}

/// Opens `recording` for `channels`, each as the file has it.
fn open<'a>(
    machine: &Machine,
    recording: &Path,
    channels: impl Iterator<Item = &'a Channel>,
) -> Result<Reader, CalibrateError> {
    let channels: Vec<&Channel> = channels.collect();
    let names: Vec<_> = channels.iter().map(|c| (c.name.as_str(), true)).collect();
    let found = columns(recording, &machine.recording, &names)?;
    let wanted: Vec<Wanted<'_>> = channels
        .iter()
        .map(|channel| as_written(channel, &found))
        .collect();
    Ok(Reader::open(recording, &machine.recording, &wanted)?
        .expect_period(1.0 / machine.rate_hz)?)
}

/// What a calibration found of one channel; readings in SI.
pub struct Gauge {
    /// Number of the channel in the machine.
    pub channel: usize,
    /// The surface fit of its readings, where there is one.
    pub surface: Option<Surface>,
    /// Its updated model.
    pub placement: Option<Placement>,
    /// Its noise about the model that was asked for.
    pub noise: Option<MeasurementNoise>,
    /// What is wrong with it.
    pub fault: Option<GaugeFault>,
    /// The source with the smaller error on turns of the carrier that it was not fitted to.
    pub best: MapSource,
}

/// Fits every channel of `machine` to its observations.
///
/// `patch_rad`: how far from its described angle a gauge may sit, > 0.
///
/// # Errors
/// When the recordings have too little torque variation or do not cover a
/// turn of the carrier, or a map cannot be read.
pub fn calibrate(
    machine: &Machine,
    observations: &Observations,
    recording: &Path,
    patch_rad: f64,
    source: MapSource,
) -> Result<Vec<Gauge>, CalibrateError> {
    let refused = |reason: String| CalibrateError::TooLittle {
        recording: recording.to_owned(),
        reason,
    };
    let mut jobs = Vec::new();
    for (i, (channel, moments)) in machine
        .channels
        .iter()
        .zip(&observations.channels)
        .enumerate()
    {
        let Some(moments) = moments else { continue };
        // Of a constant speed a tachometer keeps its data sheet's response.
        if channel.speed_of().is_some() && variation(moments) < LEAST_VARIATION {
            continue;
        }
        jobs.push((
            i,
            channel,
            moments,
            channel.sensitivity_over_angle(machine)?,
            channel.candidates_over_angle(machine)?,
        ));
    }
    for (_, channel, moments, map, _) in &jobs {
        check_observed(channel, moments, map).map_err(refused)?;
    }
    let mut gauges: Vec<Gauge> = jobs
        .par_iter()
        .map(|(i, channel, moments, map, patch)| {
            let described = channel.to_si(channel.offset);
            let surface = Surface::fit(moments, map.len() > 1);
            let placement = Placement::fit(moments, map, patch, described, patch_rad);
            let fault = gauge_fault::of_gauge(
                moments,
                observations.samples,
                placement.as_ref().map(|p| p.gain),
                surface.as_ref().map(|s| s.adjusted_r2),
            );
            let mut gauge = Gauge {
                channel: *i,
                surface,
                placement,
                noise: None,
                fault,
                best: match &observations.turn_parity[*i] {
                    Some(halves) => map_selection::best(halves, map, patch, described, patch_rad),
                    None => MapSource::Placed,
                },
            };
            gauge.noise = gauge.model(source).map(|(offset, map)| {
                MeasurementNoise::new(
                    moments,
                    offset,
                    map,
                    channel.lsb_si().abs() / 12.0_f64.sqrt(),
                )
            });
            gauge
        })
        .collect();
    name_swapped(machine, &jobs, &mut gauges);
    Ok(gauges)
}

/// Part by which what a channel senses varies, of its root mean square.
fn variation(moments: &Moments) -> f64 {
    let total = moments.total();
    let mean_square = total.ss / total.n;
    (1.0 - (total.s / total.n).powi(2) / mean_square)
        .max(0.0)
        .sqrt()
}

/// Refuses a channel whose load does not vary, or of which part of the turn was not observed.
fn check_observed(channel: &Channel, moments: &Moments, map: &[f64]) -> Result<(), String> {
    let total = moments.total();
    if total.n == 0.0 {
        return Ok(());
    }
    if map.len() > 1 && moments.coverage() < 1.0 {
        return Err(format!(
            "the carrier covered {:.0} % of a turn (channel {}); at least one full turn is needed",
            100.0 * moments.coverage(),
            channel.name
        ));
    }
    let variation = variation(moments);
    if variation < LEAST_VARIATION {
        return Err(format!(
            "what channel {} senses varies by {:.1} % of its root mean square; at least {:.0} % is needed to tell offset from sensitivity: add a recording with torque ramps",
            channel.name,
            100.0 * variation,
            100.0 * LEAST_VARIATION
        ));
    }
    Ok(())
}

impl Gauge {
    /// Where the map of `asked` comes from.
    pub fn source(&self, asked: MapSource) -> MapSource {
        match asked {
            MapSource::Best => self.best,
            given => given,
        }
    }

    /// Offset and sensitivity over the angle of the calibrated model.
    pub fn model(&self, source: MapSource) -> Option<(f64, &[f64])> {
        match self.source(source) {
            MapSource::Placed | MapSource::Best => self
                .placement
                .as_ref()
                .map(|p| (p.offset, p.map.as_slice())),
            MapSource::Measured => self.surface.as_ref().map(|s| (s.offset, s.map.as_slice())),
        }
    }
}

type Patch = Vec<(String, Vec<f64>)>;
type Job<'a> = (usize, &'a Channel, &'a Moments, Vec<f64>, Patch);

/// Looks for swapped gauges among those of one group that sense the same.
fn name_swapped(machine: &Machine, jobs: &[Job<'_>], gauges: &mut [Gauge]) {
    let kin =
        |a: &Channel, b: &Channel| a.senses == b.senses && a.group == b.group && a.unit == b.unit;
    for first in 0..jobs.len() {
        let channel = jobs[first].1;
        if jobs[..first].iter().any(|job| kin(job.1, channel)) {
            continue;
        }
        let group: Vec<usize> = (first..jobs.len())
            .filter(|&j| kin(jobs[j].1, channel) && jobs[j].2.total().n > 0.0)
            .collect();
        let readings: Vec<(&Moments, &[f64])> = group
            .iter()
            .map(|&j| (jobs[j].2, jobs[j].3.as_slice()))
            .collect();
        for (a, b) in gauge_fault::swapped(&readings) {
            for (one, other) in [(group[a], group[b]), (group[b], group[a])] {
                let name = machine.channels[jobs[other].0].name.clone();
                gauges[one].fault = Some(GaugeFault::SwappedWith(name));
            }
        }
    }
}
