//! Loads a machine description for a command, with a note on values that are still to be filled in
//! (`load`), and applies the option `--layout`, which replaces its recording layout (`LayoutFile`).

use std::path::{Path, PathBuf};

use clap::Args;

use crate::cli::printing::note;
use crate::init::MARK;
use crate::machine::{Machine, MachineError};

/// How the recordings are laid out.
#[derive(Clone, Debug, Args)]
pub struct LayoutFile {
    /// Layout of the recordings (TOML), in place of `[recording]` in the
    /// description, of which only the channels are kept.
    #[arg(long, value_name = "FILE")]
    layout: Option<PathBuf>,
}

impl LayoutFile {
    /// The file, which is read.
    pub(super) fn file(&self) -> Option<&Path> {
        self.layout.as_deref()
    }

    /// Reads the description in `path` for recordings of this layout.
    pub(super) fn machine(&self, path: &Path) -> Result<Machine, MachineError> {
        let machine = load(path)?;
        match &self.layout {
            Some(layout) => machine.with_layout(layout),
            None => Ok(machine),
        }
    }
}

/// Reads the description in `path`; notes what `init` marked and is not filled in.
pub(super) fn load(path: &Path) -> Result<Machine, MachineError> {
    let machine = Machine::load(path)?;
    let text = std::fs::read_to_string(&machine.path).unwrap_or_default();
    let mut marked = (text.lines().zip(1..)).filter(|(line, _)| line.starts_with(MARK));
    if let Some((_, first)) = marked.next() {
        let count = 1 + marked.count();
        note(format_args!(
            "{}: {count} values are marked `{}`, the first in line {first}: results are of no use before they \
             are filled in and the marks deleted\n",
            path.display(),
            MARK.trim_end().trim_end_matches(':'),
        ));
    }
    Ok(machine)
}
