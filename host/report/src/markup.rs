//! Turns text and table cells of a report into HTML: escapes characters, writes minus signs, and
//! marks columns of words, which are aligned to the left.

use super::Table;
use std::fmt::Write as _;

/// Cells of a row; columns of words stand left.
pub(crate) fn cells(cells: &[String], tag: &str, is_words: &[bool]) -> String {
    let mut html = String::new();
    for (cell, is_words) in cells.iter().zip(is_words) {
        let class = if *is_words { " class=\"words\"" } else { "" };
        // Writing to a String cannot fail.
        let _ = write!(html, "<{tag}{class}>{}</{tag}>", escape(&with_minus(cell)));
    }
    html
}

/// Hyphens before numbers as minus signs, after which no line breaks: `-7.1e-3`, but
/// `torque-arm-3`.
pub(crate) fn with_minus(text: &str) -> String {
    let letters: Vec<char> = text.chars().collect();
    let is_minus = |i: usize| {
        let before = |back: usize| i.checked_sub(back).map(|at| letters[at]);
        let is_first = before(1).is_none_or(|c| c == ' ' || c == '(');
        let is_exponent =
            before(1) == Some('e') && before(2).is_some_and(|c| c.is_ascii_digit() || c == '.');
        let is_number = letters.get(i + 1).is_some_and(char::is_ascii_digit);
        is_number && (is_first || is_exponent)
    };
    (letters.iter().enumerate())
        .map(|(i, c)| {
            if *c == '-' && is_minus(i) {
                '\u{2212}'
            } else {
                *c
            }
        })
        .collect()
}

/// Of each column whether some cell begins with a letter.
pub(crate) fn columns_of_words(table: &Table) -> Vec<bool> {
    let is_words = |column: usize| {
        let mut cells = table.rows.iter().filter_map(|row| row.get(column));
        cells.any(|cell| cell.starts_with(char::is_alphabetic))
    };
    (0..table.head.len()).map(is_words).collect()
}

/// Text as it may stand in an element or a quoted attribute.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minus_signs_are_no_hyphens() {
        assert_eq!(
            with_minus("-7.1e-3 (-1.0 to -0.5)"),
            "−7.1e−3 (−1.0 to −0.5)"
        );
        for text in [
            "torque-arm-3",
            "2026-11-28",
            "drive-1.csv",
            "-",
            "up - down",
        ] {
            assert_eq!(with_minus(text), text);
        }
    }
}
