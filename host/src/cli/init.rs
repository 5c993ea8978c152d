//! The command `loadtwin init`: has `init` generate the draft of a machine description from a
//! recording or for the channels of a board, writes or prints it, and reports the kind of machine
//! and the number of places to fill in.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use serde_json::json;

use super::build::BoardName;
use super::file_plan::{Plan, Replace};
use super::printing::{note, print, say, shown};
use crate::atomic_file::AtomicFile;
use crate::init::{Draft, MARK, MachineKind, draft, draft_for_board};
use crate::machine::DESCRIPTION;

/// Begin a machine description from a recording, or for the channels of a board.
///
/// Columns are described by their units, names and values. What a recording or a board does not show
/// stands below a line `# TO FILL IN: ...`. The description is valid as it is.
#[derive(Debug, Args)]
pub struct Init {
    /// The recording: CSV, Parquet or MDF4.
    #[arg(required_unless_present = "board")]
    recording: Option<PathBuf>,
    /// The board whose channels, rate and counters are described, of a drivetrain.
    #[arg(long, value_name = "BOARD", conflicts_with_all = ["recording", "kind"])]
    board: Option<BoardName>,
    /// The description; printed where absent.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Kind of machine; by the columns where absent.
    #[arg(long, value_name = "KIND")]
    kind: Option<MachineKind>,
    #[command(flatten)]
    replace: Replace,
}

impl Init {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        Plan::new(self.replace)
            .reads(&self.recording)
            .writes("--output", self.output.as_deref(), DESCRIPTION)
            .check(as_json)?;
        if let Some(board) = self.board {
            return self.for_board(board, as_json);
        }
        let Some(recording) = &self.recording else {
            return Ok(());
        };
        let draft = draft(recording, self.kind)?;
        for line in &draft.survey.notes {
            note(format_args!("{line}\n"));
        }
        if let Some(refused) = &draft.survey.refused {
            note(format_args!("{}: {refused}\n", recording.display()));
        }
        match &self.output {
            Some(path) => {
                written(path, &draft.text)?;
                self.summarise(&draft, path, as_json);
            }
            None if as_json => self.summarise(&draft, Path::new("-"), as_json),
            None => print(format_args!("{}", draft.text)),
        }
        Ok(())
    }

    fn for_board(&self, board: BoardName, as_json: bool) -> anyhow::Result<()> {
        let name = board.to_possible_value();
        let name = name.as_ref().map_or("", |name| name.get_name());
        let (text, marks) = draft_for_board(name, &board.hardware())?;
        if let Some(path) = &self.output {
            written(path, &text)?;
        }
        let machine_out = self.output.as_ref().map(shown);
        match &self.output {
            _ if as_json => say!(
                "{}",
                json!({ "kind": "drivetrain", "board": name, "to_fill_in": marks, "machine_out": machine_out })
            ),
            Some(path) => say!(
                "{}: drivetrain on {name}; {marks} places to fill in (`{}`)",
                path.display(),
                MARK.trim_end_matches([':', ' '])
            ),
            None => print(format_args!("{text}")),
        }
        Ok(())
    }

    fn summarise(&self, draft: &Draft, path: &Path, as_json: bool) {
        let kind = format!("{:?}", draft.kind).to_lowercase();
        if as_json {
            let columns: Vec<_> = (draft.columns.iter())
                .map(|column| json!({ "name": column.name, "unit": column.written_unit, "look": format!("{:?}", column.kind) }))
                .collect();
            let machine_out = self.output.as_ref().map(shown);
            say!(
                "{}",
                json!({
                    "kind": kind, "columns": columns, "rows": draft.survey.rows, "to_fill_in": draft.marks,
                    "refused": draft.survey.refused, "machine_out": machine_out,
                })
            );
        } else {
            say!(
                "{}: {kind}, {} columns; {} places to fill in (`{}`)",
                path.display(),
                draft.columns.len(),
                draft.marks,
                MARK.trim_end_matches([':', ' '])
            );
        }
    }
}

/// Writes the description.
fn written(path: &Path, text: &str) -> anyhow::Result<()> {
    (AtomicFile::marked(path, &DESCRIPTION, text).and_then(AtomicFile::finish))
        .with_context(|| path.display().to_string())
}
