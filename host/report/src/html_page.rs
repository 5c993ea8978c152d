//! Writes a `Report` as one HTML file that needs no network (`Report::write`): checks its plots,
//! encodes the data, and thins the signals until the page has at most 8 MB; a page that stays
//! larger is an error.

use super::markup::{cells, columns_of_words, escape, with_minus};
use super::plot_check::check;
use super::thinning::thinned;
use super::{Data, MinMaxDecimator, Plot, Report, Samples, Section, Table, UPLOT_CSS, UPLOT_JS};
use base64::{Engine as _, engine::general_purpose::STANDARD};
use loadtwin_files::atomic_file::{AtomicFile, Complete, publish};
use loadtwin_files::file_kind::FileKind;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The page never gets larger (bytes).
const LARGEST_PAGE: usize = 8_000_000;

/// A plot thinner than this many points says nothing.
const FEWEST_POINTS: usize = 128;

/// Says which program wrote a page.
const GENERATOR: &str = "<meta name=\"generator\" content=\"loadtwin\">";

/// What is written as a page.
pub const PAGE: FileKind = FileKind {
    noun: "page",
    suffixes: &["html", "htm"],
    // Nothing was added to it.
    is_same: |file| Ok(file.ends_with(b"</html>")? && file.contains(&[GENERATOR])?),
};

/// Nothing but what is in the file itself may be loaded or run.
const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:";

/// As [`POLICY`], but that the file of samples beside the page may be loaded.
const POLICY_BESIDE: &str = "default-src 'none'; script-src 'unsafe-inline' 'self'; style-src 'unsafe-inline'; img-src data:";

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file cannot be written.
    #[error("{path}: cannot write the report: {source}")]
    Write {
        /// Where it was to be.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// So many plots or rows of tables that thinning the signals does not help.
    #[error("report: {found} bytes with {plots} plots, allowed are {LARGEST_PAGE}")]
    TooLarge {
        /// Size of the page with its signals thinned as far as they may be.
        found: usize,
        /// Number of plots.
        plots: usize,
    },
    /// A plot does not fit its data.
    #[error("report: plot {plot:?}: {problem}")]
    Plot {
        /// Heading of the plot.
        plot: String,
        /// What is wrong.
        problem: String,
    },
}

impl Report {
    /// Writes the page to `path`, whole or not at all.
    ///
    /// # Errors
    /// [`ReportError`]; an existing file is then as it was.
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        publish([self.complete(path)?]).map_err(|error| ReportError::Write {
            path: error.path,
            source: error.source,
        })
    }

    /// As [`Report::write`], but that the page has no name before it is published.
    ///
    /// # Errors
    /// [`ReportError`]
    pub fn complete(&self, path: &Path) -> Result<Complete, ReportError> {
        let page = self.to_html()?;
        let write = || {
            let mut file = AtomicFile::create(path)?;
            file.write_all(page.as_bytes())?;
            file.complete()
        };
        write().map_err(|source| ReportError::Write {
            path: path.to_owned(),
            source,
        })
    }

    /// The page, at most 8 MB: signals are thinned until it fits.
    ///
    /// # Errors
    /// [`ReportError::TooLarge`] and [`ReportError::Plot`].
    pub fn to_html(&self) -> Result<String, ReportError> {
        for plot in self.plots() {
            check(plot, self.time.as_ref())?;
        }
        let mut time = self.time.clone();
        let is_thinned = |time: &MinMaxDecimator| time.samples_per_bucket() > 1;
        let mut samples = (self.samples.as_ref())
            .filter(|_| time.as_ref().is_some_and(is_thinned))
            .map(Samples::json)
            .unwrap_or_default();
        let mut halvings = 0;
        loop {
            let page = self.page(time.as_ref(), &samples, halvings);
            if page.len() <= LARGEST_PAGE {
                return Ok(page);
            }
            if samples.1.take().is_some() {
                samples.0 = Value::Null;
                continue;
            }
            halvings += 1;
            if halvings > 16 {
                return Err(ReportError::TooLarge {
                    found: page.len(),
                    plots: self.plots().count(),
                });
            }
            if let Some(time) = time
                .as_mut()
                .filter(|t| t.rows().x.len() > 2 * FEWEST_POINTS)
            {
                time.halve();
            }
        }
    }

    fn plots(&self) -> impl Iterator<Item = &Plot> {
        self.sections.iter().flat_map(|section| &section.plots)
    }

    fn page(
        &self,
        time: Option<&MinMaxDecimator>,
        (samples, chunks): &(Value, Option<String>),
        halvings: u32,
    ) -> String {
        let rows = time.map(MinMaxDecimator::rows).unwrap_or_default();
        let data = json!({
            "time": {
                "x": encode_f64(&rows.x),
                "buckets": STANDARD.encode(&rows.buckets),
                "perBucket": time.map_or(1, MinMaxDecimator::samples_per_bucket),
                "columns": rows.columns.iter().map(|c| encode_f32(c)).collect::<Vec<_>>(),
            },
            "samples": samples,
            "plots": self.plots().map(|plot| plot_json(plot, halvings)).collect::<Vec<_>>(),
        });
        // In a script element only `<` could end or open anything.
        let data = data.to_string().replace('<', "\\u003c");
        let mut html = String::with_capacity(data.len() + 100_000);
        let title = escape(&self.title);
        html += "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">";
        html += GENERATOR;
        html += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">";
        // Writing to a String cannot fail.
        let policy = if samples["file"].is_null() {
            POLICY
        } else {
            POLICY_BESIDE
        };
        let _ = write!(
            html,
            "<meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\"><title>{title}</title><style>{UPLOT_CSS}\n{}</style></head><body>",
            include_str!("assets/page.css"),
        );
        self.head(&mut html, &title);
        if let Some(time) = time.filter(|time| time.samples_per_bucket() > 1) {
            let _ = write!(
                html,
                "<p class=\"drawn\"><span id=\"drawn\" role=\"status\">Drawn as the least and the greatest of each {} samples.</span> {}</p>",
                time.samples_per_bucket(),
                escape(&zoom_note(
                    samples,
                    chunks.is_some(),
                    self.samples.is_some()
                )),
            );
        }
        let mut next_plot = 0;
        let sections = self.sections.iter();
        let is_empty = |section: &&Section| section.plots.is_empty() && section.tables.is_empty();
        for section in sections.filter(|section| !is_empty(section)) {
            section_html(&mut html, section, &mut next_plot);
        }
        footer(&mut html, time);
        let _ = write!(
            html,
            "<script type=\"application/json\" id=\"data\">{data}</script><script type=\"application/json\" id=\"samples\">{}</script>\
             <script>{UPLOT_JS}</script><script>{}</script><script>{}</script><script>{}</script></body></html>",
            // Base64 in brackets, which needs no escapes.
            chunks.as_deref().unwrap_or("null"),
            include_str!("assets/save.js"),
            include_str!("assets/zoom.js"),
            include_str!("assets/page.js"),
        );
        html
    }

    fn head(&self, html: &mut String, title: &str) {
        let _ = write!(html, "<header><div class=\"bar\"><h1>{title}</h1>");
        *html += include_str!("assets/toolbar.html");
        *html += "</div><dl class=\"facts\">";
        for [label, value] in &self.facts {
            let (label, value) = (escape(label), escape(value));
            let _ = write!(html, "<div><dt>{label}</dt><dd>{value}</dd></div>");
        }
        *html += "</dl></header><main><div class=\"figures\">";
        for figure in &self.key_figures {
            let _ = write!(
                html,
                "<div class=\"figure\"><span class=\"label\">{}</span><span class=\"value\">{}</span><span class=\"note\">{}</span></div>",
                escape(&figure.label),
                escape(&with_minus(&figure.value)),
                escape(&figure.note)
            );
        }
        *html += "</div><div class=\"tables\">";
        tables_html(html, &self.tables);
        *html += "</div>";
    }
}

/// What a reader does to see every sample.
fn zoom_note(samples: &Value, is_in_page: bool, is_gathered: bool) -> String {
    match samples["file"].as_str() {
        Some(file) => format!("Zoom in to see each, read from {file} beside this page."),
        None if is_in_page => "Zoom in to see each.".to_owned(),
        None if is_gathered => {
            "They do not fit this page: --report-samples writes them beside it, for zooming."
                .to_owned()
        }
        None => String::new(),
    }
}

fn section_html(html: &mut String, section: &Section, next_plot: &mut usize) {
    let open = if section.open { " open" } else { "" };
    let _ = write!(
        html,
        "<details{open}><summary><h2>{}</h2><span>{}</span></summary>",
        escape(&section.title),
        [
            counted(section.plots.len(), "plot"),
            counted(section.tables.len(), "table")
        ]
        .concat()
        .trim_start()
    );
    if !section.note.is_empty() {
        let _ = write!(html, "<p>{}</p>", escape(&section.note));
    }
    if !section.plots.is_empty() {
        *html += "<div class=\"plots\">";
    }
    for plot in &section.plots {
        let _ = write!(
            html,
            "<figure class=\"plot\" data-plot=\"{next_plot}\"><figcaption>{}</figcaption></figure>",
            escape(&plot.title)
        );
        *next_plot += 1;
    }
    if !section.plots.is_empty() {
        *html += "</div>";
    }
    if !section.tables.is_empty() {
        *html += "<div class=\"tables\">";
        tables_html(html, &section.tables);
        *html += "</div>";
    }
    *html += "</details>";
}

/// ` 2 plots`, or nothing.
fn counted(number: usize, noun: &str) -> String {
    match number {
        0 => String::new(),
        1 => format!(" 1 {noun}"),
        _ => format!(" {number} {noun}s"),
    }
}

fn tables_html(html: &mut String, tables: &[Table]) {
    for table in tables {
        let is_words = columns_of_words(table);
        let _ = write!(
            html,
            "<div class=\"table\" tabindex=\"0\"><table><caption>{}</caption><thead><tr>{}</tr></thead><tbody>",
            escape(&table.caption),
            cells(&table.head, "th", &is_words)
        );
        for row in &table.rows {
            let _ = write!(html, "<tr>{}</tr>", cells(row, "td", &is_words));
        }
        *html += "</tbody></table></div>";
    }
}

fn footer(html: &mut String, time: Option<&MinMaxDecimator>) {
    *html += "</main><footer>";
    if let Some(time) = time {
        let _ = write!(html, "{} samples over time. ", time.samples());
    }
    let _ = write!(
        html,
        "loadtwin {}. Plots by uPlot 1.6.32, MIT licence, copyright Leon Sorokin.</footer>",
        env!("CARGO_PKG_VERSION")
    );
}

fn plot_json(plot: &Plot, halvings: u32) -> Value {
    let mut json = json!({
        "title": plot.title, "size": plot.size, "x": plot.x, "y": plot.y, "limits": plot.limits,
        "shaded": plot.shaded, "band": plot.band, "names": plot.names,
    });
    match &plot.data {
        Data::Time(series) => {
            json["series"] = json!(series.iter().map(|(s, _)| s).collect::<Vec<_>>());
            json["columns"] = json!(series.iter().map(|(_, c)| c).collect::<Vec<_>>());
        }
        Data::Own { x, series } => {
            let values: Vec<&[f64]> = series.iter().map(|(_, values)| &values[..]).collect();
            let (x, values) = if plot.names.is_empty() {
                thinned(x, &values, reduction(x.len(), halvings))
            } else {
                thinned(x, &values, 1)
            };
            json["series"] = json!(series.iter().map(|(s, _)| s).collect::<Vec<_>>());
            json["own"] = json!({
                "x": encode_f64(&x),
                "columns": values.iter().map(|column| encode_f32(column)).collect::<Vec<_>>(),
            });
        }
    }
    json
}

/// By how much points are thinned after a number of halvings.
fn reduction(points: usize, halvings: u32) -> usize {
    let most = (points / FEWEST_POINTS).max(1);
    1_usize
        .checked_shl(halvings)
        .unwrap_or(usize::MAX)
        .min(most)
}

fn encode_f32(values: &[f32]) -> String {
    STANDARD.encode(
        values
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<_>>(),
    )
}

fn encode_f64(values: &[f64]) -> String {
    STANDARD.encode(
        values
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<_>>(),
    )
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Mark, Role, Series};
    use super::*;

    fn with_plot(data: Data, time: Option<MinMaxDecimator>) -> Report {
        Report {
            title: "<script>alert(1)</script>".into(),
            time,
            sections: vec![Section {
                plots: vec![Plot {
                    title: "</script><b a='\"'>&".into(),
                    y: Axis::new("</script>", "N"),
                    data,
                    ..Plot::default()
                }],
                ..Section::default()
            }],
            ..Report::default()
        }
    }

    #[test]
    fn text_cannot_become_markup() {
        let page = with_plot(Data::Time(vec![]), None).to_html().unwrap();
        assert!(!page.contains("<script>alert") && !page.contains("<b a="));
        assert_eq!(page.matches("</script>").count(), 6);
        assert!(page.contains("&lt;/script&gt;&lt;b a=&#39;&quot;&#39;&gt;&amp;"));
    }

    /// 200 columns of noise would be 17 MB at the resolution that was asked for.
    #[test]
    fn page_stays_below_its_limit_and_keeps_the_peak() {
        let mut time = MinMaxDecimator::new(200, 8192);
        for i in 0..20_000_u32 {
            let y = if i == 7777 { 1e6 } else { f64::from(i % 17) };
            time.push(f64::from(i), &[y; 200]);
        }
        let data = Data::Time(vec![(Series::line("a", Role::Other), 199)]);
        let page = with_plot(data, Some(time)).to_html().unwrap();
        assert!(
            page.len() <= LARGEST_PAGE && page.len() > LARGEST_PAGE / 3,
            "{}",
            page.len()
        );
        let start = page.find("\"columns\":[\"").unwrap() + 12;
        let end = start + page[start..].find('"').unwrap();
        let bytes = STANDARD.decode(&page[start..end]).unwrap();
        let peak = bytes
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .fold(0.0, f32::max);
        assert_eq!(peak, 1e6);
    }

    #[test]
    fn plots_that_do_not_fit_their_data_are_refused() {
        let line = || Series::line("a", Role::Other);
        let edge = |mark| Series::new("a", Role::Other, mark);
        let one = || Some(MinMaxDecimator::new(2, 8));
        let own = |x: &[f64], y: &[f64]| Data::Own {
            x: x.to_vec(),
            series: vec![(line(), y.to_vec())],
        };
        for (data, says) in [
            (
                Data::Time(vec![(line(), 2)]),
                "found column 2, allowed is below 2",
            ),
            (own(&[0.0, 1.0], &[0.0]), "\"a\" has 1 values for 2 x"),
            (own(&[1.0, 0.0], &[0.0, 0.0]), "x falls"),
            (
                Data::Time(vec![(edge(Mark::Upper), 0), (line(), 1)]),
                "its lower edge next",
            ),
            (
                Data::Time(vec![(edge(Mark::Lower), 0)]),
                "its lower edge next",
            ),
        ] {
            let error = with_plot(data, one()).to_html().unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
        let band = vec![(line(), 0), (edge(Mark::Upper), 0), (edge(Mark::Lower), 1)];
        assert!(with_plot(Data::Time(band), one()).to_html().is_ok());
    }

    #[test]
    fn a_report_that_cannot_be_written_says_where() {
        let error = Report::default()
            .write(Path::new("/nowhere/at/all.html"))
            .unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("/nowhere/at/all.html: cannot write the report")
        );
    }
}
