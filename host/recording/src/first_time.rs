//! Reads the time of the first row of a recording in s (`first_time`). By it a recording is placed
//! after another one, before either is read.

use super::column_selection::Selection;
use super::error::{Problem, RecordingError};
use super::reader::read_rows;
use super::recording_layout::CsvLayout;
use super::row_source::{Input, Opened, Source};

/// Time of the first row (s); none where there is no row.
///
/// # Errors
/// [`RecordingError`] when the file cannot be read, or its first rows have no usable time.
pub fn first_time<'a>(
    input: impl Into<Input<'a>>,
    layout: &CsvLayout,
) -> Result<Option<f64>, RecordingError> {
    let input = input.into();
    let first = || -> Result<Option<f64>, Problem> {
        let opened = Opened::open(input, layout, &[])?;
        let selection = Selection::try_new(&opened.columns, &[], &[], layout)
            .map_err(|problem| opened.format.explained(problem, &opened.columns))?;
        let source = Source::start(opened.format, selection.picks.clone())?;
        let rows = read_rows(&source, &selection, 0, &mut None)?;
        Ok(rows.t().first().copied())
    };
    first().map_err(|problem| input.error(problem))
}
