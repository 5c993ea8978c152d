//! Checks single fields of a description: range, sign, allowed and unique names. Each function
//! gives a `Violation` with the field, the value found and what is allowed.

use std::fmt::Display;

use super::error::Violation;

/// Result of a check: nothing, or the field that is not allowed.
pub(super) type Checked = Result<(), Violation>;

/// The names of all items, by which other parts of the description refer to them.
pub(super) fn names<T>(items: &[T], name: impl Fn(&T) -> &String) -> Vec<&str> {
    items.iter().map(|item| name(item).as_str()).collect()
}

/// Refuses a field with the value `found`.
pub(super) fn refuse(field: &str, found: impl Display, allowed: &str) -> Checked {
    Err(Violation {
        field: field.into(),
        found: found.to_string(),
        allowed: allowed.into(),
    })
}

/// Refuses a field unless `is`.
pub(super) fn within(field: &str, found: impl Display, is: bool, allowed: &str) -> Checked {
    if is {
        Ok(())
    } else {
        refuse(field, found, allowed)
    }
}

/// Largest value of a description, in its unit: the estimator squares it in single precision.
const LARGEST: f64 = 1e18;

pub(super) fn finite(field: &str, value: f64) -> Checked {
    let is = value.abs() <= LARGEST;
    within(field, value, is, "a number of at most 1e18 in size")
}

pub(super) fn positive(field: &str, value: f64) -> Checked {
    let is = (1.0 / LARGEST..=LARGEST).contains(&value);
    within(field, value, is, "> 0 (1e-18 to 1e18)")
}

pub(super) fn nonzero(field: &str, value: f64) -> Checked {
    within(
        field,
        value,
        (1.0 / LARGEST..=LARGEST).contains(&value.abs()),
        "a number other than 0 (1e-18 to 1e18 in size)",
    )
}

pub(super) fn at_least(field: &str, value: f64, least: f64) -> Checked {
    within(
        field,
        value,
        value >= least && value.is_finite(),
        &format!(">= {least}"),
    )
}

pub(super) fn at_most(field: &str, found: usize, most: usize) -> Checked {
    within(field, found, found <= most, &format!("at most {most}"))
}

pub(super) fn range(field: &str, value: f64, least: f64, most: f64) -> Checked {
    within(
        field,
        value,
        (least..=most).contains(&value),
        &format!("{least} to {most}"),
    )
}

/// Refuses a name that is not among the allowed ones.
pub(super) fn one_of(field: &str, name: &str, allowed: &[&str]) -> Checked {
    within(
        field,
        format!("{name:?}"),
        allowed.contains(&name),
        &listed(allowed),
    )
}

/// Refuses the first name that stands twice in `names` of an array of tables.
pub(super) fn unique(table: &str, names: &[&str]) -> Checked {
    for (i, name) in names.iter().enumerate() {
        let first = names[..i].iter().all(|other| other != name);
        within(
            &format!("{table}[{}].name", i + 1),
            name,
            first,
            "a name that no other one has",
        )?;
    }
    Ok(())
}

/// Names with commas, for a message.
pub(super) fn listed(names: &[&str]) -> String {
    if names.is_empty() {
        "nothing: there is none".into()
    } else {
        names.join(", ")
    }
}
