//! `--layout`, of the commands that read recordings.

use std::path::{Path, PathBuf};

use clap::Args;

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
        let machine = Machine::load(path)?;
        match &self.layout {
            Some(layout) => machine.with_layout(layout),
            None => Ok(machine),
        }
    }
}
