//! From a recording to residuals: what the model says of each sample, given
//! the torque that reference loads, or else all gauges together, tell.

use std::collections::HashMap;
use std::path::Path;

use super::DiagnoseError;
use super::chain::Carried;
use super::consensus;
use super::doubt::{SHORTEST_S, doubt};
use super::effect::bending::take_out;
use super::filtered::Filtered;
use super::known::{course, course_by_shaft, drives, loads};
use super::recorded::{Recorded, derivatives};
use super::seen::{SMOOTHING_S, Seen};
use super::signals::{Signals, smooth};
use super::stream::{Kind, Session, Stream, Told, product};
use super::thin::{Thin, filled};
use super::torque::{Bodies, torques};
use loadtwin_design::build::Sensors;
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{LATEST_S, Machine, MachineError};

/// Samples a second on which effects are judged.
const RATE_HZ: f64 = 125.0;

/// Inertia of a gear that a description has in its neighbours, part of the smaller one's.
const GEAR: f64 = 0.01;

/// Reads `path` as residuals of today's `machine`, given the torque that the
/// references tell, or where there are none the gauges together; where these are too few, as
/// the innovations of the filter.
///
/// # Errors
/// When the recording cannot be read, is too short to be judged, shows next to
/// nothing, or contradicts the description.
pub fn observe(machine: &Machine, path: &Path) -> Result<Session, DiagnoseError> {
    observe_given(machine, path, Told::References)
}

/// As [`observe`], given the torque that `told` tells, or what it lacks the gauges or the filter.
pub(super) fn observe_given(
    machine: &Machine,
    path: &Path,
    mut told: Told,
) -> Result<Session, DiagnoseError> {
    let drivetrain = machine
        .drivetrain
        .as_ref()
        .ok_or(DiagnoseError::NoDrivetrain)?;
    let recorded = Recorded::read(machine, path)?;
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
    let mut known = match told {
        Told::References => loads(machine, drivetrain, &recorded),
        Told::Gauges | Told::Filter => vec![None; drivetrain.loads.len()],
    };
    if told == Told::References && known.iter().all(Option::is_none) {
        told = Told::Gauges;
    }
    let drives = drives(machine, drivetrain, &recorded);
    let by_loads = |known: &[Option<Vec<f64>>]| {
        torques(
            drivetrain,
            &torsion,
            &motion,
            known,
            &drives,
            width,
            recorded.dt_s,
        )
    };
    let mut told_by = match told {
        Told::References => by_loads(&known),
        Told::Gauges | Told::Filter => consensus::torques(machine, drivetrain, &recorded)?,
    };
    let mut innovations = Vec::new();
    if told != Told::References && told_by.shafts.iter().all(Option::is_none) {
        told = Told::Filter;
        let filtered = Filtered::run(machine, &Sensors::choose(machine, None)?, path)?;
        let load = |of: &Vec<f64>| Some(smooth(&filled(of), width));
        known = filtered.loads.iter().map(load).collect();
        told_by = by_loads(&known);
        innovations = filtered.innovations;
    }
    let every = ((1.0 / (recorded.dt_s * RATE_HZ)).round() as usize).max(1);
    // Nor is known what a gauge reads that is late by as much as is looked for, and the samples
    // beside that.
    let late = (LATEST_S / recorded.dt_s) as usize + 2 * every;
    let seen = Seen {
        machine,
        drivetrain,
        thin: Thin {
            every,
            edge: 2 * width + late,
            n: recorded.len(),
        },
        torsion,
        recorded,
        motion,
        known,
        drives,
        torques: told_by,
    };
    let session = session(&seen, told, &innovations)?;
    match doubt(&session) {
        Some(reason) => Err(refused(reason)),
        None => Ok(session),
    }
}

/// Everything that `seen` shows, given the torque that `told` tells.
fn session(
    seen: &Seen<'_>,
    told: Told,
    innovations: &[(String, Vec<f64>)],
) -> Result<Session, MachineError> {
    let signals = seen.signals();
    let streams = match told {
        Told::References | Told::Gauges => streams(seen, &signals)?,
        Told::Filter => seen.innovations(innovations),
    };
    let course = match told {
        Told::References | Told::Filter => course(
            seen.drivetrain,
            &seen.torsion,
            &seen.recorded,
            &seen.motion,
            &seen.known,
            &seen.drives,
        ),
        Told::Gauges => Some(course_by_shaft(
            seen.drivetrain,
            &seen.torsion,
            &seen.recorded,
            &seen.motion,
            &seen.level(),
        )),
    };
    Ok(Session {
        twist: seen.twist(),
        signals,
        streams,
        course,
        told,
        reference_noise: seen.reference_noise(),
    })
}

/// What each gauge, the balance and the angles show beyond today's model.
fn streams(seen: &Seen<'_>, signals: &Signals) -> Result<Vec<Stream>, MachineError> {
    let mut streams = Vec::new();
    let mut spikes = Vec::new();
    for channel in 0..seen.machine.channels.len() {
        if let Some((stream, stand_out)) = seen.strain(channel)? {
            streams.push(stream);
            spikes.push(stand_out);
        }
    }
    for (stream, count) in streams.iter_mut().zip(alone(&spikes)) {
        stream.spikes = count;
    }
    take_out(seen.machine, &mut streams);
    streams.extend(seen.balance());
    streams.extend((1..seen.machine.encoders.len()).filter_map(|k| seen.angle(k)));
    home(&mut streams, signals.count);
    known_roughly(&mut streams, signals);
    Ok(streams)
}

/// How many samples of each channel stand out while no other channel's does:
/// what all have in common happens to the machine, and not to a word.
fn alone(spikes: &[Vec<usize>]) -> Vec<u64> {
    let mut channels: HashMap<usize, u32> = HashMap::new();
    for at in spikes.iter().flatten() {
        *channels.entry(*at).or_default() += 1;
    }
    spikes
        .iter()
        .map(|own| own.iter().filter(|at| channels[*at] == 1).count() as u64)
        .collect()
}

/// Takes off the error that the counts of the index's encoder leave in the
/// carrier angle: the shift on which most maps agree, up to two counts, beyond
/// what a clean machine leaves.
pub(super) fn home(streams: &mut [Stream], count: f64) {
    let mut told: Vec<(f64, f64)> = (streams.iter())
        .filter(|s| s.over_angle())
        .filter_map(shift_of_map)
        .collect();
    if told.is_empty() {
        return;
    }
    // A gauge with a delay or another place may be far off.
    let shift = consensus::median(&mut told).clamp(-2.0 * count, 2.0 * count);
    for stream in streams.iter_mut().filter(|s| s.over_angle()) {
        for (r, slope) in stream.residual.iter_mut().zip(&stream.slope) {
            *r -= shift * slope;
        }
    }
}

/// The shift of the carrier angle that explains most of a residual [rad], and its weight.
fn shift_of_map(stream: &Stream) -> Option<(f64, f64)> {
    let clean = |i: usize| stream.clean.get(i).copied().unwrap_or(0.0);
    let known: Vec<(f64, f64)> = (stream.residual.iter().zip(&stream.slope).enumerate())
        .map(|(i, (r, slope))| (r - clean(i), *slope))
        .filter(|(r, _)| r.is_finite())
        .collect();
    let mean = known.iter().map(|k| k.0).sum::<f64>() / known.len().max(1) as f64;
    let product: f64 = known.iter().map(|(r, slope)| slope * (r - mean)).sum();
    let square: f64 = known.iter().map(|(_, slope)| slope * slope).sum();
    (square > 0.0).then(|| (product / square, square * stream.noise_std.powi(-2)))
}

/// How each residual changes with what of the chain is known only roughly: the stiffness and the
/// damping of the shafts, which decide for how long a vibration stays in step with the simulated
/// one, gears whose inertia the description has in their neighbours, and the inertias; and what
/// vibrates at the start.
fn known_roughly(streams: &mut [Stream], signals: &Signals) {
    let Some(response) = &signals.response else {
        return;
    };
    let driven = &response.driven;
    let fast = |changes: Vec<Carried>| changes.into_iter().map(|c| signals.fast_alone(c));
    let shafts = 0..response.stiffness.len();
    let gears = shafts.filter_map(|s| signals.with_gear(s, GEAR));
    let roughly: Vec<Carried> = fast(driven.tolerances(&response.carried))
        .chain(gears)
        .chain(signals.heavier())
        .collect();
    let beginnings: Vec<Carried> = fast(driven.beginnings()).collect();
    for stream in streams {
        let column = |change: &Carried| match (stream.kind, stream.shaft) {
            (Kind::Strain, Some(s)) => Some(product(&stream.map, &change.torque[s])),
            (Kind::Angle, _) => Some(stream.along_twists(&change.twist)),
            _ => None,
        };
        (stream.roughly, stream.beginnings) = (
            roughly.iter().filter_map(column).collect(),
            beginnings.iter().filter_map(column).collect(),
        );
    }
}
