//! Parses the lines of TRC files, versions 1.0 to 2.1, the text log of CAN buses by PEAK's tools,
//! into frames with time and bus. The version, or the file's list of columns, states what each word
//! of a line is.
//!
//! `     1)       0.200  1  Rx        0109  -  8    2C CB ...` (1.3) or `      1       0.200 DT  1
//! 0109 Rx -  8    2C CB ...` (2.1, by `;$COLUMNS=N,O,T,B,I,d,R,L,D`).

use super::line_parsing::{Line, Parsed, bytes_of, hex, time_us};
use crate::bus_frame::{BusFrame, FrameKind};

/// Reads lines.
#[derive(Debug)]
pub(super) struct Trc {
    /// Letters of the columns: `N` number, `O` offset (ms), `T` type, `B` bus, `I` identifier, `d`
    /// direction, `R` reserved, `l` length, `L` length code, `D` data.
    columns: String,
}

impl Trc {
    /// A reader for a log that begins with `lines`; none where it is none.
    pub(super) fn of(lines: &[&str]) -> Option<Self> {
        let first = lines.first()?.trim_start();
        first.starts_with(';').then(|| Self {
            columns: columns_of("1.0").into(),
        })
    }

    pub(super) fn parse(&mut self, line: &str) -> Parsed {
        let line = line.trim();
        if let Some(comment) = line.strip_prefix(';') {
            if let Some(version) = comment.strip_prefix("$FILEVERSION=") {
                self.columns = columns_of(version.trim()).into();
            } else if let Some(columns) = comment.strip_prefix("$COLUMNS=") {
                self.columns = columns.chars().filter(char::is_ascii_alphabetic).collect();
            }
            return Parsed::Other;
        }
        if line.is_empty() {
            return Parsed::Other;
        }
        self.message(line).unwrap_or(Parsed::Malformed)
    }

    fn message(&self, line: &str) -> Option<Parsed> {
        let row = self.row(line)?;
        let flags = match row.kind {
            "DT" | "RR" => None,
            "FD" => Some(0),
            "FB" => Some(1),
            "FE" => Some(2),
            "BI" => Some(3),
            "ER" => {
                let error = BusFrame::new(FrameKind::Error, 0, false, &[0; 8])?;
                return Some(row.with(error));
            }
            "ST" | "EC" | "EV" => return Some(Parsed::Other),
            _ => return None,
        };
        let id = row.id?;
        let (raw, is_extended) = (hex(id)?, id.len() > 4);
        let count = match row.length? {
            ('L', code) if flags.is_some() => BusFrame::length_of_code(code)?,
            (_, length) => length,
        };
        if row.kind == "RR" || row.data.first() == Some(&"RTR") {
            return Some(row.with(BusFrame::remote(raw, is_extended, count)?));
        }
        let data = bytes_of(row.data.get(..usize::from(count))?.iter().copied(), 16)?;
        let kind = flags.map_or(FrameKind::Data, |flags| FrameKind::Fd { flags });
        Some(row.with(BusFrame::new(kind, raw, is_extended, &data)?))
    }

    /// The cells of a line by the columns.
    fn row<'a>(&self, line: &'a str) -> Option<Cells<'a>> {
        let mut words = line.split_whitespace();
        let mut row = Cells {
            device: "1",
            kind: "DT",
            ..Cells::default()
        };
        for column in self.columns.chars() {
            if column == 'D' {
                row.data = words.by_ref().collect();
                continue;
            }
            let Some(word) = words.next() else { break };
            match column {
                'O' => row.t_us = time_us(word, 1e3)?,
                'B' => row.device = word,
                'T' => row.kind = word,
                'I' => row.id = Some(word),
                'l' | 'L' => row.length = Some((column, word.parse().ok()?)),
                'd' if matches!(word, "Warng" | "Error") => row.kind = "ER",
                'N' => {
                    word.trim_end_matches(')').parse::<u64>().ok()?;
                }
                _ => {}
            }
        }
        Some(row)
    }
}

/// The cells of a line.
#[derive(Debug, Default)]
struct Cells<'a> {
    t_us: u64,
    device: &'a str,
    id: Option<&'a str>,
    kind: &'a str,
    /// Column of the length and its number.
    length: Option<(char, u8)>,
    data: Vec<&'a str>,
}

impl Cells<'_> {
    fn with(&self, frame: BusFrame) -> Parsed {
        Parsed::Frame(Line {
            t_us: self.t_us,
            device: self.device.to_owned(),
            frame,
        })
    }
}

/// The columns of a version, where the file does not list them.
fn columns_of(version: &str) -> &'static str {
    match version {
        "1.1" => "NOdILD",
        "1.2" => "NOBdILD",
        "1.3" => "NOBdIRLD",
        "2.0" => "NOTIdlD",
        "2.1" => "NOTBIdRLD",
        _ => "NOILD",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(trc: &mut Trc, line: &str) -> String {
        match trc.parse(line) {
            Parsed::Frame(line) => format!("{} {} {}", line.t_us, line.device, line.frame),
            other => format!("{other:?}"),
        }
    }

    /// Lines of PEAK CAN TRC File Format, 4.2019.
    #[test]
    fn every_version() {
        for (version, line, expected) in [
            (
                "1.0",
                "     1)      1841 0001  8  00 00 00 00 00 00 00 00",
                "1841000 1 001#0000000000000000",
            ),
            (
                "1.1",
                "     1)      1059.9  Rx         0300  7  00 00 00 00 04 00 00",
                "1059900 1 300#00000000040000",
            ),
            (
                "1.1",
                "     2)      1283.2  Rx         0300  4  RTR",
                "1283200 1 300#R4",
            ),
            (
                "1.1",
                "     3)      1298.9  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY",
                "1298900 1 20000000#0000000000000000",
            ),
            (
                "1.2",
                "     1)      1059.900 1  Rx         0300  7  00 00 00 00 04 00 00",
                "1059900 1 300#00000000040000",
            ),
            (
                "1.3",
                "     1)      1059.900 1  Rx        0300 -  7    00 00 00 00 04 00 00",
                "1059900 1 300#00000000040000",
            ),
            (
                "1.3",
                "     5)      1323.354 1  Tx    18EFC034 -  8    01 02 03 04 05 06 07 08",
                "1323354 1 18EFC034#0102030405060708",
            ),
            (
                "2.0",
                "      1      1059.900 DT     0300 Rx 7  00 00 00 00 04 00 00",
                "1059900 1 300#00000000040000",
            ),
            (
                "2.0",
                "      6      1334.416 FD     0500 Tx 12 01 02 03 04 05 06 07 08 09 0A 0B 0C",
                "1334416 1 500##00102030405060708090A0B0C",
            ),
            (
                "2.1",
                "      1      1059.900 DT 1      0300 Rx -  7    00 00 00 00 04 00 00",
                "1059900 1 300#00000000040000",
            ),
            (
                "2.1",
                "      6      1334.416 FB 2      0500 Tx -  9    01 02 03 04 05 06 07 08 09 0A 0B 0C",
                "1334416 2 500##10102030405060708090A0B0C",
            ),
            (
                "2.1",
                "      8      1334.522 ER 1         - Rx -  5    04 00 02 00 00",
                "1334522 1 20000000#0000000000000000",
            ),
            (
                "2.1",
                "      9      1334.522 ST 1         - Rx -  4    00 00 00 08",
                "Other",
            ),
            (
                "2.1",
                "      1      1059.900 DT 1      0300 Rx -  7    00 00",
                "Malformed",
            ),
        ] {
            let mut trc = Trc::of(&[";"]).unwrap();
            assert_eq!(
                trc.parse(&format!(";$FILEVERSION={version}")),
                Parsed::Other
            );
            assert_eq!(shown(&mut trc, line), expected, "{version} {line}");
        }
        assert!(Trc::of(&["(1.0) can0 501#00"]).is_none());
    }
}
