//! Declares the inputs and outputs of a command, with the option `--force` (`Plan`), and checks
//! them before it runs: refuses `-` as an input, hold-outs that are fitted, and outputs that may
//! not be written. Where an output takes standard output, text goes to standard error.

use std::path::{Path, PathBuf};

use clap::Args;

use super::printing;
use crate::calibrate::maps_beside;
use crate::files::file_kind::FileKind;
use crate::files::outputs::Outputs;
use crate::machine::{DESCRIPTION, MAPS, named_files};

/// What may be replaced.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(super) struct Replace {
    /// Replace an existing file that is no such output of loadtwin, or a description that was
    /// edited since. What is read is never written to.
    #[arg(long)]
    force: bool,
}

/// Inputs and outputs of a command, and what is refused of its inputs.
pub(super) struct Plan(Outputs, Option<String>);

impl Plan {
    /// Nothing yet.
    pub(super) fn new(replace: Replace) -> Self {
        Self(Outputs::new(replace.force), None)
    }

    /// Reads a machine description and whatever files it names.
    pub(super) fn description(mut self, path: &Path) -> Self {
        if path == Path::new("-") {
            let reason = "-: a description names files beside it; give the name of a file";
            self.1 = Some(reason.to_owned());
        }
        self.0.reads(path);
        for named in named_files(path) {
            self.0.reads(&named);
        }
        self
    }

    /// Reads files.
    pub(super) fn reads<P: AsRef<Path>>(mut self, paths: impl IntoIterator<Item = P>) -> Self {
        for path in paths {
            if path.as_ref() == Path::new("-") {
                let reason = "-: only replay and send read standard input; save it to a file";
                self.1 = Some(reason.to_owned());
            }
            self.0.reads(path.as_ref());
        }
        self
    }

    /// Reads `fitted`, and `held_out`, which take no part in the fit and are none of them.
    pub(super) fn reads_held_out<'a>(
        mut self,
        fitted: &[PathBuf],
        held_out: impl IntoIterator<Item = &'a PathBuf>,
    ) -> Self {
        let place = |path: &PathBuf| std::fs::canonicalize(path).ok();
        for path in held_out {
            if place(path)
                .is_some_and(|at| fitted.iter().any(|f| place(f).is_some_and(|f| f == at)))
            {
                self.1 = Some(format!(
                    "--validate {}: it is fitted as well; give a recording that takes no part",
                    path.display()
                ));
            }
            self.0.reads(path);
        }
        self.reads_once(fitted)
    }

    /// Reads recordings that are fitted together, each of which counts once.
    pub(super) fn reads_once(mut self, recordings: &[PathBuf]) -> Self {
        let places: Vec<Option<PathBuf>> = (recordings.iter())
            .map(|path| std::fs::canonicalize(path).ok())
            .collect();
        let again =
            (1..places.len()).find(|&k| places[k].is_some() && places[..k].contains(&places[k]));
        if let Some(k) = again {
            self.1 = Some(format!(
                "{}: is given twice; allowed: each recording once",
                recordings[k].display()
            ));
        }
        self.reads(recordings)
    }

    /// Writes one file, where `option` is given.
    pub(super) fn writes(
        mut self,
        option: &'static str,
        path: Option<&Path>,
        kind: FileKind,
    ) -> Self {
        if let Some(path) = path {
            self.0.writes(option, path, kind);
        }
        self
    }

    /// Writes one of several files that belong together.
    pub(super) fn writes_beside(
        mut self,
        option: &'static str,
        path: &Path,
        kind: FileKind,
    ) -> Self {
        self.0.writes_beside(option, path, kind);
        self
    }

    /// Writes a file that is never replaced, where `option` is given.
    pub(super) fn writes_new(
        mut self,
        option: &'static str,
        path: Option<&Path>,
        kind: FileKind,
    ) -> Self {
        if let Some(path) = path {
            self.0.writes_new(option, path, kind);
        }
        self
    }

    /// Writes a description with its maps beside it, where `option` is given.
    pub(super) fn writes_description(mut self, option: &'static str, path: Option<&Path>) -> Self {
        if let Some(path) = path {
            self.0.writes_beside(option, path, DESCRIPTION);
            for maps in maps_beside(path) {
                self.0.writes_beside(option, &maps, MAPS);
            }
        }
        self
    }

    /// Checks it. Where an output goes to standard output, text goes to
    /// standard error from now on.
    ///
    /// # Errors
    /// One line on an input that is refused, or on the first output that may not be written.
    pub(super) fn check(self, as_json: bool) -> anyhow::Result<()> {
        if let Some(refused) = self.1 {
            anyhow::bail!(refused);
        }
        if let Some(option) = self.0.check()?.stdout {
            anyhow::ensure!(
                !as_json,
                "{option}: standard output is taken by --json; give the name of a file, or leave out --json"
            );
            printing::text_to_standard_error();
        }
        Ok(())
    }
}
