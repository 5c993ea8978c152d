//! Reads a recording of a rotor, 60 000 samples at most: readings of the sensors (m); angle, speed
//! and acceleration of the shaft from smoothed encoder counts or, without an encoder, from the
//! described speed.

use std::f64::consts::TAU;
use std::path::Path;

use faer::Mat;

use crate::diagnosis::DiagnoseError;
use crate::regression::normal_equations::solve_ridge;
use loadtwin_design::image_build::Sensors;
use loadtwin_design::rotor::ShaftRotation;
use loadtwin_machine::{Machine, Rotor};
use loadtwin_replay::Samples;

/// Samples that are tested, from the start of a recording.
const MOST: usize = 60_000;

/// Half of the time over which angle and speed are computed from counts [s].
const SPAN_S: f64 = 0.1;

/// Shortest recording that is tested, in turns.
const FEWEST_TURNS: f64 = 30.0;

/// Readings [m] and motion, sample by sample.
pub struct RotorRecording {
    /// Of each channel; NaN where missing.
    pub readings: Vec<Vec<f64>>,
    /// How the shaft turned.
    pub turning: ShaftRotation,
}

impl RotorRecording {
    /// Reads `path`.
    ///
    /// # Errors
    /// When it cannot be read or is too short.
    pub fn read(
        machine: &Machine,
        rotor: &Rotor,
        sensors: &Sensors,
        path: &Path,
    ) -> Result<Self, DiagnoseError> {
        let mut samples = Samples::open(machine, sensors, path)?;
        let mut readings = vec![Vec::new(); sensors.channels.len()];
        let mut counts = Vec::new();
        let mut home = None;
        let mut more = true;
        while more && readings[0].len() < MOST {
            more = samples.next_block(|sample| {
                let raw = &sample.raw;
                for (k, (channel, of)) in sensors.channels.iter().zip(&mut readings).enumerate() {
                    let word = f64::from(raw.words[k]) - f64::from(channel.zero_word());
                    of.push(if raw.has_word(k) {
                        word * channel.lsb_si()
                    } else {
                        f64::NAN
                    });
                }
                let count = raw.has_encoder(0).then_some(f64::from(raw.encoders[0]));
                home = home.or(raw.index.map(|index| (counts.len(), f64::from(index))));
                counts.push(count);
            })?;
        }
        for of in &mut readings {
            of.truncate(MOST);
        }
        counts.truncate(MOST);
        let dt_s = 1.0 / machine.rate_hz;
        let n = counts.len();
        let turning = match sensors.encoders.first() {
            None => ShaftRotation {
                dt_s,
                angle: (0..n)
                    .map(|i| rotor.speed_rad_s * i as f64 * dt_s)
                    .collect(),
                speed: vec![rotor.speed_rad_s; n],
                acceleration: vec![0.0; n],
            },
            Some(encoder) => {
                let step = TAU / encoder.counts_per_turn;
                let modulus = f64::from(encoder.bits).exp2();
                let continuous = continued(&counts, modulus);
                let home = home
                    .zip(machine.index.as_ref())
                    .map_or(0.0, |((at, count), index)| {
                        let moved = wrapped(count - counts[at].unwrap_or(count), modulus);
                        index.angle_rad - step * (continuous[at.min(n - 1)] + moved)
                    });
                // A count is somewhere within its step.
                let angle: Vec<f64> = (continuous.iter())
                    .map(|count| home + step * count + 0.5 * step.abs())
                    .collect();
                smoothed(&angle, dt_s)
            }
        };
        let turns = turning.speed.iter().sum::<f64>() * dt_s / TAU;
        if turns.abs() < FEWEST_TURNS {
            return Err(DiagnoseError::TooLittle {
                recording: path.to_owned(),
                reason: format!(
                    "{turns:.1} turns are too few to tell an effect from chance; at least {FEWEST_TURNS} are needed"
                ),
            });
        }
        Ok(Self { readings, turning })
    }
}

/// Counts without their wraps; a missing one repeats the last.
fn continued(counts: &[Option<f64>], modulus: f64) -> Vec<f64> {
    let mut last = counts.iter().flatten().next().copied().unwrap_or(0.0);
    let mut total = last;
    (counts.iter())
        .map(|count| {
            if let Some(count) = count {
                total += wrapped(count - last, modulus);
                last = *count;
            }
            total
        })
        .collect()
}

fn wrapped(moved: f64, modulus: f64) -> f64 {
    moved - (moved / modulus).round() * modulus
}

/// A parabola through the samples about each one.
fn smoothed(angle: &[f64], dt_s: f64) -> ShaftRotation {
    let n = angle.len();
    let half = ((SPAN_S / dt_s) as usize).clamp(2, n.max(5) / 2);
    let fits: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let range = i.saturating_sub(half)..(i + half + 1).min(n);
            let (mut gram, mut right) = (Mat::<f64>::zeros(3, 3), Mat::<f64>::zeros(3, 1));
            for k in range {
                let t = (k as f64 - i as f64) * dt_s;
                let row = [1.0, t, t * t];
                for a in 0..3 {
                    // From the angle itself: it grows for hours.
                    right[(a, 0)] += row[a] * (angle[k] - angle[i]);
                    for b in 0..3 {
                        gram[(a, b)] += row[a] * row[b];
                    }
                }
            }
            let fit = solve_ridge(gram, &right, &[0.0; 3]);
            [angle[i] + fit[(0, 0)], fit[(1, 0)], 2.0 * fit[(2, 0)]]
        })
        .collect();
    ShaftRotation {
        dt_s,
        angle: fits.iter().map(|f| f[0]).collect(),
        speed: fits.iter().map(|f| f[1]).collect(),
        acceleration: fits.iter().map(|f| f[2]).collect(),
    }
}
