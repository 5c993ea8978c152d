//! Compares the filter of a wheel bearing with the regression and the cascade of Kerst et al. 2019
//! in a replay with reference loads (`loadtwin replay --baselines`): RMSE of each load as JSON, and
//! as a table beside the published figures.

use loadtwin_common::bearing::LOADS;
use loadtwin_common::io::estimate::Estimate;
use serde_json::{Map, Value, json};

use super::{ReplayError, Sample};
use loadtwin_design::bearing::Calibration;
use loadtwin_design::bearing::baseline::{Comparison, ESTIMATED, METHODS, PUBLISHED};
use loadtwin_machine::{BEARING_LOADS, Kind, Machine};
use loadtwin_report::Table;

/// Both algorithms and the filter on one recording.
pub struct Baselines {
    comparison: Comparison,
    /// For each load, the reference that measures it.
    reference_of: [Option<usize>; LOADS],
}

impl Baselines {
    /// Nothing compared yet.
    ///
    /// # Errors
    /// When the machine is no bearing or its calibration holds no baselines.
    pub fn try_new(machine: &Machine) -> Result<Self, ReplayError> {
        let none = || ReplayError::NoBaselines(machine.name.clone());
        let Some(Kind::Bearing(bearing)) = machine.kind() else {
            return Err(none());
        };
        let file = bearing.calibration.as_ref().ok_or_else(none)?;
        let calibration = Calibration::read(&machine.resolve(file), bearing.gauges.len())
            .map_err(loadtwin_design::image_build::BuildError::from)?;
        Ok(Self {
            comparison: Comparison::try_new(machine, bearing, &calibration)?.ok_or_else(none)?,
            reference_of: BEARING_LOADS
                .map(|load| machine.references.iter().position(|r| r.load == load)),
        })
    }

    /// Adds one sample.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        let loads = (self.reference_of).map(|at| at.map_or(f64::NAN, |i| sample.references[i]));
        self.comparison.push(estimate, &loads);
    }

    /// Errors of each method by load, for `--json`.
    pub fn figures(&self) -> Value {
        let methods = METHODS.iter().zip(self.comparison.rmse());
        let by_method: Map<String, Value> = methods
            .map(|(method, rmse)| {
                let by_load: Map<String, Value> = (ESTIMATED.iter().zip(&rmse))
                    .map(|(load, rmse)| (BEARING_LOADS[*load].to_owned(), json!(rmse)))
                    .collect();
                ((*method).to_owned(), Value::Object(by_load))
            })
            .collect();
        Value::Object(by_method)
    }

    /// Tables III to V of the paper: a row for each load, its figures beside.
    pub fn table(&self) -> Table {
        let mut head = vec!["Load".to_owned()];
        for method in METHODS {
            head.extend([method.to_owned(), format!("{method}, stable")]);
        }
        head.extend(PUBLISHED.map(|(case, _)| format!("paper {case}")));
        let methods = self.comparison.rmse();
        let cell = |value: Option<f64>| value.map_or_else(|| "–".into(), |v| format!("{v:.1}"));
        let rows = (ESTIMATED.iter().enumerate())
            .map(|(i, load)| {
                let mut row = vec![BEARING_LOADS[*load].to_owned()];
                for rmse in &methods {
                    row.extend([cell(rmse[i].whole), cell(rmse[i].stable)]);
                }
                row.extend(PUBLISHED.map(|(_, [regression, cascade])| {
                    format!("{:.1} / {:.1}", regression[i], cascade[i])
                }));
                row
            })
            .collect();
        Table {
            caption: "RMSE [% of the range] where all three give loads, over a low-pass of 4 Hz; \
                      paper: regression / cascade"
                .into(),
            head,
            rows,
        }
    }
}
