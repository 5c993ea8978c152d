//! Reads files up to a size limit; a longer file, or a device that never ends, is an error.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Largest description, calibration or rotor model (bytes). The largest of the
/// examples has 60 kB; a gauge takes about 300 bytes.
pub const DESCRIPTION: u64 = 16 << 20;

/// Reads a file of at most `most` bytes, whatever it is: a device that never
/// ends is refused as well.
///
/// # Errors
/// When it cannot be read or is longer.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader(path, most)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// As [`read`], text.
///
/// # Errors
/// As [`read`], and when it is no UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let mut text = String::new();
    reader(path, most)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Opens a file of which at most `most` bytes can be read.
///
/// # Errors
/// When it cannot be opened. Reading beyond `most` bytes is an error as well.
pub fn reader(path: &Path, most: u64) -> io::Result<Bounded> {
    Ok(Bounded {
        file: File::open(path)?,
        left: most,
        most,
    })
}

/// A file that ends with an error after so many bytes.
#[derive(Debug)]
pub struct Bounded {
    file: File,
    left: u64,
    most: u64,
}

impl Read for Bounded {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        // One byte more than is allowed shows that the file has not ended.
        let length = (bytes.len() as u64).min(self.left + 1) as usize;
        let read = self.file.read(&mut bytes[..length])? as u64;
        self.left = self.left.checked_sub(read).ok_or_else(|| {
            let most = self.most >> 20;
            io::Error::new(
                io::ErrorKind::FileTooLarge,
                format!("found more than {most} MiB, allowed: up to {most} MiB"),
            )
        })?;
        Ok(read as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        std::fs::write(&path, vec![b'a'; 1 << 20]).unwrap();
        assert_eq!(read(&path, 1 << 20).unwrap().len(), 1 << 20);
        let error = read_text(&path, (1 << 20) - 1).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::FileTooLarge);
        let error = read(Path::new("/dev/zero"), 1 << 20).unwrap_err();
        assert!(error.to_string().contains("allowed: up to 1 MiB"));
    }
}
