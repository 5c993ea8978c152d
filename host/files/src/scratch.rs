//! Makes the temporary folder of a running command and removes it at the end (`Scratch`); folders
//! of killed runs are removed by the next run.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::Duration;

use tempfile::TempDir;

/// Beginning of the names of scratch folders.
pub(crate) const PREFIX: &str = "loadtwin-scratch-";

/// Age from which a folder without a lock is a dead run's: making one and
/// locking it takes microseconds.
const DEAD: Duration = Duration::from_mins(1);

/// A folder below the system's one for temporary files, removed with its
/// contents when it is dropped. That of a run that was killed is removed by the
/// next run: a lock shows which ones are in use.
#[derive(Debug)]
pub struct Scratch {
    folder: TempDir,
    _lock: File,
}

impl Scratch {
    /// A new folder.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn new() -> io::Result<Self> {
        remove_dead(&std::env::temp_dir());
        let folder = tempfile::Builder::new().prefix(PREFIX).tempdir()?;
        let lock = File::open(folder.path())?;
        // Where the file system has no locks, nothing of it is found dead either.
        let _ = lock.try_lock();
        Ok(Self {
            folder,
            _lock: lock,
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Removes what killed runs left; another user's cannot be removed.
fn remove_dead(parent: &Path) {
    let entries = std::fs::read_dir(parent).into_iter().flatten().flatten();
    for entry in entries {
        let is_ours = entry.file_name().to_string_lossy().starts_with(PREFIX);
        let age = || entry.metadata().ok()?.modified().ok()?.elapsed().ok();
        if is_ours && age().is_some_and(|age| age > DEAD) {
            let lock = File::open(entry.path());
            if lock.is_ok_and(|folder| folder.try_lock().is_ok()) {
                let _ = std::fs::remove_dir_all(entry.path());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;

    #[test]
    fn only_the_folders_of_dead_runs_are_removed() {
        let parent = tempfile::tempdir().unwrap();
        let at = |name: &str| parent.path().join(name);
        for name in [
            "loadtwin-scratch-dead",
            "loadtwin-scratch-used",
            "loadtwin-scratch-new",
            "mine",
        ] {
            std::fs::create_dir(at(name)).unwrap();
            std::fs::write(at(name).join("maps.csv"), "").unwrap();
            let old = SystemTime::now() - 2 * DEAD;
            if !name.ends_with("new") {
                File::open(at(name)).unwrap().set_modified(old).unwrap();
            }
        }
        let used = File::open(at("loadtwin-scratch-used")).unwrap();
        used.lock().unwrap();
        remove_dead(parent.path());
        assert!(!at("loadtwin-scratch-dead").exists());
        for name in ["loadtwin-scratch-used", "loadtwin-scratch-new", "mine"] {
            assert!(at(name).join("maps.csv").exists(), "{name}");
        }
        let scratch = Scratch::new().unwrap();
        let path = scratch.path().to_path_buf();
        drop(scratch);
        assert!(!path.exists());
    }
}
