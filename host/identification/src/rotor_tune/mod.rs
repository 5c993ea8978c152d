//! Tunes the noise of a rotor's filter: by differential evolution on the objectives of Rezende et
//! al. 2023, and by maximum likelihood of the innovations.

mod evaluation;
mod filter_trial;
mod report_page;

pub use crate::rotor_tune::evaluation::{Evaluation, evaluate};
pub use crate::rotor_tune::filter_trial::{Outcome, Trial};
pub use crate::rotor_tune::report_page::page;

use crate::tune::{Evolution, Training, TuneError, pattern_search};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Machine, Rotor};

/// Range of each number to either side of the described one [decades].
const REACH: f64 = 3.0;

/// First and last step of the search for the likelihood [decades].
const STEPS: (f64, f64) = (1.0, 0.1);

/// Size of the evolutions, each of which ends within some percent of its objective.
const EVOLUTION: Evolution = Evolution {
    population: 20,
    generations: 20,
    seed: 1,
};

/// How the noise is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// As described.
    Described,
    /// Differential evolution on two objectives, brought together by compromise.
    Evolution,
    /// Largest likelihood of the innovations; needs no reference of the loads.
    Likelihood,
}

impl Method {
    /// What `--method` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Described => "described",
            Self::Evolution => "evolution",
            Self::Likelihood => "likelihood",
        }
    }
}

/// What one method chose.
pub struct Choice {
    /// The method.
    pub method: Method,
    /// The description with the noise that it chose.
    pub machine: Machine,
    /// What the filter says with it on the recordings that were tuned on.
    pub outcome: Outcome,
}

/// Tunes walk of the loads, model error, spread before the first sample and noise of the
/// sensors of `rotor` on `training`: as described, and by each method.
///
/// The evolution minimises `f_1 = sum_j 1 - R^2(y_j, h_j x)` over the sensors, with x the
/// estimate, and `f_2`, the same with displacements that the model computes from the estimated
/// forces; then the distance from the best of both, `|(f_i - f_i,best) / (f_i,worst - f_i,best)|`,
/// the worst being that at the best of the other. `R^2` and not `|R^2|`, which rewards -1.
///
/// # Errors
/// When a recording or the machine cannot be used.
///
/// Source: Rezende et al. 2023, section 3, eq. (15); Lobato 2008.
pub fn tune(
    machine: &Machine,
    rotor: &Rotor,
    sensors: &Sensors,
    training: Training<'_>,
    progress: impl Fn(f64),
) -> Result<Vec<Choice>, TuneError> {
    // Readings are held against the estimate that they themselves make.
    let mut prompt = machine.clone();
    if let Some(rotor) = &mut prompt.rotor {
        rotor.lag_samples = Some(0);
    }
    let payload = loadtwin_design::image_build::image(&prompt, sensors)?;
    let trial = Trial::new(machine, rotor, sensors, &payload, training)?;
    let count = rotor.loads.len() + 2 + sensors.channels.len();
    let start = vec![0.0; count];
    progress(0.05);
    let (likely, _) = pattern_search(&start, STEPS.0, STEPS.1, REACH, |x| trial.run(x).misfit);
    progress(0.3);
    let bounds = vec![(-REACH, REACH); count];
    let known = [start.clone()];
    let objectives = |x: &[f64]| trial.run(x).objectives;
    let best: Vec<Vec<f64>> = (0..2)
        .map(|i| {
            let (point, _) = EVOLUTION.minimise(&bounds, &known, |x| objectives(x)[i]);
            progress(0.5 + 0.2 * i as f64);
            point
        })
        .collect();
    let ends: Vec<[f64; 2]> = best.iter().map(|x| objectives(x)).collect();
    let compromise = |x: &[f64]| {
        let found = objectives(x);
        let part = |i: usize| {
            let (least, most) = (ends[i][i], ends[1 - i][i]);
            (found[i] - least) / (most - least).max(f64::EPSILON)
        };
        part(0).hypot(part(1))
    };
    let (evolved, _) = EVOLUTION.minimise(&bounds, &best, compromise);
    progress(1.0);
    let choice = |method, x: &[f64]| Choice {
        method,
        machine: trial.machine_at(x),
        outcome: trial.run(x),
    };
    Ok(vec![
        choice(Method::Described, &start),
        choice(Method::Evolution, &evolved),
        choice(Method::Likelihood, &likely),
    ])
}
