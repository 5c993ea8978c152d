//! Reads a text file line by line as UTF-8 through a buffer of 1 MiB (`Lines`), which is also the
//! longest line. The encoding (UTF-8, UTF-16, Windows-1252 or another) is stated by the layout or
//! recognised by the first 64 KiB.
use std::fs::File;
use std::io::{Cursor, Read};
use std::ops::Range;
use std::path::Path;

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::DecodeReaderBytesBuilder;

use crate::error::Problem;
use crate::recording_layout::CsvLayout;

/// Size of the read buffer and so the longest line: what is longer is no CSV.
const BUFFER: usize = 1 << 20;

/// Bytes by which the encoding and the delimiter are recognised.
const SAMPLE: usize = 1 << 16;

/// Lines of a file in a buffer of fixed size.
pub(super) struct Lines {
    text: Box<dyn Read + Send>,
    /// Bytes of the text, as far as the file's size says it.
    length: u64,
    pub(super) buffer: Vec<u8>,
    /// Bytes of the buffer that hold text not yet handed out.
    unread: Range<usize>,
    /// Bytes taken from the text.
    taken: u64,
    ended: bool,
    /// Number of the line handed out last, from 1.
    pub(super) number: u64,
    /// Encoding that was recognised and is not the usual one.
    pub(super) recognised: Option<&'static str>,
}

impl Lines {
    pub(super) fn open(path: &Path, layout: &CsvLayout) -> Result<Self, Problem> {
        let file = File::open(path)?;
        let mut length = file.metadata()?.len();
        let mut head = Vec::new();
        (&file).take(SAMPLE as u64).read_to_end(&mut head)?;
        let stated = layout.encoding.as_deref().map(stated).transpose()?;
        let encoding = stated.unwrap_or_else(|| recognise(&head));
        if encoding == UTF_16LE || encoding == UTF_16BE {
            length /= 2;
        }
        let bytes = Cursor::new(head).chain(file);
        let text: Box<dyn Read + Send> = if encoding == UTF_8 {
            Box::new(bytes)
        } else {
            Box::new(
                DecodeReaderBytesBuilder::new()
                    .encoding(Some(encoding))
                    .bom_sniffing(true)
                    .build(bytes),
            )
        };
        let recognised = (stated.is_none() && encoding != UTF_8).then(|| encoding.name());
        let mut lines = Self {
            text,
            length,
            buffer: vec![0; BUFFER],
            unread: 0..0,
            taken: 0,
            ended: false,
            number: 0,
            recognised,
        };
        lines.fill()?;
        if lines.buffer[lines.unread.clone()].starts_with(b"\xef\xbb\xbf") {
            lines.unread.start += 3;
        }
        Ok(lines)
    }

    /// The text that comes next, up to [`SAMPLE`] bytes of whole lines, without taking it.
    pub(super) fn preview(&mut self) -> Result<&[u8], Problem> {
        while self.unread.len() < SAMPLE && !self.ended {
            self.fill()?;
        }
        let ahead = &self.buffer[self.unread.clone()];
        let ahead = &ahead[..ahead.len().min(SAMPLE)];
        let cut_off = !self.ended || self.unread.len() > SAMPLE;
        let end = memchr::memrchr(b'\n', ahead).filter(|_| cut_off);
        Ok(end.map_or(ahead, |end| &ahead[..end]))
    }

    /// Moves what is unread to the front and reads on behind it.
    fn fill(&mut self) -> Result<(), Problem> {
        self.buffer.copy_within(self.unread.clone(), 0);
        self.unread = 0..self.unread.len();
        loop {
            match self.text.read(&mut self.buffer[self.unread.end..]) {
                Ok(count) => {
                    self.unread.end += count;
                    self.taken += count as u64;
                    self.ended = count == 0;
                    return Ok(());
                }
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e.into()),
            }
        }
    }

    /// The next line without its end, as a range of the buffer.
    pub(super) fn next(&mut self) -> Result<Option<Range<usize>>, Problem> {
        let mut searched = 0;
        let (length, end) = loop {
            let unread = &self.buffer[self.unread.clone()];
            if let Some(length) = memchr::memchr(b'\n', &unread[searched..]) {
                break (searched + length, 1);
            }
            searched = unread.len();
            if self.ended {
                if searched == 0 {
                    return Ok(None);
                }
                break (searched, 0);
            }
            if searched == BUFFER {
                return Err(Problem::LineTooLong {
                    line: self.number + 1,
                    limit: BUFFER,
                });
            }
            self.fill()?;
        };
        self.number += 1;
        let start = self.unread.start;
        let line = &self.buffer[start..start + length];
        let without_return = line.strip_suffix(b"\r").unwrap_or(line).len();
        self.unread.start += length + end;
        Ok(Some(start..start + without_return))
    }

    pub(super) fn at_end(&mut self) -> bool {
        if self.unread.is_empty() && !self.ended {
            // An error to read shows again when the next line is asked for.
            let _ = self.fill();
        }
        self.unread.is_empty()
    }

    pub(super) fn progress(&self) -> f64 {
        let used = self.taken.saturating_sub(self.unread.len() as u64);
        (used as f64 / self.length.max(1) as f64).min(1.0)
    }
}

/// The encoding of that name.
fn stated(name: &str) -> Result<&'static Encoding, Problem> {
    Encoding::for_label(name.as_bytes()).ok_or_else(|| Problem::Layout {
        field: "encoding",
        found: format!("{name:?}"),
        allowed: "utf-8, utf-16le, utf-16be, windows-1252 or another name of the WHATWG Encoding \
                  Standard",
    })
}

/// The encoding of a text that begins with `head`: by its byte order mark, by
/// every other byte of its first line being zero, else UTF-8 where all of it is,
/// or some of its characters beyond ASCII, else Windows-1252.
fn recognise(head: &[u8]) -> &'static Encoding {
    if let Some((encoding, _)) = Encoding::for_bom(head) {
        return encoding;
    }
    let line = &head[..memchr::memchr(b'\n', head).unwrap_or(head.len())];
    let zero = |from: usize| {
        let mut each = line.iter().skip(from).step_by(2);
        line.len() >= 4 && each.all(|b| *b == 0)
    };
    if zero(1) && !zero(0) {
        UTF_16LE
    } else if zero(0) && !zero(1) {
        UTF_16BE
    } else if line.contains(&0) || is_utf8(head) || line.iter().any(|b| is_control(*b)) {
        UTF_8
    } else {
        WINDOWS_1252
    }
}

/// A byte that no line of text has.
fn is_control(byte: u8) -> bool {
    byte < 0x20 && !matches!(byte, b'\t' | b'\r' | 0x0c)
}

/// Whether it is UTF-8, up to a character cut off at its end, or has characters that only UTF-8
/// makes of several bytes.
fn is_utf8(head: &[u8]) -> bool {
    let is_whole = match std::str::from_utf8(head) {
        Ok(_) => true,
        Err(error) => error.error_len().is_none(),
    };
    is_whole || head.utf8_chunks().any(|chunk| !chunk.valid().is_ascii())
}
