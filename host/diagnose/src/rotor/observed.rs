//! A recording of a rotor as the judgement sees it.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::recorded::Recorded;
use super::{Readings, RotorPlace, RotorSession, RotorStream, clean, effect, write};
use crate::effect::{Coupling, Effect};
use crate::error::LoadErrors;
use crate::observed::{Abscissa, Nuisance, Observed, Shaft};
use crate::refit::rest;
use crate::select::{Found, Selection};
use crate::stream::Columns;
use crate::{DiagnoseError, Diagnosis, Residuals, SEED, cannot_show};
use loadtwin_design::build::Sensors;
use loadtwin_machine::{LoadKind, Machine, RotorLoad};

/// Blocks that a recording is divided into, at least so many turns each.
const BLOCKS: usize = 32;
const BLOCK_TURNS: f64 = 2.0;

impl Observed for RotorSession {
    type Stream = RotorStream;
    type Term = Readings;
    type Place = RotorPlace;

    fn library() -> &'static [&'static dyn Effect<Self>] {
        effect::LIBRARY
    }

    fn read(
        machine: &Machine,
        recordings: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<Residuals<Self>, DiagnoseError> {
        let rotor = machine.rotor.as_ref().ok_or(DiagnoseError::NoDrivetrain)?;
        let walks = |load: &RotorLoad| load.kind == LoadKind::Walk;
        if let Some(i) = rotor.loads.iter().position(walks) {
            return Err(DiagnoseError::AnyLoad(i + 1));
        }
        let sensors = Sensors::choose(machine, None)?;
        let mut sessions = Vec::new();
        let mut end = 0.0;
        for path in recordings.iter().chain(validation) {
            let recorded = Recorded::read(machine, rotor, &sensors, path)?;
            let mut session = Self::new(rotor, &sensors.channels, recorded)?;
            session.t.iter_mut().for_each(|t| *t += end);
            end = session.t.last().copied().unwrap_or(0.0) + session.dt_s();
            sessions.push(session);
        }
        progress(0.3);
        let clean = clean::simulated(machine, &sensors, &mut sessions, SEED)?;
        progress(0.9);
        let unseen = sessions.split_off(recordings.len());
        let draws = clean::draws(&sessions, &clean, SEED);
        Ok(Residuals {
            sessions,
            unseen,
            draws,
        })
    }

    fn write(
        machine: &Machine,
        diagnosis: &Diagnosis<Self>,
        path: &Path,
    ) -> Result<Vec<&'static str>, DiagnoseError> {
        write::write(machine, diagnosis, path)
    }

    /// Mean absolute residual, % of the mean absolute displacement that the sensors see.
    fn errors(sessions: &[Self], found: &[Found<Self>]) -> LoadErrors {
        let clean = vec![vec![1.0]; sessions[0].streams.len()];
        let blocks = |found: &[Found<Self>]| -> Vec<(f64, f64)> {
            (sessions.iter().zip(rest(sessions, found, &clean)))
                .flat_map(|(session, rest)| session.blocks_of(&rest))
                .collect()
        };
        LoadErrors::as_described(&blocks(&[]), &blocks(found))
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

    fn streams(&self) -> &[RotorStream] {
        &self.streams
    }

    fn name(&self, k: usize) -> &str {
        &self.channels()[k].name
    }

    fn unit(&self, _: usize) -> &'static str {
        "m"
    }

    fn residual(&self, k: usize) -> &[f64] {
        &self.streams[k].residual
    }

    fn clean(&self, k: usize) -> &[f64] {
        &self.streams[k].clean
    }

    fn set_residual(&mut self, k: usize, residual: Vec<f64>) {
        self.streams[k].residual = residual;
    }

    fn noise_std(&self, k: usize) -> f64 {
        let channel = &self.channels()[k];
        channel.to_si(channel.noise_std)
    }

    fn inflation(&self, _: usize) -> f64 {
        1.0
    }

    /// What a clean machine leaves when it does the same.
    fn nuisances(&self, k: usize) -> Vec<Nuisance> {
        let mut column = self.streams[k].clean.clone();
        column.resize(self.t.len(), 0.0);
        vec![Nuisance::of_machine(column, 1.0)]
    }

    fn columns(
        &self,
        effect: &dyn Effect<Self>,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Columns> {
        let none = || vec![Vec::new(); self.streams.len()];
        (effect.terms_about(self, shape, parameters).into_iter())
            .zip(effect.linear())
            .map(|(term, linear)| match effect.coupling() {
                Coupling::Shared => self.left_of(term, linear.prior_std).unwrap_or_else(none),
                // Each sensor alone.
                Coupling::Own => (0..term.len())
                    .map(|own| {
                        let left = self.left_of(self.alone(&term, own), linear.prior_std);
                        left.map(|mut all| all.swap_remove(own)).unwrap_or_default()
                    })
                    .collect(),
            })
            .collect()
    }

    fn abscissae(&self) -> Vec<Abscissa<'_>> {
        let turning = self.turning();
        let turn = |angle: &f64| angle.rem_euclid(std::f64::consts::TAU);
        vec![
            Abscissa::new("Time", "s", &self.t),
            Abscissa::new("Speed", "rad/s", &turning.speed),
            Abscissa::new(
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

    fn particulars(&self) -> Map<String, Value> {
        let unbalances: Vec<Value> = (self.rotor().loads.iter().zip(self.seen.sizes.chunks(2)))
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

    fn note(&self, selection: &Selection<Self>) -> Option<String> {
        let silent = cannot_show(selection);
        (self.one_speed() && !silent.is_empty()).then(|| {
            format!(
                "at one speed an unbalance does the same as {}: not to be told apart; {} would",
                silent.join(", "),
                effect::RUN_UP
            )
        })
    }
}

impl RotorSession {
    /// Sum of the absolute residual over mean absolute displacement [%], and count, block by block.
    fn blocks_of(&self, rest: &Readings) -> Vec<(f64, f64)> {
        let explained = self.seen.explained.iter().flatten();
        let size =
            explained.map(|y| y.abs()).sum::<f64>() / (self.t.len() * self.streams.len()) as f64;
        let block = self.block();
        (0..self.t.len())
            .step_by(block)
            .map(|from| {
                let to = (from + block).min(self.t.len());
                let known = rest
                    .iter()
                    .flat_map(|of| &of[from..to])
                    .filter(|r| r.is_finite());
                let sum = known.clone().map(|r| r.abs() / size).sum::<f64>();
                (sum, known.count() as f64)
            })
            .collect()
    }
}
