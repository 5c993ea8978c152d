//! Describes a kind of output file (`FileKind`): its name, its suffixes, and whether an existing
//! file is of the same kind and may be replaced. Also names the kind of any file by its first
//! bytes.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use memchr::memmem;

/// Bytes at the beginning that are looked at: a header line of 100 gauges has about 10 kB.
const START: u64 = 64 << 10;

/// Bytes that are searched at a time.
const CHUNK: usize = 1 << 20;

/// A kind of output.
#[derive(Clone, Copy, Debug)]
pub struct FileKind {
    /// What it is called in messages, as `estimates`.
    pub noun: &'static str,
    /// Suffixes that its name may have, besides none.
    pub suffixes: &'static [&'static str],
    /// Whether a file that is there is of this kind and was written by this
    /// program, so that nothing of the user's is lost with it.
    pub is_same: fn(&mut Existing) -> io::Result<bool>,
}

impl FileKind {
    /// Whether `path` may be the name of such a file.
    pub(crate) fn may_be_called(&self, path: &Path) -> bool {
        let Some(suffix) = path.extension() else {
            return true;
        };
        (self.suffixes.iter()).any(|allowed| suffix.eq_ignore_ascii_case(allowed))
    }

    /// The suffixes as a message lists them.
    pub(crate) fn allowed(&self) -> String {
        let dotted: Vec<String> = self.suffixes.iter().map(|s| format!(".{s}")).collect();
        dotted.join(", ")
    }
}

/// A file that is there.
#[derive(Debug)]
pub struct Existing {
    file: File,
    start: Vec<u8>,
}

impl Existing {
    /// Opens a file and reads its first 64 KiB.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(path: &Path) -> io::Result<Self> {
        let mut file = File::open(path)?;
        let mut start = Vec::new();
        (&mut file).take(START).read_to_end(&mut start)?;
        Ok(Self { file, start })
    }

    /// Its first 64 KiB.
    pub fn start(&self) -> &[u8] {
        &self.start
    }

    /// Its first line of text that is neither empty nor a comment (`#`).
    pub fn header(&self) -> &[u8] {
        let mut lines = self.start.split(|byte| *byte == b'\n');
        lines
            .find(|line| !line.is_empty() && !line.starts_with(b"#"))
            .unwrap_or_default()
    }

    /// The whole file, where it has at most `most` bytes; else its start.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn whole(&mut self, most: u64) -> io::Result<Vec<u8>> {
        self.file.rewind()?;
        let mut bytes = Vec::new();
        (&mut self.file).take(most).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Whether the file ends so, blanks left out.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn ends_with(&mut self, end: &[u8]) -> io::Result<bool> {
        let length = self.file.metadata()?.len();
        let at = length.saturating_sub(end.len() as u64 + START);
        self.file.seek(SeekFrom::Start(at))?;
        let mut bytes = Vec::new();
        (&mut self.file).take(length - at).read_to_end(&mut bytes)?;
        Ok(bytes.trim_ascii_end().ends_with(end))
    }

    /// Whether all of `needles` stand somewhere in the file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn contains(&mut self, needles: &[&str]) -> io::Result<bool> {
        let overlap = needles.iter().map(|n| n.len()).max().unwrap_or(1);
        let mut missing: Vec<&str> = needles.to_vec();
        self.file.seek(SeekFrom::Start(0))?;
        let mut bytes = Vec::new();
        while !missing.is_empty() {
            let kept = bytes.len().saturating_sub(overlap);
            bytes.drain(..kept);
            let before = bytes.len();
            (&mut self.file)
                .take(CHUNK as u64)
                .read_to_end(&mut bytes)?;
            if bytes.len() == before {
                return Ok(false);
            }
            missing.retain(|needle| memmem::find(&bytes, needle.as_bytes()).is_none());
        }
        Ok(true)
    }

    /// What the file is, in words, from its first bytes.
    pub fn name(&self) -> &'static str {
        named(&self.start)
    }
}

/// [`named`] of what is no text, such as the payload of an image.
pub const BINARY: &str = "a binary file";

/// [`named`] of TOML.
pub const TOML: &str = "a TOML file";

/// [`named`] of what is not recognised.
pub const OTHER: &str = "another file";

/// What a file is, in words, from its first bytes.
pub fn named(start: &[u8]) -> &'static str {
    let text = start.trim_ascii_start();
    let toml = |line: &[u8]| line.starts_with(b"[") || line.contains(&b'=');
    let mut lines = (text.split(|b| *b == b'\n')).filter(|l| !l.is_empty() && l[0] != b'#');
    let first = lines.next().unwrap_or_default();
    match start {
        _ if start.starts_with(b"PAR1") => "a Parquet file",
        _ if start.starts_with(b"MDF ") || start.starts_with(b"UnFinMF ") => "an MDF file",
        _ if start.starts_with(b"-----BEGIN ") => "a key",
        _ if text.starts_with(b"<!DOCTYPE html") || text.starts_with(b"<html") => "an HTML page",
        _ if start.starts_with(b"%PDF") => "a PDF",
        _ if start.contains(&0) || std::str::from_utf8(first).is_err() => BINARY,
        _ if first.starts_with(b"(") && first.contains(&b'#') => "a candump log",
        _ if toml(first) => TOML,
        _ if first.iter().any(|b| matches!(b, b',' | b';' | b'\t')) => "a table of text",
        _ => OTHER,
    }
}
