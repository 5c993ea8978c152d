//! Builds the TOML text of a draft description (`Text`): tables, fields and comments; each value
//! that is to be filled in is marked with a comment and counted. Also formats numbers and texts in
//! TOML.

use std::fmt::Display;

/// What stands above a value that is to be filled in.
pub const MARK: &str = "# TO FILL IN: ";

/// Columns of a comment.
const COLUMNS: usize = 110;

/// A description while it is written.
#[derive(Debug, Default)]
pub(super) struct Text {
    text: String,
    marks: usize,
}

impl Text {
    /// A line.
    pub(super) fn line(&mut self, line: impl Display) {
        self.text += &format!("{line}\n");
    }

    /// An empty line and a line.
    pub(super) fn table(&mut self, header: impl Display) {
        self.text += &format!("\n{header}\n");
    }

    /// A comment, on as many lines as it needs.
    pub(super) fn comment(&mut self, text: impl Display) {
        self.wrapped("# ", &text.to_string());
    }

    /// A field.
    pub(super) fn set(&mut self, key: &str, value: impl Display) {
        self.line(format_args!("{key} = {value}"));
    }

    /// Marks what follows as to be filled in.
    pub(super) fn mark(&mut self, what: impl Display) {
        self.marks += 1;
        self.wrapped(MARK, &what.to_string());
    }

    /// A field that is to be filled in, with a value that is allowed until then.
    pub(super) fn fill_in(&mut self, key: &str, value: impl Display, what: impl Display) {
        self.mark(what);
        self.set(key, value);
    }

    /// A field that is to be filled in where it was not found.
    pub(super) fn set_or_fill_in(
        &mut self,
        key: &str,
        found: Option<impl Display>,
        otherwise: impl Display,
        what: impl Display,
    ) {
        match found {
            Some(value) => self.set(key, value),
            None => self.fill_in(key, otherwise, what),
        }
    }

    fn wrapped(&mut self, begin: &str, text: &str) {
        let mut line = begin.to_owned();
        let mut is_empty = true;
        for word in text.split_whitespace() {
            if !is_empty && line.chars().count() + word.chars().count() > COLUMNS {
                self.line(line.trim_end());
                "# ".clone_into(&mut line);
            }
            line += word;
            line.push(' ');
            is_empty = false;
        }
        self.line(line.trim_end());
    }

    /// The text and the number of places to fill in.
    pub(super) fn finish(self) -> (String, usize) {
        (self.text, self.marks)
    }
}

/// A text in TOML.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A number with three significant digits, or more where it is whole.
pub(super) fn number(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e9 {
        return format!("{value:.0}");
    }
    in_toml(format!("{value:.2e}").parse().unwrap_or(value))
}

/// A number with all of its digits; one that is small or large with an exponent.
pub(super) fn in_toml(value: f64) -> String {
    if (1e-3..1e6).contains(&value.abs()) {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}

/// The same rounded up to two digits.
pub(super) fn rounded_up(value: f64) -> String {
    if value <= 0.0 || !value.is_finite() {
        return "1".into();
    }
    let unit = 10.0_f64.powf(value.log10().floor() - 1.0);
    number((value / unit * (1.0 - 1e-9)).ceil() * unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_toml() {
        for (value, expected) in [
            (500.0, "500"),
            (0.31234, "0.312"),
            (-2.346e-7, "-2.35e-7"),
            (1.5e12, "1.5e12"),
        ] {
            assert_eq!(number(value), expected);
            toml::from_str::<toml::Table>(&format!("a = {expected}")).unwrap();
        }
        assert_eq!(rounded_up(311_878.0), "320000");
        assert_eq!(rounded_up(0.031), "0.031");
        assert_eq!(rounded_up(0.0), "1");
        assert_eq!(quoted("a \"b\""), "'a \"b\"'");
    }
}
