//! `loadtwin completions` and `loadtwin man`.

use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, CommandFactory};

use super::Cli;

/// Print completions for a shell.
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell.
    shell: clap_complete::Shell,
}

impl Completions {
    pub(super) fn run(&self) {
        clap_complete::generate(
            self.shell,
            &mut Cli::command(),
            "loadtwin",
            &mut std::io::stdout(),
        );
    }
}

/// Write a man page for each command.
#[derive(Debug, Args)]
pub struct Man {
    /// Folder for the pages.
    folder: PathBuf,
}

impl Man {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let folder = self.folder.display();
        std::fs::create_dir_all(&self.folder).with_context(|| format!("{folder}"))?;
        clap_mangen::generate_to(Cli::command(), &self.folder).with_context(|| format!("{folder}"))
    }
}
