//! Tunes the random walks of a drivetrain's loads by six methods: frequency response in two
//! weightings, innovation norm, L-curve, likelihood, error to reference loads.

use std::f64::consts::TAU;

use loadtwin_common::drivetrain::GearboxModel;
use loadtwin_common::image::{Image, Model};
use rayon::prelude::*;

use crate::tune::TuneError;
use crate::tune::filter_trial::{Outcome, Trial};
use crate::tune::frequency_response::{FrequencyResponse, Weighting};
use crate::tune::pattern_search::pattern_search;
use crate::tune::training_recordings::Training;
use loadtwin_design::gearbox::OperatingPoint;
use loadtwin_design::image_build::{self, Sensors};
use loadtwin_machine::{Drivetrain, Machine};
use loadtwin_replay::ReplayError;

/// Carrier angles at which the frequency response is tuned.
const ANGLES: usize = 16;

/// Range of the search by likelihood, innovation norm and error, to either side of its start
/// [decades].
const REACH: f64 = 4.0;

/// How the variance of the loads' steps is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Closed-loop frequency response, eq. (23) as printed.
    Frf,
    /// The same with each band averaged by itself: full bandwidth at any price.
    FrfPerBand,
    /// Least innovation norm.
    Innovation,
    /// Corner of the L-curve of solution norm over innovation norm.
    LCurve,
    /// Largest likelihood of the innovations (prediction error).
    Likelihood,
    /// Least mean absolute error to the reference loads.
    Reference,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Frf,
        Self::FrfPerBand,
        Self::Innovation,
        Self::LCurve,
        Self::Likelihood,
        Self::Reference,
    ];

    /// What `--method` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frf => "frf",
            Self::FrfPerBand => "frf-per-band",
            Self::Innovation => "innovation",
            Self::LCurve => "l-curve",
            Self::Likelihood => "likelihood",
            Self::Reference => "reference",
        }
    }
}

/// Random walk of each load.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadNoise {
    /// Standard deviation over one second, `Qd = walk^2 dt` [N m/sqrt(s)].
    pub walk: Vec<f64>,
    /// `log10 Qd`, Qd in (N m)^2 a sample.
    pub log10_qd: Vec<f64>,
    /// What the estimator says with it, where it was tried.
    pub outcome: Option<Outcome>,
}

/// The load noise by each method that was asked for, and the response of the first.
pub struct Tuned {
    /// In the order asked for.
    pub methods: Vec<(Method, LoadNoise)>,
    /// Frequency (Hz) and the median over the carrier angle of `|H|` of each
    /// load, with the noise of the first method.
    pub response: Vec<(f64, Vec<f64>)>,
    responses: Vec<FrequencyResponse>,
    nominal: Vec<f64>,
    rate_hz: f64,
}

impl Tuned {
    /// As `response`, with random walks of the loads of `walk` [N m/sqrt(s)].
    pub fn response_with(&self, walk: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let loads = walk.iter().zip(&self.nominal);
        let variance: Vec<f64> = (loads)
            .map(|(walk, nominal)| walk * walk / self.rate_hz / (nominal * nominal))
            .collect();
        median_response(&self.responses, &variance)
    }
}

/// The walk of each load, common to sets of sensors, from the estimates of each, `[set][load]`:
/// the median, of an even number of sets the lower of the two in the middle.
///
/// The likelihood asks how the loads moved, which is the same for every set. What a set's model
/// gets wrong can only pass for a load that moves faster.
pub fn common_walk(estimated: &[&[f64]]) -> Vec<f64> {
    let loads = estimated.first().map_or(0, |walks| walks.len());
    let of_load = |j: usize| {
        let mut walks: Vec<f64> = estimated.iter().map(|walks| walks[j]).collect();
        walks.sort_by(f64::total_cmp);
        walks[(walks.len() - 1) / 2]
    };
    (0..loads).map(of_load).collect()
}

/// Tunes the load noise of `machine` with `sensors` by `methods`. All but the frequency responses
/// run the estimator on `training`; their search starts from the described noise or from that of
/// [`Method::Frf`], whichever is better, the L-curve from the latter.
///
/// # Errors
/// When the cut-off is out of range, a recording cannot be used, or the
/// sensors do not observe the loads.
///
/// Source: Bosmans et al. 2023, section 5.3.3; Hansen 1992 for the L-curve.
pub fn tune_loads(
    machine: &Machine,
    sensors: &Sensors,
    training: Training<'_>,
    cutoff_hz: f64,
    methods: &[Method],
    progress: impl Fn(f64),
) -> Result<Tuned, TuneError> {
    let most = 0.5 * machine.rate_hz;
    if !(cutoff_hz > 0.0 && cutoff_hz < most) {
        return Err(TuneError::Cutoff {
            found: cutoff_hz,
            most,
        });
    }
    let drivetrain = machine
        .drivetrain
        .as_ref()
        .ok_or(crate::calibrate::CalibrateError::NoDrivetrain)?;
    let payload = image_build::image(machine, sensors)?;
    let Model::Gearbox(model) = Image::from_bytes(&payload)
        .map_err(ReplayError::Image)?
        .model
    else {
        return Err(crate::calibrate::CalibrateError::NoDrivetrain.into());
    };
    let nominal: Vec<f64> = drivetrain.loads.iter().map(|l| l.nominal_nm).collect();
    let responses = Responses::new(machine, drivetrain, &model, cutoff_hz)?;
    let tries = methods
        .iter()
        .any(|m| !matches!(m, Method::Frf | Method::FrfPerBand));
    let trial = tries
        .then(|| Trial::new(machine, sensors, &payload, training))
        .transpose()?;
    let standard = responses.tuned(Weighting::Literal);
    let described: Vec<f64> = (model.load_noise.iter().take(nominal.len()))
        .map(|variance| f64::from(*variance))
        .collect();
    let mut found = Vec::new();
    for (k, method) in methods.iter().enumerate() {
        progress((k as f64 + 0.5) / (methods.len() as f64 + 0.5));
        let variance = variance(*method, trial.as_ref(), &responses, &standard, &described)?;
        let qd = |j: usize| variance[j] * nominal[j] * nominal[j];
        let noise = LoadNoise {
            walk: (0..nominal.len())
                .map(|j| (qd(j) * machine.rate_hz).sqrt())
                .collect(),
            log10_qd: (0..nominal.len()).map(|j| qd(j).log10()).collect(),
            outcome: trial.as_ref().map(|trial| trial.run(&variance)),
        };
        found.push((*method, noise));
    }
    let mut tuned = Tuned {
        methods: found,
        response: Vec::new(),
        responses: responses.over_angle,
        nominal,
        rate_hz: machine.rate_hz,
    };
    if let Some((_, noise)) = tuned.methods.first() {
        tuned.response = tuned.response_with(&noise.walk);
    }
    Ok(tuned)
}

/// Variances of the loads, parts of nominal, by one method.
fn variance(
    method: Method,
    trial: Option<&Trial<'_>>,
    responses: &Responses,
    standard: &[f64],
    described: &[f64],
) -> Result<Vec<f64>, TuneError> {
    let starts = [standard, described];
    let found = match (method, trial) {
        (Method::FrfPerBand, _) => responses.tuned(Weighting::PerBand),
        (Method::Innovation, Some(trial)) => search(&starts, |q| trial.run(q).innovation),
        (Method::Likelihood, Some(trial)) => search(&starts, |q| trial.run(q).misfit),
        (Method::Reference, Some(trial)) => {
            if trial.run(described).error_percent.is_none() {
                return Err(TuneError::NoReference);
            }
            search(&starts, |q| {
                trial.run(q).error_percent.unwrap_or(f64::INFINITY)
            })
        }
        (Method::LCurve, Some(trial)) => corner(standard, trial),
        _ => standard.to_vec(),
    };
    Ok(found)
}

/// Frequency responses of the filter over the carrier angle.
struct Responses {
    over_angle: Vec<FrequencyResponse>,
    /// Variances of the loads, parts of nominal, from which they are tuned.
    start: Vec<f64>,
}

impl Responses {
    /// # Errors
    /// When the sensors do not observe the loads at any angle.
    fn new(
        machine: &Machine,
        drivetrain: &Drivetrain,
        model: &GearboxModel<'_>,
        cutoff_hz: f64,
    ) -> Result<Self, TuneError> {
        let over_angle: Vec<FrequencyResponse> = (0..ANGLES)
            .into_par_iter()
            .map(|i| {
                let angle = TAU * i as f64 / ANGLES as f64;
                let point = OperatingPoint::new(model, drivetrain, angle);
                FrequencyResponse::new(point, machine.rate_hz, cutoff_hz)
            })
            .collect();
        // Half the nominal load in a second.
        let start = vec![0.25 / machine.rate_hz; drivetrain.loads.len()];
        if over_angle.iter().all(|r| r.magnitudes(&start).is_none()) {
            return Err(TuneError::NoSteadyFilter);
        }
        Ok(Self { over_angle, start })
    }

    /// The variance of each load, parts of nominal: the median over the angle.
    fn tuned(&self, weighting: Weighting) -> Vec<f64> {
        let tuned: Vec<Vec<f64>> = (self.over_angle.par_iter())
            .filter(|r| r.objective(&self.start, weighting).is_finite())
            .map(|r| r.tuned(&self.start, weighting))
            .collect();
        (0..self.start.len())
            .map(|j| median(tuned.iter().map(|q| q[j]).collect()))
            .collect()
    }
}

/// Least `value` over the logarithms of the variances, from the best of `starts`.
fn search(starts: &[&[f64]], value: impl Fn(&[f64]) -> f64 + Sync) -> Vec<f64> {
    let usable = starts.iter().filter(|start| start.iter().all(|q| *q > 0.0));
    let best = usable.min_by(|a, b| value(a).total_cmp(&value(b)));
    let start = best.or(starts.first()).copied().unwrap_or_default();
    let logarithms: Vec<f64> = start.iter().map(|q| q.log10()).collect();
    let exponential = |x: &[f64]| x.iter().map(|x| 10.0_f64.powf(*x)).collect::<Vec<_>>();
    exponential(&pattern_search(&logarithms, 1.0, 0.25, REACH, |x| value(&exponential(x))).0)
}

/// Where the curve of solution norm over innovation norm, both logarithmic,
/// turns most sharply, all variances in the proportion of `start`.
fn corner(start: &[f64], trial: &Trial<'_>) -> Vec<f64> {
    let decades: Vec<f64> = (-8..=8).map(|i| 0.5 * f64::from(i)).collect();
    let scaled = |decade: f64| {
        start
            .iter()
            .map(|q| q * 10.0_f64.powf(decade))
            .collect::<Vec<_>>()
    };
    let curve: Vec<[f64; 2]> = decades
        .par_iter()
        .map(|decade| {
            let outcome = trial.run(&scaled(*decade));
            [outcome.innovation.ln(), outcome.load.ln()]
        })
        .collect();
    let curvature = |i: usize| {
        let (a, b, c) = (curve[i - 1], curve[i], curve[i + 1]);
        let side = |p: [f64; 2], q: [f64; 2]| (q[0] - p[0]).hypot(q[1] - p[1]);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        2.0 * area.abs() / (side(a, b) * side(b, c) * side(a, c)).max(1e-12)
    };
    let best = (1..curve.len() - 1)
        .filter(|i| curvature(*i).is_finite())
        .max_by(|a, b| curvature(*a).total_cmp(&curvature(*b)));
    scaled(best.map_or(0.0, |i| decades[i]))
}

fn median_response(responses: &[FrequencyResponse], variance: &[f64]) -> Vec<(f64, Vec<f64>)> {
    let all: Vec<Vec<(f64, Vec<f64>)>> = responses
        .par_iter()
        .filter_map(|r| r.magnitudes(variance))
        .collect();
    let Some(first) = all.first() else {
        return Vec::new();
    };
    (0..first.len())
        .map(|i| {
            let of_load = |j: usize| median(all.iter().map(|r| r[i].1[j]).collect());
            (first[i].0, (0..variance.len()).map(of_load).collect())
        })
        .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => values[n / 2],
        _ => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::common_walk;

    #[test]
    fn a_set_whose_model_is_wrong_is_outvoted() {
        let estimated: [&[f64]; 3] = [&[7.0, 2.0], &[900.0, 1.0], &[8.0, 3.0]];
        assert_eq!(common_walk(&estimated), [8.0, 2.0]);
        assert_eq!(common_walk(&estimated[..2]), [7.0, 1.0]);
        assert_eq!(common_walk(&estimated[..1]), [7.0, 2.0]);
    }
}
