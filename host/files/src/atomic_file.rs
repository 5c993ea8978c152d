//! Writes output files that get their names only when they are complete (`AtomicFile`), several of
//! them together under a lock on their folders (`publish`). Pipes and devices are written directly.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use thiserror::Error;

use super::destination::{Destination, Place, destination};
use super::file_kind::FileKind;
use super::mark::marked;
use super::system::{FileId, Owner, link, unnamed};

/// Name between the link to a complete file and its renaming over one that is
/// there. The next run removes one that a kill between these two calls left.
const BETWEEN: &str = ".loadtwin-new";

/// Removes from `folder` what a kill between two calls left there, where no run works in it.
///
/// # Errors
/// When it cannot be removed.
pub fn remove_leftover(folder: &Path) -> io::Result<()> {
    match std::fs::remove_file(folder.join(BETWEEN)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Longest wait for other runs that publish into the same folder. They take
/// milliseconds; `flock FOLDER loadtwin ...` of a script would never end.
const LOCK_TIME: Duration = Duration::from_secs(1);

/// A file without a name in the folder of its target; [`AtomicFile::finish`]
/// gives it its name. Where the program ends before that, however it ends,
/// nothing is left of it, and a file of that name stays as it was.
///
/// Links are followed. A file that is replaced gives its permissions and its
/// owner to the new one. A target that is there and is no plain file
/// (`/dev/stdout`, a pipe) is written to directly, as is `-`, standard output.
///
/// ```
/// use std::io::Write;
/// use loadtwin_files::atomic_file::AtomicFile;
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("report.html");
/// let mut file = AtomicFile::create(&path)?;
/// file.write_all(b"<html>")?;
/// assert!(!path.exists());
/// file.finish()?;
/// assert_eq!(std::fs::read(&path)?, b"<html>");
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<File>,
    /// None: written to directly.
    place: Option<Place>,
    /// Never in place of another.
    only_new: bool,
}

impl AtomicFile {
    /// Begins a file that is to be at `path`.
    ///
    /// # Errors
    /// When the folder is not there or cannot be written to, or when there is a
    /// file of that name that may not be written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let (file, place) = match destination(path)? {
            Destination::Stream(file) => (file, None),
            Destination::Plain(place) => {
                if place.existing.is_some() {
                    // Renaming would replace a read-only file as well.
                    File::options().write(true).open(place.path())?;
                }
                (unnamed(&place.folder)?, Some(*place))
            }
        };
        Ok(Self {
            file: BufWriter::new(file),
            place,
            only_new: false,
        })
    }

    /// Begins a file that is to be at `path` with `text`, marked as `kind`.
    ///
    /// # Errors
    /// As [`AtomicFile::create`], and when it cannot be written to.
    pub fn marked(path: &Path, kind: &FileKind, text: &str) -> io::Result<Self> {
        let mut file = Self::create(path)?;
        file.write_all(marked(kind.noun, text).as_bytes())?;
        Ok(file)
    }

    /// Begins a file that is never put in place of another, with the permissions
    /// `mode`, from which the umask takes away.
    ///
    /// # Errors
    /// As [`AtomicFile::create`], and where there is a file of that name; one that
    /// comes later is an error of [`publish`].
    pub fn create_new(path: &Path, mode: u32) -> io::Result<Self> {
        let Destination::Plain(place) = destination(path)? else {
            return Err(io::ErrorKind::AlreadyExists.into());
        };
        if place.existing.is_some() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        let file = unnamed(&place.folder)?;
        Owner::limit(&file, mode)?;
        Ok(Self {
            file: BufWriter::new(file),
            place: Some(*place),
            only_new: true,
        })
    }

    /// Gives the file its name, in place of one that was there.
    ///
    /// # Errors
    /// When the last bytes cannot be written or the file cannot be named.
    pub fn finish(self) -> io::Result<()> {
        publish([self.complete()?]).map_err(|error| error.source)
    }

    /// Brings the whole file onto the disk, still without a name: [`publish`]
    /// names it together with others.
    ///
    /// # Errors
    /// When the last bytes cannot be written.
    pub fn complete(self) -> io::Result<Complete> {
        let file = (self.file.into_inner()).map_err(io::IntoInnerError::into_error)?;
        let Some(place) = self.place else {
            return Ok(Complete::default());
        };
        if let Some(replaced) = &place.existing {
            Owner::keep(&file, replaced)?;
        }
        if !place.is_temporary() {
            file.sync_all()?;
        }
        Ok(Complete(Some(Unnamed {
            file,
            place,
            only_new: self.only_new,
        })))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A complete file that has no name yet; dropped, it is gone.
#[derive(Debug, Default)]
#[must_use = "without publish the file is lost"]
pub struct Complete(Option<Unnamed>);

#[derive(Debug)]
struct Unnamed {
    file: File,
    place: Place,
    only_new: bool,
}

/// A complete file could not get its name.
#[derive(Debug, Error)]
#[error("{}: {source}", path.display())]
pub struct PublishError {
    /// The file.
    pub path: PathBuf,
    /// The system's reason.
    pub source: io::Error,
}

/// Names complete files in their order, with nothing but these calls in
/// between. Runs that publish the same files at once wait for each other, up to
/// one second.
///
/// # Errors
/// [`PublishError`], where a folder is full or has gone.
pub fn publish(files: impl IntoIterator<Item = Complete>) -> Result<(), PublishError> {
    let files: Vec<Unnamed> = files.into_iter().filter_map(|file| file.0).collect();
    // One order of locking, so that two runs cannot wait for each other.
    let mut folders = BTreeMap::new();
    for Unnamed { place, .. } in &files {
        // A folder without leave to read it can be neither locked nor synchronised.
        if !place.is_temporary()
            && let Ok(folder) = File::open(&place.folder)
            && let Ok(metadata) = folder.metadata()
        {
            folders.insert(FileId::of(&place.folder, &metadata), folder);
        }
    }
    let last = Instant::now() + LOCK_TIME;
    for folder in folders.values() {
        while let Err(std::fs::TryLockError::WouldBlock) = folder.try_lock() {
            if Instant::now() > last {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let mut made = Vec::new();
    for file in files {
        let path = file.place.path();
        if let Err(source) = file.name() {
            // Of new files all are made or none.
            for path in made {
                let _ = std::fs::remove_file(path);
            }
            return Err(PublishError { path, source });
        }
        if file.only_new {
            made.push(path);
        }
    }
    for folder in folders.values() {
        // Not every file system synchronises folders.
        let _ = folder.sync_all();
    }
    Ok(())
}

impl Unnamed {
    fn name(&self) -> io::Result<()> {
        let target = self.place.path();
        if self.place.existing.is_none() {
            let linked = link(&self.file, &target);
            let is_there = |e: &io::Error| e.kind() == io::ErrorKind::AlreadyExists;
            if self.only_new && !linked.as_ref().is_err_and(is_there) {
                return linked.or_else(|_| self.copy(&target));
            }
            if self.only_new || linked.is_ok() {
                return linked;
            }
        }
        let between = self.place.folder.join(BETWEEN);
        match std::fs::remove_file(&between) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let named = link(&self.file, &between)
            .or_else(|_| self.copy(&between))
            .and_then(|()| std::fs::rename(&between, &target));
        if named.is_err() {
            // The first error is the one to report.
            let _ = std::fs::remove_file(&between);
        }
        named
    }

    /// As [`link`], where the file system or the system cannot: by a copy.
    fn copy(&self, path: &Path) -> io::Result<()> {
        let permissions = self.file.metadata()?.permissions();
        let mut to = Owner::new_like(&self.file, path)?;
        let mut from = &self.file;
        from.rewind()?;
        io::copy(&mut from, &mut to)?;
        if self.place.existing.is_some() {
            to.set_permissions(permissions)?;
        }
        to.sync_all()
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::{PermissionsExt, symlink};

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn written(path: &Path, bytes: &[u8]) {
        let mut file = AtomicFile::create(path).unwrap();
        file.write_all(bytes).unwrap();
        file.finish().unwrap();
    }

    fn mode(path: &Path) -> u32 {
        path.metadata().unwrap().permissions().mode() & 0o777
    }

    #[test]
    fn nothing_is_there_before_the_end() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.csv");
        std::fs::write(&path, "before").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(&vec![b'x'; 100_000]).unwrap();
        let complete = file.complete().unwrap();
        assert_eq!(names(dir.path()), ["out.csv"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"before");
        drop(complete);
        assert_eq!(std::fs::read(&path).unwrap(), b"before");
        // What a kill between two calls left is removed.
        std::fs::write(dir.path().join(BETWEEN), "stale").unwrap();
        written(&path, b"after");
        assert_eq!(names(dir.path()), ["out.csv"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"after");
    }

    #[test]
    fn permissions_links_and_devices_are_as_the_user_left_them() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        File::create(at("plain")).unwrap();
        written(&at("ours"), b"");
        assert_eq!(mode(&at("plain")), mode(&at("ours")));

        std::fs::set_permissions(at("plain"), PermissionsExt::from_mode(0o600)).unwrap();
        symlink("plain", at("link")).unwrap();
        written(&at("link"), b"through");
        assert!(at("link").symlink_metadata().unwrap().is_symlink());
        assert_eq!(std::fs::read(at("plain")).unwrap(), b"through");
        assert_eq!(mode(&at("plain")), 0o600);

        symlink("absent", at("dangling")).unwrap();
        written(&at("dangling"), b"through");
        assert!(at("dangling").symlink_metadata().unwrap().is_symlink());
        assert_eq!(std::fs::read(at("absent")).unwrap(), b"through");
        symlink("circle", at("circle")).unwrap();
        assert!(AtomicFile::create(&at("circle")).is_err());

        written(Path::new("/dev/null"), b"gone");
        assert!(AtomicFile::create(dir.path()).is_err());
        assert!(AtomicFile::create(&at("absent/out")).is_err());
    }

    #[test]
    fn without_unnamed_files_a_copy_takes_the_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out");
        let mut file = tempfile::tempfile_in(dir.path()).unwrap();
        file.write_all(b"copied").unwrap();
        let Destination::Plain(place) = destination(&path).unwrap() else {
            panic!("a plain file");
        };
        let unnamed = Unnamed {
            file,
            place: *place,
            only_new: false,
        };
        unnamed.name().unwrap();
        assert_eq!(names(dir.path()), ["out"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"copied");
    }

    #[test]
    fn new_files_come_together_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let files = ["key", "key.pub"].map(|name| dir.path().join(name));
        let complete = || {
            files.each_ref().map(|path| {
                let mut file = AtomicFile::create_new(path, 0o600).unwrap();
                file.write_all(b"new").unwrap();
                file.complete().unwrap()
            })
        };
        let late = complete();
        std::fs::write(&files[1], "old").unwrap();
        let error = publish(late).unwrap_err();
        assert_eq!(error.path, files[1]);
        assert_eq!(error.source.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(names(dir.path()), ["key.pub"]);
        assert_eq!(std::fs::read(&files[1]).unwrap(), b"old");
        std::fs::remove_file(&files[1]).unwrap();
        publish(complete()).unwrap();
        assert_eq!(names(dir.path()), ["key", "key.pub"]);
        assert_eq!(mode(&files[0]), 0o600);
    }

    #[test]
    fn of_two_runs_one_set_of_files_remains() {
        let dir = tempfile::tempdir().unwrap();
        let files = ["a", "b", "c"].map(|name| dir.path().join(name));
        let run = |which: u8| {
            for _ in 0..100 {
                let complete = files.each_ref().map(|path| {
                    let mut file = AtomicFile::create(path).unwrap();
                    file.write_all(&[which]).unwrap();
                    file.complete().unwrap()
                });
                publish(complete).unwrap();
            }
        };
        std::thread::scope(|scope| {
            let other = scope.spawn(|| run(b'1'));
            run(b'2');
            other.join().unwrap();
        });
        let [a, b, c] = files.each_ref().map(|path| std::fs::read(path).unwrap());
        assert!(a == b && b == c, "{a:?} {b:?} {c:?}");
        assert_eq!(names(dir.path()), ["a", "b", "c"]);
    }
}
