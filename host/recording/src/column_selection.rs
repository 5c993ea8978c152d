//! Finds the wanted columns among those of a recording (`Selection`): index, conversion to the
//! wanted unit, and role of each, and the time. A required column that is missing, and one that is
//! there twice or has no convertible unit, is an error.
use super::error::Problem;
use super::recording_layout::{Column, CsvLayout, Role, Wanted};
use super::unit::{Conversion, Unit};
use super::{TIME, shown};

/// Which columns of a file to read, and how to convert them.
pub(super) struct Selection {
    /// Columns of the file, each once, the time first.
    pub(super) picks: Vec<usize>,
    /// For the time.
    pub(super) time: Conversion,
    /// For each wanted column, its index among the picks.
    pub(super) order: Vec<Option<(usize, Conversion)>>,
    /// What each pick is.
    pub(super) roles: Vec<Role>,
    /// Picks that are read as counts, and their names.
    pub(super) counts: Vec<(usize, String)>,
}

impl Selection {
    /// `roles`: those of the wanted columns, in their order; continuous where
    /// there are fewer.
    pub(super) fn try_new(
        columns: &[Column],
        wanted: &[Wanted<'_>],
        roles: &[Role],
        layout: &CsvLayout,
    ) -> Result<Self, Problem> {
        let find = |name: &str| {
            let mut same = (0..columns.len()).filter(|&i| columns[i].name == name);
            match (same.next(), same.next()) {
                (Some(i), None) => Ok(i),
                (Some(_), Some(_)) => Err(Problem::Duplicate { name: shown(name) }),
                (None, _) => Err(missing(columns, name, layout)),
            }
        };
        let time = find(TIME)?;
        let mut selection = Self {
            picks: vec![time],
            time: conversion(&columns[time], Unit::SECOND)?,
            order: Vec::with_capacity(wanted.len()),
            roles: vec![Role::Continuous],
            counts: Vec::new(),
        };
        for (k, w) in wanted.iter().enumerate() {
            let role = roles.get(k).copied().unwrap_or_default();
            let place = match find(w.name) {
                Ok(i) if role == Role::Pulse => Some((selection.pick(i, role), Conversion::Same)),
                Ok(i) => Some((selection.pick(i, role), conversion(&columns[i], w.unit)?)),
                Err(Problem::Missing { .. }) if !w.required => None,
                Err(problem) => return Err(problem),
            };
            if let Some((pick, _)) = place
                && w.unit == Unit::COUNTS
            {
                selection.counts.push((pick, shown(w.name)));
            }
            selection.order.push(place);
        }
        Ok(selection)
    }

    /// Index of the column among the picks.
    fn pick(&mut self, column: usize, role: Role) -> usize {
        let known = self.picks.iter().position(|&p| p == column);
        known.unwrap_or_else(|| {
            self.picks.push(column);
            self.roles.push(role);
            self.picks.len() - 1
        })
    }
}

fn conversion(column: &Column, wanted: Unit) -> Result<Conversion, Problem> {
    let name = || shown(&column.name);
    let allowed = || {
        let symbols: Vec<_> = wanted.quantity().symbols().collect();
        format!("a unit of {} ({})", wanted.quantity(), symbols.join(", "))
    };
    let Some(text) = &column.unit else {
        return Err(Problem::NoUnit {
            column: name(),
            allowed: allowed(),
        });
    };
    text.parse::<Unit>()
        .ok()
        .and_then(|unit| unit.conversion_to(wanted))
        .ok_or_else(|| Problem::WrongUnit {
            column: name(),
            found: shown(text),
            allowed: allowed(),
        })
}

/// `channel`: its name; in the file it may have another.
fn missing(columns: &[Column], channel: &str, layout: &CsvLayout) -> Problem {
    /// Columns that a message lists.
    const LISTED: usize = 20;
    let name = layout.column_of(channel);
    let mut found: Vec<_> = columns
        .iter()
        .filter(|c| !c.name.is_empty())
        .take(LISTED)
        .map(|c| shown(&c.name))
        .collect();
    if columns.len() > LISTED {
        found.push(format!("and {} more", columns.len() - LISTED));
    }
    let nearest = columns
        .iter()
        .take(1000)
        .map(|c| {
            let is_same = c.name.eq_ignore_ascii_case(name);
            let likeness = strsim::jaro_winkler(&c.name, name);
            (if is_same { 1.0 } else { likeness }, c)
        })
        .filter(|(likeness, _)| *likeness > 0.81)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| shown(&c.name));
    Problem::Missing {
        is_time: channel == TIME,
        column: if name == channel {
            format!("`{}`", shown(name))
        } else {
            format!("`{}` of the channel `{}`", shown(name), shown(channel))
        },
        found: found.join(", "),
        nearest,
    }
}
