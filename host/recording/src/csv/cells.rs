//! Splits a line of text into cells at the delimiter, and calls a function with each cell, trimmed
//! and unquoted (`Cells`).

/// How a line is divided.
#[derive(Clone, Copy)]
pub(super) struct Cells {
    pub(super) delimiter: u8,
}

impl Cells {
    /// Calls `each` with every cell, trimmed and unquoted; returns their number.
    pub(super) fn each(self, line: &[u8], mut each: impl FnMut(usize, &[u8])) -> usize {
        if memchr::memchr(b'"', line).is_some() {
            return self.quoted(line, each);
        }
        let (mut start, mut count) = (0, 0);
        for end in memchr::memchr_iter(self.delimiter, line) {
            each(count, line[start..end].trim_ascii());
            start = end + 1;
            count += 1;
        }
        each(count, line[start..].trim_ascii());
        count + 1
    }

    #[cold]
    fn quoted(self, line: &[u8], mut each: impl FnMut(usize, &[u8])) -> usize {
        let mut record = csv::ByteRecord::new();
        // One line of memory cannot fail to be read, and has one record at
        // most; where it has none there are no cells.
        let _ = csv::ReaderBuilder::new()
            .delimiter(self.delimiter)
            .has_headers(false)
            .trim(csv::Trim::All)
            .from_reader(line)
            .read_byte_record(&mut record);
        for (i, cell) in record.iter().enumerate() {
            each(i, cell);
        }
        record.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_and_plain_cells_are_the_same() {
        for line in [&b"1, 2 ,,x"[..], b"\"1\",\" 2 \",,\"x\""] {
            let mut cells = Vec::new();
            let comma = Cells { delimiter: b',' };
            assert_eq!(comma.each(line, |_, c| cells.push(c.to_vec())), 4);
            assert_eq!(cells, [&b"1"[..], b"2", b"", b"x"]);
        }
    }
}
