//! Implementation of the traits `Diagnosable` and `ResidualModel` for drivetrains: residuals and
//! null samples from recordings, nuisance and regressor columns, covariates, shaft angles, and
//! notes on missing references and on inertia or twist that differ from their description.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::{DiagnoseError, Diagnosis, DiagnosisInput, SEED};
use crate::drivetrain::candidate_effect::{GaugeModel, LIBRARY};
use crate::drivetrain::gauge_median::MIN_GAUGES;
use crate::drivetrain::load_error::load_errors;
use crate::drivetrain::plausibility::SHORTEST_S;
use crate::drivetrain::residual_signals::{
    DrivetrainResiduals, Kind, Regressor, ResidualSignal, TorqueSource,
};
use crate::drivetrain::{improved_description, null_simulation, residual_reader};
use crate::error_interval::LoadErrors;
use crate::residual_model::Columns;
use crate::residual_model::{Covariate, Nuisance, ResidualModel, Shaft};
use crate::selection::relevance::RELEVANT_PART;
use crate::selection::stepwise::Selection;
use loadtwin_machine::{Drivetrain, Inertia, Machine, Senses};

/// Length of the blocks of the cross-validation [s].
const BLOCK_S: f64 = 1.5;

/// Prior standard deviation of a gauge's zero from recording to recording, as part of full scale.
const ZERO_BETWEEN: f64 = 0.02;

/// Index of the described quantity, inertia or twist, among the nuisances of a balance or an angle.
const DESCRIBED: usize = 1;

/// Prior standard deviation of all moments of inertia together, relative, where not each has a stated one.
const INERTIA: f64 = 0.02;

/// Prior standard deviation of the twist between encoders, relative, where not each stiffness has a stated one.
const TWIST: f64 = 0.1;

/// Relative standard deviation of the sum of all moments of `drivetrain`, whose errors are independent.
fn total_moment_std(drivetrain: &Drivetrain) -> f64 {
    let stated = |i: &Inertia| Some(i.moment_std_kg_m2? * i.speed_ratio.powi(2));
    let squares = drivetrain.inertias.iter().map(|i| Some(stated(i)?.powi(2)));
    let total: f64 = drivetrain
        .inertias
        .iter()
        .map(Inertia::referred_moment)
        .sum();
    let square = squares.sum::<Option<f64>>();
    square.map_or(INERTIA, |square| square.sqrt() / total)
}

/// Relative standard deviation of a twist of the shafts of `drivetrain`: that of the least known stiffness.
fn twist_std(drivetrain: &Drivetrain) -> f64 {
    let shafts = drivetrain.shafts.iter();
    let stds = shafts.map(|s| Some(s.stiffness_std_nm_per_rad? / s.stiffness_nm_per_rad));
    let stds: Option<Vec<f64>> = stds.collect();
    stds.map_or(TWIST, |stds| stds.into_iter().fold(0.0, f64::max))
}

/// Standard deviations from which an error of the description is reported.
const OFF: f64 = 2.0;

impl Diagnosable for DrivetrainResiduals {
    fn read(
        machine: &Machine,
        paths: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<DiagnosisInput<DrivetrainResiduals>, DiagnoseError> {
        let machine = &measured_load_first(machine);
        let mut recordings = read(machine, &[paths, validation].concat())?;
        let mut holdout = recordings.split_off(paths.len());
        check_duration(&recordings, paths)?;
        let mut end = 0.0;
        for recording in recordings.iter_mut().chain(&mut holdout) {
            for t in &mut recording.signals.t {
                *t += end;
            }
            end = recording.signals.t.last().copied().unwrap_or(0.0) + recording.signals.dt_s;
        }
        progress(0.2);
        let null_samples = null_simulation::null_samples(machine, &mut recordings, SEED);
        for recording in &mut recordings {
            residual_reader::remove_carrier_offset(
                &mut recording.residuals,
                recording.signals.count,
            );
        }
        for recording in recordings.iter_mut().chain(&mut holdout) {
            recording.mask_quantised_standstill();
        }
        progress(1.0);
        Ok(DiagnosisInput {
            recordings,
            holdout,
            null_samples,
            relevant_part: RELEVANT_PART,
        })
    }

    fn write(
        machine: &Machine,
        diagnosis: &Diagnosis<DrivetrainResiduals>,
        path: &Path,
    ) -> Result<Vec<&'static str>, DiagnoseError> {
        improved_description::write(machine, diagnosis, path)
    }

    fn errors(recordings: &[Self], found: &[FittedEffect<DrivetrainResiduals>]) -> LoadErrors {
        load_errors(recordings, found)
    }

    fn extra_json(&self) -> Map<String, Value> {
        [("torque_told_by".to_owned(), json!(self.torque_source))]
            .into_iter()
            .collect()
    }

    fn remarks(&self, selection: &Selection<Self>) -> Option<String> {
        let lacks = match self.torque_source {
            TorqueSource::References if self.missing_references.is_empty() => None,
            TorqueSource::References => Some(format!(
                "no values of the reference `{}`: effects of the torque balance are not tested",
                self.missing_references.join("`, `")
            )),
            TorqueSource::Gauges => Some(
                "no reference load: what all gauges have in common cannot be distinguished from the torque"
                    .into(),
            ),
            TorqueSource::Filter => Some(format!(
                "no reference load and no shaft with {MIN_GAUGES} gauges: only innovations are tested; \
                 what the estimated load takes up is not seen, and no effect can be named",
            )),
        };
        let off = self.description_off(&selection.nuisance);
        let notes: Vec<String> = lacks.into_iter().chain(off).collect();
        (!notes.is_empty()).then(|| notes.join("; "))
    }
}

impl ResidualModel for DrivetrainResiduals {
    type ResidualSignal = ResidualSignal;
    type Regressor = Regressor;
    type Target = GaugeModel;

    fn library() -> &'static [&'static dyn Effect<DrivetrainResiduals>] {
        LIBRARY
    }

    fn dt_s(&self) -> f64 {
        self.signals.dt_s
    }

    fn speed(&self) -> &[f64] {
        &self.signals.speed
    }

    fn block(&self) -> usize {
        ((BLOCK_S / self.signals.dt_s) as usize).max(2)
    }

    fn residuals(&self) -> &[ResidualSignal] {
        &self.residuals
    }

    fn name(&self, k: usize) -> &str {
        &self.residuals[k].name
    }

    fn unit(&self, k: usize) -> &'static str {
        self.residuals[k].unit
    }

    fn residual(&self, k: usize) -> &[f64] {
        &self.residuals[k].residual
    }

    fn fault_free(&self, k: usize) -> &[f64] {
        &self.residuals[k].fault_free
    }

    fn set_residual(&mut self, k: usize, residual: Vec<f64>) {
        self.residuals[k].residual = residual;
    }

    fn noise_std(&self, k: usize) -> f64 {
        self.residuals[k].noise_std
    }

    fn full_scale(&self, k: usize) -> Option<f64> {
        let signal = &self.residuals[k];
        (signal.kind != Kind::Innovation).then_some(signal.scale)
    }

    fn has_reference_torque(&self) -> bool {
        self.torque_source == TorqueSource::References
    }

    fn samples_per_independent(&self, k: usize) -> f64 {
        match self.residuals[k].kind {
            Kind::Balance => 1.5 * self.signals.smoothing as f64,
            // Counts err alike for a while at a steady speed.
            Kind::Angle => 16.0,
            Kind::Strain | Kind::Innovation => 1.0,
        }
    }

    fn zero_std(&self, k: usize) -> f64 {
        let signal = &self.residuals[k];
        let part = match signal.kind {
            Kind::Strain | Kind::Innovation => 1.0,
            Kind::Balance => 1e-3,
            Kind::Angle => 1e3,
        };
        part * signal.scale
    }

    /// A zero for each strain and angle, a count by which the carrier's zero may be off, the
    /// reference's zero, an error of the inertia and one of the time in the balance, an error of the
    /// stiffness in an angle; the uncertain parameters; the initial vibration; and the residual of a
    /// fault-free machine under the same profile. Zeros, counts and initial vibrations differ from
    /// recording to recording.
    ///
    /// The zero comes first, and at `DESCRIBED` the inertia of a balance or the twist of an angle.
    fn nuisances(&self, k: usize) -> Vec<Nuisance> {
        let (signal, signals) = (&self.residuals[k], &self.signals);
        let n = signals.len();
        let std = self.zero_std(k);
        let zero = |part: f64| Nuisance::per_recording(vec![1.0; n], std, part * std);
        let mut own = match signal.kind {
            Kind::Strain | Kind::Innovation => vec![zero(ZERO_BETWEEN)],
            Kind::Balance => {
                let bodies = signals.response.iter().flat_map(|r| &r.bodies);
                let moment: f64 = bodies.map(|b| b.0).sum();
                let inertia = signals.acceleration.iter().map(|a| a * moment);
                let time_skew = signals.time_skew().into_iter().map(|a| a * moment);
                vec![
                    zero(1.0),
                    Nuisance::shared(inertia.collect(), self.described_std(Kind::Balance)),
                    Nuisance::shared(time_skew.collect(), 1.0),
                ]
            }
            Kind::Angle => {
                let twist = signals.level.iter().map(|l| l * signal.scale);
                vec![
                    zero(1.0),
                    Nuisance::shared(twist.collect(), self.described_std(Kind::Angle)),
                ]
            }
        };
        if signal.over_angle() && signals.count > 0.0 {
            own.push(Nuisance::per_recording(
                signal.slope.clone(),
                signals.count,
                signals.count,
            ));
        }
        own.extend(
            (signal.parameter_sensitivities.iter())
                .map(|column| Nuisance::shared(column.clone(), 1.0)),
        );
        own.extend(
            (signal.initial_vibrations.iter())
                .map(|column| Nuisance::per_recording(column.clone(), 1.0, 1.0)),
        );
        let mut fault_free = signal.fault_free.clone();
        fault_free.resize(n, 0.0);
        own.push(Nuisance::shared(fault_free, 1.0));
        own
    }

    fn columns(
        &self,
        effect: &dyn Effect<DrivetrainResiduals>,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Columns> {
        let terms = effect.regressors_at(self, shape, parameters);
        self.columns_where_it_acts(effect, &terms)
    }

    fn nuisances_of(
        &self,
        effect: &dyn Effect<DrivetrainResiduals>,
        shape: &[f64],
    ) -> Vec<Columns> {
        self.columns_where_it_acts(effect, &effect.own_nuisances(self, shape))
    }

    fn covariates(&self) -> Vec<Covariate<'_>> {
        let signals = &self.signals;
        let turn = |angle: &f64| angle.rem_euclid(std::f64::consts::TAU);
        let mut all = vec![
            Covariate::new("Time", "s", &signals.t),
            Covariate::new("Torque over nominal", "", &signals.level),
            Covariate::new("Change of torque over nominal", "1/s", signals.change()),
            Covariate::new("Speed of the main shaft", "rad/s", &signals.speed),
            Covariate::new(
                "Acceleration of the main shaft",
                "rad/s²",
                &signals.acceleration,
            ),
            Covariate::new(
                "Carrier angle",
                "rad",
                signals.angle.iter().map(turn).collect::<Vec<f64>>(),
            ),
        ];
        if let Some(warming) = &signals.warming {
            all.push(Covariate::new("Warmer than where zeros hold", "K", warming));
        }
        all
    }

    fn shafts(&self) -> Vec<Shaft<'_>> {
        let signals = &self.signals;
        let mut ratios: Vec<f64> = Vec::new();
        let mut shafts = Vec::new();
        for (name, ratio) in signals.inertias.iter().zip(&signals.ratios) {
            if !ratios.iter().any(|r| (r / ratio).abs() == 1.0) {
                ratios.push(*ratio);
                let angle: Vec<f64> = signals.angle.iter().map(|a| a * ratio).collect();
                shafts.push(Shaft {
                    name,
                    angle: angle.into(),
                });
            }
        }
        shafts
    }
}

impl DrivetrainResiduals {
    /// Relative standard deviation of what a signal of `kind` shows at once of the description.
    fn described_std(&self, kind: Kind) -> f64 {
        let chain = self.signals.response.as_ref().map(|r| &r.driven.drivetrain);
        match kind {
            Kind::Angle => chain.map_or(TWIST, twist_std),
            _ => chain.map_or(INERTIA, total_moment_std),
        }
    }

    /// Where the description is off by more than it should be, by the nuisances of each signal.
    fn description_off(&self, nuisance: &[Vec<f64>]) -> Vec<String> {
        (self.residuals.iter().zip(nuisance))
            .filter_map(|(signal, own)| {
                let name = &signal.name;
                let what = match signal.kind {
                    Kind::Balance => "moments of inertia that differ",
                    Kind::Angle => "a twist that differs",
                    Kind::Strain | Kind::Innovation => return None,
                };
                let known_to = self.described_std(signal.kind);
                let part = own.get(DESCRIBED).filter(|part| part.abs() > OFF * known_to)?;
                let percent = 100.0 * part * signal.sign_of_twist();
                Some(format!(
                    "{name}: fits {what} by {percent:+.1} % from the described; mend the description first"
                ))
            })
            .collect()
    }

    /// The column of each of `terms` in each signal that `effect` acts on.
    fn columns_where_it_acts(
        &self,
        effect: &dyn Effect<DrivetrainResiduals>,
        terms: &[Regressor],
    ) -> Vec<Columns> {
        let columns = |term: &Regressor| {
            let mut columns = self.columns_of(term);
            for (signal, column) in self.residuals.iter().zip(&mut columns) {
                if !effect.applies_to(signal) {
                    column.clear();
                }
            }
            columns
        };
        terms.iter().map(columns).collect()
    }
}

/// The same machine, a measured load before one that is not: null samples are simulated under the
/// first load.
fn measured_load_first(machine: &Machine) -> Machine {
    let mut sorted = machine.clone();
    if let Some(drivetrain) = &mut sorted.drivetrain {
        drivetrain.loads.sort_by_key(|load| {
            let sensed = Senses::Load(load.name.clone());
            let is_measured = machine.references.iter().any(|r| r.load == load.name)
                || machine.channels.iter().any(|c| c.senses == sensed);
            !is_measured
        });
    }
    sorted
}

/// Refuses recordings that are together too short.
fn check_duration(
    recordings: &[DrivetrainResiduals],
    paths: &[PathBuf],
) -> Result<(), DiagnoseError> {
    let seconds: f64 = (recordings.iter())
        .map(|r| r.signals.len() as f64 * r.signals.dt_s)
        .sum();
    // Decimation drops less than a sample of each.
    let rounding: f64 = recordings.iter().map(|r| r.signals.dt_s).sum();
    if seconds + rounding >= SHORTEST_S {
        return Ok(());
    }
    Err(DiagnoseError::TooLittle {
        recording: paths.first().cloned().unwrap_or_default(),
        reason: format!(
            "{seconds:.1} s are too short to tell an effect from chance; at least {SHORTEST_S} s are needed, in \
             one recording or in several"
        ),
    })
}

/// All paths, given the torque in the same way.
fn read(machine: &Machine, paths: &[PathBuf]) -> Result<Vec<DrivetrainResiduals>, DiagnoseError> {
    let by = |torque_source: TorqueSource| {
        paths
            .iter()
            .map(|path| residual_reader::read_residuals_given(machine, path, torque_source))
            .collect::<Result<Vec<_>, _>>()
    };
    let mut recordings = by(TorqueSource::References)?;
    if recordings
        .iter()
        .any(|s| s.torque_source != recordings[0].torque_source)
    {
        recordings = by(TorqueSource::Gauges)?;
    }
    for (path, recording) in paths.iter().zip(&recordings) {
        let first = (&paths[0], &recordings[0]);
        if let Some((has, lacks, what)) = differing(first, (path, recording)) {
            let reason = format!(
                "has no {what}, as {} has; recordings that are diagnosed together need the same columns",
                has.display()
            );
            return Err(DiagnoseError::TooLittle {
                recording: lacks.clone(),
                reason,
            });
        }
    }
    Ok(recordings)
}

/// Which of two paths has what the other one has not.
fn differing<'a>(
    (a, of_a): (&'a PathBuf, &DrivetrainResiduals),
    (b, of_b): (&'a PathBuf, &DrivetrainResiduals),
) -> Option<(&'a PathBuf, &'a PathBuf, String)> {
    let beyond = |one: &DrivetrainResiduals, other: &DrivetrainResiduals| {
        let missing = |s: &&ResidualSignal| !other.residuals.iter().any(|o| o.name == s.name);
        let (own, others) = (&one.signals, &other.signals);
        if let Some(signal) = one.residuals.iter().find(missing) {
            Some(signal.name.clone())
        } else if own.response.is_some() && others.response.is_none() {
            Some("reference for each load".to_owned())
        } else {
            (own.warming.is_some() && others.warming.is_none()).then(|| "temperature".to_owned())
        }
    };
    (beyond(of_a, of_b).map(|what| (a, b, what)))
        .or_else(|| beyond(of_b, of_a).map(|what| (b, a, what)))
}
