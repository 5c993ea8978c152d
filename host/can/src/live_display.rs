//! Collects what a command on the bus shows while it runs (`Page`: loads, sensors, status, verdict,
//! counts), and shows it through the trait `View`: nothing (`Quiet`) or one line a second
//! (`Lines`). `live` chooses these lines or the full-screen view of `terminal_view.rs`.

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::ops::ControlFlow;
use std::time::Duration;

use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::frame::{LoadFrame, SensorFrame, Status};

use super::Model;
use super::frame_comparison::Verdict;
use super::terminal_view::Screen;

/// One load.
#[derive(Clone, Debug, Default)]
pub struct LoadRow {
    /// Its name.
    pub name: String,
    /// The load at the end of its scale (N m or N; 100 where the load is in %).
    pub full_scale: f64,
    /// Value (N m, N or %).
    pub value: Option<f64>,
    /// Standard deviation, in the unit of the value.
    pub std: Option<f64>,
    /// Why it is not to be trusted.
    pub fault: Fault,
}

/// One sensor.
#[derive(Clone, Copy, Debug, Default)]
pub struct SensorRow {
    /// Normalised innovation squared.
    pub nis: Option<f32>,
    /// Why it was not used.
    pub fault: Fault,
}

/// What there is to see.
#[derive(Clone, Debug)]
pub struct Page {
    /// The command.
    pub title: &'static str,
    /// The machine.
    pub machine: String,
    /// Loads.
    pub loads: Vec<LoadRow>,
    /// Sensors.
    pub sensors: Vec<SensorRow>,
    /// The machine's own status.
    pub status: Option<Status>,
    /// What the comparison says.
    pub verdict: Option<Verdict>,
    /// Counts, each with its name.
    pub counts: Vec<(&'static str, u64)>,
    /// Time from a raw sample to the frames made from it, mean and largest (ms).
    pub lag_ms: Option<(f64, f64)>,
    /// Anything else.
    pub note: Option<String>,
}

impl Page {
    /// An empty page of the command `title`.
    pub fn new(title: &'static str, model: &Model<'_>) -> Self {
        let loads = model.image.loads().iter().map(|load| LoadRow {
            name: load.name.as_str().to_owned(),
            full_scale: load.full_scale.into(),
            ..LoadRow::default()
        });
        Self {
            loads: loads.collect(),
            machine: model.image.machine.to_owned(),
            ..Self::empty(title)
        }
    }

    /// An empty page where the model is not known.
    pub fn empty(title: &'static str) -> Self {
        Self {
            title,
            machine: String::new(),
            loads: Vec::new(),
            sensors: Vec::new(),
            status: None,
            verdict: None,
            counts: Vec::new(),
            lag_ms: None,
            note: None,
        }
    }

    /// Shows the loads and sensors of `estimate`.
    pub fn estimate(&mut self, estimate: &Estimate) {
        for (row, load) in self.loads.iter_mut().zip(&estimate.loads) {
            row.value = Some(load.value.into());
            row.std = Some(load.std.into());
            row.fault = load.fault;
        }
        self.sensors
            .resize(estimate.sensors.len(), SensorRow::default());
        for (row, sensor) in self.sensors.iter_mut().zip(&estimate.sensors) {
            *row = SensorRow {
                nis: Some(sensor.nis),
                fault: sensor.fault,
            };
        }
    }

    /// Shows a load as it came over the bus; in % of full scale where its scale is not known.
    pub fn load(&mut self, index: usize, frame: &LoadFrame) {
        while self.loads.len() <= index {
            let name = format!("load {} [%]", self.loads.len() + 1);
            self.loads.push(LoadRow {
                name,
                full_scale: 100.0,
                ..LoadRow::default()
            });
        }
        let row = &mut self.loads[index];
        row.value = frame.value(row.full_scale);
        row.std = frame.std(row.full_scale);
        row.fault = frame.fault;
    }

    /// Shows a sensor as it came over the bus.
    pub fn sensor(&mut self, index: usize, frame: &SensorFrame) {
        if self.sensors.len() <= index {
            self.sensors.resize(index + 1, SensorRow::default());
        }
        self.sensors[index] = SensorRow {
            nis: frame.nis(),
            fault: frame.fault,
        };
    }

    /// Shows the machine's status.
    pub fn status(&mut self, status: Option<Status>) {
        self.status = status;
    }

    /// Shows the verdict of the comparison.
    pub fn verdict(&mut self, verdict: Verdict) {
        self.verdict = Some(verdict);
    }

    /// Shows a count.
    pub fn count(&mut self, name: &'static str, count: u64) {
        match self.counts.iter_mut().find(|(found, _)| *found == name) {
            Some(found) => found.1 = count,
            None => self.counts.push((name, count)),
        }
    }

    /// Shows the time from a raw sample to the frames made from it, mean and largest (ms).
    pub fn lag(&mut self, mean: f64, most: f64) {
        self.lag_ms = Some((mean, most));
    }

    /// Shows a line of text.
    pub fn note(&mut self, note: String) {
        self.note = Some(note);
    }
}

/// One line: what `Lines` prints once a second.
impl fmt::Display for Page {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.title)?;
        if let Some(verdict) = self.verdict {
            write!(f, " {verdict:?}")?;
        }
        if let Some(status) = self.status {
            write!(f, " [{}]", status.state.name())?;
        }
        for load in &self.loads {
            match (load.value, load.std) {
                (Some(value), Some(std)) => write!(f, "  {} {value:.1} +- {std:.1}", load.name)?,
                _ => write!(f, "  {} --", load.name)?,
            }
            if !load.fault.is_none() {
                write!(f, " ({})", load.fault.name())?;
            }
        }
        for (name, count) in &self.counts {
            write!(f, "  {name} {count}")?;
        }
        if let Some((mean, most)) = self.lag_ms {
            write!(f, "  lag {mean:.1} ms (most {most:.1})")?;
        }
        match &self.note {
            Some(note) => write!(f, "  {note}"),
            None => Ok(()),
        }
    }
}

/// Where pages are shown.
pub trait View {
    /// Whether it is time for the next page.
    fn due(&mut self, now: Duration) -> bool;

    /// Takes the values of a page that has just changed: a view that shows less often than they
    /// come may keep the least and the largest.
    fn take(&mut self, _page: &Page) {}

    /// Shows a page; breaks when the user wants to end.
    ///
    /// # Errors
    /// When it cannot be written.
    fn show(&mut self, page: &Page) -> io::Result<ControlFlow<()>>;
}

/// Shows nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quiet;

impl View for Quiet {
    fn due(&mut self, _now: Duration) -> bool {
        false
    }

    fn show(&mut self, _page: &Page) -> io::Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }
}

/// Due after equal times.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    period: Duration,
    last: Option<Duration>,
}

impl Clock {
    pub(super) fn new(period: Duration) -> Self {
        Self { period, last: None }
    }

    pub(super) fn due(&mut self, now: Duration) -> bool {
        // From the first call on, so that nothing is shown before there is anything.
        let last = *self.last.get_or_insert(now);
        let due = now.saturating_sub(last) >= self.period;
        if due {
            self.last = Some(now);
        }
        due
    }
}

/// One line a second.
#[derive(Debug)]
pub struct Lines<W> {
    to: W,
    clock: Clock,
}

impl<W: Write> Lines<W> {
    /// Onto `to`.
    pub fn new(to: W) -> Self {
        Self {
            to,
            clock: Clock::new(Duration::from_secs(1)),
        }
    }
}

impl<W: Write> View for Lines<W> {
    fn due(&mut self, now: Duration) -> bool {
        self.clock.due(now)
    }

    fn show(&mut self, page: &Page) -> io::Result<ControlFlow<()>> {
        writeln!(self.to, "{page}")?;
        Ok(ControlFlow::Continue(()))
    }
}

/// A page in the terminal where standard error is one; a line a second on
/// standard error where it is not.
///
/// # Errors
/// When the terminal cannot be set up.
pub fn live() -> io::Result<Box<dyn View>> {
    if io::stderr().is_terminal() && io::stdin().is_terminal() {
        Ok(Box::new(Screen::new()?))
    } else {
        Ok(Box::new(Lines::new(io::stderr())))
    }
}
