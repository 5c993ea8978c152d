//! Lists the rows that `loadtwin tables` computes (`Published`): those of tables 2 and 3 of Bosmans
//! et al. 2023 with the published NMAE and, in table 3, Qd; and further tuning methods and drift
//! states that the paper does not have.

use super::Nmae;
use crate::tune::Method;

/// A row of a table in the paper, or of what the paper does not have.
#[derive(Clone, Copy, Debug)]
pub struct Published {
    /// Set of sensors of the shipped example.
    pub sensors: &'static str,
    /// What the loads' noise was tuned by.
    pub method: Method,
    /// Cut-off frequency (Hz).
    pub cutoff_hz: f64,
    /// Whether each gauge has a state for its drift.
    pub drift: bool,
    /// `log10 Qd` of both loads, in table 3.
    pub log10_qd: Option<[f64; 2]>,
    /// NMAE that the paper found (%); none for a way of tuning that it does not have.
    pub nmae: Option<Nmae>,
}

const fn table2(sensors: &'static str, nmae: Nmae) -> Published {
    Published {
        sensors,
        method: Method::Frf,
        cutoff_hz: 10.0,
        drift: false,
        log10_qd: None,
        nmae: Some(nmae),
    }
}

const fn table3(
    sensors: &'static str,
    method: Method,
    cutoff_hz: f64,
    log10_qd: [f64; 2],
    nmae: Nmae,
) -> Published {
    Published {
        sensors,
        method,
        cutoff_hz,
        drift: false,
        log10_qd: Some(log10_qd),
        nmae: Some(nmae),
    }
}

/// Bosmans et al. 2023, table 2.
pub const TABLE_2: [Published; 8] = [
    table2("torque-arm-1", [3.57, 3.80, 3.46, 3.57]),
    table2("torque-arm-3", [3.43, 3.43, 3.41, 3.49]),
    table2("torque-arm-5", [3.41, 3.99, 3.10, 3.45]),
    table2("ring-gear-1", [7.27, 5.77, 6.46, 11.46]),
    table2("ring-gear-3", [4.59, 4.65, 3.11, 8.47]),
    table2("ring-gear-5", [3.90, 3.92, 2.67, 7.15]),
    table2("high-speed-housing-1", [6.81, 8.70, 2.44, 15.96]),
    table2("high-speed-housing-3", [7.47, 6.92, 3.96, 17.56]),
];

/// Bosmans et al. 2023, table 3.
pub const TABLE_3: [Published; 12] = {
    const TA: &str = "torque-arm-3";
    const RG: &str = "ring-gear-3";
    const HSH: &str = "high-speed-housing-3";
    const F: Method = Method::Frf;
    const I: Method = Method::Innovation;
    [
        table3(TA, I, 10.0, [8.0, 4.0], [3.91, 3.71, 3.98, 4.01]),
        table3(TA, F, 1.0, [4.3, 0.8], [3.80, 5.36, 2.71, 4.62]),
        table3(TA, F, 10.0, [5.6, 2.3], [3.43, 3.43, 3.41, 3.49]),
        table3(TA, F, 100.0, [5.4, 5.1], [3.42, 3.44, 3.39, 3.46]),
        table3(RG, I, 10.0, [8.0, 6.0], [11.49, 8.94, 11.37, 15.19]),
        table3(RG, F, 1.0, [4.8, 1.1], [6.11, 8.19, 2.36, 13.35]),
        table3(RG, F, 10.0, [6.4, 2.5], [4.59, 4.65, 3.11, 8.47]),
        table3(RG, F, 100.0, [6.4, 5.3], [5.28, 4.87, 4.07, 9.05]),
        table3(HSH, I, 10.0, [8.0, 6.0], [9.93, 6.03, 7.51, 18.54]),
        table3(HSH, F, 1.0, [3.6, -0.6], [7.57, 7.07, 3.88, 18.08]),
        table3(HSH, F, 10.0, [5.1, 1.2], [7.47, 6.92, 3.96, 17.56]),
        table3(HSH, F, 100.0, [5.6, 2.5], [7.50, 6.92, 4.03, 17.55]),
    ]
};

/// Other ways of tuning, and states for the drift of gauges.
pub const OTHERS: [Published; 11] = {
    const fn row(sensors: &'static str, method: Method, cutoff_hz: f64) -> Published {
        Published {
            sensors,
            method,
            cutoff_hz,
            drift: false,
            log10_qd: None,
            nmae: None,
        }
    }
    const fn with_drift(sensors: &'static str) -> Published {
        Published {
            drift: true,
            ..row(sensors, Method::Frf, 10.0)
        }
    }
    [
        row("torque-arm-3", Method::FrfPerBand, 1.0),
        row("torque-arm-3", Method::FrfPerBand, 10.0),
        row("torque-arm-3", Method::Likelihood, 10.0),
        row("ring-gear-3", Method::FrfPerBand, 1.0),
        row("ring-gear-3", Method::FrfPerBand, 10.0),
        row("ring-gear-3", Method::Likelihood, 10.0),
        row("high-speed-housing-3", Method::FrfPerBand, 1.0),
        row("high-speed-housing-3", Method::FrfPerBand, 10.0),
        row("high-speed-housing-3", Method::Likelihood, 10.0),
        with_drift("high-speed-housing-1"),
        with_drift("high-speed-housing-3"),
    ]
};

impl Published {
    /// How the row was tuned, in words.
    pub fn tuning(&self) -> String {
        let drift = if self.drift { ", drift" } else { "" };
        format!("{} {} Hz{drift}", self.method.name(), self.cutoff_hz)
    }
}
