//! From a recording to residuals: what the model says of each sample, given
//! the torque that reference loads, or else all gauges together, tell.

use std::path::Path;

use super::DiagnoseError;
use super::consensus;
use super::doubt::{SHORTEST_S, doubt};
use super::known::{course, course_by_shaft, drives, loads};
use super::recorded::{Recorded, derivatives, take_out_spikes, take_out_stuck};
use super::signals::{Signals, smooth};
use super::stream::{Kind, Session, Stream, Told};
use super::thin::{Thin, at, filled};
use super::torque::{Bodies, torques};
use crate::gearbox::Torsion;
use crate::machine::{Machine, Senses, resampled};

/// Width of each of the three moving means that smooth accelerations [s].
const SMOOTHING_S: f64 = 0.2;

/// Samples a second on which effects are judged.
const RATE_HZ: f64 = 125.0;

/// Entries of a map between which lines are drawn.
const ENTRIES: usize = 4096;

/// Reads `path` as residuals of today's `machine`, given the torque that the
/// references tell, or where there are none the gauges together.
///
/// # Errors
/// When the recording cannot be read, is too short to be judged, shows next to
/// nothing, or contradicts the description.
pub fn observe(machine: &Machine, path: &Path) -> Result<Session, DiagnoseError> {
    observe_given(machine, path, Told::References)
}

/// As [`observe`], given the torque that `told` tells, or what it lacks the gauges.
#[allow(clippy::too_many_lines, reason = "one stream after another")]
pub(super) fn observe_given(
    machine: &Machine,
    path: &Path,
    mut told: Told,
) -> Result<Session, DiagnoseError> {
    let drivetrain = machine
        .drivetrain
        .as_ref()
        .ok_or(DiagnoseError::NoDrivetrain)?;
    let mut recorded = Recorded::read(machine, path)?;
    let refused = |reason: String| DiagnoseError::TooLittle {
        recording: path.to_owned(),
        reason,
    };
    let duration = recorded.len() as f64 * recorded.dt_s;
    if duration < SHORTEST_S {
        return Err(refused(format!(
            "{duration:.1} s are too short to tell an effect from chance; at least {SHORTEST_S} s are needed"
        )));
    }
    let torsion = Torsion::new(drivetrain);
    let width = (SMOOTHING_S / recorded.dt_s) as usize | 1;
    let (speeds, accelerations): (Vec<_>, Vec<_>) = recorded
        .encoders
        .iter()
        .map(|angle| derivatives(angle, width, recorded.dt_s))
        .unzip();
    let motion = Bodies::new(machine, drivetrain, &speeds, &accelerations);
    let known = match told {
        Told::References => loads(machine, drivetrain, &recorded),
        Told::Gauges => vec![None; drivetrain.loads.len()],
    };
    if known.iter().all(Option::is_none) {
        told = Told::Gauges;
    }
    let drives = drives(machine, drivetrain, &recorded);
    let torques = match told {
        Told::References => torques(
            drivetrain,
            &torsion,
            &motion,
            &known,
            &drives,
            width,
            recorded.dt_s,
        ),
        Told::Gauges => consensus::torques(machine, drivetrain, &recorded)?,
    };
    if torques.shafts.iter().all(Option::is_none) && told == Told::Gauges {
        return Err(refused(format!(
            "no reference load (columns [{}]) and no shaft with {} gauges that could tell the torque together",
            machine
                .references
                .iter()
                .map(|r| r.name.as_str())
                .collect::<Vec<_>>()
                .join(", "),
            consensus::FEWEST,
        )));
    }
    let nominal_torque = drivetrain
        .loads
        .iter()
        .map(|l| l.nominal_nm * torsion.ratio(&l.inertia).abs())
        .fold(0.0, f64::max);

    let every = ((1.0 / (recorded.dt_s * RATE_HZ)).round() as usize).max(1);
    let edge = 2 * width;
    let thin = Thin {
        every,
        edge,
        n: recorded.len(),
    };
    let dt_s = recorded.dt_s * every as f64;
    let level_full = torques
        .shafts
        .iter()
        .flatten()
        .next()
        .cloned()
        .unwrap_or_else(|| vec![0.0; recorded.len()]);
    let smoothing = ((SMOOTHING_S / dt_s) as usize | 1).max(1);
    let response = torques.response.map(|mut response| {
        response.transition = torsion.discretised(dt_s);
        response
    });
    let temperature = recorded
        .temperature
        .as_ref()
        .map(|t| smooth(&thin.means(t), smoothing))
        .map(|t| t.iter().map(|x| x - t[0]).collect());
    let signals = Signals {
        dt_s,
        t: thin.times(recorded.dt_s),
        angle: filled(&thin.means(&recorded.angle)),
        speed: thin.means(&motion.speed[0]),
        acceleration: thin.means(&motion.acceleration[0]),
        level: thin
            .means(&level_full)
            .iter()
            .map(|t| t / nominal_torque)
            .collect(),
        temperature,
        nominal_speed: drivetrain.nominal_speed_rad_s,
        nominal_torque,
        inertias: drivetrain.inertias.iter().map(|i| i.name.clone()).collect(),
        ratios: drivetrain.inertias.iter().map(|i| i.speed_ratio).collect(),
        smoothing,
        home: machine.index.as_ref().map_or(0.0, |i| i.angle_rad),
        response,
    };

    let mut streams = Vec::new();
    for (k, channel) in machine.channels.iter().enumerate() {
        let (sensed, shaft, ratio): (&[f64], _, f64) = match &channel.senses {
            Senses::Shaft(name) => {
                let s = drivetrain.shafts.iter().position(|s| s.name == *name);
                let Some(s) = s else { continue };
                let Some(torque) = &torques.shafts[s] else {
                    continue;
                };
                (torque, Some(s), drivetrain.shafts[s].speed_ratio)
            }
            Senses::Load(name) => {
                let j = drivetrain.loads.iter().position(|l| l.name == *name);
                let has_reference = machine.references.iter().any(|r| r.load == *name);
                match j.and_then(|j| known[j].as_deref()) {
                    Some(load) if has_reference => (load, None, 1.0),
                    _ => continue,
                }
            }
            Senses::Speed(name) => {
                let i = torsion.inertia(name);
                (&motion.speed[i], None, 1.0 / torsion.ratio(name))
            }
            _ => continue,
        };
        let stuck = take_out_stuck(&mut recorded.channels[k]);
        let table = channel.sensitivity_over_angle(machine)?;
        let over_angle = table.len() > 1;
        let table = if over_angle {
            resampled(&table, ENTRIES)
        } else {
            table
        };
        let offset = channel.to_si(channel.offset);
        let n = recorded.len();
        let (mut residual, mut reading) = (vec![f64::NAN; n], vec![0.0; n]);
        let (mut map, mut slope) = (vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            let angle = if over_angle { recorded.angle[i] } else { 0.0 };
            if angle.is_nan() {
                continue;
            }
            let (m, dm) = at(&table, angle);
            map[i] = m / ratio;
            reading[i] = map[i] * sensed[i];
            slope[i] = dm / ratio * sensed[i];
            residual[i] = recorded.channels[k][i] - offset - reading[i];
        }
        let spikes = take_out_spikes(&mut residual);
        let square = table.iter().map(|m| m * m).sum::<f64>() / table.len() as f64;
        let nominal = match &channel.senses {
            Senses::Speed(_) => drivetrain.nominal_speed_rad_s,
            Senses::Load(name) => drivetrain
                .loads
                .iter()
                .find(|l| l.name == *name)
                .map_or(1.0, |l| l.nominal_nm),
            _ => nominal_torque,
        };
        let noise = channel.noise_over_angle(machine)?;
        let noise = (noise.iter().map(|s| s * s).sum::<f64>() / noise.len() as f64).sqrt();
        streams.push(Stream {
            name: channel.name.clone(),
            kind: Kind::Strain,
            group: channel.group.clone(),
            residual: thin.residual(&residual),
            clean: Vec::new(),
            scale: square.sqrt() / ratio.abs() * nominal,
            noise_std: noise / (every as f64).sqrt(),
            map: thin.means(&map),
            reading: thin.means(&reading),
            slope: thin.means(&slope),
            shaft,
            over_angle,
            twists: Vec::new(),
            inertias: [0, 0],
            samples: n as u64,
            spikes,
            stuck,
        });
    }
    let twist: Vec<f64> = torsion
        .referred_stiffness()
        .map(|k| nominal_torque / k)
        .collect();
    let rest = |name: String, kind| Stream {
        name,
        kind,
        group: None,
        residual: Vec::new(),
        clean: Vec::new(),
        scale: nominal_torque,
        noise_std: 2e-4 * nominal_torque,
        map: Vec::new(),
        reading: Vec::new(),
        slope: Vec::new(),
        shaft: None,
        over_angle: false,
        twists: Vec::new(),
        inertias: [0, 0],
        samples: recorded.len() as u64,
        spikes: 0,
        stuck: 0,
    };
    if let Some(balance) = &torques.balance {
        streams.push(Stream {
            residual: thin.residual(balance),
            ..rest("torque balance".into(), Kind::Balance)
        });
    }
    for (k, encoder) in machine.encoders.iter().enumerate().skip(1) {
        let first = torsion.angle_row(&machine.encoders[0].inertia);
        let own = torsion.angle_row(&encoder.inertia);
        let signs: Vec<f64> = (0..twist.len())
            .map(|i| own[1 + i] - first[1 + i])
            .collect();
        let full: f64 = signs.iter().zip(&twist).map(|(s, t)| (s * t).abs()).sum();
        if full == 0.0 || torques.shafts.iter().any(Option::is_none) {
            continue;
        }
        let stiffness: Vec<f64> = torsion.referred_stiffness().collect();
        let residual: Vec<f64> = (0..recorded.len())
            .map(|i| {
                let twisted: f64 = torques
                    .shafts
                    .iter()
                    .flatten()
                    .zip(&stiffness)
                    .zip(&signs)
                    .map(|((torque, k), s)| s * torque[i] / k)
                    .sum();
                recorded.encoders[k][i] - recorded.encoders[0][i] - twisted
            })
            .collect();
        let count = |e: &crate::machine::Encoder| {
            e.noise_std_counts.unwrap_or(0.29) * std::f64::consts::TAU
                / (e.counts_per_turn * torsion.ratio(&e.inertia)).abs()
        };
        streams.push(Stream {
            residual: thin.residual(&residual),
            scale: full,
            noise_std: count(encoder).hypot(count(&machine.encoders[0])) / (every as f64).sqrt(),
            twists: signs,
            inertias: [
                torsion.inertia(&machine.encoders[0].inertia),
                torsion.inertia(&encoder.inertia),
            ],
            ..rest(encoder.name.clone(), Kind::Angle)
        });
    }
    home(&mut streams, machine, &torsion);
    let course = match told {
        Told::References => course(drivetrain, &torsion, &recorded, &motion, &known, &drives),
        Told::Gauges => Some(course_by_shaft(
            drivetrain,
            &torsion,
            &recorded,
            &motion,
            &level_full,
        )),
    };
    let session = Session {
        signals,
        streams,
        twist,
        course,
        told,
    };
    match doubt(&session) {
        Some(reason) => Err(refused(reason)),
        None => Ok(session),
    }
}

/// Takes off the error that the counts of the index's encoder leave in the
/// carrier angle: the shift that all maps agree on, up to two counts.
fn home(streams: &mut [Stream], machine: &Machine, torsion: &Torsion) {
    let Some(encoder) = machine.encoders.first() else {
        return;
    };
    let count =
        std::f64::consts::TAU / (encoder.counts_per_turn * torsion.ratio(&encoder.inertia)).abs();
    let (mut told, mut weight) = (0.0, 0.0);
    for stream in streams.iter().filter(|s| s.over_angle) {
        let known = |x: &f64| x.is_finite();
        let n = stream.residual.iter().filter(|r| known(r)).count().max(1) as f64;
        let mean = stream.residual.iter().filter(|r| known(r)).sum::<f64>() / n;
        for (r, slope) in stream
            .residual
            .iter()
            .zip(&stream.slope)
            .filter(|(r, _)| known(r))
        {
            let slope = slope / stream.noise_std;
            told += slope * (r - mean) / stream.noise_std;
            weight += slope * slope;
        }
    }
    let shift = (told / f64::max(weight, 1e-300)).clamp(-2.0 * count, 2.0 * count);
    for stream in streams.iter_mut().filter(|s| s.over_angle) {
        for (r, slope) in stream.residual.iter_mut().zip(&stream.slope) {
            *r -= shift * slope;
        }
    }
}
