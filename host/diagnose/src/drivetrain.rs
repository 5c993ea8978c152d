//! A recording of a drivetrain as the judgement sees it.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::consensus::FEWEST;
use super::effect::{Effect, GaugeModel, LIBRARY};
use super::error::{LoadErrors, load_errors};
use super::observed::{Abscissa, Nuisance, Observed, Shaft};
use super::select::{Found, Selection};
use super::stream::{Columns, Kind, Session, Stream, Term, Told};
use super::{DiagnoseError, Diagnosis, Residuals, SEED, correct, null, observe};
use loadtwin_machine::Machine;

/// Blocks are this long [s].
const BLOCK_S: f64 = 1.5;

/// Part of full scale by which the zero of a gauge differs from recording to recording.
const ZERO_BETWEEN: f64 = 0.02;

/// Place of what the description should tell, inertia or twist, among the nuisances of a balance or an angle.
const DESCRIBED: usize = 1;

/// Part to which the moments of inertia are known, all together.
const INERTIA: f64 = 0.02;

/// Part to which the twist between encoders is known.
const TWIST: f64 = 0.1;

/// Standard deviations from which a description that is off is said to be.
const OFF: f64 = 2.0;

impl Observed for Session {
    type Stream = Stream;
    type Term = Term;
    type Place = GaugeModel;

    fn library() -> &'static [&'static dyn Effect] {
        LIBRARY
    }

    fn read(
        machine: &Machine,
        recordings: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<Residuals, DiagnoseError> {
        let mut sessions = read(machine, &[recordings, validation].concat())?;
        let mut unseen = sessions.split_off(recordings.len());
        let mut end = 0.0;
        for session in sessions.iter_mut().chain(&mut unseen) {
            for t in &mut session.signals.t {
                *t += end;
            }
            end = session.signals.t.last().copied().unwrap_or(0.0) + session.signals.dt_s;
        }
        progress(0.2);
        let draws = null::draws(machine, &mut sessions, SEED);
        for session in &mut sessions {
            observe::home(&mut session.streams, session.signals.count);
        }
        for session in sessions.iter_mut().chain(&mut unseen) {
            session.forget_coarse_angles();
        }
        progress(1.0);
        Ok(Residuals {
            sessions,
            unseen,
            draws,
        })
    }

    fn write(
        machine: &Machine,
        diagnosis: &Diagnosis,
        path: &Path,
    ) -> Result<Vec<&'static str>, DiagnoseError> {
        correct::write(machine, diagnosis, path)
    }

    fn errors(sessions: &[Self], found: &[Found]) -> LoadErrors {
        load_errors(sessions, found)
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

    fn streams(&self) -> &[Stream] {
        &self.streams
    }

    fn name(&self, k: usize) -> &str {
        &self.streams[k].name
    }

    fn unit(&self, k: usize) -> &'static str {
        match self.streams[k].kind {
            Kind::Strain => "",
            Kind::Balance => "N m",
            Kind::Angle => "rad",
            Kind::Innovation => "σ",
        }
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
        self.streams[k].noise_std
    }

    fn is_referred(&self) -> bool {
        self.told == Told::References
    }

    fn inflation(&self, k: usize) -> f64 {
        match self.streams[k].kind {
            Kind::Balance => 1.5 * self.signals.smoothing as f64,
            // Counts err alike for a while at a steady speed.
            Kind::Angle => 16.0,
            Kind::Strain | Kind::Innovation => 1.0,
        }
    }

    fn zero_std(&self, k: usize) -> f64 {
        let stream = &self.streams[k];
        let part = match stream.kind {
            Kind::Strain | Kind::Innovation => 1.0,
            Kind::Balance => 1e-3,
            Kind::Angle => 1e3,
        };
        part * stream.scale
    }

    /// A zero for each strain and angle, a count by which the carrier's zero may be off, the
    /// reference's zero, an error of the inertia and one of the time in the balance, an error of the
    /// stiffness in an angle; what is only known roughly; what vibrates at first; and what a clean machine leaves
    /// when it does the same. Zeros, counts and first vibrations differ from recording to recording.
    ///
    /// The zero comes first, and at [`DESCRIBED`] the inertia of a balance or the twist of an angle.
    fn nuisances(&self, k: usize) -> Vec<Nuisance> {
        let (stream, signals) = (&self.streams[k], &self.signals);
        let n = signals.len();
        let std = self.zero_std(k);
        let zero = |part: f64| Nuisance::of_recording(vec![1.0; n], std, part * std);
        let mut own = match stream.kind {
            Kind::Strain | Kind::Innovation => vec![zero(ZERO_BETWEEN)],
            Kind::Balance => {
                let bodies = signals.response.iter().flat_map(|r| &r.bodies);
                let moment: f64 = bodies.map(|b| b.0).sum();
                let inertia = signals.acceleration.iter().map(|a| a * moment);
                let later = signals.later().into_iter().map(|a| a * moment);
                vec![
                    zero(1.0),
                    Nuisance::of_machine(inertia.collect(), INERTIA),
                    Nuisance::of_machine(later.collect(), 1.0),
                ]
            }
            Kind::Angle => {
                let twist = signals.level.iter().map(|l| l * stream.scale);
                vec![zero(1.0), Nuisance::of_machine(twist.collect(), TWIST)]
            }
        };
        if stream.over_angle() && signals.count > 0.0 {
            own.push(Nuisance::of_recording(
                stream.slope.clone(),
                signals.count,
                signals.count,
            ));
        }
        own.extend((stream.roughly.iter()).map(|column| Nuisance::of_machine(column.clone(), 1.0)));
        own.extend(
            (stream.beginnings.iter())
                .map(|column| Nuisance::of_recording(column.clone(), 1.0, 1.0)),
        );
        let mut clean = stream.clean.clone();
        clean.resize(n, 0.0);
        own.push(Nuisance::of_machine(clean, 1.0));
        own
    }

    fn columns(&self, effect: &dyn Effect, shape: &[f64], parameters: &[Vec<f64>]) -> Vec<Columns> {
        let terms = effect.terms_about(self, shape, parameters);
        self.columns_where_it_acts(effect, &terms)
    }

    fn nuisances_of(&self, effect: &dyn Effect, shape: &[f64]) -> Vec<Columns> {
        self.columns_where_it_acts(effect, &effect.nuisances(self, shape))
    }

    fn abscissae(&self) -> Vec<Abscissa<'_>> {
        let signals = &self.signals;
        let turn = |angle: &f64| angle.rem_euclid(std::f64::consts::TAU);
        let mut all = vec![
            Abscissa::new("Time", "s", &signals.t),
            Abscissa::new("Torque over nominal", "", &signals.level),
            Abscissa::new("Change of torque over nominal", "1/s", signals.change()),
            Abscissa::new("Speed of the main shaft", "rad/s", &signals.speed),
            Abscissa::new(
                "Acceleration of the main shaft",
                "rad/s²",
                &signals.acceleration,
            ),
            Abscissa::new(
                "Carrier angle",
                "rad",
                signals.angle.iter().map(turn).collect::<Vec<f64>>(),
            ),
        ];
        if let Some(warming) = &signals.warming {
            all.push(Abscissa::new("Warmer than where zeros hold", "K", warming));
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

    fn particulars(&self) -> Map<String, Value> {
        [("torque_told_by".to_owned(), json!(self.told))]
            .into_iter()
            .collect()
    }

    fn note(&self, selection: &Selection<Self>) -> Option<String> {
        let lacks = match self.told {
            Told::References => None,
            Told::Gauges => Some(
                "no reference load: what all gauges have in common cannot be told from the torque"
                    .into(),
            ),
            Told::Filter => Some(format!(
                "no reference load and no shaft with {FEWEST} gauges: only innovations are judged; \
                 what the estimated load takes up is not seen, and no effect can be named",
            )),
        };
        let off = self.description_off(&selection.nuisance);
        let notes: Vec<String> = lacks.into_iter().chain(off).collect();
        (!notes.is_empty()).then(|| notes.join("; "))
    }
}

impl Session {
    /// Where the description is off by more than it should be, by the nuisances of each stream.
    fn description_off(&self, nuisance: &[Vec<f64>]) -> Vec<String> {
        (self.streams.iter().zip(nuisance))
            .filter_map(|(stream, own)| {
                let name = &stream.name;
                let (what, known_to) = match stream.kind {
                    Kind::Balance => ("moments of inertia that differ", INERTIA),
                    Kind::Angle => ("a twist that differs", TWIST),
                    Kind::Strain | Kind::Innovation => return None,
                };
                let part = own.get(DESCRIBED).filter(|part| part.abs() > OFF * known_to)?;
                let percent = 100.0 * part;
                Some(format!(
                    "{name}: fits {what} by {percent:+.1} % from the described; mend the description first"
                ))
            })
            .collect()
    }

    /// The column of each of `terms` in each stream that `effect` acts on.
    fn columns_where_it_acts(&self, effect: &dyn Effect, terms: &[Term]) -> Vec<Columns> {
        let columns = |term: &Term| {
            let mut columns = self.columns_of(term);
            for (stream, column) in self.streams.iter().zip(&mut columns) {
                if !effect.acts_on(stream) {
                    column.clear();
                }
            }
            columns
        };
        terms.iter().map(columns).collect()
    }
}

/// All recordings, given the torque in the same way.
fn read(machine: &Machine, paths: &[PathBuf]) -> Result<Vec<Session>, DiagnoseError> {
    let by = |told: Told| {
        paths
            .iter()
            .map(|path| observe::observe_given(machine, path, told))
            .collect::<Result<Vec<_>, _>>()
    };
    let mut sessions = by(Told::References)?;
    if sessions.iter().any(|s| s.told != sessions[0].told) {
        sessions = by(Told::Gauges)?;
    }
    for (path, session) in paths.iter().zip(&sessions) {
        let first = (&paths[0], &sessions[0]);
        if let Some((has, lacks, what)) = differing(first, (path, session)) {
            let reason = format!(
                "has no {what}, as {} has; recordings that are judged together need the same columns",
                has.display()
            );
            return Err(DiagnoseError::TooLittle {
                recording: lacks.clone(),
                reason,
            });
        }
    }
    Ok(sessions)
}

/// Which of two recordings has what the other one has not.
fn differing<'a>(
    (a, of_a): (&'a PathBuf, &Session),
    (b, of_b): (&'a PathBuf, &Session),
) -> Option<(&'a PathBuf, &'a PathBuf, String)> {
    let beyond = |one: &Session, other: &Session| {
        let missing = |s: &&Stream| !other.streams.iter().any(|o| o.name == s.name);
        let (own, others) = (&one.signals, &other.signals);
        if let Some(stream) = one.streams.iter().find(missing) {
            Some(stream.name.clone())
        } else if own.response.is_some() && others.response.is_none() {
            Some("reference for each load".to_owned())
        } else {
            (own.warming.is_some() && others.warming.is_none()).then(|| "temperature".to_owned())
        }
    };
    (beyond(of_a, of_b).map(|what| (a, b, what)))
        .or_else(|| beyond(of_b, of_a).map(|what| (b, a, what)))
}
