//! Parses the number in a text cell to f64, with decimal point or decimal comma (`parse`). Numbers
//! with separators between thousands are not parsed; `is_grouped` recognises them for the error
//! message.

/// The number in a cell; none where there is no number.
pub(super) fn parse(cell: &[u8], decimal_comma: bool) -> Option<f64> {
    if decimal_comma {
        parse_decimal_comma(cell)
    } else {
        parse_number(cell)
    }
}

/// Whether a number has separators between thousands: `1,234.5`, `1.234,5`, `1'234.5`.
pub(super) fn is_grouped(cell: &[u8]) -> bool {
    let digits = cell.strip_prefix(b"-").unwrap_or(cell);
    let is_part = |b: &u8| b.is_ascii_digit() || matches!(b, b',' | b'.' | b'\'');
    let separators = digits.iter().filter(|b| !b.is_ascii_digit());
    let both = digits.contains(&b',') && digits.contains(&b'.');
    let apostrophe = digits.contains(&b'\'');
    digits.iter().all(is_part) && separators.count() > 0 && (both || apostrophe)
}

/// Whether the comma of a number may stand between thousands: `312,031`, not `0,031`.
pub(super) fn may_be_thousands(cell: &[u8]) -> bool {
    let digits = cell.strip_prefix(b"-").unwrap_or(cell);
    let [whole @ .., b',', a, b, c] = digits else {
        return false;
    };
    let is_number = |part: &[u8]| part.iter().all(u8::is_ascii_digit);
    (1..=3).contains(&whole.len())
        && whole[0] != b'0'
        && is_number(whole)
        && is_number(&[*a, *b, *c])
}

fn parse_number(cell: &[u8]) -> Option<f64> {
    parse_short(cell).or_else(|| std::str::from_utf8(cell).ok()?.parse().ok())
}

/// A plain decimal of at most 15 digits, such as recorders write: its digits as
/// an integer and the power of ten are exact in f64, so that one division
/// rounds as the full parser does, in a third of the time.
///
/// Source: Clinger 1990, How to read floating point numbers accurately.
fn parse_short(cell: &[u8]) -> Option<f64> {
    /// Powers of ten that f64 holds exactly, up to the digits of a short number.
    const POWERS: [f64; 16] = [
        1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
    ];
    let (negative, digits) = match cell {
        [b'-', rest @ ..] => (true, rest),
        rest => (false, rest),
    };
    // 15 digits and the point.
    if digits.is_empty() || digits.len() > 16 {
        return None;
    }
    let mut whole = 0_u64;
    let mut point = None;
    for (i, &byte) in digits.iter().enumerate() {
        let digit = byte.wrapping_sub(b'0');
        if digit <= 9 {
            whole = whole * 10 + u64::from(digit);
        } else if byte == b'.' && point.is_none() {
            point = Some(i);
        } else {
            return None;
        }
    }
    let decimals = match point {
        Some(i) if digits.len() > 1 => digits.len() - 1 - i,
        None if digits.len() < 16 => 0,
        _ => return None,
    };
    let value = whole as f64 / POWERS[decimals];
    Some(if negative { -value } else { value })
}

fn parse_decimal_comma(cell: &[u8]) -> Option<f64> {
    if cell.contains(&b'.') {
        return None;
    }
    // Longer than any number that a recorder writes.
    let mut copy = [0; 64];
    let copy = copy.get_mut(..cell.len())?;
    copy.copy_from_slice(cell);
    if let Some(comma) = copy.iter().position(|&b| b == b',') {
        copy[comma] = b'.';
    }
    parse_number(copy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_between_thousands_are_known() {
        for text in ["1,234.5", "-312.031,2", "312'031.2", "1'000"] {
            assert!(is_grouped(text.as_bytes()), "{text}");
        }
        for text in ["1,5", "1.5", "-3", "", "1.5 m", "a.b,c"] {
            assert!(!is_grouped(text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn decimal_comma() {
        assert_eq!(parse_decimal_comma(b"-1,25e-3"), Some(-1.25e-3));
        assert_eq!(parse_decimal_comma(b"1.5"), None);
        assert_eq!(parse_decimal_comma(b"1,000,5"), None);
        assert_eq!(parse_decimal_comma(&[b'1'; 100]), None);
    }

    proptest::proptest! {
        #[test]
        fn short_decimals_are_those_of_the_full_parser(
            text in "-?[0-9]{0,9}\\.?[0-9]{0,9}|[-+.0-9e]{0,6}"
        ) {
            let full = text.parse::<f64>().ok().map(f64::to_bits);
            if let Some(value) = parse_short(text.as_bytes()) {
                proptest::prop_assert_eq!(Some(value.to_bits()), full, "{}", text);
            }
            proptest::prop_assert_eq!(parse_number(text.as_bytes()).map(f64::to_bits), full);
        }
    }
}
