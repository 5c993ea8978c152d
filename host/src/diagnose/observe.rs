//! From a recording to residuals: what the model says of each sample, given
//! the reference loads.

use std::path::Path;

use super::DiagnoseError;
use super::recorded::{Recorded, derivatives, take_out_spikes, take_out_stuck};
use super::signals::{Response, Signals, smooth};
use super::stream::{Kind, Session, Stream};
use crate::gearbox::Torsion;
use crate::machine::{Drivetrain, Machine, Senses, resampled};

/// Width of each of the three moving means that smooth accelerations [s].
const SMOOTHING_S: f64 = 0.2;

/// Samples a second on which effects are judged.
const RATE_HZ: f64 = 125.0;

/// Entries of a map between which lines are drawn.
const ENTRIES: usize = 4096;

/// Shortest recording that is judged [s].
const SHORTEST_S: f64 = 10.0;

/// What the loads tell of the torques in the chain.
struct Torques {
    /// Torque of each shaft, referred [N m].
    shafts: Vec<Option<Vec<f64>>>,
    /// `sum loads - sum J dw/dt - sum c w`, smoothed, where all loads are known.
    balance: Option<Vec<f64>>,
    /// Response of the chain, where all loads are known.
    response: Option<Response>,
}

/// Reads `path` as residuals of today's `machine`.
///
/// # Errors
/// When the recording cannot be read, or is too short to be judged.
#[allow(clippy::too_many_lines, reason = "one stream after another")]
pub fn observe(machine: &Machine, path: &Path) -> Result<Session, DiagnoseError> {
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
    let known = loads(machine, drivetrain, &recorded);
    if known.iter().all(Option::is_none) {
        return Err(refused(format!(
            "no reference load; the residuals need one of the columns [{}]",
            machine
                .references
                .iter()
                .map(|r| r.name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        )));
    }
    let drives = drives(machine, drivetrain, &recorded);
    let torques = torques(
        drivetrain,
        &torsion,
        &motion,
        &known,
        &drives,
        width,
        recorded.dt_s,
    );
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
            Senses::Drive(_) => continue,
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
    let usable = streams
        .iter()
        .map(|s| s.residual.iter().filter(|r| r.is_finite()).count())
        .max()
        .unwrap_or(0);
    if (usable as f64) * dt_s < 0.5 * SHORTEST_S {
        return Err(refused(
            "there is no stretch in which angle, loads and readings are known together".into(),
        ));
    }
    let demand = known[0].as_ref().map_or(Vec::new(), |load| {
        let nominal = drivetrain.loads[0].nominal_nm;
        thin.means(load)
            .iter()
            .zip(signals.relative_speed())
            .map(|(load, speed)| [load / nominal, speed])
            .collect()
    });
    Ok(Session {
        signals,
        streams,
        twist,
        demand,
    })
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

/// Speed and acceleration of each inertia, referred.
struct Bodies {
    speed: Vec<Vec<f64>>,
    acceleration: Vec<Vec<f64>>,
}

impl Bodies {
    /// Each inertia by its own encoder, or by the nearest one.
    fn new(
        machine: &Machine,
        drivetrain: &Drivetrain,
        speeds: &[Vec<f64>],
        accelerations: &[Vec<f64>],
    ) -> Self {
        let place = |name: &str| {
            drivetrain
                .inertias
                .iter()
                .position(|i| i.name == name)
                .unwrap_or(0)
        };
        let nearest = |body: usize| {
            (0..machine.encoders.len())
                .min_by_key(|k| place(&machine.encoders[*k].inertia).abs_diff(body))
                .unwrap_or(0)
        };
        let bodies = 0..drivetrain.inertias.len();
        Self {
            speed: bodies.clone().map(|b| speeds[nearest(b)].clone()).collect(),
            acceleration: bodies.map(|b| accelerations[nearest(b)].clone()).collect(),
        }
    }
}

/// Each load as its reference tells it, or a channel that senses the load itself.
fn loads(machine: &Machine, drivetrain: &Drivetrain, recorded: &Recorded) -> Vec<Option<Vec<f64>>> {
    drivetrain
        .loads
        .iter()
        .enumerate()
        .map(|(j, load)| {
            let reference = &recorded.loads[j];
            if reference.iter().any(|v| v.is_finite()) {
                return Some(filled(reference));
            }
            let k = machine
                .channels
                .iter()
                .position(|c| c.senses == Senses::Load(load.name.clone()))?;
            let channel = &machine.channels[k];
            let sensitivity = channel.to_si(channel.sensitivity?);
            let offset = channel.to_si(channel.offset);
            let load: Vec<f64> = recorded.channels[k]
                .iter()
                .map(|y| (y - offset) / sensitivity)
                .collect();
            Some(filled(&load))
        })
        .collect()
}

/// Measured drive torque on each inertia, at its own speed [N m].
fn drives(
    machine: &Machine,
    drivetrain: &Drivetrain,
    recorded: &Recorded,
) -> Vec<Option<Vec<f64>>> {
    drivetrain
        .inertias
        .iter()
        .map(|inertia| {
            let k = machine
                .channels
                .iter()
                .position(|c| c.senses == Senses::Drive(inertia.name.clone()))?;
            let channel = &machine.channels[k];
            let sensitivity = channel.to_si(channel.sensitivity.unwrap_or(1.0));
            let offset = channel.to_si(channel.offset);
            let torque: Vec<f64> = recorded.channels[k]
                .iter()
                .map(|y| (y - offset) / sensitivity)
                .collect();
            Some(filled(&torque))
        })
        .collect()
}

#[allow(
    clippy::too_many_lines,
    reason = "the equations of the chain, in their order"
)]
fn torques(
    drivetrain: &Drivetrain,
    torsion: &Torsion,
    motion: &Bodies,
    known: &[Option<Vec<f64>>],
    drives: &[Option<Vec<f64>>],
    width: usize,
    dt_s: f64,
) -> Torques {
    let bodies = drivetrain.inertias.len();
    let n = motion.speed[0].len();
    let ratio = |b: usize| drivetrain.inertias[b].speed_ratio;
    let moment = |b: usize| drivetrain.inertias[b].moment_kg_m2 * ratio(b) * ratio(b);
    let drag = |b: usize| drivetrain.inertias[b].drag_nm_s_per_rad * ratio(b) * ratio(b);
    // Torque from outside on each inertia, referred; none where it is not known.
    let outside: Vec<Option<Vec<f64>>> = (0..bodies)
        .map(|b| {
            let mut sum = vec![0.0; n];
            for (load, values) in drivetrain.loads.iter().zip(known) {
                if torsion.inertia(&load.inertia) == b {
                    let factor = load.direction.sign() * ratio(b);
                    for (sum, v) in sum.iter_mut().zip(values.as_ref()?) {
                        *sum += factor * v;
                    }
                }
            }
            if let Some(drive) = &drives[b] {
                for (sum, v) in sum.iter_mut().zip(drive) {
                    *sum += ratio(b) * v;
                }
            }
            Some(sum)
        })
        .collect();
    let has_load = |b: usize| {
        drives[b].is_some()
            || drivetrain
                .loads
                .iter()
                .any(|l| torsion.inertia(&l.inertia) == b)
    };
    let all = outside.iter().all(Option::is_some);
    let simulated = all.then(|| simulate(torsion, drivetrain, motion, &outside, dt_s));
    // What inertia and drag of body b take, smoothed.
    let taken =
        |b: usize, i: usize| moment(b) * motion.acceleration[b][i] + drag(b) * motion.speed[b][i];
    let slow: Vec<Option<Vec<f64>>> = outside
        .iter()
        .map(|o| o.as_ref().map(|o| smooth(o, width)))
        .collect();
    let mut sides = Vec::new();
    let shafts = (0..bodies - 1)
        .map(|s| {
            let before: Vec<usize> = (0..=s).collect();
            let after: Vec<usize> = (s + 1..bodies).collect();
            let usable = |side: &[usize]| {
                side.iter().all(|b| outside[*b].is_some()) && side.iter().any(|b| has_load(*b))
            };
            let weight = |side: &[usize]| side.iter().map(|b| moment(*b)).sum::<f64>();
            let take_after = match (usable(&before), usable(&after)) {
                (false, false) => {
                    sides.push(vec![0.0; bodies]);
                    return None;
                }
                (true, false) => false,
                (false, true) => true,
                _ => weight(&after) < weight(&before),
            };
            let (side, sign) = if take_after {
                (&after, -1.0)
            } else {
                (&before, 1.0)
            };
            sides.push(
                (0..bodies)
                    .map(|b| if side.contains(&b) { -sign } else { 0.0 })
                    .collect(),
            );
            // The slow part by the loads of one side, the fast part by the chain.
            let source = if simulated.is_some() { &slow } else { &outside };
            let mut torque: Vec<f64> = (0..n)
                .map(|i| {
                    let sum: f64 = side
                        .iter()
                        .map(|b| source[*b].as_ref().map_or(0.0, |o| o[i]) - taken(*b, i))
                        .sum();
                    sign * sum
                })
                .collect();
            if let Some(simulated) = &simulated {
                let slow_part = smooth(&simulated[s], width);
                for i in 0..n {
                    torque[i] += simulated[s][i] - slow_part[i];
                }
            }
            Some(torque)
        })
        .collect();
    let balance = all.then(|| {
        (0..n)
            .map(|i| {
                (0..bodies)
                    .map(|b| slow[b].as_ref().map_or(0.0, |o| o[i]) - taken(b, i))
                    .sum()
            })
            .collect()
    });
    let response = all.then(|| Response {
        transition: torsion.discretised(dt_s),
        first_drive: torsion.states() + drivetrain.loads.len(),
        shafts: shaft_rows(torsion, drivetrain),
        stiffness: torsion.referred_stiffness().collect(),
        bodies: (0..bodies).map(|b| (moment(b), ratio(b))).collect(),
        side: sides,
    });
    Torques {
        shafts,
        balance,
        response,
    }
}

fn shaft_rows(torsion: &Torsion, drivetrain: &Drivetrain) -> Vec<Vec<f64>> {
    drivetrain
        .shafts
        .iter()
        .map(|shaft| {
            let row = torsion.sensed_row(&Senses::Shaft(shaft.name.clone()));
            row[..torsion.states()]
                .iter()
                .map(|c| c * shaft.speed_ratio)
                .collect()
        })
        .collect()
}

/// Torque of each shaft when the known torques act on the chain and its rigid
/// motion is the measured one.
fn simulate(
    torsion: &Torsion,
    drivetrain: &Drivetrain,
    motion: &Bodies,
    outside: &[Option<Vec<f64>>],
    dt_s: f64,
) -> Vec<Vec<f64>> {
    let f = torsion.discretised(dt_s);
    let (states, bodies) = (torsion.states(), outside.len());
    let first = states + drivetrain.loads.len();
    let rows = shaft_rows(torsion, drivetrain);
    let n = motion.speed[0].len();
    let moments: Vec<f64> = drivetrain
        .inertias
        .iter()
        .map(|i| i.moment_kg_m2 * i.speed_ratio * i.speed_ratio)
        .collect();
    let total: f64 = moments.iter().sum();
    let torque = |b: usize, i: usize| outside[b].as_ref().map_or(0.0, |o| o[i]);
    let mut x = vec![0.0; states];
    x[states - bodies..].fill(motion.speed[0][0]);
    let net: f64 = (0..bodies).map(|b| torque(b, 0)).sum();
    let mut carried = 0.0;
    for (s, k) in torsion.referred_stiffness().enumerate() {
        carried += torque(s, 0) - moments[s] / total * net;
        x[1 + s] = carried / k;
    }
    let mut next = x.clone();
    let mut out = vec![Vec::with_capacity(n); rows.len()];
    for i in 0..n {
        for (row, out) in rows.iter().zip(&mut out) {
            out.push(row.iter().zip(&x).map(|(c, x)| c * x).sum());
        }
        let to = (i + 1).min(n - 1);
        for (r, slot) in next.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (c, x) in x.iter().enumerate() {
                sum += f[(r, c)] * x;
            }
            for b in 0..bodies {
                // Between the samples by straight lines: their mean over the step.
                let u = 0.5 * (torque(b, i) + torque(b, to)) / drivetrain.inertias[b].speed_ratio;
                sum += f[(r, first + b)] * u;
            }
            *slot = sum;
        }
        let speeds = states - bodies;
        let mean: f64 = (0..bodies)
            .map(|b| moments[b] / total * next[speeds + b])
            .sum();
        let shift = motion.speed[0][to] - mean;
        next[speeds..].iter_mut().for_each(|w| *w += shift);
        next[0] = 0.0;
        std::mem::swap(&mut x, &mut next);
    }
    out
}

/// Fewer samples: means of so many.
struct Thin {
    every: usize,
    /// Raw samples at both ends whose accelerations are not known.
    edge: usize,
    n: usize,
}

impl Thin {
    fn count(&self) -> usize {
        self.n / self.every
    }

    fn times(&self, dt_s: f64) -> Vec<f64> {
        (0..self.count())
            .map(|i| (i as f64 * self.every as f64 + 0.5 * (self.every as f64 - 1.0)) * dt_s)
            .collect()
    }

    /// Means of what is known; NaN where nothing is.
    fn means(&self, x: &[f64]) -> Vec<f64> {
        x.chunks_exact(self.every)
            .map(|chunk| {
                let (sum, n) = chunk
                    .iter()
                    .filter(|v| v.is_finite())
                    .fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
                sum / n
            })
            .collect()
    }

    /// Means where all samples are known, NaN elsewhere and at the ends.
    fn residual(&self, x: &[f64]) -> Vec<f64> {
        x.chunks_exact(self.every)
            .enumerate()
            .map(|(i, chunk)| {
                let from = i * self.every;
                if from < self.edge || from + self.every + self.edge > self.n {
                    return f64::NAN;
                }
                chunk.iter().sum::<f64>() / self.every as f64
            })
            .collect()
    }
}

/// The value and the slope of a map at `angle`.
fn at(table: &[f64], angle: f64) -> (f64, f64) {
    let n = table.len();
    if n == 1 {
        return (table[0], 0.0);
    }
    let position = (angle / std::f64::consts::TAU).rem_euclid(1.0) * n as f64;
    let left = position as usize % n;
    let (a, b) = (table[left], table[(left + 1) % n]);
    let step = std::f64::consts::TAU / n as f64;
    (a + position.fract() * (b - a), (b - a) / step)
}

/// Each value that is not known is the one before, the first ones the first known.
fn filled(values: &[f64]) -> Vec<f64> {
    let mut last = values
        .iter()
        .copied()
        .find(|v| v.is_finite())
        .unwrap_or(0.0);
    values
        .iter()
        .map(|v| {
            if v.is_finite() {
                last = *v;
            }
            last
        })
        .collect()
}
