//! The command `loadtwin explain`: prints what a flag, an effect or the line of an error means, and
//! the next step, from pages of the documentation that are compiled in. A question is searched by
//! its words.

use anyhow::bail;
use clap::Args;
use serde_json::json;

use super::printing::print;

/// Pages with terms, by what they explain.
const PAGES: [(&str, &str); 4] = [
    ("flag", include_str!("../../explained/flags.md")),
    ("effect", include_str!("../../explained/effects.md")),
    ("error", include_str!("../../explained/errors.md")),
    ("question", include_str!("../../explained/faq.md")),
];

/// Explain a flag, an effect or an error.
///
/// Without a term it lists all flags and effects. Of an error give the line that was printed.
#[derive(Debug, Args)]
pub struct Explain {
    /// Flag or effect, the line of an error, or some words of a question.
    term: Vec<String>,
}

/// What a page says about some terms.
struct Entry {
    /// What the terms are.
    kind: &'static str,
    /// Heading above it, e.g. the kind of machine.
    heading: String,
    /// Terms in code style; none of a question.
    terms: Vec<String>,
    /// The whole text.
    text: String,
}

impl Explain {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let entries = entries();
        if self.term.is_empty() {
            list(&entries, as_json);
            return Ok(());
        }
        let term = self.term.join(" ");
        let found = matching(&entries, &term);
        if found.is_empty() {
            bail!(
                "{term}: found in no page, allowed: the name of a flag or an effect, the line of an error, or words of a question; \
                 `loadtwin explain` lists the names, docs/README.md the pages"
            );
        }
        if as_json {
            let found: Vec<_> = (found.iter())
                .map(|e| json!({ "kind": e.kind, "of": e.heading, "names": e.terms, "text": e.text }))
                .collect();
            print(format_args!("{}\n", json!({ "explained": found })));
        } else {
            for entry in found {
                let of = match entry.heading.as_str() {
                    "" => String::new(),
                    heading => format!(", {}", heading.to_lowercase()),
                };
                print(format_args!("{}{of}: {}\n", entry.kind, entry.text));
            }
        }
        Ok(())
    }
}

fn list(entries: &[Entry], as_json: bool) {
    let of = |kind: &str| -> Vec<&str> {
        let mut names: Vec<&str> = (entries.iter())
            .filter(|e| e.kind == kind)
            .flat_map(|e| e.terms.iter().map(String::as_str))
            .collect();
        names.sort_unstable();
        names.dedup();
        names
    };
    let (flags, effects) = (of("flag"), of("effect"));
    if as_json {
        print(format_args!(
            "{}\n",
            json!({ "flags": flags, "effects": effects })
        ));
    } else {
        print(format_args!(
            "flags: {}\neffects: {}\n",
            flags.join(", "),
            effects.join(", ")
        ));
    }
}

/// Entries of that name; else the error that it is; else those that have all the words.
fn matching<'a>(entries: &'a [Entry], term: &str) -> Vec<&'a Entry> {
    let named: Vec<&Entry> = (entries.iter())
        .filter(|e| e.terms.iter().any(|name| name == term))
        .collect();
    if !named.is_empty() {
        return named;
    }
    let message = term.replace('`', "");
    let errors = entries.iter().filter(|e| e.kind == "error");
    let fixed = |e: &&Entry| {
        let fitting = e.terms.iter().filter(|pattern| fits(&message, pattern));
        fitting.map(String::len).max()
    };
    // The longest pattern says most.
    let error = errors
        .filter(|e| fixed(e).is_some())
        .max_by_key(|e| fixed(e));
    if let Some(error) = error {
        return vec![error];
    }
    let words = term.to_lowercase();
    let has_all = |e: &&Entry| {
        let text = e.text.to_lowercase();
        words.split_whitespace().all(|word| text.contains(word))
    };
    (entries.iter())
        .filter(|e| !words.trim().is_empty() && has_all(e))
        .collect()
}

/// Whether the parts of `pattern` between `...` stand in `message`, in their order.
fn fits(message: &str, pattern: &str) -> bool {
    let mut rest = message;
    pattern.split("...").all(|part| {
        let found = rest.find(part);
        rest = found.map_or("", |at| &rest[at + part.len()..]);
        found.is_some()
    })
}

fn entries() -> Vec<Entry> {
    PAGES
        .iter()
        .flat_map(|(kind, page)| entries_of(kind, page))
        .collect()
}

/// Rows of tables and points of lists that begin with a term; rows of questions.
fn entries_of(kind: &'static str, page: &str) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut heading = String::new();
    let mut columns: Vec<String> = Vec::new();
    let mut is_point = false;
    for line in page.lines() {
        let is_continued = is_point && line.starts_with("  ");
        is_point = is_continued;
        if let Some(title) = line.strip_prefix("## ") {
            title.clone_into(&mut heading);
        } else if is_continued && let Some(entry) = entries.last_mut() {
            entry.text += &format!(" {}", plain(line.trim()));
        } else if let Some(point) = line.strip_prefix("- `") {
            is_point = true;
            let text = format!("`{point}");
            entries.push(entry(kind, &heading, &text, plain(&text)));
        } else if let Some(row) = line.strip_prefix("| ") {
            let cells: Vec<&str> = row.trim_end_matches('|').split(" | ").collect();
            let first = cells.first().copied().unwrap_or_default();
            if columns.is_empty() {
                columns = cells.iter().map(|cell| plain(cell)).collect();
            } else if kind == "question" || first.starts_with('`') {
                let rest = (cells.iter().zip(&columns).skip(1))
                    .map(|(cell, column)| match column.as_str() {
                        "meaning" | "answer" => plain(cell),
                        column => format!("{column}: {}", plain(cell)),
                    })
                    .collect::<Vec<_>>();
                let text = format!("{}: {}", plain(first), rest.join(". "));
                entries.push(entry(kind, &heading, first, text));
            }
        } else if !line.starts_with('|') {
            columns.clear();
        }
    }
    entries
}

fn entry(kind: &'static str, heading: &str, first: &str, text: String) -> Entry {
    // A point of a list has its meaning behind a colon; an error may hold one.
    let names = match kind {
        "error" => first,
        _ => first.split(':').next().unwrap_or_default(),
    };
    let is_named = kind != "question";
    Entry {
        kind,
        heading: heading.to_owned(),
        // Every other part stands between two marks.
        terms: (names.split('`').skip(1).step_by(2))
            .filter(|_| is_named)
            .map(str::to_owned)
            .collect(),
        text,
    }
}

/// Without the marks of code and links.
fn plain(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text.trim();
    while let Some(at) = rest.find("](") {
        out += &rest[..at];
        let end = rest[at..].find(')').map_or(rest.len(), |end| at + end + 1);
        rest = &rest[end..];
    }
    (out + rest).replace(['`', '['], "")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn explained(term: &str) -> String {
        let entries = entries();
        let found = matching(&entries, term).into_iter();
        found.map(|e| e.text.clone() + "\n").collect()
    }

    #[test]
    fn flags_effects_and_questions_are_found() {
        let stuck = explained("stuck");
        assert!(
            stuck.starts_with("stuck: too many equal readings. next step: converter;"),
            "{stuck}"
        );
        assert!(explained("saturated_low").contains("gain of the amplifier"));
        let creep = explained("gauge-creep");
        assert!(
            creep.ends_with("then a long one without load.\n"),
            "{creep}"
        );
        assert!(explained("backlash").lines().count() == 2);
        assert!(explained("refuses image").contains("key differs"));
        assert_eq!(explained("no such thing"), "");
        // Of patterns that fit, the longest.
        let line = "a.csv: row 95 (line 100), column `left`: found `abc`; allowed: a number";
        assert!(explained(line).starts_with("row ..., column ...: found: a cell holds no number."));
        assert!(!fits("b then a", "a ... b") && fits("a then b", "a ... b"));
    }
}
