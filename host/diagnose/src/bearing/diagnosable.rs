//! Implements `Diagnosable` and `ResidualModel` for bearings: reads recordings as residuals of
//! strain and cage slip, and gives their names, units, noise, regressor columns and covariates, and
//! the mean absolute residual without and with the effects found.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use loadtwin_common::bearing::GAUGES;
use serde_json::{Map, Value};

use crate::bearing::recorded_blocks::BearingRecording;
use crate::bearing::residual_computation::BearingContext;
use crate::bearing::{
    BearingResiduals, BearingSignal, BearingTarget, Kind, STREAMS, candidate_effect,
    improved_description, null_simulation,
};
use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::{DiagnoseError, Diagnosis, DiagnosisInput, SEED};
use crate::error_interval::LoadErrors;
use crate::regression::joint_fit::residuals_after;
use crate::residual_model::Columns;
use crate::residual_model::SignalSet;
use crate::residual_model::{Covariate, Nuisance, ResidualModel, Shaft};
use crate::selection::relevance::RELEVANT_PART;
use crate::selection::stepwise::Selection;
use loadtwin_design::bearing::{Calibration, Rig, calibration};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::recorded;

/// Length of the hold-out blocks [s].
const BLOCK_S: f64 = 1.5;

/// Time for which the error of a calibration is constant: about as long as the loads are [s].
const LASTS_S: f64 = 1.0;

impl BearingResiduals {
    /// The recording in `path` as residuals.
    ///
    /// # Errors
    /// When it cannot be read, lacks a load, or too little of it can be followed.
    pub(crate) fn read_one(
        rig: &Rig<'_>,
        calibration: &Calibration,
        path: &Path,
    ) -> Result<Self, DiagnoseError> {
        let samples = recorded(rig.machine, rig.sensors, path)?;
        let at_rate = |rate: f64| {
            let recorded = BearingRecording::follow(rig, calibration, &samples, rate, path)?;
            BearingContext::new(rig, calibration, recorded)
        };
        // Harmonics are gathered over the rate at which the balls pass.
        let context = at_rate(1.0 + at_rate(1.0)?.mean_slip())?;
        let dt_s = context.recorded.course.dt_s;
        let residuals = (context.residual().into_iter().enumerate())
            .map(|(k, residual)| BearingSignal {
                name: match Kind::of(k) {
                    Kind::Bulk(g) => format!("{} bulk", rig.bearing.gauges[g].name),
                    Kind::Local(g) => format!("{} local", rig.bearing.gauges[g].name),
                    Kind::Slip(row) => format!("row {row} slip"),
                },
                residual,
                noise_std: 1.0,
            })
            .collect();
        Ok(Self {
            t: (0..context.len()).map(|i| i as f64 * dt_s).collect(),
            context: Arc::new(context),
            residuals,
        })
    }

    /// Sum of the absolute residual over the mean absolute strain [%], and count, block by block.
    fn blocks_of(&self, residuals_after: &SignalSet) -> Vec<(f64, f64)> {
        let strains = self.context.predicted.iter().flat_map(|p| &p.strain);
        let rms = |c: &[f64]| c.iter().map(|c| c * c).sum::<f64>().sqrt();
        let size = strains.map(|c| rms(&c[1..])).sum::<f64>()
            / (GAUGES * self.context.predicted.len()) as f64;
        let block = self.block();
        (0..self.t.len())
            .step_by(block)
            .map(|from| {
                let to = (from + block).min(self.t.len());
                let known = residuals_after[..2 * GAUGES]
                    .iter()
                    .flat_map(|of| &of[from..to])
                    .filter(|r| r.is_finite());
                let sum = known.clone().map(|r| r.abs() / size).sum::<f64>();
                (sum, known.count() as f64)
            })
            .collect()
    }
}

impl Diagnosable for BearingResiduals {
    fn read(
        machine: &Machine,
        paths: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<DiagnosisInput<Self>, DiagnoseError> {
        let bearing = machine
            .bearing
            .as_ref()
            .ok_or(DiagnoseError::NoDrivetrain)?;
        let sensors = Sensors::choose(machine, None)?;
        let calibration = calibration(machine, bearing)?;
        let rig = Rig {
            machine,
            bearing,
            sensors: &sensors,
        };
        let mut recordings = Vec::new();
        let mut end = 0.0;
        for path in paths.iter().chain(validation) {
            let mut recording = Self::read_one(&rig, &calibration, path)?;
            recording.t.iter_mut().for_each(|t| *t += end);
            end = recording.t.last().copied().unwrap_or(0.0) + recording.dt_s();
            recordings.push(recording);
        }
        progress(0.2);
        let holdout = recordings.split_off(paths.len());
        let null_samples = null_simulation::null_samples(&rig, &mut recordings, SEED)?;
        for recording in &mut recordings {
            for (k, signal) in recording.residuals.iter_mut().enumerate() {
                signal.noise_std = rms(null_samples
                    .iter()
                    .flatten()
                    .map(|null_sample| &null_sample[k]));
            }
        }
        progress(0.9);
        Ok(DiagnosisInput {
            recordings,
            holdout,
            null_samples,
            relevant_part: RELEVANT_PART,
        })
    }

    fn write(
        machine: &Machine,
        diagnosis: &Diagnosis<Self>,
        path: &Path,
    ) -> Result<Vec<&'static str>, DiagnoseError> {
        improved_description::write(machine, diagnosis, path)
    }

    /// Mean absolute residual, % of the mean strain that goes with the balls.
    fn errors(recordings: &[Self], found: &[FittedEffect<Self>]) -> LoadErrors {
        let fault_free = vec![Vec::new(); STREAMS];
        let blocks = |found: &[FittedEffect<Self>]| -> Vec<(f64, f64)> {
            (recordings
                .iter()
                .zip(residuals_after(recordings, found, &fault_free)))
            .flat_map(|(recording, residuals_after)| recording.blocks_of(&residuals_after))
            .collect()
        };
        LoadErrors::as_described(&blocks(&[]), &blocks(found))
    }

    fn extra_json(&self) -> Map<String, Value> {
        Map::new()
    }

    fn remarks(&self, _: &Selection<Self>) -> Option<String> {
        None
    }
}

impl ResidualModel for BearingResiduals {
    type ResidualSignal = BearingSignal;
    type Regressor = SignalSet;
    type Target = BearingTarget;

    fn library() -> &'static [&'static dyn Effect<Self>] {
        candidate_effect::LIBRARY
    }

    fn dt_s(&self) -> f64 {
        self.context.recorded.course.dt_s
    }

    fn speed(&self) -> &[f64] {
        &self.context.recorded.course.speed
    }

    fn block(&self) -> usize {
        (BLOCK_S / self.dt_s()) as usize
    }

    fn residuals(&self) -> &[BearingSignal] {
        &self.residuals
    }

    fn name(&self, k: usize) -> &str {
        &self.residuals[k].name
    }

    fn unit(&self, k: usize) -> &'static str {
        match Kind::of(k) {
            Kind::Bulk(_) | Kind::Local(_) => "µm/m",
            Kind::Slip(_) => "1",
        }
    }

    fn residual(&self, k: usize) -> &[f64] {
        &self.residuals[k].residual
    }

    /// The fault-free machine is another one.
    fn fault_free(&self, _: usize) -> &[f64] {
        &[]
    }

    fn set_residual(&mut self, k: usize, residual: Vec<f64>) {
        self.residuals[k].residual = residual;
    }

    fn noise_std(&self, k: usize) -> f64 {
        self.residuals[k].noise_std
    }

    fn samples_per_independent(&self, _: usize) -> f64 {
        LASTS_S / self.dt_s()
    }

    fn nuisances(&self, _: usize) -> Vec<Nuisance> {
        Vec::new()
    }

    /// Less what an offset does; none where nothing acts.
    fn columns(
        &self,
        effect: &dyn Effect<Self>,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Columns> {
        let mut all: Vec<Columns> = (effect.regressors_at(self, shape, parameters).into_iter())
            .map(|term| self.context.projection.annihilate(term))
            .collect();
        for k in 0..STREAMS {
            let acts = (all.iter()).any(|columns| columns[k].iter().any(|v| *v != 0.0));
            if !acts {
                for columns in &mut all {
                    columns[k].clear();
                }
            }
        }
        all
    }

    fn covariates(&self) -> Vec<Covariate<'_>> {
        let load = |j: usize| -> Vec<f64> {
            (self.context.recorded.course.loads.iter())
                .map(|loads| loads[j])
                .collect()
        };
        vec![
            Covariate::new("Time", "s", &self.t),
            Covariate::new("Speed", "rad/s", self.speed()),
            Covariate::new("Fz", "N", load(2)),
            Covariate::new("Mx", "N m", load(3)),
        ]
    }

    /// None: a block is long against a turn.
    fn shafts(&self) -> Vec<Shaft<'_>> {
        Vec::new()
    }
}

/// Root mean square of the finite values.
fn rms<'a>(values: impl Iterator<Item = &'a Vec<f64>>) -> f64 {
    let known = values.flatten().filter(|v| v.is_finite());
    let (sum, n) = known.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt().max(f64::MIN_POSITIVE)
}
