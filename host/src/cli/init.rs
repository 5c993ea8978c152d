//! The command `loadtwin init`: has `init::draft` generate the draft of a machine description from
//! a recording, writes or prints it, and reports the kind of machine and the number of places to
//! fill in.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::printing::{note, print, say, shown};
use crate::atomic_file::AtomicFile;
use crate::init::{Draft, MARK, MachineKind, draft};
use crate::machine::DESCRIPTION;

/// Begin a machine description from a recording.
///
/// Columns are described by their units, names and values. What a recording does not show stands
/// below a line `# TO FILL IN: ...`. The description is valid as it is.
#[derive(Debug, Args)]
pub struct Init {
    /// The recording: CSV, Parquet or MDF4.
    recording: PathBuf,
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
            .reads([&self.recording])
            .writes("--output", self.output.as_deref(), DESCRIPTION)
            .check(as_json)?;
        let draft = draft(&self.recording, self.kind)?;
        for line in &draft.survey.notes {
            note(format_args!("{line}\n"));
        }
        if let Some(refused) = &draft.survey.refused {
            note(format_args!("{}: {refused}\n", self.recording.display()));
        }
        match &self.output {
            Some(path) => {
                (AtomicFile::marked(path, &DESCRIPTION, &draft.text).and_then(AtomicFile::finish))
                    .with_context(|| path.display().to_string())?;
                self.summarise(&draft, path, as_json);
            }
            None if as_json => self.summarise(&draft, Path::new("-"), as_json),
            None => print(format_args!("{}", draft.text)),
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
