//! Scores the benchmark: one row for each recording (`Row`, a line of the CSV that `main.rs`
//! writes), with true and named effects; over all rows (`Score`) the rates, which effect was taken
//! for which, the part of the improvement that was recovered, and the wrong answers, as text.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::cases::{Kind, STRONG};
use crate::rate::Rate;

/// One recording, its true effects and its diagnosis.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    pub number: usize,
    pub machine: usize,
    pub kind: Kind,
    pub profile: String,
    /// The profile drawn at first, in which the recording may not have shown its effects.
    pub drawn: String,
    /// Effects as `name=strength`, spaces between.
    pub truth: String,
    /// Whether the recording differs from the same one without each of the effects.
    pub shows: bool,
    pub verdict: String,
    /// Effects named, the first found first.
    pub said: String,
    /// Beside several effects: `name=other` where the recording does not separate the two.
    pub open: String,
    /// Error on the unseen recording as described [% of nominal].
    pub before: Option<f64>,
    /// The same with the effects reported.
    pub after: Option<f64>,
    /// The same with the true effect, where it is one of the library.
    pub given: Option<f64>,
    pub seconds: f64,
}

impl Row {
    fn truth(&self) -> Vec<(&str, f64)> {
        self.truth
            .split_whitespace()
            .filter_map(|word| word.split_once('='))
            .map(|(name, strength)| (name, strength.parse().unwrap_or(f64::NAN)))
            .collect()
    }

    fn names(&self) -> Vec<&str> {
        self.said.split_whitespace().collect()
    }

    /// Whether the named effect is `wanted`, or is reported as inseparable from it.
    fn exact_or_inseparable(&self, wanted: &[&str]) -> bool {
        let open: Vec<(&str, &str)> = (self.open.split_whitespace())
            .filter_map(|pair| pair.split_once('='))
            .collect();
        let mut left = wanted.to_vec();
        let every = self.names().iter().all(|name| {
            let named = left.iter().position(|w| w == name);
            let at = named.or(left.iter().position(|w| open.contains(&(name, w))));
            at.map(|at| left.remove(at)).is_some()
        });
        every && left.is_empty()
    }

    /// The first result: an effect, or the verdict itself.
    fn first(&self) -> &str {
        self.names().first().copied().unwrap_or(&self.verdict)
    }

    /// Part of the improvement that the true effect brings; none where it
    /// brings less than a tenth of the error.
    fn recovered(&self) -> Option<f64> {
        let (before, after, given) = (self.before?, self.after?, self.given?);
        (before - given > 0.1 * before).then(|| (before - after) / (before - given))
    }
}

/// Counts of true effects that were named.
#[derive(Default)]
pub struct Named {
    /// Of all.
    pub all: Rate,
    /// Where the recording shows it.
    shown: Rate,
    /// There, named or reported as inseparable from the named one.
    among: Rate,
}

impl Named {
    fn count(&mut self, right: bool, shows: bool, among: bool) {
        self.all.count(right);
        if shows {
            self.shown.count(right);
            self.among.count(right || among);
        }
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, what: &str) -> fmt::Result {
        for (name, rate) in [
            (what, self.all),
            ("  where the recording shows it", self.shown),
            ("  there, or reported as inseparable", self.among),
        ] {
            writeln!(f, "{name:<36}{rate}")?;
        }
        Ok(())
    }
}

/// All rates.
#[derive(Default)]
pub struct Score {
    pub first_strong: Named,
    pub first_weak: Named,
    pub two_exact: Named,
    pub two_first: Rate,
    pub false_alarms: Rate,
    pub unknown_outside: Rate,
    pub unknown_inside: Rate,
    redrawn: usize,
    recovered: Vec<f64>,
    confusion: BTreeMap<(String, String), usize>,
    wrong: Vec<String>,
}

impl Score {
    pub fn of(rows: &[Row]) -> Self {
        let mut score = Self::default();
        for row in rows {
            score.add(row);
        }
        score.recovered.sort_by(f64::total_cmp);
        score
    }

    fn add(&mut self, row: &Row) {
        let unknown = row.verdict == "unknown";
        self.redrawn += usize::from(row.profile != row.drawn);
        let truth = row.truth();
        let mut wanted: Vec<&str> = truth.iter().map(|t| t.0).collect();
        let right = match row.kind {
            Kind::One => {
                let right = row.first() == wanted[0];
                let named = if truth[0].1 >= STRONG {
                    &mut self.first_strong
                } else {
                    &mut self.first_weak
                };
                let among = row.verdict == "inseparable" && row.names().contains(&wanted[0]);
                named.count(right, row.shows, among);
                self.unknown_inside.count(unknown);
                self.recovered.extend(row.recovered());
                let key = (wanted[0].to_owned(), row.first().to_owned());
                *self.confusion.entry(key).or_default() += 1;
                right
            }
            Kind::Two => {
                self.two_first.count(wanted.contains(&row.first()));
                let mut named = row.names();
                named.sort_unstable();
                wanted.sort_unstable();
                let exact = row.verdict == "effects" && named == wanted;
                let among = row.verdict == "effects" && row.exact_or_inseparable(&wanted);
                self.two_exact.count(exact, row.shows, among);
                self.unknown_inside.count(unknown);
                exact
            }
            Kind::Clean => {
                self.false_alarms.count(row.verdict != "none");
                row.verdict == "none"
            }
            Kind::Outside => {
                self.unknown_outside.count(unknown);
                unknown
            }
        };
        if !right {
            let shows = if row.shows { "" } else { ", not shown" };
            let said = format!("{} {}{shows}", row.verdict, row.said);
            self.wrong.push(format!(
                "{:>4} {:<11} [{}]: {said}",
                row.number, row.profile, row.truth
            ));
        }
    }
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "not as it was:")?;
        for line in &self.wrong {
            writeln!(f, "{line}")?;
        }
        writeln!(f, "\none effect -> said first")?;
        for ((truth, said), n) in &self.confusion {
            writeln!(f, "{truth:<26}{said:<26}{n:>4}")?;
        }
        let redrawn = self.redrawn;
        writeln!(
            f,
            "\nwith another profile, as the one drawn did not show the effect: {redrawn}"
        )?;
        self.first_strong
            .write(f, "first right, strength 0.3 and more")?;
        self.first_weak.write(f, "first right, weaker")?;
        self.two_exact.write(f, "two, exact")?;
        for (name, rate) in [
            ("two, first among them", self.two_first),
            ("false alarms on clean ones", self.false_alarms),
            ("unknown outside the library", self.unknown_outside),
            ("unknown inside the library", self.unknown_inside),
        ] {
            writeln!(f, "{name:<36}{rate}")?;
        }
        if let Some(median) = self.recovered.get(self.recovered.len() / 2) {
            writeln!(
                f,
                "improvement on unseen data, part of what the true effect brings: median {:.0} % of {}",
                100.0 * median,
                self.recovered.len()
            )?;
        }
        Ok(())
    }
}
