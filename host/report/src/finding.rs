//! Makes a table of two columns of an effect that a diagnosis found (`Finding::table`): place, size
//! with its interval of 95 %, error of the estimator before and after, what else it could be, what
//! to record next.

use super::{Table, prefix_of};

/// Standard normal quantile of a two-sided interval of 95 %.
const QUANTILE_95: f64 = 1.96;

/// Units whose values are read best with a prefix; seconds only with one below 1.
const PREFIXED: [&str; 9] = ["N", "Nm", "W", "Pa", "m", "rad", "V", "Hz", "s"];

/// An effect that was found.
#[derive(Clone, Debug, Default)]
pub struct Finding {
    /// Name of the effect, and what it is.
    pub effect: String,
    /// Channels or part of the machine.
    pub place: String,
    /// How large it is.
    pub sizes: Vec<EffectSize>,
    /// `[of what, before → after]`.
    pub errors: Vec<[String; 2]>,
    /// Effects that explain the recordings as well.
    pub alternatives: Vec<String>,
    /// The experiment that would show which of them it is.
    pub next_recording: Option<String>,
}

/// Value of a parameter of an effect.
#[derive(Clone, Debug, Default)]
pub struct EffectSize {
    /// Channel, or empty where the parameter is one for all.
    pub channel: String,
    /// Name, with the unit in brackets at its end.
    pub parameter: String,
    /// Value, in the unit of `parameter`.
    pub value: f64,
    /// Standard deviation, in the same unit; `None` of a value of a grid, and where the recordings
    /// do not determine it.
    pub std: Option<f64>,
}

impl Finding {
    /// The table under `caption`.
    pub fn table(self, caption: String) -> Table {
        let mut rows = Vec::new();
        let mut add = |label: &str, text: String| {
            if !text.is_empty() {
                rows.push(vec![label.to_owned(), text]);
            }
        };
        add("Where", self.place);
        for size in &self.sizes {
            let (name, _) = size.name_and_unit();
            let of = match size.channel.as_str() {
                "" => String::new(),
                channel => format!("{channel}: "),
            };
            add(&format!("Size, {of}{name}"), size.text());
        }
        for [of, change] in self.errors {
            add(&of, change.replace("->", "→"));
        }
        let is_certain = self.alternatives.is_empty();
        add(
            "Could also be",
            if is_certain {
                "no other effect explains the recordings as well".into()
            } else {
                self.alternatives.join(", ")
            },
        );
        add(
            "Record next",
            match self.next_recording {
                Some(next) => next,
                None if is_certain => "nothing more for this effect".into(),
                None => String::new(),
            },
        );
        Table {
            caption,
            head: vec!["Effect".into(), self.effect],
            rows,
        }
    }
}

impl EffectSize {
    fn name_and_unit(&self) -> (&str, &str) {
        (self.parameter.strip_suffix(']'))
            .and_then(|text| text.rsplit_once(" ["))
            .unwrap_or((&self.parameter, ""))
    }

    /// Value with unit and, where its standard deviation is known, the interval of 95 %:
    /// `30.2 s (29.3 to 31.1)`.
    pub fn text(&self) -> String {
        let (_, unit) = self.name_and_unit();
        let (prefix, factor) = match prefix_of(self.value) {
            (_, factor) if unit == "s" && factor > 1.0 => ("", 1.0),
            found if PREFIXED.contains(&unit) => found,
            _ => ("", 1.0),
        };
        let value = self.value / factor;
        let half = (self.std)
            .map(|std| QUANTILE_95 * std / factor)
            .filter(|half| half.is_finite() && *half > 0.0);
        let written = |v: f64| written(v, value, half);
        let unit = match unit {
            "" => String::new(),
            unit => format!(" {prefix}{unit}"),
        };
        let interval = half.map_or_else(String::new, |half| {
            format!(" ({} to {})", written(value - half), written(value + half))
        });
        format!("{}{unit}{interval}", written(value))
    }
}

/// `number` with as many digits as `value` has that its interval of `half` its width leaves
/// certain, and one more; with four without an interval.
fn written(number: f64, value: f64, half: Option<f64>) -> String {
    let exponent = |size: f64| size.log10().floor() as i32;
    if value == 0.0 && half.is_none() {
        return "0".into();
    }
    let size = value.abs().max(half.unwrap_or(0.0));
    let decimals = half.map_or_else(|| 3 - exponent(size), |half| 1 - exponent(half));
    if !(1e-3..1e5).contains(&size) {
        let digits = (decimals + exponent(size)).clamp(1, 6);
        return format!("{number:.*e}", digits as usize);
    }
    if half.is_none() && number.fract() == 0.0 {
        return format!("{number}");
    }
    format!("{number:.*}", decimals.clamp(0, 9) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(parameter: &str, value: f64, std: Option<f64>) -> String {
        let parameter = parameter.to_owned();
        EffectSize {
            parameter,
            value,
            std,
            ..EffectSize::default()
        }
        .text()
    }

    #[test]
    fn sizes_have_unit_prefix_and_interval() {
        assert_eq!(
            size("time constant [s]", 30.16, Some(0.464)),
            "30.16 s (29.25 to 31.07)"
        );
        assert_eq!(
            size("offset [m]", 9.73e-6, Some(1e-8)),
            "9.730 µm (9.710 to 9.750)"
        );
        assert_eq!(
            size("delay [s]", 2.1e-3, Some(5e-4)),
            "2.10 ms (1.12 to 3.08)"
        );
        assert_eq!(size("time constant [s]", 3600.0, None), "3600 s");
        assert_eq!(
            size("part of the reading", -0.05, Some(3e-3)),
            "-0.0500 (-0.0559 to -0.0441)"
        );
        assert_eq!(size("order", 6.0, None), "6");
        assert_eq!(size("part", 0.0, None), "0");
        assert_eq!(
            size("part", 2.5e-6, Some(1e-7)),
            "2.50e-6 (2.30e-6 to 2.70e-6)"
        );
    }

    #[test]
    fn a_finding_is_read_in_the_order_of_its_use() {
        let finding = Finding {
            effect: "gauge-drift: a zero drifts with time".into(),
            place: "g2".into(),
            sizes: vec![EffectSize {
                channel: "g2".into(),
                parameter: "part of full scale per hour".into(),
                value: 0.25,
                std: None,
            }],
            errors: vec![["Error".into(), "2 -> 1 %".into()]],
            alternatives: vec!["gain-error".into()],
            next_recording: Some("torque ramps".into()),
        };
        let table = finding.table("Found".into());
        let rows: Vec<String> = table.rows.iter().map(|row| row.join(" = ")).collect();
        assert_eq!(
            rows,
            [
                "Where = g2",
                "Size, g2: part of full scale per hour = 0.2500",
                "Error = 2 → 1 %",
                "Could also be = gain-error",
                "Record next = torque ramps"
            ]
        );
    }
}
