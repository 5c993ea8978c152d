//! Makes the report page: one HTML file with tables and interactive plots that is complete without
//! a network. Here: the types of its contents (`Report`, `Section`, `Plot`, `Table`), plots of
//! autocorrelation and histogram, a table of named figures, and the choice of the prefix of a unit.
//!
//! Drawing is by uPlot 1.6.32 (MIT, from the npm registry, unchanged, beside this file with its
//! licence): 51 kB against 4.8 MB for plotly.js 4.1.2, which leaves the page's 8 MB to the data.
//!
//! ```
//! use loadtwin_report::{Axis, Data, MinMaxDecimator, Plot, Report, Role, Section, Series};
//! let mut time = MinMaxDecimator::new(2, 4096);
//! for i in 0..10_000 {
//!     let t = f64::from(i) * 1e-3;
//!     time.push(t, &[t.sin(), t.sin() + 0.1]);
//! }
//! let report = Report {
//!     title: "Rotor".into(),
//!     time: Some(time),
//!     sections: vec![Section {
//!         title: "Load".into(),
//!         open: true,
//!         plots: vec![Plot {
//!             title: "Unbalance force".into(),
//!             y: Axis::new("Force", "N"),
//!             data: Data::Time(vec![
//!                 (Series::line("estimate", Role::Estimate), 0),
//!                 (Series::line("reference", Role::Reference), 1),
//!             ]),
//!             ..Plot::default()
//!         }],
//!         ..Section::default()
//!     }],
//!     ..Report::default()
//! };
//! let directory = tempfile::tempdir().unwrap();
//! report.write(&directory.path().join("report.html")).unwrap();
//! ```
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

mod decimator;
mod finding;
mod html_page;
mod innovation_spectra;
mod markup;
mod plot_check;
mod replay_plots;
mod samples;
mod scatter;
mod sensor_plots;
mod thinning;

pub use decimator::{MinMaxDecimator, Rows};
pub use finding::{EffectSize, Finding};
pub use html_page::{PAGE, ReportError};
pub use replay_plots::{LoadLabel, ReplayPlots, SensorLabel};
pub use samples::{Combination, SAMPLES, Samples, samples_beside};
pub use scatter::ScatterSample;

/// The style sheet of uPlot.
pub const UPLOT_CSS: &str = include_str!("assets/uplot-1.6.32.min.css");

/// The script of uPlot.
pub const UPLOT_JS: &str = include_str!("assets/uplot-1.6.32.min.js");

use loadtwin_math::metrics::{Autocorrelation, Histogram};
use serde::Serialize;

/// The contents of a report, in their order.
#[derive(Default)]
pub struct Report {
    /// Heading.
    pub title: String,
    /// Machine, recording, filter and the like: label and value.
    pub facts: Vec<[String; 2]>,
    /// The few figures to see first.
    pub key_figures: Vec<KeyFigure>,
    /// Tables, e.g. of errors.
    pub tables: Vec<Table>,
    /// All signals over time (s); plots choose among its columns and share zoom and cursors.
    pub time: Option<MinMaxDecimator>,
    /// Every sample of them, for zooming.
    pub samples: Option<Samples>,
    /// Plots in sections that open and close.
    pub sections: Vec<Section>,
}

/// A figure in the page's head.
#[derive(Clone, Debug, Default)]
pub struct KeyFigure {
    /// What it is.
    pub label: String,
    /// The number as text, with its unit.
    pub value: String,
    /// What it is to be compared with, or empty.
    pub note: String,
}

impl KeyFigure {
    /// The tiles of a diagnosis: error as described and recalibrated, each before and after the
    /// effects found, by `tile` of the label and the error.
    pub fn of_errors<E>(
        nominal: [E; 2],
        recalibrated: [E; 2],
        tile: impl Fn(String, E) -> Option<Self>,
    ) -> Vec<Self> {
        let labels = [
            "as described",
            "as described, with what was found",
            "recalibrated",
            "recalibrated, with what was found",
        ];
        let errors = nominal.into_iter().chain(recalibrated);
        (labels.into_iter().zip(errors))
            .filter_map(|(label, error)| tile(format!("error, {label}"), error))
            .collect()
    }
}

/// A table of text; numbers are written by the caller. All but the first column stand right.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// What the table shows.
    pub caption: String,
    /// Column headings, with units.
    pub head: Vec<String>,
    /// Rows as long as the head.
    pub rows: Vec<Vec<String>>,
}

/// Figures by their name, with what they are of.
#[derive(Clone, Debug, Default)]
pub struct FigureRow {
    /// Cells that say of what the figures are.
    pub first: Vec<String>,
    /// `[name, text]` of each figure.
    pub figures: Vec<[String; 2]>,
    /// Remarks.
    pub last: Vec<String>,
}

impl Table {
    /// A table with a column for each name of a figure, between the columns headed `before` and
    /// `after`.
    pub fn of_figures(caption: String, [before, after]: [&[&str]; 2], rows: &[FigureRow]) -> Self {
        let mut names: Vec<String> = Vec::new();
        for [name, _] in rows.iter().flat_map(|row| &row.figures) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        let cells = |figures: &[[String; 2]]| -> Vec<String> {
            let of = |name: &String| figures.iter().find(|[other, _]| other == name);
            (names.iter())
                .map(|name| {
                    of(name).map_or_else(|| "–".into(), |[_, text]| text.replace("->", "→"))
                })
                .collect()
        };
        Self {
            rows: (rows.iter())
                .map(|row| [&row.first[..], &cells(&row.figures), &row.last].concat())
                .collect(),
            head: (before.iter().map(ToString::to_string))
                .chain(names.iter().cloned())
                .chain(after.iter().map(ToString::to_string))
                .collect(),
            caption,
        }
    }
}

/// The prefix of a unit in which a size near `value` is read best, and its factor: `k` and 1000 for
/// 3e5.
pub fn prefix_of(value: f64) -> (&'static str, f64) {
    /// SI prefixes with their factors, the largest first.
    const PREFIXES: [(&str, f64); 7] = [
        ("G", 1e9),
        ("M", 1e6),
        ("k", 1e3),
        ("", 1.0),
        ("m", 1e-3),
        ("µ", 1e-6),
        ("n", 1e-9),
    ];
    let size = value.abs();
    // Up to 2000 and down to 0.2 without one, as the plots.
    let is_read =
        |(_, factor): &&(&str, f64)| size >= if *factor > 1.0 { 2.0 } else { 0.2 } * factor;
    let is_plain = size == 0.0 || !size.is_finite();
    match PREFIXES.iter().find(is_read) {
        Some(found) if !is_plain => *found,
        _ => ("", 1.0),
    }
}

/// A number with four significant digits, six decimals at most.
pub fn significant(value: f64) -> String {
    // Of 9.9999 as well, which is written 10.00.
    let size = value.abs().max(1e-3) * (1.0 + 5e-5);
    let digits = 3 - size.log10().floor() as i32;
    format!("{value:.*}", digits.max(0) as usize)
}

/// Plots under one heading.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// Heading.
    pub title: String,
    /// A sentence on how to read the plots, or empty.
    pub note: String,
    /// Whether it is open at first.
    pub open: bool,
    /// The plots.
    pub plots: Vec<Plot>,
    /// Tables below the plots.
    pub tables: Vec<Table>,
}

/// One plot. The default is wide, over time, and empty.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Share of the page's width.
    pub size: PlotSize,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The series.
    pub data: Data,
    /// Horizontal lines at fixed values, e.g. chi-squared bounds.
    pub limits: Vec<Limit>,
    /// Times that are shaded; only over time.
    pub shaded: Option<Shaded>,
    /// Columns of [`Report::time`] with the upper and lower edge of the estimate's band: where it
    /// is far wider than usual, as while a filter settles, values do not rule the vertical scale.
    pub band: Option<[usize; 2]>,
    /// Names of the points, one for each `x` of [`Data::Own`], drawn beside them; or empty.
    pub names: Vec<String>,
}

impl Default for Plot {
    fn default() -> Self {
        Self {
            title: String::new(),
            size: PlotSize::Wide,
            x: Axis::new("Time", "s"),
            y: Axis::new("", ""),
            data: Data::Time(Vec::new()),
            limits: Vec::new(),
            shaded: None,
            band: None,
            names: Vec::new(),
        }
    }
}

/// Times in which something is so, shaded behind the curves.
#[derive(Clone, Debug, Serialize)]
pub struct Shaded {
    /// What is so, e.g. `not valid`.
    pub label: String,
    /// Column of [`Report::time`] that is above 0 then.
    pub column: usize,
}

impl Shaded {
    /// Where `column` is above 0.
    pub fn new(label: &str, column: usize) -> Self {
        Self {
            label: label.to_owned(),
            column,
        }
    }
}

/// Share of the page's width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PlotSize {
    /// All of it.
    Wide,
    /// Two beside each other.
    Half,
    /// Three beside each other.
    Third,
}

/// Label of an axis.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Axis {
    /// Quantity.
    pub quantity: String,
    /// Unit, or empty. Values in N, N m, W, Pa, m, m/m, rad, V and Hz are shown with a
    /// prefix.
    pub unit: String,
    /// Logarithmic scale; values that are not positive are left out.
    pub logarithmic: bool,
}

impl Axis {
    /// Linear axis; newton metres are written `Nm`, as in descriptions.
    pub fn new(quantity: &str, unit: &str) -> Self {
        Self {
            quantity: quantity.to_owned(),
            unit: unit.replace("N m", "Nm"),
            logarithmic: false,
        }
    }
}

/// A line at a fixed value.
#[derive(Clone, Debug, Serialize)]
pub struct Limit {
    /// What it bounds.
    pub label: String,
    /// Where it is, in the unit of the vertical axis.
    pub value: f64,
}

/// Series of a plot.
#[derive(Clone, Debug)]
pub enum Data {
    /// Columns of [`Report::time`].
    Time(Vec<(Series, usize)>),
    /// Values of its own; `x` must not fall.
    Own {
        /// Horizontal values.
        x: Vec<f64>,
        /// Vertical values, as long as `x`; NaN where there is none.
        series: Vec<(Series, Vec<f64>)>,
    },
}

/// How one series looks.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// Gives the colour, the same on the whole page.
    pub role: Role,
    /// Gives the shape.
    pub mark: Mark,
}

impl Series {
    /// A series drawn as a line.
    pub fn line(label: &str, role: Role) -> Self {
        Self::new(label, role, Mark::Line)
    }

    /// A series drawn as `mark`.
    pub fn new(label: &str, role: Role, mark: Mark) -> Self {
        Self {
            label: label.to_owned(),
            role,
            mark,
        }
    }
}

/// What a series is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// What the filter says.
    Estimate,
    /// What is taken as true.
    Reference,
    /// What a sensor says.
    Measured,
    /// What the model says that the sensor should.
    Predicted,
    /// Innovations and what is computed from them.
    Innovation,
    /// Anything else.
    Other,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mark {
    /// Line.
    Line,
    /// Points without a line.
    Points,
    /// Bars from zero.
    Bars,
    /// Upper edge of a filled band; the next series must be its [`Mark::Lower`].
    Upper,
    /// Lower edge of a filled band.
    Lower,
}

/// Autocorrelation of an innovation sequence with its 99 % bounds.
pub fn autocorrelation_plot(title: &str, acf: &Autocorrelation) -> Plot {
    let coefficients = acf.coefficients();
    let bound = acf.bound();
    let limits = [bound, -bound].map(|value| Limit {
        label: "99 %".to_owned(),
        value,
    });
    Plot {
        title: title.to_owned(),
        size: PlotSize::Third,
        x: Axis::new("Lag", "samples"),
        y: Axis::new("Autocorrelation", ""),
        data: Data::Own {
            x: (1..=coefficients.len()).map(|lag| lag as f64).collect(),
            series: vec![(
                Series::new("r", Role::Innovation, Mark::Bars),
                coefficients.map(|r| r.unwrap_or(f64::NAN)).to_vec(),
            )],
        },
        limits: if bound.is_finite() {
            limits.to_vec()
        } else {
            Vec::new()
        },
        ..Plot::default()
    }
}

/// Histogram of normalised innovations beside the standard normal density.
pub fn normalised_histogram_plot(title: &str, histogram: &Histogram) -> Plot {
    let (x, density): (Vec<f64>, Vec<f64>) = histogram.density().unzip();
    let normal = x
        .iter()
        .map(|x| (-x * x / 2.0).exp() / std::f64::consts::TAU.sqrt())
        .collect();
    Plot {
        title: title.to_owned(),
        size: PlotSize::Third,
        x: Axis::new("Innovation / σ", ""),
        y: Axis::new("Density", ""),
        data: Data::Own {
            x,
            series: vec![
                (
                    Series::new("innovations", Role::Innovation, Mark::Bars),
                    density,
                ),
                (Series::line("normal", Role::Reference), normal),
            ],
        },
        ..Plot::default()
    }
}
