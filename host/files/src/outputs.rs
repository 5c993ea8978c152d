//! Checks a command's outputs before it runs (`Outputs`): each needs a writable place of its own
//! (standard output included) and a fitting suffix; none may replace an input or, unless forced, a
//! file of another kind; keys never replace anything.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

pub use super::destination::is_stream;
use super::destination::{
    Destination, Identity, Place, destination, is_stdout, stdin_file, stdout_file,
};
use super::file_kind::{Existing, FileKind};
use super::system::check_writable;

/// Everything that a command reads and writes.
///
/// ```
/// use loadtwin_files::file_kind::FileKind;
/// use loadtwin_files::outputs::Outputs;
/// # let dir = tempfile::tempdir()?;
/// # let recording = dir.path().join("s.csv");
/// # std::fs::write(&recording, "t [s],a\n")?;
/// const TABLE: FileKind = FileKind { noun: "table", suffixes: &["csv"], is_same: |_| Ok(true) };
/// let mut outputs = Outputs::default();
/// outputs.reads(&recording);
/// outputs.writes("--estimates", &recording, TABLE);
/// assert!(outputs.check().is_err());
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug, Default)]
pub struct Outputs {
    read: Vec<Input>,
    written: Vec<Output>,
    force: bool,
}

#[derive(Debug)]
struct Input {
    path: PathBuf,
    identity: Identity,
    /// Where it is a folder: all that lies in it is read.
    folder: Option<PathBuf>,
}

#[derive(Debug)]
struct Output {
    option: &'static str,
    path: PathBuf,
    kind: FileKind,
    way: Way,
}

/// How an output is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// One file, from its beginning to its end.
    Streamed,
    /// One of several files that belong together.
    Beside,
    /// A file that cannot be made again, such as a key: never replaced.
    New,
}

/// Why a command may not write what it was asked for; one line.
#[derive(Debug, Error)]
pub enum OutputError {
    /// It would replace what the command reads.
    #[error("{option} {}: is the input {}, and no input is written to; give another name", path.display(), input.display())]
    IsInput {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// The input, under the name by which it is read.
        input: PathBuf,
    },
    /// Standard output leads into what the command reads.
    #[error("standard output: is the input {}, and no input is written to; redirect it to another file", input.display())]
    StdoutIsInput {
        /// The input, under the name by which it is read.
        input: PathBuf,
    },
    /// Two outputs are one file.
    #[error("{option} {}: is what {other} writes; give each a file of its own", path.display())]
    Twice {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// The other option.
        other: &'static str,
    },
    /// Its name has the suffix of another kind of file.
    #[error("{option} {}: {noun} cannot have this suffix; allowed: {allowed}", path.display())]
    Suffix {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// What it would hold.
        noun: &'static str,
        /// The suffixes that it may have.
        allowed: String,
    },
    /// There is a file that this program did not write as such.
    #[error("{option} {}: is there already, {found} and no {noun} as written by loadtwin, or edited since; give another name, or --force to replace it", path.display())]
    OtherContent {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// What the file is.
        found: &'static str,
        /// What it would hold.
        noun: &'static str,
    },
    /// It is never replaced.
    #[error("{option} {}: is there already, and a {noun} is never overwritten; give another name", path.display())]
    Exists {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// What it would hold.
        noun: &'static str,
    },
    /// It needs a plain file.
    #[error("{option} {}: {noun} cannot go to standard output, a pipe or a device; give the name of a file", path.display())]
    NoFile {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// What it would hold.
        noun: &'static str,
    },
    /// The folder is missing.
    #[error("{option} {}: there is no folder {}; make it first: mkdir -p {}", path.display(), folder.display(), folder.display())]
    NoFolder {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// The folder.
        folder: PathBuf,
    },
    /// The system does not let it be written.
    #[error("{option} {}: {source}", path.display())]
    Unwritable {
        /// The option.
        option: &'static str,
        /// What it was given.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

/// What a check found besides errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checked {
    /// The option that writes to standard output, where nothing else may go.
    pub stdout: Option<&'static str>,
}

impl Outputs {
    /// With `force` an existing file of another kind is replaced. Inputs are
    /// refused all the same.
    pub fn new(force: bool) -> Self {
        Self {
            force,
            ..Self::default()
        }
    }

    /// Declares a file that is read, or a folder of such files; one that is not
    /// there is left to whoever reads it.
    pub fn reads(&mut self, path: &Path) {
        let metadata = if path == Path::new("-") {
            stdin_file().and_then(|file| file.metadata())
        } else {
            path.metadata()
        };
        let Ok(metadata) = metadata else {
            return;
        };
        if metadata.is_file() || metadata.is_dir() {
            self.read.push(Input {
                path: path.to_path_buf(),
                identity: Identity::of(path, &metadata),
                folder: path.canonicalize().ok().filter(|_| metadata.is_dir()),
            });
        }
    }

    /// Declares one file that `option` writes from its beginning to its end.
    pub fn writes(&mut self, option: &'static str, path: &Path, kind: FileKind) {
        self.push(option, path, kind, Way::Streamed);
    }

    /// As [`Outputs::writes`], for a file that has others beside it.
    pub fn writes_beside(&mut self, option: &'static str, path: &Path, kind: FileKind) {
        self.push(option, path, kind, Way::Beside);
    }

    /// As [`Outputs::writes`], for a file that cannot be made again once it is
    /// lost, such as a key: one that is there is never replaced.
    pub fn writes_new(&mut self, option: &'static str, path: &Path, kind: FileKind) {
        self.push(option, path, kind, Way::New);
    }

    fn push(&mut self, option: &'static str, path: &Path, kind: FileKind, way: Way) {
        self.written.push(Output {
            option,
            path: path.to_path_buf(),
            kind,
            way,
        });
    }

    /// Checks every output against every input, the other outputs and what is
    /// there.
    ///
    /// # Errors
    /// The first [`OutputError`].
    pub fn check(&self) -> Result<Checked, OutputError> {
        if let Some(input) = self.input_of(&stdout_file()) {
            return Err(OutputError::StdoutIsInput { input });
        }
        let mut stdout: Option<&Output> = None;
        let mut places: Vec<(&Output, Identity)> = Vec::new();
        for output in &self.written {
            if is_stdout(&output.path) {
                if output.way != Way::Streamed {
                    return Err(output.no_file());
                }
                if let Some(other) = stdout.replace(output) {
                    return Err(output.twice(other));
                }
                continue;
            }
            let place = match destination(&output.path).map_err(|e| output.unwritable(e))? {
                Destination::Stream(file) if output.way == Way::Streamed => {
                    if let Some(input) = self.input_of(&Ok(file)) {
                        return Err(output.is_input(input));
                    }
                    continue;
                }
                Destination::Stream(_) => return Err(output.no_file()),
                Destination::Plain(place) => place,
            };
            self.check_input(output, &place)?;
            let identity = output.identity(&place)?;
            if let Some((other, _)) = places.iter().find(|(_, at)| *at == identity) {
                return Err(output.twice(other));
            }
            places.push((output, identity));
            output.check_suffix()?;
            output.check_place(&place)?;
            if output.way == Way::New {
                output.check_absent(&place)?;
            } else if !self.force {
                output.check_kind(&place)?;
            }
        }
        Ok(Checked {
            stdout: stdout.map(|output| output.option),
        })
    }

    /// The input that an open file is.
    fn input_of(&self, file: &io::Result<File>) -> Option<PathBuf> {
        let metadata = file.as_ref().ok()?.metadata().ok()?;
        let identity = Identity::of(Path::new("-"), &metadata);
        let input = self.read.iter().find(|input| input.identity == identity)?;
        Some(input.path.clone())
    }

    fn check_input(&self, output: &Output, place: &Place) -> Result<(), OutputError> {
        let Some(metadata) = &place.existing else {
            return Ok(());
        };
        let identity = Identity::of(&place.path(), metadata);
        let whole = place.path().canonicalize().ok();
        let is = |input: &&Input| {
            let lies_in = (input.folder.as_ref().zip(whole.as_ref()))
                .is_some_and(|(folder, path)| path.starts_with(folder));
            input.identity == identity || lies_in
        };
        match self.read.iter().find(is) {
            None => Ok(()),
            Some(input) => Err(output.is_input(input.path.clone())),
        }
    }
}

impl Output {
    fn identity(&self, place: &Place) -> Result<Identity, OutputError> {
        place.identity().map_err(|_| OutputError::NoFolder {
            option: self.option,
            path: self.path.clone(),
            folder: place.folder.clone(),
        })
    }

    fn check_suffix(&self) -> Result<(), OutputError> {
        if self.kind.may_be_called(&self.path) {
            return Ok(());
        }
        Err(OutputError::Suffix {
            option: self.option,
            path: self.path.clone(),
            noun: self.kind.noun,
            allowed: self.kind.allowed(),
        })
    }

    fn check_place(&self, place: &Place) -> Result<(), OutputError> {
        check_writable(&place.folder, true)
            .and_then(|()| match &place.existing {
                Some(_) => check_writable(&place.path(), false),
                None => Ok(()),
            })
            .map_err(|source| self.unwritable(source))
    }

    fn check_absent(&self, place: &Place) -> Result<(), OutputError> {
        if place.existing.is_none() {
            return Ok(());
        }
        Err(OutputError::Exists {
            option: self.option,
            path: self.path.clone(),
            noun: self.kind.noun,
        })
    }

    fn check_kind(&self, place: &Place) -> Result<(), OutputError> {
        // With an empty file nothing is lost.
        if place.existing.as_ref().is_none_or(|file| file.len() == 0) {
            return Ok(());
        }
        let mut existing = Existing::open(&place.path()).map_err(|e| self.unwritable(e))?;
        if (self.kind.is_same)(&mut existing).map_err(|e| self.unwritable(e))? {
            return Ok(());
        }
        Err(OutputError::OtherContent {
            option: self.option,
            path: self.path.clone(),
            found: existing.name(),
            noun: self.kind.noun,
        })
    }

    fn is_input(&self, input: PathBuf) -> OutputError {
        OutputError::IsInput {
            option: self.option,
            path: self.path.clone(),
            input,
        }
    }

    fn twice(&self, other: &Self) -> OutputError {
        OutputError::Twice {
            option: self.option,
            path: self.path.clone(),
            other: other.option,
        }
    }

    fn no_file(&self) -> OutputError {
        OutputError::NoFile {
            option: self.option,
            path: self.path.clone(),
            noun: self.kind.noun,
        }
    }

    fn unwritable(&self, source: io::Error) -> OutputError {
        OutputError::Unwritable {
            option: self.option,
            path: self.path.clone(),
            source,
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    const TABLE: FileKind = FileKind {
        noun: "table",
        suffixes: &["csv"],
        is_same: |file| Ok(file.header().starts_with(b"table")),
    };

    /// What comes of writing `name` in a folder with `in.csv`, which is read,
    /// and other files.
    fn checked(names: &[&str], force: bool) -> Result<Checked, OutputError> {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("in.csv"), "measured\n").unwrap();
        std::fs::hard_link(at("in.csv"), at("hard.csv")).unwrap();
        symlink("in.csv", at("link.csv")).unwrap();
        symlink("absent.csv", at("dangling.csv")).unwrap();
        std::fs::write(at("same.csv"), "# note\ntable\n").unwrap();
        std::fs::write(at("other.csv"), "measured,too\n").unwrap();
        std::fs::write(at("empty.csv"), "").unwrap();
        std::fs::create_dir(at("folder")).unwrap();
        std::fs::write(at("folder/part.csv"), "table\n").unwrap();
        let mut outputs = Outputs::new(force);
        outputs.reads(&at("in.csv"));
        outputs.reads(&at("folder"));
        outputs.reads(&at("not-there.csv"));
        for name in names {
            let path = if name.len() > 1 {
                at(name)
            } else {
                name.into()
            };
            outputs.writes("--estimates", &path, TABLE);
        }
        outputs.check()
    }

    #[test]
    fn an_output_is_no_input_under_any_name() {
        for name in [
            "in.csv",
            "hard.csv",
            "link.csv",
            "folder/../in.csv",
            "folder/part.csv",
        ] {
            for force in [false, true] {
                let error = checked(&[name], force).unwrap_err();
                assert!(matches!(error, OutputError::IsInput { .. }), "{name}");
            }
        }
    }

    #[test]
    fn two_outputs_are_two_files() {
        for names in [
            ["a.csv", "folder/../a.csv"],
            ["absent.csv", "dangling.csv"],
            ["same.csv", "same.csv"],
            ["-", "-"],
        ] {
            let error = checked(&names, true).unwrap_err();
            assert!(matches!(error, OutputError::Twice { .. }), "{names:?}");
        }
        assert!(checked(&["a.csv", "b.csv"], false).is_ok());
    }

    #[test]
    fn only_a_file_of_the_same_kind_is_replaced() {
        for name in ["same.csv", "empty.csv", "new.csv", "dangling.csv"] {
            assert!(checked(&[name], false).is_ok(), "{name}");
        }
        let error = checked(&["other.csv"], false).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("a table of text and no table"),
            "{message}"
        );
        assert!(checked(&["other.csv"], true).is_ok());
    }

    #[test]
    fn name_and_folder_fit_what_is_written() {
        let error = checked(&["new.pdf"], true).unwrap_err();
        assert!(error.to_string().ends_with("allowed: .csv"), "{error}");
        assert!(checked(&["new"], false).is_ok());
        let error = checked(&["absent/new.csv"], true).unwrap_err();
        assert!(matches!(error, OutputError::NoFolder { .. }), "{error}");
        let error = checked(&["folder"], true).unwrap_err();
        assert!(matches!(error, OutputError::Unwritable { .. }), "{error}");
        let stdout = Checked {
            stdout: Some("--estimates"),
        };
        assert_eq!(checked(&["-", "new.csv"], false).unwrap(), stdout);
    }
}
