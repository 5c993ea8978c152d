//! Opens a recording from a file or an Arrow stream (`Input`), by the first bytes as CSV, Parquet
//! or MDF4, and decodes its rows on another thread, two blocks ahead of the caller (`Source`). A
//! format that is not read, and a panic of a decoder, is an error.
use std::cell::Cell;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Once};

use super::arrow::{ArrowStream, Batches, Since};
use super::channel_names::named;
use super::csv::Csv;
use super::error::{Problem, RecordingError, Row};
use super::foreign_formats::{HEAD, recognise};
use super::mdf::Mdf;
use super::parquet::Parquet;
use super::recording_layout::{Column, CsvLayout};
use super::table_writer::SIMULATED;
use super::{BLOCK_ROWS, clipped, shown};
use loadtwin_files::file_kind::Existing;

/// Blocks decoded ahead of the caller.
const AHEAD: usize = 2;

/// Rows as a format reads them: the time first, then each column once.
pub(super) struct Rows {
    pub(super) columns: Vec<Vec<f64>>,
    /// Line of each row in a text file; else empty.
    pub(super) lines: Vec<u64>,
}

impl Rows {
    /// Index of the time among the columns.
    pub(super) const TIME: usize = 0;

    pub(super) fn with_columns(count: usize) -> Self {
        Self {
            columns: vec![Vec::with_capacity(BLOCK_ROWS); count],
            lines: Vec::new(),
        }
    }

    pub(super) fn t(&self) -> &[f64] {
        &self.columns[Self::TIME]
    }

    /// Place of row `i`, where `before` rows came before this block.
    pub(super) fn place(&self, before: u64, i: usize) -> Row {
        Row {
            row: before + i as u64 + 1,
            line: self.lines.get(i).copied(),
        }
    }
}

/// Where a recording is.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// In a file.
    File(&'a Path),
    /// In a file of an archive: a time of timestamps is in seconds since 1970 (UTC), so that
    /// recordings follow one another.
    Archived(&'a Path),
    /// In memory, or in a stream that is read once.
    Batches(&'a Batches),
}

impl<'a> Input<'a> {
    /// What it is called in messages.
    pub fn name(self) -> &'a Path {
        match self {
            Self::File(path) | Self::Archived(path) => path,
            Self::Batches(_) => Path::new("table"),
        }
    }

    /// The first `rows` rows of a stream, or somewhat more, which stay unread; none of a file,
    /// which can be opened again.
    ///
    /// # Errors
    /// When the stream cannot be read.
    pub fn head(self, rows: usize) -> Result<Option<Batches>, RecordingError> {
        match self {
            Self::File(_) | Self::Archived(_) => Ok(None),
            Self::Batches(batches) => {
                let head = batches.head(rows).map_err(|problem| self.error(problem))?;
                Ok(Some(head))
            }
        }
    }

    pub(super) fn error(self, problem: Problem) -> RecordingError {
        RecordingError {
            file: self.name().to_path_buf(),
            problem,
        }
    }
}

impl<'a, P: AsRef<Path> + ?Sized> From<&'a P> for Input<'a> {
    fn from(path: &'a P) -> Self {
        Self::File(path.as_ref())
    }
}

/// A recording of a known format, opened.
pub(super) enum Format {
    Csv(Csv),
    Parquet(Parquet),
    Mdf(Box<Mdf>),
    Arrow(ArrowStream),
}

/// A recording of a known format, opened, and its columns by the names of channels.
pub(super) struct Opened {
    pub(super) format: Format,
    pub(super) columns: Vec<Column>,
    /// What the reader of the recording should know, one line each.
    pub(super) notes: Vec<String>,
}

impl Opened {
    pub(super) fn open(
        input: Input<'_>,
        layout: &CsvLayout,
        wanted: &[(&str, bool)],
    ) -> Result<Self, Problem> {
        let simulated;
        let layout = match input {
            Input::File(path) | Input::Archived(path) if is_simulated_text(path) => {
                simulated = layout.of_simulated();
                &simulated
            }
            _ => layout,
        };
        let format = match input {
            Input::File(path) => Format::open(path, layout, wanted)?,
            Input::Archived(path) => Format::open_since(path, layout, wanted, Since::Epoch)?,
            Input::Batches(batches) => Format::Arrow(ArrowStream::open(batches, layout)),
        };
        let notes = match &format {
            Format::Csv(csv) => csv.note().into_iter().collect(),
            Format::Parquet(_) | Format::Arrow(_) => Vec::new(),
            Format::Mdf(mdf) => mdf.notes().to_vec(),
        };
        let columns = match &format {
            // Its channels were looked up by the layout.
            Format::Mdf(mdf) => mdf.columns().to_vec(),
            other => named(other.columns(), layout),
        };
        Ok(Self {
            format,
            columns,
            notes,
        })
    }
}

/// Whether `loadtwin simulate` wrote the file as text.
///
/// A stream is not looked into: its bytes come once.
fn is_simulated_text(path: &Path) -> bool {
    let is_file = path.metadata().is_ok_and(|metadata| metadata.is_file());
    let is_text = |file: &Existing| file.start().starts_with(b"# ");
    is_file
        && Existing::open(path)
            .is_ok_and(|mut file| is_text(&file) && (SIMULATED.is_same)(&mut file).unwrap_or(false))
}

/// The columns of a recording, with the units that they are written in.
///
/// `wanted` are the names that will be asked of a [`super::Reader`], and whether
/// each is required: of a file of several groups, those are found in the groups
/// that the reader takes them from.
///
/// # Errors
/// [`RecordingError`] when the file cannot be read, or is no recording.
pub fn columns<'a>(
    input: impl Into<Input<'a>>,
    layout: &CsvLayout,
    wanted: &[(&str, bool)],
) -> Result<Vec<Column>, RecordingError> {
    let input = input.into();
    let opened = Opened::open(input, layout, wanted);
    opened
        .map(|opened| opened.columns)
        .map_err(|problem| input.error(problem))
}

impl Format {
    /// Recognises the format by the first bytes of the file, not by its name.
    pub(super) fn open(
        path: &Path,
        layout: &CsvLayout,
        wanted: &[(&str, bool)],
    ) -> Result<Self, Problem> {
        Self::open_since(path, layout, wanted, Since::First)
    }

    /// As [`Self::open`], with timestamps of Parquet as seconds `since`.
    fn open_since(
        path: &Path,
        layout: &CsvLayout,
        wanted: &[(&str, bool)],
        since: Since,
    ) -> Result<Self, Problem> {
        let file = File::open(path)?;
        // A pipe can be read once: its start is not inspected. Parquet and MDF4 are not read from a
        // pipe.
        let mut start = Vec::new();
        if file.metadata()?.is_file() {
            (&file).take(HEAD as u64).read_to_end(&mut start)?;
            (&file).seek(SeekFrom::Start(0))?;
        }
        if let Some(foreign) = recognise(&start) {
            return Err(Problem::Foreign {
                name: foreign.name,
                remedy: foreign.remedy,
            });
        }
        if start.starts_with(b"PAR1") {
            contained("Parquet", || Parquet::open(file, layout, since)).map(Self::Parquet)
        } else if start.starts_with(b"MDF ") || start.starts_with(b"UnFinMF ") {
            contained("MDF4", || Mdf::open(path, layout, wanted))
                .map(|mdf| Self::Mdf(Box::new(mdf)))
        } else {
            Csv::open(path, layout).map(Self::Csv)
        }
    }

    fn columns(&self) -> &[Column] {
        match self {
            Self::Csv(csv) => csv.columns(),
            Self::Parquet(parquet) => parquet.columns(),
            Self::Mdf(mdf) => mdf.columns(),
            Self::Arrow(stream) => stream.columns(),
        }
    }

    /// `problem`, where a column without a unit is none of numbers: that it holds text. `columns`:
    /// those of the file, as the layout names them.
    pub(super) fn explained(&self, problem: Problem, columns: &[Column]) -> Problem {
        let table = match self {
            Self::Parquet(parquet) => parquet.table(),
            Self::Arrow(stream) => stream.table(),
            Self::Csv(_) | Self::Mdf(_) => return problem,
        };
        let Problem::NoUnit { column, .. } = &problem else {
            return problem;
        };
        let place = columns.iter().position(|c| shown(&c.name) == *column);
        let checked = place.map(|place| table.check_numbers(&[place]));
        match checked {
            Some(Err(not_numeric)) => not_numeric,
            _ => problem,
        }
    }

    /// Names of all columns that it may be asked for.
    pub(super) fn names(&self) -> Result<Vec<String>, Problem> {
        match self {
            Self::Mdf(mdf) => contained("MDF4", || mdf.names()),
            other => Ok(other.columns().iter().map(|c| c.name.clone()).collect()),
        }
    }

    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::Csv(_) => "CSV",
            Self::Parquet(_) => "Parquet",
            Self::Mdf(_) => "MDF4",
            Self::Arrow(_) => "Arrow",
        }
    }

    fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        match self {
            Self::Csv(csv) => csv.run(picks, output),
            Self::Parquet(parquet) => contained("Parquet", || parquet.run(picks, output)),
            Self::Mdf(mdf) => contained("MDF4", || mdf.run(picks, output)),
            Self::Arrow(stream) => contained("Arrow", || stream.run(picks, output)),
        }
    }
}

thread_local! {
    /// Whether a panic of this thread is made an error by `contained`.
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder that is not ours and makes its panic an error: `parquet` 60
/// indexes out of bounds on some damaged pages.
fn contained<T>(
    format: &'static str,
    decode: impl FnOnce() -> Result<T, Problem>,
) -> Result<T, Problem> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !CONTAINED.get() {
                report(panic);
            }
        }));
    });
    CONTAINED.set(true);
    // What the decoder leaves behind is dropped, whatever state it is in.
    let outcome = catch_unwind(AssertUnwindSafe(decode));
    CONTAINED.set(false);
    outcome.unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<String>().map(String::as_str);
        let said = said.or_else(|| panic.downcast_ref::<&str>().copied());
        Err(Problem::Damaged {
            format,
            found: clipped(said.unwrap_or("its decoder gave up").as_bytes(), 160),
        })
    })
}

/// Where a format puts its rows.
pub(super) struct Output {
    rows: SyncSender<Result<Rows, Problem>>,
    progress: Arc<AtomicU64>,
}

impl Output {
    /// Hands rows on; false when nobody wants more.
    pub(super) fn deliver(&self, rows: Rows, progress: f64) -> bool {
        self.progress.store(progress.to_bits(), Ordering::Relaxed);
        self.rows.send(Ok(rows)).is_ok()
    }
}

/// Rows that a thread decodes, block by block.
pub(super) struct Source {
    rows: Receiver<Result<Rows, Problem>>,
    progress: Arc<AtomicU64>,
    format: &'static str,
}

impl Source {
    /// Starts to decode the columns `picks`, the time first.
    pub(super) fn start(format: Format, picks: Vec<usize>) -> Result<Self, Problem> {
        let (sender, rows) = sync_channel(AHEAD);
        let progress = Arc::new(AtomicU64::new(0.0_f64.to_bits()));
        let output = Output {
            rows: sender,
            progress: Arc::clone(&progress),
        };
        let name = format.name();
        // Not joined: it ends by itself once `rows` is dropped.
        std::thread::Builder::new()
            .name("recording".into())
            .spawn(move || {
                // An empty block marks the end: without one the decoder has failed.
                let end = format
                    .run(&picks, &output)
                    .map(|()| Rows::with_columns(picks.len()));
                let _ = output.rows.send(end);
            })?;
        Ok(Self {
            rows,
            progress,
            format: name,
        })
    }

    /// The next rows; none at the end.
    pub(super) fn next(&self) -> Result<Rows, Problem> {
        self.rows.recv().unwrap_or_else(|_| {
            Err(Problem::Damaged {
                format: self.format,
                found: "its decoder gave up".into(),
            })
        })
    }

    pub(super) fn progress(&self) -> f64 {
        f64::from_bits(self.progress.load(Ordering::Relaxed))
    }
}
