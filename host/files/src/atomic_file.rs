//! An output that is there whole or not at all.
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A file under a temporary name beside the target; [`AtomicFile::finish`]
/// gives it its name. Dropped before that, it is removed and a file of that
/// name stays as it was.
///
/// A target that is there and is no plain file (`/dev/stdout`, a pipe) is
/// written to directly.
///
/// ```
/// use std::io::Write;
/// use loadtwin::atomic_file::AtomicFile;
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
pub struct AtomicFile(Target);

#[derive(Debug)]
enum Target {
    Beside(BufWriter<NamedTempFile>, PathBuf),
    Direct(BufWriter<File>),
}

impl AtomicFile {
    /// Begins a file that is to be at `path`; a symbolic link is followed.
    ///
    /// # Errors
    /// When the folder is not there or cannot be written to.
    pub fn create(path: &Path) -> io::Result<Self> {
        let path = match path.canonicalize() {
            Ok(there) if there.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
            Ok(there) if !there.is_file() => {
                let file = File::options().write(true).open(there)?;
                return Ok(Self(Target::Direct(BufWriter::new(file))));
            }
            Ok(there) => there,
            Err(_) => path.to_path_buf(),
        };
        let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut prefix = std::ffi::OsString::from(".");
        prefix.push(name);
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(".partial");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As any new file: the user's umask takes away from it.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let file = builder.tempfile_in(folder)?;
        Ok(Self(Target::Beside(BufWriter::new(file), path)))
    }

    /// Gives the file its name, in place of one that was there.
    ///
    /// # Errors
    /// When the last bytes cannot be written or the file cannot be renamed.
    pub fn finish(self) -> io::Result<()> {
        match self.0 {
            Target::Beside(file, path) => {
                let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
                file.persist(path).map_err(|e| e.error)?;
            }
            Target::Direct(mut file) => file.flush()?,
        }
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.0 {
            Target::Beside(file, _) => file.write(bytes),
            Target::Direct(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.0 {
            Target::Beside(file, _) => file.flush(),
            Target::Direct(file) => file.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn dropped_before_the_end_it_leaves_what_was_there() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.csv");
        std::fs::write(&path, "before").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(&vec![b'x'; 100_000]).unwrap();
        assert_eq!(names(dir.path()).len(), 2);
        drop(file);
        assert_eq!(names(dir.path()), ["out.csv"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"before");

        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"after").unwrap();
        file.finish().unwrap();
        assert_eq!(names(dir.path()), ["out.csv"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"after");
    }

    #[cfg(unix)]
    #[test]
    fn permissions_links_and_devices_are_as_for_any_new_file() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let (plain, ours) = (dir.path().join("plain"), dir.path().join("ours"));
        File::create(&plain).unwrap();
        AtomicFile::create(&ours).unwrap().finish().unwrap();
        let mode = |p: &Path| p.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&plain), mode(&ours));

        let link = dir.path().join("link");
        symlink(&plain, &link).unwrap();
        let mut file = AtomicFile::create(&link).unwrap();
        file.write_all(b"through").unwrap();
        file.finish().unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!(std::fs::read(&plain).unwrap(), b"through");

        let mut file = AtomicFile::create(Path::new("/dev/null")).unwrap();
        file.write_all(b"gone").unwrap();
        file.finish().unwrap();
        assert!(AtomicFile::create(dir.path()).is_err());
        assert!(AtomicFile::create(&dir.path().join("absent/out")).is_err());
    }
}
