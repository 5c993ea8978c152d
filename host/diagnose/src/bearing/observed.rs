//! A recording of a bearing as the judgement sees it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use loadtwin_common::bearing::GAUGES;
use serde_json::{Map, Value};

use super::recorded::Recorded;
use super::seen::Seen;
use super::{BearingPlace, BearingSession, BearingStream, Kind, STREAMS, clean, effect, write};
use crate::effect::Effect;
use crate::error::LoadErrors;
use crate::observed::{Abscissa, Nuisance, Observed, Shaft};
use crate::refit::rest;
use crate::select::{Found, Selection};
use crate::stream::Columns;
use crate::taken::Readings;
use crate::{DiagnoseError, Diagnosis, Residuals, SEED};
use loadtwin_design::bearing::{Calibration, Rig, calibration};
use loadtwin_design::build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::recorded;

/// Length of the blocks that are left out [s].
const BLOCK_S: f64 = 1.5;

/// For how long what a calibration lacks stays the same: about as long as the loads do [s].
const LASTS_S: f64 = 1.0;

impl BearingSession {
    /// The recording in `path` as residuals.
    ///
    /// # Errors
    /// When it cannot be read, lacks a load, or too little of it can be followed.
    pub(super) fn read_one(
        rig: &Rig<'_>,
        calibration: &Calibration,
        path: &Path,
    ) -> Result<Self, DiagnoseError> {
        let samples = recorded(rig.machine, rig.sensors, path)?;
        let at_rate = |rate: f64| {
            let recorded = Recorded::follow(rig, calibration, &samples, rate, path)?;
            Seen::new(rig, calibration, recorded)
        };
        // Harmonics are gathered over the rate at which the balls pass.
        let seen = at_rate(1.0 + at_rate(1.0)?.mean_slip())?;
        let dt_s = seen.recorded.course.dt_s;
        let streams = (seen.residual().into_iter().enumerate())
            .map(|(k, residual)| BearingStream {
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
            t: (0..seen.len()).map(|i| i as f64 * dt_s).collect(),
            seen: Arc::new(seen),
            streams,
        })
    }

    /// Sum of the absolute residual over the mean absolute strain [%], and count, block by block.
    fn blocks_of(&self, rest: &Readings) -> Vec<(f64, f64)> {
        let strains = self.seen.predicted.iter().flat_map(|p| &p.strain);
        let rms = |c: &[f64]| c.iter().map(|c| c * c).sum::<f64>().sqrt();
        let size = strains.map(|c| rms(&c[1..])).sum::<f64>()
            / (GAUGES * self.seen.predicted.len()) as f64;
        let block = self.block();
        (0..self.t.len())
            .step_by(block)
            .map(|from| {
                let to = (from + block).min(self.t.len());
                let known = rest[..2 * GAUGES]
                    .iter()
                    .flat_map(|of| &of[from..to])
                    .filter(|r| r.is_finite());
                let sum = known.clone().map(|r| r.abs() / size).sum::<f64>();
                (sum, known.count() as f64)
            })
            .collect()
    }
}

impl Observed for BearingSession {
    type Stream = BearingStream;
    type Term = Readings;
    type Place = BearingPlace;

    fn library() -> &'static [&'static dyn Effect<Self>] {
        effect::LIBRARY
    }

    fn read(
        machine: &Machine,
        recordings: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<Residuals<Self>, DiagnoseError> {
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
        let mut sessions = Vec::new();
        let mut end = 0.0;
        for path in recordings.iter().chain(validation) {
            let mut session = Self::read_one(&rig, &calibration, path)?;
            session.t.iter_mut().for_each(|t| *t += end);
            end = session.t.last().copied().unwrap_or(0.0) + session.dt_s();
            sessions.push(session);
        }
        progress(0.2);
        let unseen = sessions.split_off(recordings.len());
        let draws = clean::draws(&rig, &mut sessions, SEED)?;
        for session in &mut sessions {
            for (k, stream) in session.streams.iter_mut().enumerate() {
                stream.noise_std = rms(draws.iter().flatten().map(|draw| &draw[k]));
            }
        }
        progress(0.9);
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

    /// Mean absolute residual, % of the mean strain that goes with the balls.
    fn errors(sessions: &[Self], found: &[Found<Self>]) -> LoadErrors {
        let clean = vec![Vec::new(); STREAMS];
        let blocks = |found: &[Found<Self>]| -> Vec<(f64, f64)> {
            (sessions.iter().zip(rest(sessions, found, &clean)))
                .flat_map(|(session, rest)| session.blocks_of(&rest))
                .collect()
        };
        LoadErrors::as_described(&blocks(&[]), &blocks(found))
    }

    fn dt_s(&self) -> f64 {
        self.seen.recorded.course.dt_s
    }

    fn speed(&self) -> &[f64] {
        &self.seen.recorded.course.speed
    }

    fn block(&self) -> usize {
        (BLOCK_S / self.dt_s()) as usize
    }

    fn streams(&self) -> &[BearingStream] {
        &self.streams
    }

    fn name(&self, k: usize) -> &str {
        &self.streams[k].name
    }

    fn unit(&self, k: usize) -> &'static str {
        match Kind::of(k) {
            Kind::Bulk(_) | Kind::Local(_) => "µm/m",
            Kind::Slip(_) => "1",
        }
    }

    fn residual(&self, k: usize) -> &[f64] {
        &self.streams[k].residual
    }

    /// The clean machine is another one.
    fn clean(&self, _: usize) -> &[f64] {
        &[]
    }

    fn set_residual(&mut self, k: usize, residual: Vec<f64>) {
        self.streams[k].residual = residual;
    }

    fn noise_std(&self, k: usize) -> f64 {
        self.streams[k].noise_std
    }

    fn inflation(&self, _: usize) -> f64 {
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
        let mut all: Vec<Columns> = (effect.terms_about(self, shape, parameters).into_iter())
            .map(|term| self.seen.taken.left_of(term))
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

    fn abscissae(&self) -> Vec<Abscissa<'_>> {
        let load = |j: usize| -> Vec<f64> {
            (self.seen.recorded.course.loads.iter())
                .map(|loads| loads[j])
                .collect()
        };
        vec![
            Abscissa::new("Time", "s", &self.t),
            Abscissa::new("Speed", "rad/s", self.speed()),
            Abscissa::new("Fz", "N", load(2)),
            Abscissa::new("Mx", "N m", load(3)),
        ]
    }

    /// None: a block is long against a turn.
    fn shafts(&self) -> Vec<Shaft<'_>> {
        Vec::new()
    }

    fn particulars(&self) -> Map<String, Value> {
        Map::new()
    }

    fn note(&self, _: &Selection<Self>) -> Option<String> {
        None
    }
}

/// Root mean square of what is finite.
fn rms<'a>(values: impl Iterator<Item = &'a Vec<f64>>) -> f64 {
    let known = values.flatten().filter(|v| v.is_finite());
    let (sum, n) = known.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt().max(f64::MIN_POSITIVE)
}
