//! Implements `Diagnosable` and `ResidualModel` for rotors: reads recordings as residuals of
//! displacement (m), and gives their noise, regressor columns orthogonal to the unbalance,
//! covariates, errors and remarks.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::assessment::verdict::cannot_show;
use crate::candidate_effect::fitted::FittedEffect;
use crate::candidate_effect::{Effect, Scope};
use crate::diagnosable::Diagnosable;
use crate::diagnosis::{DiagnoseError, Diagnosis, DiagnosisInput, SEED};
use crate::error_interval::LoadErrors;
use crate::regression::joint_fit::residuals_after;
use crate::residual_model::Columns;
use crate::residual_model::SignalSet;
use crate::residual_model::{Covariate, Nuisance, ResidualModel, Shaft};
use crate::rotor::recorded_samples::RotorRecording;
use crate::rotor::{
    RotorResiduals, RotorSignal, RotorTarget, candidate_effect, improved_description,
    null_simulation,
};
use crate::selection::relevance::RELEVANT_PART;
use crate::selection::stepwise::Selection;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{LoadKind, Machine, RotorLoad};

/// Blocks of the cross-validation that a recording is divided into.
const BLOCKS: usize = 32;

/// Fewest turns of a block.
const BLOCK_TURNS: f64 = 2.0;

impl Diagnosable for RotorResiduals {
    fn read(
        machine: &Machine,
        paths: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<DiagnosisInput<Self>, DiagnoseError> {
        let rotor = machine.rotor.as_ref().ok_or(DiagnoseError::NoDrivetrain)?;
        let walks = |load: &RotorLoad| load.kind == LoadKind::Walk;
        if let Some(i) = rotor.loads.iter().position(walks) {
            return Err(DiagnoseError::AnyLoad(i + 1));
        }
        let sensors = Sensors::choose(machine, None)?;
        let mut recordings = Vec::new();
        let mut end = 0.0;
        for path in paths.iter().chain(validation) {
            let recorded = RotorRecording::read(machine, rotor, &sensors, path)?;
            let mut recording = Self::new(rotor, &sensors.channels, recorded)?;
            recording.t.iter_mut().for_each(|t| *t += end);
            end = recording.t.last().copied().unwrap_or(0.0) + recording.dt_s();
            recordings.push(recording);
        }
        progress(0.3);
        let fault_free = null_simulation::simulated(machine, &sensors, &mut recordings, SEED)?;
        progress(0.9);
        let holdout = recordings.split_off(paths.len());
        let null_samples = null_simulation::null_samples(&recordings, &fault_free, SEED);
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

    /// Mean absolute residual, % of the mean absolute displacement that the sensors see.
    fn errors(recordings: &[Self], found: &[FittedEffect<Self>]) -> LoadErrors {
        let fault_free = vec![vec![1.0]; recordings[0].residuals.len()];
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
        let unbalances: Vec<Value> = (self.rotor().loads.iter().zip(self.context.sizes.chunks(2)))
            .map(|(load, size)| {
                json!({
                    "node": load.node,
                    "moment_kg_m": size[0].hypot(size[1]),
                    "phase_rad": size[1].atan2(size[0]),
                })
            })
            .collect();
        [("unbalance".to_owned(), json!(unbalances))]
            .into_iter()
            .collect()
    }

    fn remarks(&self, selection: &Selection<Self>) -> Option<String> {
        let silent = cannot_show(selection);
        (self.one_speed() && !silent.is_empty()).then(|| {
            format!(
                "at one speed an unbalance does the same as {}: not to be distinguished; {} would",
                silent.join(", "),
                candidate_effect::RUN_UP
            )
        })
    }
}

impl ResidualModel for RotorResiduals {
    type ResidualSignal = RotorSignal;
    type Regressor = SignalSet;
    type Target = RotorTarget;

    fn library() -> &'static [&'static dyn Effect<Self>] {
        candidate_effect::LIBRARY
    }

    fn dt_s(&self) -> f64 {
        self.turning().dt_s
    }

    fn speed(&self) -> &[f64] {
        &self.turning().speed
    }

    fn block(&self) -> usize {
        let n = self.t.len();
        let turning = self.turning();
        let turned = (turning.angle[n - 1] - turning.angle[0]).abs() / std::f64::consts::TAU;
        let turn = n as f64 / turned.max(1.0);
        (n / BLOCKS).max((BLOCK_TURNS * turn) as usize).max(2)
    }

    fn residuals(&self) -> &[RotorSignal] {
        &self.residuals
    }

    fn name(&self, k: usize) -> &str {
        &self.channels()[k].name
    }

    fn unit(&self, _: usize) -> &'static str {
        "m"
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
        let channel = &self.channels()[k];
        channel.to_si(channel.noise_std)
    }

    fn samples_per_independent(&self, _: usize) -> f64 {
        1.0
    }

    /// Residuals of a fault-free machine under the same profile.
    fn nuisances(&self, k: usize) -> Vec<Nuisance> {
        let mut column = self.residuals[k].fault_free.clone();
        column.resize(self.t.len(), 0.0);
        vec![Nuisance::shared(column, 1.0)]
    }

    fn columns(
        &self,
        effect: &dyn Effect<Self>,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Columns> {
        let none = || vec![Vec::new(); self.residuals.len()];
        (effect.regressors_at(self, shape, parameters).into_iter())
            .zip(effect.linear_parameters())
            .map(|(term, linear)| match effect.scope() {
                Scope::Machine => self
                    .orthogonal_part(term, linear.prior_std)
                    .unwrap_or_else(none),
                // Each sensor alone.
                Scope::PerSignal => (0..term.len())
                    .map(|own| {
                        let left =
                            self.orthogonal_part(self.on_channel(&term, own), linear.prior_std);
                        left.map(|mut all| all.swap_remove(own)).unwrap_or_default()
                    })
                    .collect(),
            })
            .collect()
    }

    fn covariates(&self) -> Vec<Covariate<'_>> {
        let turning = self.turning();
        let turn = |angle: &f64| angle.rem_euclid(std::f64::consts::TAU);
        vec![
            Covariate::new("Time", "s", &self.t),
            Covariate::new("Speed", "rad/s", &turning.speed),
            Covariate::new(
                "Shaft angle",
                "rad",
                turning.angle.iter().map(turn).collect::<Vec<f64>>(),
            ),
        ]
    }

    fn shafts(&self) -> Vec<Shaft<'_>> {
        vec![Shaft {
            name: "shaft",
            angle: self.turning().angle.as_slice().into(),
        }]
    }
}

impl RotorResiduals {
    /// Sum of the absolute residual over mean absolute displacement [%], and count, block by block.
    fn blocks_of(&self, residuals_after: &SignalSet) -> Vec<(f64, f64)> {
        let explained = self.context.explained.iter().flatten();
        let size =
            explained.map(|y| y.abs()).sum::<f64>() / (self.t.len() * self.residuals.len()) as f64;
        let block = self.block();
        (0..self.t.len())
            .step_by(block)
            .map(|from| {
                let to = (from + block).min(self.t.len());
                let known = residuals_after
                    .iter()
                    .flat_map(|of| &of[from..to])
                    .filter(|r| r.is_finite());
                let sum = known.clone().map(|r| r.abs() / size).sum::<f64>();
                (sum, known.count() as f64)
            })
            .collect()
    }
}
