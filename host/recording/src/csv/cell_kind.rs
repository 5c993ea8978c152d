//! Converts one text cell to f64 by the kind of its column (`Kind`: number, Boolean, timestamp,
//! duration), in s for times; timestamps count from the first row. `recognise` finds the kind of a
//! column from its first cells.
use std::cell::Cell as Remembered;

use chrono::{DateTime, FixedOffset, NaiveDateTime};

use super::number;
use crate::recording_layout::{ChannelLayout, ColumnType};

/// How the cells of a column are read.
#[derive(Debug)]
pub(crate) enum Kind {
    Number,
    Boolean,
    /// Seconds since the first row.
    Timestamp {
        /// As `strftime` has it; ISO 8601 where none.
        format: Option<String>,
        /// The first row's.
        origin: Remembered<Option<Stamp>>,
    },
    /// Seconds of `hours:minutes:seconds`.
    Duration,
}

impl Kind {
    pub(crate) fn of(kind: ColumnType, layout: Option<&ChannelLayout>) -> Self {
        match kind {
            ColumnType::Number => Self::Number,
            ColumnType::Boolean => Self::Boolean,
            ColumnType::Timestamp => Self::Timestamp {
                format: layout.and_then(|layout| layout.format.clone()),
                origin: Remembered::new(None),
            },
            ColumnType::Duration => Self::Duration,
        }
    }

    /// The unit that the values have by their kind.
    pub(crate) fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Number => None,
            Self::Boolean => Some("1"),
            Self::Timestamp { .. } | Self::Duration => Some("s"),
        }
    }

    /// What such a cell may hold.
    pub(crate) fn allowed(&self) -> &'static str {
        match self {
            Self::Number => {
                "a number, or nothing where the sample is missing (`missing` under [recording] lists \
                 texts that stand for that)"
            }
            Self::Boolean => "true or false, or nothing where the sample is missing",
            Self::Timestamp { format: None, .. } => {
                "a timestamp such as 2026-03-31T12:00:00.002, with a zone in each row or in none (`format` \
                 of the channel under [recording.channels] reads others)"
            }
            Self::Timestamp { .. } => {
                "a timestamp as `format` under [recording.channels] has it, with a zone in each row \
                 or in none"
            }
            Self::Duration => "hours:minutes:seconds",
        }
    }

    /// The value of a cell; none where it holds none.
    pub(crate) fn value(&self, cell: &[u8], decimal_comma: bool) -> Option<f64> {
        if let Self::Number = self {
            return number::parse(cell, decimal_comma);
        }
        let text = std::str::from_utf8(cell).ok()?;
        match self {
            Self::Number => None,
            Self::Boolean => boolean(text),
            Self::Duration => duration(text),
            Self::Timestamp { format, origin } => {
                let stamp = timestamp(text, format.as_deref())?;
                let first = origin.get().unwrap_or(stamp);
                origin.set(Some(first));
                // Without a zone the clock is unknown, and so is its distance to one with.
                let elapsed_ns = stamp.ns.checked_sub(first.ns)?;
                (stamp.has_zone == first.has_zone).then(|| elapsed_ns as f64 / 1e9)
            }
        }
    }
}

/// The kind of a column that has these cells, blank ones left out.
pub(super) fn recognise(cells: &[&[u8]]) -> ColumnType {
    let all = |parse: &dyn Fn(&str) -> bool| {
        let mut texts = cells.iter().map(|cell| std::str::from_utf8(cell));
        texts.all(|text| text.is_ok_and(parse))
    };
    if cells.is_empty() {
        ColumnType::Number
    } else if all(&|text| boolean(text).is_some()) && !all(&|text| text == "0" || text == "1") {
        ColumnType::Boolean
    } else if all(&|text| timestamp(text, None).is_some()) {
        ColumnType::Timestamp
    } else if all(&|text| duration(text).is_some()) {
        ColumnType::Duration
    } else if all(&is_date_and_time) {
        // In an order that only `format` can say.
        ColumnType::Timestamp
    } else {
        ColumnType::Number
    }
}

fn boolean(text: &str) -> Option<f64> {
    /// Texts of 1, in any case.
    const TRUE: [&str; 4] = ["true", "on", "yes", "1"];
    /// Texts of 0, in any case.
    const FALSE: [&str; 4] = ["false", "off", "no", "0"];
    let is = |words: [&str; 4]| words.iter().any(|word| text.eq_ignore_ascii_case(word));
    match text.as_bytes() {
        _ if is(TRUE) => Some(1.0),
        _ if is(FALSE) => Some(0.0),
        _ => None,
    }
}

/// A point in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stamp {
    /// Nanoseconds since 1970, where the text has no zone those of its clock.
    ns: i64,
    has_zone: bool,
}

/// Dates and times of day that are recognised; a zone may follow.
const FORMS: [&str; 8] = [
    "%Y-%m-%dT%H:%M:%S%.f",
    "%Y-%m-%d %H:%M:%S%.f",
    "%Y/%m/%dT%H:%M:%S%.f",
    "%Y/%m/%d %H:%M:%S%.f",
    "%d.%m.%YT%H:%M:%S%.f",
    "%d.%m.%Y %H:%M:%S%.f",
    "%Y%m%dT%H%M%S%.f",
    "%Y%m%dT%H:%M:%S%.f",
];

fn timestamp(text: &str, format: Option<&str>) -> Option<Stamp> {
    let text = &*text.replace(',', ".");
    if let Some(format) = format {
        let zoned = DateTime::parse_from_str(text, format).map(|stamp| stamp.to_utc());
        let has_zone = zoned.is_ok();
        let plain = || NaiveDateTime::parse_from_str(text, format).map(|stamp| stamp.and_utc());
        let ns = zoned.or_else(|_| plain()).ok()?.timestamp_nanos_opt()?;
        return Some(Stamp { ns, has_zone });
    }
    // A date of eight digits first: years have four, and no number is written so.
    let digits = |from: &str| from.bytes().filter(u8::is_ascii_digit).count();
    let is_compact = text.get(8..9) == Some("T");
    if digits(text.get(..if is_compact { 8 } else { 10 })?) != 8 {
        return None;
    }
    let parsed = |form| NaiveDateTime::parse_and_remainder(text, form).ok();
    let (stamp, zone) = FORMS.into_iter().find_map(parsed)?;
    let has_zone = !zone.is_empty();
    let offset_s = if has_zone {
        zone_s(zone.trim_start())?
    } else {
        0
    };
    let ns = stamp.and_utc().timestamp_nanos_opt()?;
    Some(Stamp {
        ns: ns.checked_sub(i64::from(offset_s) * 1_000_000_000)?,
        has_zone,
    })
}

/// Seconds by which a zone is ahead of UTC.
fn zone_s(zone: &str) -> Option<i32> {
    let offset = |zone: &str| zone.parse::<FixedOffset>().ok();
    match zone {
        "Z" | "z" | "UTC" | "GMT" => Some(0),
        _ => offset(zone)
            .or_else(|| offset(&format!("{zone}:00")))
            .map(|offset| offset.local_minus_utc()),
    }
}

/// Whether a text is a date and a time of day, such as `03/31/2026 1:30:00 PM`.
fn is_date_and_time(text: &str) -> bool {
    let digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let Some((date, clock)) = text.split_once([' ', 'T']) else {
        return false;
    };
    let date: Vec<&str> = date.split(['/', '-', '.']).collect();
    let clock = clock.split_once(':').map(|(hours, _)| hours);
    date.len() == 3 && date.into_iter().all(digits) && clock.is_some_and(digits)
}

/// Seconds of `12:34:56.789`, before it days as `1 days 12:34:56.789`.
fn duration(text: &str) -> Option<f64> {
    let (negative, text) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text),
    };
    let (days, clock) = match text.split_once(' ') {
        Some((days, rest)) => {
            let rest = rest.trim_start();
            let clock = rest.strip_prefix("days").or(rest.strip_prefix("day"))?;
            (days.parse::<u32>().ok()?, clock.trim_start())
        }
        None => (0, text),
    };
    let mut parts = clock.split(':');
    let hours: u32 = parts.next()?.parse().ok()?;
    let minutes: u32 = parts.next()?.parse().ok().filter(|m| *m < 60)?;
    let (whole, decimals) = seconds(parts.next()?)?;
    if parts.next().is_some() {
        return None;
    }
    let minutes = (u64::from(days) * 24 + u64::from(hours)) * 60 + u64::from(minutes);
    // Whole nanoseconds and one division: the nearest number to the decimal.
    let value = (minutes as f64 * 60e9 + whole as f64 * 1e9 + decimals as f64) / 1e9;
    Some(if negative { -value } else { value })
}

/// Whole seconds below 60 and nanoseconds.
fn seconds(text: &str) -> Option<(u64, u64)> {
    let (whole, decimals) = text.split_once(['.', ',']).unwrap_or((text, ""));
    let is_digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty() || whole.len() > 2 || !is_digits(whole) || !is_digits(decimals) {
        return None;
    }
    let nanoseconds = format!("{decimals:0<9}");
    let nanoseconds = nanoseconds.get(..9)?.parse().ok()?;
    Some((whole.parse().ok().filter(|s| *s < 60)?, nanoseconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_of_the_trade() {
        let second = timestamp("2026-03-31T12:00:00", None).unwrap().ns;
        let ns = |text: &str, format| timestamp(text, format).map(|stamp| stamp.ns);
        for text in [
            "2026-03-31 12:00:00.002",
            "2026-03-31T12:00:00,002",
            "2026-03-31T12:00:00.002Z",
            "2026-03-31T14:00:00.002+02:00",
            "2026-03-31T14:00:00.002+0200",
            "2026-03-31T14:00:00.002+02",
            "2026-03-31 14:00:00.002 +02:00",
            "2026-03-31 12:00:00.002 UTC",
            "2026-03-31 12:00:00.002Z",
            "2026/03/31 12:00:00.002",
            "20260331T120000.002Z",
            "20260331T120000.002",
            "31.03.2026 12:00:00,002",
        ] {
            assert_eq!(ns(text, None), Some(second + 2_000_000), "{text}");
        }
        let american = ns("03/31/2026 12:00:00.002", Some("%m/%d/%Y %H:%M:%S%.f"));
        assert_eq!(american, Some(second + 2_000_000));
        for text in [
            "03/31/2026 12:00:00",
            "12:00:00",
            "1.5",
            "",
            "2026-13-01 00:00:00",
            "20260331",
        ] {
            assert_eq!(timestamp(text, None), None, "{text}");
        }
    }

    #[test]
    fn durations_of_the_trade() {
        assert_eq!(duration("0 days 00:00:00.002000"), Some(0.002));
        assert_eq!(duration("01:02:03,5"), Some(3723.5));
        assert_eq!(duration("1 day 00:00:01"), Some(86401.0));
        assert_eq!(duration("-00:00:01"), Some(-1.0));
        for text in ["1:2", "12:61:00", "1.5", "a:b:c", "", "1:2:3:4"] {
            assert_eq!(duration(text), None, "{text}");
        }
    }

    #[test]
    fn kind_of_a_column() {
        let kind = |cells: &[&str]| {
            let cells: Vec<&[u8]> = cells.iter().map(|c| c.as_bytes()).collect();
            recognise(&cells)
        };
        assert_eq!(kind(&["0", "1"]), ColumnType::Number);
        assert_eq!(kind(&["False", "TRUE"]), ColumnType::Boolean);
        assert_eq!(kind(&["00:00:00.1", "00:00:00.2"]), ColumnType::Duration);
        assert_eq!(kind(&["2026-03-31 12:00:00", "x"]), ColumnType::Number);
        assert_eq!(kind(&[]), ColumnType::Number);
        // Which of them is the month, only `format` says.
        let american = ["03/31/2026 01:00:00 PM", "03/31/2026 01:00:01 PM"];
        assert_eq!(kind(&american), ColumnType::Timestamp);
        let cell = Kind::of(ColumnType::Timestamp, None);
        assert_eq!(cell.value(american[0].as_bytes(), false), None);
        assert_eq!(cell.value(b"2026-03-31 12:00:00", false), Some(0.0));
        assert_eq!(cell.value(b"2026-03-31 12:00:01", false), Some(1.0));
        // A zone in this row only.
        assert_eq!(cell.value(b"2026-03-31 12:00:01Z", false), None);
    }
}
