//! Arranges raw samples (`SampleRows`) and load frames (`EstimateRows`) of a machine on a bus as
//! rows of columns over time (s), with empty cells for what is missing; counts missing and
//! repeated samples and restarts. Cuts the rows into parts, each for a file: at midnight (UTC),
//! raw samples also at a gap above 1 s or a restart of the machine, and whenever the recorder asks
//! (`take`).

use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::frame::LoadFrame;
use loadtwin_common::io::raw::RawSample;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_recording::{OutputColumn, Unit};

use super::counts::Counts;
use super::part_writer::{Kind, Part};
use super::sample_clock::{SampleClock, Step};

/// Longest gap that is rows with empty cells (s); a longer one begins a new file.
const LONGEST_GAP_S: f64 = 1.0;

/// Length of a day of UTC (s).
const DAY_S: f64 = 86_400.0;

/// Column of ticks.
pub const TICK: &str = "tick";

/// Rows that are not in a part yet.
#[derive(Default)]
struct Rows {
    t: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl Rows {
    fn new(columns: usize) -> Self {
        Self {
            t: Vec::new(),
            columns: vec![Vec::new(); columns],
        }
    }

    fn push(&mut self, t: f64, values: impl IntoIterator<Item = f64>) {
        self.t.push(t);
        for (column, value) in self.columns.iter_mut().zip(values) {
            column.push(value);
        }
    }

    fn take(&mut self) -> (Vec<f64>, Vec<Vec<f64>>) {
        let columns = self.columns.iter_mut().map(std::mem::take).collect();
        (std::mem::take(&mut self.t), columns)
    }

    fn is_of_another_day(&self, t: f64) -> bool {
        let day = |t: f64| (t / DAY_S).floor();
        self.t.first().is_some_and(|first| day(*first) != day(t))
    }
}

/// Raw samples as rows.
pub struct SampleRows {
    rows: Rows,
    channels: usize,
    encoders: usize,
    has_index: bool,
    rate_hz: f64,
    clock: Option<SampleClock>,
    /// Since the last part.
    pub counts: Counts,
}

impl SampleRows {
    /// Columns of the raw samples of `machine`.
    pub fn columns(machine: &Machine, sensors: &Sensors) -> Vec<OutputColumn> {
        let column = |name: &str| OutputColumn {
            name: name.to_owned(),
            unit: Unit::COUNTS,
            single: false,
        };
        (sensors.channels.iter().map(|channel| column(&channel.name)))
            .chain(sensors.encoders.iter().map(|encoder| column(&encoder.name)))
            .chain(machine.index.iter().map(|index| column(&index.name)))
            .chain([column(TICK)])
            .collect()
    }

    /// After the sample of `clock`.
    pub fn new(machine: &Machine, sensors: &Sensors, clock: Option<SampleClock>) -> Self {
        Self {
            rows: Rows::new(Self::columns(machine, sensors).len()),
            channels: sensors.channels.len(),
            encoders: sensors.encoders.len(),
            has_index: machine.index.is_some(),
            rate_hz: machine.rate_hz,
            clock,
            counts: Counts::default(),
        }
    }

    /// Time of the tick closest to the last one whose number is `counter` modulo 256 where every
    /// `2^log2`th tick has a number.
    pub fn time_of(&self, counter: u8, log2: u32) -> Option<f64> {
        let clock = self.clock?;
        let last = clock.tick >> log2;
        let apart = i64::from(counter.wrapping_sub(last as u8) as i8);
        let number = last.saturating_add_signed(apart);
        Some(clock.time_of(number << log2, self.rate_hz))
    }

    /// Takes a sample that came at `now_s`; a part that ends before it goes to `end`.
    pub fn push(&mut self, sample: &RawSample, now_s: f64, end: impl FnOnce(Part)) {
        let before = self.clock;
        let mut clock = before.unwrap_or(SampleClock::new(sample.tick, now_s, self.rate_hz));
        let step = match before {
            Some(_) => clock.follow(sample.tick, now_s, self.rate_hz),
            None => Step::Later(0),
        };
        let missing = match step {
            Step::Repeated => {
                self.counts.samples_repeated += 1;
                return;
            }
            Step::Later(missing) => missing,
            Step::Anew => 0,
        };
        let t = clock.t(self.rate_hz);
        let is_long = missing as f64 > LONGEST_GAP_S * self.rate_hz;
        if step == Step::Anew || is_long || self.rows.is_of_another_day(t) {
            end(self.take());
        } else if !self.rows.t.is_empty() {
            for tick in clock.tick - missing..clock.tick {
                let empty = std::iter::repeat(f64::NAN);
                self.rows.push(clock.time_of(tick, self.rate_hz), empty);
            }
        }
        self.clock = Some(clock);
        self.counts.restarts += u64::from(step == Step::Anew);
        self.counts.samples_missing += missing;
        self.counts.gaps += u64::from(missing > 0);
        self.counts.samples_received += 1;
        let or_empty = |is_there: bool, value: f64| if is_there { value } else { f64::NAN };
        let words =
            (0..self.channels).map(|k| or_empty(sample.has_word(k), sample.words[k].into()));
        let counters =
            (0..self.encoders).map(|k| or_empty(sample.has_encoder(k), sample.encoders[k].into()));
        let index = sample.index.map_or(f64::NAN, f64::from);
        let values = words.chain(counters).chain(self.has_index.then_some(index));
        self.rows.push(t, values.chain([clock.tick as f64]));
    }

    /// The rows so far.
    pub fn take(&mut self) -> Part {
        let counts = std::mem::take(&mut self.counts);
        let (t, columns) = self.rows.take();
        Part {
            kind: Kind::Recordings,
            t,
            columns,
            written: Counts {
                samples_written: counts.samples_received,
                ..counts
            },
            not_written: Counts {
                samples_not_written: counts.samples_received,
                ..counts
            },
            clock: self.clock,
        }
    }
}

/// A load as it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Value (in the load's unit).
    pub value: Option<f64>,
    /// Standard deviation (in the load's unit).
    pub std: Option<f64>,
    /// Why it is not valid.
    pub fault: Fault,
}

impl Load {
    /// From its frame.
    pub fn of(frame: &LoadFrame, full_scale: f64) -> Self {
        Self {
            value: frame.value(full_scale),
            std: frame.std(full_scale),
            fault: frame.fault,
        }
    }
}

/// Estimates as rows: the loads of one sample.
pub struct EstimateRows {
    rows: Rows,
    open: Option<(u8, f64)>,
    loads: Vec<Option<Load>>,
}

impl EstimateRows {
    /// Columns of the loads of `machine`, as `replay --estimates` has them before those of sensors.
    pub fn columns(machine: &Machine) -> Vec<OutputColumn> {
        let column = |name: String, unit| OutputColumn {
            name,
            unit,
            single: true,
        };
        let loads = machine.loads();
        let of_load = loads.iter().flat_map(|load| {
            [
                column(load.name.to_owned(), load.unit),
                column(format!("{}_std", load.name), load.unit),
                column(format!("{}_fault", load.name), Unit::ONE),
            ]
        });
        of_load.collect()
    }

    /// No row yet.
    pub fn new(loads: usize) -> Self {
        Self {
            rows: Rows::new(3 * loads),
            open: None,
            loads: vec![None; loads],
        }
    }

    /// Takes a load with the counter of its frame, of a sample at `t`.
    pub fn push(
        &mut self,
        (index, counter): (usize, u8),
        load: Load,
        t: f64,
        end: impl FnOnce(Part),
    ) {
        let is_next = self.open.is_none_or(|(open, _)| open != counter);
        if is_next {
            self.close();
            if self.rows.is_of_another_day(t) {
                end(self.take());
            }
            self.open = Some((counter, t));
        }
        if let Some(slot) = self.loads.get_mut(index) {
            *slot = Some(load);
        }
    }

    fn close(&mut self) {
        let Some((_, t)) = self.open.take() else {
            return;
        };
        let values = self.loads.iter_mut().map(Option::take).flat_map(|load| {
            let nan = f64::NAN;
            load.map_or([nan; 3], |load| {
                let fault = f64::from(load.fault as u8);
                [load.value.unwrap_or(nan), load.std.unwrap_or(nan), fault]
            })
        });
        let values: Vec<f64> = values.collect();
        self.rows.push(t, values);
    }

    /// The rows so far.
    pub fn take(&mut self) -> Part {
        self.close();
        let (t, columns) = self.rows.take();
        let rows = t.len() as u64;
        Part {
            kind: Kind::Estimates,
            t,
            columns,
            written: Counts {
                estimates_written: rows,
                ..Counts::default()
            },
            not_written: Counts {
                estimates_not_written: rows,
                ..Counts::default()
            },
            clock: None,
        }
    }
}
