//! Gives the loads and drive torques that are known from a recording, by references (Wiener filter)
//! or by channels, and the operating profile, torque and speed over time, by which a simulation
//! repeats the recording.

use crate::drivetrain::decimation::forward_filled;
use crate::drivetrain::inverse_dynamics::InertiaMotion;
use crate::drivetrain::recorded_samples::{DrivetrainRecording, derivatives};
use crate::sample_statistics::white_noise_std;
use crate::smoothing::{smooth, wiener_denoise};
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{Drivetrain, Machine, Senses};
use loadtwin_simulate::{Course, Demand};

/// Width of the moving mean over which the speed of the operating profile is computed [s]: short
/// against torsional vibrations.
const TRACKED_S: f64 = 0.02;

/// Each load as its reference measures it, without its noise, or by a channel that senses the load
/// itself.
pub(crate) fn loads(
    machine: &Machine,
    drivetrain: &Drivetrain,
    recorded: &DrivetrainRecording,
) -> Vec<Option<Vec<f64>>> {
    drivetrain
        .loads
        .iter()
        .enumerate()
        .map(|(j, load)| {
            let reference = &recorded.loads[j];
            if reference.iter().any(|v| v.is_finite()) {
                let measured = forward_filled(reference);
                let noise = white_noise_std(&measured);
                return Some(wiener_denoise(&measured, recorded.dt_s, noise));
            }
            sensed(machine, recorded, &Senses::Load(load.name.clone()))
        })
        .collect()
}

/// Measured drive torque on each inertia, at its own speed [N m].
pub(crate) fn drives(
    machine: &Machine,
    drivetrain: &Drivetrain,
    recorded: &DrivetrainRecording,
) -> Vec<Option<Vec<f64>>> {
    drivetrain
        .inertias
        .iter()
        .map(|inertia| {
            let senses = Senses::Drive(inertia.name.clone());
            sensed(machine, recorded, &senses)
        })
        .collect()
}

/// What the first channel of that kind says; none without one, or where its sensitivity is a map.
fn sensed(machine: &Machine, recorded: &DrivetrainRecording, senses: &Senses) -> Option<Vec<f64>> {
    let k = machine.channels.iter().position(|c| c.senses == *senses)?;
    let channel = &machine.channels[k];
    if channel.sensitivity_map.is_some() {
        return None;
    }
    let sensitivity = channel.sensitivity_si();
    let offset = channel.to_si(channel.offset);
    let readings = recorded.channels[k].iter();
    let values: Vec<f64> = readings.map(|y| (y - offset) / sensitivity).collect();
    Some(forward_filled(&values))
}

/// Torque and speed over time by which a simulation repeats the recording; none where the first
/// load is not known.
pub(crate) fn operating_profile(
    drivetrain: &Drivetrain,
    torsion: &Torsion,
    recorded: &DrivetrainRecording,
    motion: &InertiaMotion,
    known: &[Option<Vec<f64>>],
    drives: &[Option<Vec<f64>>],
) -> Option<Course> {
    let first = known[0].as_ref()?;
    let nominal = drivetrain.loads[0].nominal_nm;
    // As the bench has it: the second load, else a drive, else the first load.
    let second = drivetrain.loads.get(1).zip(known.get(1));
    let driven = drives.iter().position(Option::is_some);
    let (body, held) = match (second, driven) {
        (Some((load, values)), _) => (
            torsion.inertia(&load.inertia),
            values.as_ref().map(|v| (v, load.nominal_nm)),
        ),
        (None, Some(body)) => (body, drives[body].as_ref().map(|v| (v, nominal))),
        (None, None) => (
            torsion.inertia(&drivetrain.loads[0].inertia),
            Some((first, nominal)),
        ),
    };
    let speed = tracked(recorded, motion, body);
    let demands = (0..recorded.len())
        .map(|i| Demand {
            torque: first[i] / nominal,
            speed: speed[i] / drivetrain.nominal_speed_rad_s,
            held: held.map(|(values, nominal)| values[i] / nominal),
        })
        .collect();
    Some(doing(recorded, demands))
}

/// The same, roughly, by the torque that the first shaft carries.
pub(crate) fn operating_profile_from_shaft(
    drivetrain: &Drivetrain,
    torsion: &Torsion,
    recorded: &DrivetrainRecording,
    motion: &InertiaMotion,
    carried: &[f64],
) -> Course {
    let load = &drivetrain.loads[0];
    let body = torsion.inertia(&load.inertia);
    // What the shaft carries comes from a load before it, or goes to one behind.
    let sign = if body == 0 { 1.0 } else { -1.0 };
    let own = sign * load.direction.sign() / (torsion.ratio(&load.inertia) * load.nominal_nm);
    let width = (TRACKED_S / recorded.dt_s) as usize | 1;
    let speed = tracked(recorded, motion, body);
    let demands = smooth(carried, width)
        .iter()
        .zip(speed)
        .map(|(torque, speed)| Demand {
            torque: own * torque,
            speed: speed / drivetrain.nominal_speed_rad_s,
            held: None,
        })
        .collect();
    doing(recorded, demands)
}

/// Speed of inertia `body`, referred. Vibrations are in it: what keeps the
/// speed is not to damp them. At the ends by straight lines: an error of the
/// first speed is carried on into the angle.
fn tracked(recorded: &DrivetrainRecording, motion: &InertiaMotion, body: usize) -> Vec<f64> {
    let width = ((TRACKED_S / recorded.dt_s) as usize | 1).max(3);
    let angle = &recorded.encoders[motion.encoder[body]];
    let mut speed = derivatives(angle, width, recorded.dt_s).0;
    // Where no mean is cut short, and a width further in.
    let (n, edge) = (speed.len(), 2 * width);
    if n > 4 * edge {
        let line = |at: f64, a: f64, b: f64| a + (b - a) * at / width as f64;
        let (first, second) = (speed[edge], speed[edge + width]);
        let (last, before) = (speed[n - 1 - edge], speed[n - 1 - edge - width]);
        for i in 0..edge {
            let out = i as f64 - edge as f64;
            speed[i] = line(out, first, second);
            speed[n - 1 - i] = line(out, last, before);
        }
    }
    speed
}

fn doing(recorded: &DrivetrainRecording, demands: Vec<Demand>) -> Course {
    // From where it is first known back to the start.
    let known_at = recorded.angle.iter().position(|a| a.is_finite());
    let turned = |i: usize| recorded.encoders[0][i] - recorded.encoders[0][0];
    Course {
        dt_s: recorded.dt_s,
        angle: known_at.map_or(0.0, |i| recorded.angle[i] - turned(i)),
        demands,
    }
}
