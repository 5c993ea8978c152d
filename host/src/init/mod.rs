//! Generates the draft of a machine description for `loadtwin init`, from the sensors of a board
//! (`draft_for_board`) or from a recording (`draft`):
//! classifies the columns, chooses the kind of machine, writes the TOML text, and checks that it
//! loads.
//!
//! Columns are described by their kind; what a recording does not show stands below a line
//! `# TO FILL IN: ...` with a value that is allowed. The description is valid as it is.

mod bearing;
mod board;
mod column_kind;
mod column_statistics;
mod drive;
mod drivetrain;
mod head;
mod rotor;
mod sensor_tables;
mod toml_text;

use std::path::Path;

use clap::ValueEnum;
use loadtwin_common::bearing::GAUGES;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Machine, MachineError};
use loadtwin_recording::{RecordingError, Survey, survey};
use loadtwin_replay::{ReplayError, Samples};
use thiserror::Error;

pub use board::draft_for_board;
pub use column_kind::{ClassifiedColumn, ColumnKind};
pub use toml_text::MARK;

use toml_text::Text;

/// The kind of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MachineKind {
    /// A gearbox or another torsional drivetrain with gauges.
    Drivetrain,
    /// A flexible rotor with displacement sensors.
    Rotor,
    /// A wheel bearing with four gauges.
    Bearing,
    /// A drive without gauges.
    Drive,
}

/// Why there is no description.
#[derive(Debug, Error)]
pub enum InitError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The recording lacks what the kind needs.
    #[error("{file}: {found}; allowed: {allowed}")]
    Columns {
        /// The recording.
        file: String,
        /// What it has.
        found: String,
        /// What is needed.
        allowed: &'static str,
    },
    /// The text that was written is no description.
    #[error(transparent)]
    Machine(#[from] Box<MachineError>),
    /// The text cannot be checked.
    #[error("{0}")]
    Io(#[from] std::io::Error),
}

/// A description that was begun.
#[derive(Debug)]
pub struct Draft {
    /// The description.
    pub text: String,
    /// The kind of machine.
    pub kind: MachineKind,
    /// Places to fill in.
    pub marks: usize,
    /// The recording.
    pub survey: Survey,
    /// Its columns.
    pub columns: Vec<ClassifiedColumn>,
}

/// Begins a description of the machine whose recording is in `path`; `kind`: by the columns where
/// none.
///
/// # Errors
/// When the recording cannot be read, or lacks the columns of the kind.
pub fn draft(path: &Path, kind: Option<MachineKind>) -> Result<Draft, InitError> {
    let mut survey = survey(path)?;
    let columns = std::mem::take(&mut survey.columns);
    let mut columns: Vec<ClassifiedColumn> =
        columns.into_iter().map(ClassifiedColumn::new).collect();
    loop {
        let (kind, text, marks) = written(path, &survey, &columns, kind)?;
        let machine = checked(&text)?;
        // What the reader of recordings finds to be no index pulse is none.
        let is_no_index = Sensors::choose(&machine, None).is_ok_and(|sensors| {
            matches!(
                Samples::open(&machine, &sensors, path),
                Err(ReplayError::Index(_))
            )
        });
        let index = columns
            .iter_mut()
            .find(|column| column.kind == ColumnKind::Index);
        match index.filter(|_| is_no_index) {
            Some(index) => index.kind = ColumnKind::Other,
            None => {
                return Ok(Draft {
                    text,
                    kind,
                    marks,
                    survey,
                    columns,
                });
            }
        }
    }
}

fn written(
    path: &Path,
    survey: &Survey,
    columns: &[ClassifiedColumn],
    kind: Option<MachineKind>,
) -> Result<(MachineKind, String, usize), InitError> {
    let is_stated = kind.is_some();
    let kind = kind.unwrap_or_else(|| kind_of(columns));
    let source = Source {
        path,
        survey,
        columns,
    };
    let mut text = Text::default();
    source.head(&mut text, kind, is_stated);
    match kind {
        MachineKind::Drivetrain => source.drivetrain(&mut text),
        MachineKind::Rotor => source.rotor(&mut text)?,
        MachineKind::Bearing => source.bearing(&mut text)?,
        MachineKind::Drive => source.drive(&mut text)?,
    }
    source.recording(&mut text);
    let (text, marks) = text.finish();
    Ok((kind, text, marks))
}

/// What a description is begun from.
struct Source<'a> {
    path: &'a Path,
    survey: &'a Survey,
    columns: &'a [ClassifiedColumn],
}

impl<'a> Source<'a> {
    fn of_kind(&self, kinds: &[ColumnKind]) -> Vec<&'a ClassifiedColumn> {
        self.columns
            .iter()
            .filter(|column| column.is(kinds))
            .collect()
    }

    fn refused(&self, allowed: &'static str) -> InitError {
        let names: Vec<_> = self
            .columns
            .iter()
            .map(|column| column.name.as_str())
            .collect();
        InitError::Columns {
            file: self.path.display().to_string(),
            found: format!("found the columns {}", names.join(", ")),
            allowed,
        }
    }
}

/// Gauges make a drivetrain, with forces beside four of them a wheel bearing; displacements without
/// a drive a rotor; all else is a drive.
fn kind_of(columns: &[ClassifiedColumn]) -> MachineKind {
    let count = |kinds: &[ColumnKind]| columns.iter().filter(|column| column.is(kinds)).count();
    let strains = count(&[ColumnKind::Strain, ColumnKind::BridgeRatio]);
    let gauges = strains + count(&[ColumnKind::Words]);
    let lengths = count(&[ColumnKind::Length]);
    let drives = count(&[ColumnKind::Current, ColumnKind::Voltage, ColumnKind::Torque]);
    if count(&[ColumnKind::Force]) > 0 && strains == GAUGES {
        MachineKind::Bearing
    } else if gauges > 0 && (strains > 0 || drives == 0 || gauges > drives) {
        MachineKind::Drivetrain
    } else if lengths > 1 && drives == 0 && count(&[ColumnKind::Force]) != 1 {
        MachineKind::Rotor
    } else {
        MachineKind::Drive
    }
}

/// The machine that the text describes, by the same checks as any other.
fn checked(text: &str) -> Result<Machine, InitError> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, text)?;
    Machine::load(&path).map_err(|error| InitError::Machine(Box::new(error)))
}
