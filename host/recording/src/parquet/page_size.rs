//! Limits the expanded size of Parquet pages (`Bounded`, the file as the decoder reads it) to four
//! times the stored size and a share of 192 MiB for each column read. A header that states more
//! (it may state 2 GiB) is an error before the decoder allocates that memory.
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};

use bytes::Bytes;
use parquet::errors::{ParquetError, Result};
use parquet::file::reader::{ChunkReader, Length};

/// Memory for expanded pages beyond what the file itself holds, bytes. The
/// decoder holds a dictionary and a page of each column at once.
const BEYOND_THE_FILE: u64 = 192 << 20;

/// A page that every file may have, bytes: writers make pages of 1 MiB.
const USUAL_PAGE: u64 = 2 << 20;

/// A file whose pages expand to no more than it can hold.
pub(super) struct Bounded {
    file: File,
    length: u64,
    /// Largest expanded page beyond four times its size in the file, bytes.
    largest_page: u64,
}

impl Bounded {
    /// A file of which `columns` are read at once.
    pub(super) fn new(file: File, columns: usize) -> Self {
        let share = BEYOND_THE_FILE / (2 * columns.max(1) as u64);
        Self {
            length: Length::len(&file),
            file,
            largest_page: share.max(USUAL_PAGE),
        }
    }

    fn read_from(&self, start: u64) -> Result<BufReader<File>> {
        let mut file = self.file.try_clone()?;
        file.seek(SeekFrom::Start(start))?;
        Ok(BufReader::new(file))
    }
}

impl Length for Bounded {
    fn len(&self) -> u64 {
        self.length
    }
}

impl ChunkReader for Bounded {
    type T = Header;

    /// Only headers of pages are read so: their bodies come by [`Self::get_bytes`], and the footer
    /// was read before.
    fn get_read(&self, start: u64) -> Result<Header> {
        Ok(Header {
            bytes: self.read_from(start)?,
            checked: false,
            largest_page: self.largest_page,
        })
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        let left = self.length.saturating_sub(start);
        if length as u64 > left {
            let text = format!("{length} bytes at {start} where {left} are left");
            return Err(ParquetError::EOF(text));
        }
        let mut bytes = vec![0; length];
        self.read_from(start)?.read_exact(&mut bytes)?;
        Ok(bytes.into())
    }
}

/// The header of a page, checked when it is read.
pub(super) struct Header {
    bytes: BufReader<File>,
    checked: bool,
    largest_page: u64,
}

impl Read for Header {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if !self.checked {
            self.checked = true;
            check(self.bytes.fill_buf()?, self.largest_page)?;
        }
        self.bytes.read(buffer)
    }
}

/// Refuses a page that expands beyond `largest` and beyond four times its size in the file.
fn check(header: &[u8], largest: u64) -> io::Result<()> {
    let Some((expanded, stored)) = sizes(header) else {
        let text = "a page without its sizes";
        return Err(io::Error::new(io::ErrorKind::InvalidData, text));
    };
    if expanded > largest.saturating_add(stored.saturating_mul(4)) {
        let text = format!("a page of {stored} bytes claims to expand to {expanded} bytes");
        return Err(io::Error::new(io::ErrorKind::InvalidData, text));
    }
    Ok(())
}

/// The expanded and the stored size in a page's header: fields 2 and 3 of a
/// struct of the Thrift compact protocol, of type i32 (5), after field 1. Each
/// begins with a byte of the step to its number and its type; numbers are
/// zigzag varints. Every writer puts fields in the order of their numbers.
///
/// Source: Apache Parquet format 2.10, `parquet.thrift`, `PageHeader`.
fn sizes(header: &[u8]) -> Option<(u64, u64)> {
    /// First byte of the next field, of type i32: step of 1 in the upper half, type 5 in the lower.
    const NEXT_I32: u8 = 0x15;
    let mut rest = header;
    let mut number = || {
        let (&kind, after) = rest.split_first()?;
        rest = after;
        if kind != NEXT_I32 {
            return None;
        }
        let mut value = 0_u64;
        for place in 0..5 {
            let (&byte, after) = rest.split_first()?;
            rest = after;
            value |= u64::from(byte & 0x7f) << (7 * place);
            if byte & 0x80 == 0 {
                let negative = value & 1 == 1;
                return (!negative).then_some(value >> 1);
            }
        }
        None
    };
    let _kind = number()?;
    let expanded = number()?;
    Some((expanded, number()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_a_page_by_hand() {
        // Type 0, 300 bytes expanded, 25 bytes stored.
        let header = [0x15, 0, 0x15, 0xd8, 0x04, 0x15, 50, 0x2c];
        assert_eq!(sizes(&header), Some((300, 25)));
        assert!(check(&header, 200).is_ok());
        assert!(check(&header, 199).is_err());
        // Cut off, of another type, negative, and longer than 32 bits.
        assert_eq!(sizes(&header[..4]), None);
        assert_eq!(sizes(&[0x15, 0, 0x16, 0, 0x15, 0]), None);
        assert_eq!(sizes(&[0x15, 0, 0x15, 1, 0x15, 0]), None);
        assert_eq!(sizes(&[0x15, 0x81, 0x81, 0x81, 0x81, 0x81, 0x81, 0]), None);
    }
}
