//! Replays the recordings of one day of a machine in the order of their names: writes the estimates
//! of each to Parquet, counts load cycles, and gives the day's row (`Day`) and the state after it.
//! For each recording it decides whether the estimator continues from the state before, or begins
//! anew as time goes back, the gap is too long or the state does not fit.

use std::fs;
use std::path::Path;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_recording::{BLOCK_ROWS, Input, RecordingError, Writer, first_time};
use loadtwin_replay::{EstimateRows, Run, Sample, Sums, has_state};

use crate::carried_state::CarriedState;
use crate::day::{Day, DaySums, RecordingOfDay};
use crate::described_machine::Described;
use crate::description_table::Entry;
use crate::error::message;
use crate::layout::Recording;
use crate::load_counting::{LoadCounting, damage_of, empty_counts};
use crate::options::{Columns, Options};
use crate::verdict::Verdict;
use crate::{ArchiveError, Watch};

/// Range of the counts to either side of 0 where none is given (nominal loads).
const NOMINAL_LOADS: f64 = 1.5;

/// Part of a period by which a gap of whole periods may be off.
const HALF: f64 = 0.5;

/// Columns of the estimates that a load has: value, standard deviation, fault.
const COLUMNS_OF_LOAD: usize = 3;

/// Why a recording has no estimates.
enum Failure {
    /// The recording; the others go on.
    Fault(String),
    /// The results cannot be written, or the run was stopped.
    Ends(ArchiveError),
}

impl From<ArchiveError> for Failure {
    fn from(error: ArchiveError) -> Self {
        Self::Ends(error)
    }
}

fn fault(error: impl std::error::Error) -> Failure {
    Failure::Fault(message(&error))
}

/// Replay of the recordings of a day.
pub(crate) struct DayReplay<'a> {
    pub(crate) entry: &'a Entry,
    pub(crate) described: &'a Described,
    pub(crate) options: &'a Options,
    /// Folder of the estimates of the day.
    pub(crate) folder: &'a Path,
    /// State before the day; after [`Self::run`], that after it.
    pub(crate) carried: CarriedState,
    pub(crate) watch: &'a Watch,
}

impl DayReplay<'_> {
    /// Replays the recordings in their order; one that cannot be replayed is left out. The hashes
    /// of the day are empty.
    ///
    /// # Errors
    /// [`ArchiveError`] when estimates cannot be written, or the run was stopped.
    pub(crate) fn run(&mut self, recordings: &[Recording]) -> Result<Day, ArchiveError> {
        let sha256 = &self.described.sha256;
        if self.carried.description_sha256 != *sha256 {
            self.carried.estimator = None;
            self.carried.description_sha256.clone_from(sha256);
        }
        let begun = self.begin_counts();
        let mut sums = DaySums::default();
        let rows = recordings.iter().map(|of| self.recording(of, &mut sums));
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        let damage = begun.and_then(|()| self.damage());
        let fault = damage.as_ref().err().cloned();
        for load in &mut sums.loads {
            if Some(&load.name) == self.entry.load.as_ref() {
                load.damage = damage.clone().ok().flatten();
            }
        }
        Ok(Day {
            verdict: Verdict::of(&sums),
            sums,
            recordings: rows,
            fault,
            name: Some(self.described.machine.name.clone()),
            description: Some(self.entry.path.clone()),
            description_sha256: Some(sha256.clone()),
            loadtwin: env!("CARGO_PKG_VERSION").to_owned(),
            made_from: String::new(),
            state_sha256: String::new(),
        })
    }

    /// Begins counts of the load that is to be counted, where they are not begun.
    fn begin_counts(&mut self) -> Result<(), String> {
        let Some(name) = &self.entry.load else {
            return Ok(());
        };
        if self.carried.counts.contains_key(name) {
            return Ok(());
        }
        let loads = self.described.machine.loads();
        let nominal = loads.iter().find(|load| load.name == name);
        let limit = nominal.map_or(0.0, |load| NOMINAL_LOADS * load.nominal);
        let counts = empty_counts(name, self.entry.range.unwrap_or((-limit, limit)))?;
        self.carried.counts.insert(name.clone(), counts);
        Ok(())
    }

    fn damage(&self) -> Result<Option<f64>, String> {
        let Some(load) = self
            .entry
            .load
            .as_ref()
            .filter(|_| !self.entry.sn.is_empty())
        else {
            return Ok(None);
        };
        let counts = self.carried.counts.get(load);
        let counts = counts.ok_or_else(|| format!("damage: no counts of {load}"))?;
        let damage = damage_of(load, counts, &self.entry.sn);
        damage.map(Some).map_err(|error| format!("damage: {error}"))
    }

    fn recording(
        &mut self,
        recording: &Recording,
        sums: &mut DaySums,
    ) -> Result<RecordingOfDay, ArchiveError> {
        let mut row = RecordingOfDay {
            name: recording.name.clone(),
            ..RecordingOfDay::default()
        };
        match self.try_recording(recording, &mut row) {
            Ok(of) => {
                row.samples = of.samples;
                sums.add(of);
            }
            Err(Failure::Fault(fault)) => row.fault = Some(fault),
            Err(Failure::Ends(error)) => return Err(error),
        }
        Ok(row)
    }

    fn try_recording(
        &mut self,
        recording: &Recording,
        row: &mut RecordingOfDay,
    ) -> Result<DaySums, Failure> {
        let (state, why) = self.state_for(recording)?;
        row.notes.extend(why);
        let Some(state) = state else {
            return self.replay(recording, None, row);
        };
        match self.replay(recording, Some(&state), row) {
            Ok(sums) => {
                row.continued = true;
                Ok(sums)
            }
            Err(Failure::Fault(error)) => {
                // What no state goes on to may be a recording of its own.
                let sums = self.replay(recording, None, row)?;
                row.notes.insert(0, format!("began anew: {error}"));
                Ok(sums)
            }
            Err(ends) => Err(ends),
        }
    }

    /// The state that goes on with a recording, or why there is none.
    fn state_for(
        &self,
        recording: &Recording,
    ) -> Result<(Option<Vec<u8>>, Option<String>), Failure> {
        let (Some(state), Some(end_s)) = (&self.carried.estimator, self.carried.end_s) else {
            return Ok((None, None));
        };
        let machine = &self.described.machine;
        let begin_s = first_time(Input::Archived(&recording.path), &machine.recording);
        let Some(begin_s) = begin_s.map_err(fault)? else {
            return Ok((None, None));
        };
        if begin_s <= end_s {
            let why =
                format!("began anew: its time begins at {begin_s:?} s, not after {end_s:?} s");
            return Ok((None, Some(why)));
        }
        let missing = (begin_s - end_s) * machine.rate_hz - 1.0;
        if missing > f64::from(machine.recording.largest_gap) + HALF {
            let gap_s = begin_s - end_s;
            let why = format!("began anew: {gap_s:.3} s after the recording before");
            return Ok((None, Some(why)));
        }
        Ok((Some(state.clone()), None))
    }

    fn replay(
        &mut self,
        recording: &Recording,
        state: Option<&[u8]>,
        row: &mut RecordingOfDay,
    ) -> Result<DaySums, Failure> {
        let Described {
            machine,
            sensors,
            image,
            ..
        } = self.described;
        let input = Input::Archived(&recording.path);
        let run = match state {
            Some(state) => Run::continued(machine, sensors, image, input, state),
            None => Run::open(machine, sensors, image, input),
        };
        let mut run = run.map_err(fault)?;
        let counting = LoadCounting::continued(machine, &self.carried.counts, state.is_none());
        let mut gathered = Gathered {
            estimates: Estimates::begin(self, recording)?,
            sums: Sums::new(machine, sensors),
            counting: counting.map_err(Failure::Fault)?,
        };
        while run
            .next_block(|sample, estimate, line| gathered.push(sample, estimate, line))
            .map_err(fault)?
        {
            self.watch.check()?;
            gathered.estimates.flush(BLOCK_ROWS)?;
        }
        let notes = run.notes();
        let estimator = if has_state(machine) {
            // The samples whose estimates lag come with the next recording.
            Some(run.save().map_err(fault)?)
        } else {
            run.finish(|sample, estimate, line| gathered.push(sample, estimate, line));
            None
        };
        gathered.estimates.finish()?;
        let sums = gathered.sums.report();
        let counts = gathered.counting.save().map_err(Failure::Fault)?;
        self.carried.counts.extend(counts);
        self.carried.estimator = estimator;
        self.carried.end_s = sums.span_s.map(|[_, end_s]| end_s).or(self.carried.end_s);
        row.notes.extend(notes);
        Ok(sums.into())
    }
}

/// What a replay gives, row by row.
struct Gathered<'a> {
    estimates: Estimates<'a>,
    sums: Sums,
    counting: LoadCounting,
}

impl Gathered<'_> {
    fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate, line: &Estimator<'_>) {
        self.estimates.rows.push(sample.t, estimate, line);
        self.sums.push(sample.t, estimate);
        self.counting.push(estimate);
    }
}

/// The file with the estimates of a recording, while it is written.
struct Estimates<'a> {
    rows: EstimateRows,
    /// Columns that are kept, besides the time.
    kept: usize,
    writer: Writer,
    folder: &'a Path,
}

impl<'a> Estimates<'a> {
    fn begin(day: &DayReplay<'a>, recording: &Recording) -> Result<Self, ArchiveError> {
        let machine = &day.described.machine;
        let rows = EstimateRows::new(machine, &day.described.sensors, None);
        let kept = match day.options.columns {
            Columns::All => rows.described().len(),
            Columns::Loads => COLUMNS_OF_LOAD * machine.loads().len(),
        };
        fs::create_dir_all(day.folder).map_err(ArchiveError::io(day.folder))?;
        let path = day.folder.join(&recording.name);
        let about = [("machine", machine.name.as_str())];
        let writer = Writer::create(&path, &rows.described()[..kept], &about);
        Ok(Self {
            writer: writer.map_err(|error| unwritable(day.folder, &error))?,
            rows,
            kept,
            folder: day.folder,
        })
    }

    /// Writes what was gathered, where it is as many `rows`.
    fn flush(&mut self, rows: usize) -> Result<(), ArchiveError> {
        if self.rows.len() < rows.max(1) {
            return Ok(());
        }
        let (writer, kept) = (&mut self.writer, self.kept);
        let written = (self.rows).take(|_, t, columns| writer.write(t, &columns[..kept]));
        written.map_err(|error| unwritable(self.folder, &error))
    }

    fn finish(mut self) -> Result<(), ArchiveError> {
        self.flush(1)?;
        let finished = self.writer.finish();
        finished.map_err(|error| unwritable(self.folder, &error))
    }
}

fn unwritable(folder: &Path, error: &RecordingError) -> ArchiveError {
    ArchiveError::unwritable(folder, error)
}
