//! Computes the residuals of one drivetrain recording, given the shaft torques: strains, torque
//! balance, encoder angles, innovations; and the decimated signals from which effects are computed.

use std::f64::consts::TAU;

use crate::drivetrain::chain_response::Encoders;
use crate::drivetrain::decimated_signals::Signals;
use crate::drivetrain::decimation::{Decimator, forward_filled, interpolate_map};
use crate::drivetrain::inverse_dynamics::{AppliedTorques, InertiaMotion, ShaftTorques, torques};
use crate::drivetrain::motion_sensor::moved_inertias;
use crate::drivetrain::recorded_samples::{
    DrivetrainRecording, Outliers, derivatives, mask_outliers, mask_stuck,
};
use crate::drivetrain::residual_signals::{Kind, ResidualSignal};
use crate::sample_statistics::white_noise_std;
use crate::smoothing::smooth;
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{
    Auxiliary, Drivetrain, Encoder, Machine, MachineError, Senses, earlier, resampled,
};

/// Width of each of the three moving means that smooth accelerations [s].
const SMOOTHING_S: f64 = 0.2;

/// Moving means of this time smooth temperatures [s]: short against the temperature rise of a housing.
const WARMING_S: f64 = 2.0;

/// Width of the moving mean in the speeds that friction depends on [s]: short
/// against torsional vibrations.
const FAST_S: f64 = 0.03;

/// Entries of a map between which lines are drawn.
const ENTRIES: usize = 4096;

/// Samples of a period of `dt_s` in each of the moving means that smooth accelerations; odd.
pub(crate) fn smoothing_width(dt_s: f64) -> usize {
    (SMOOTHING_S / dt_s) as usize | 1
}

/// A recording with the torques that it is given.
pub(crate) struct RecordingContext<'a> {
    pub machine: &'a Machine,
    pub drivetrain: &'a Drivetrain,
    pub torsion: Torsion,
    pub recorded: DrivetrainRecording,
    pub motion: InertiaMotion,
    /// Each load, where it is known.
    pub known: Vec<Option<Vec<f64>>>,
    /// Measured drive torque on each inertia, at its own speed [N m].
    pub drives: Vec<Option<Vec<f64>>>,
    pub torques: ShaftTorques,
    /// The samples that effects are scored on.
    pub thin: Decimator,
}

impl RecordingContext<'_> {
    /// Samples in each of the moving means that smooth accelerations; odd.
    pub fn width(&self) -> usize {
        smoothing_width(self.recorded.dt_s)
    }

    /// The torques in `drivetrain`, a chain of the same inertias, under the loads that are known.
    pub fn torques_of(&self, drivetrain: &Drivetrain) -> ShaftTorques {
        let applied = AppliedTorques {
            loads: &self.known,
            drives: &self.drives,
        };
        let torsion = Torsion::new(drivetrain);
        let (width, dt_s) = (self.width(), self.recorded.dt_s);
        torques(drivetrain, &torsion, &self.motion, &applied, width, dt_s)
    }

    fn nominal_torque(&self) -> f64 {
        self.drivetrain.nominal_torque()
    }

    /// References of loads that the recording does not have, where it has others.
    pub fn missing_references(&self) -> Vec<String> {
        if self.known.iter().all(Option::is_none) {
            return Vec::new();
        }
        let loads = self.drivetrain.loads.iter().zip(&self.known);
        let missing: Vec<&String> = loads
            .filter_map(|(load, known)| known.is_none().then_some(&load.name))
            .collect();
        let references = self.machine.references.iter();
        references
            .filter(|reference| missing.contains(&&reference.load))
            .map(|reference| reference.name.clone())
            .collect()
    }

    /// Torque of the first shaft that is known [N m referred].
    pub fn level(&self) -> Vec<f64> {
        let first = self.torques.shafts.iter().flatten().next();
        first
            .cloned()
            .unwrap_or_else(|| vec![0.0; self.recorded.len()])
    }

    /// Nominal twist of each shaft, referred [rad].
    pub fn twist(&self) -> Vec<f64> {
        let nominal = self.nominal_torque();
        self.torsion
            .referred_stiffness()
            .map(|k| nominal / k)
            .collect()
    }

    /// Standard deviation of the noise of each reference load, part of nominal.
    pub fn reference_noise(&self) -> Vec<f64> {
        let noise = |load: &str| {
            let j = self.drivetrain.loads.iter().position(|l| l.name == load)?;
            Some(white_noise_std(&self.recorded.loads[j]) / self.drivetrain.loads[j].nominal_nm)
        };
        let references = self.machine.references.iter();
        references.map(|r| noise(&r.load).unwrap_or(0.0)).collect()
    }

    /// The signals that effects are made of.
    pub fn signals(&self) -> Signals {
        let (thin, recorded) = (&self.thin, &self.recorded);
        let (drivetrain, motion) = (self.drivetrain, &self.motion);
        let nominal_torque = self.nominal_torque();
        let dt_s = recorded.dt_s * thin.every as f64;
        let fast = ((FAST_S / recorded.dt_s) as usize | 1).max(3);
        let smoothing = smoothing_width(dt_s);
        let response = self.torques.response.clone().map(|mut response| {
            response.transition = self.torsion.discretised(dt_s);
            let driven = &mut response.driven;
            driven.outside = driven.outside.iter().map(|o| thin.means(o)).collect();
            driven.speed = thin.means(&driven.speed);
            driven.dt_s = dt_s;
            driven.encoders = (1..self.machine.encoders.len())
                .map(|k| self.encoder_pair(k))
                .collect();
            response.carried = driven.carried();
            response
        });
        let moved = moved_inertias(self.machine);
        let warming = recorded.warming.as_ref();
        let zero_k = self.machine.thermometer().and_then(Auxiliary::zero_k);
        Signals {
            dt_s,
            means_of: thin.every,
            t: thin.times(recorded.dt_s),
            angle: forward_filled(&thin.means(&recorded.angle)),
            speed: thin.means(&motion.speed[0]),
            acceleration: thin.means(&motion.acceleration[0]),
            level: thin
                .means(&self.level())
                .iter()
                .map(|t| t / nominal_torque)
                .collect(),
            warming: warming.map(|w| smooth(&thin.means(w), (WARMING_S / dt_s) as usize | 1)),
            zero_noise_k: (warming.filter(|_| zero_k.is_none()))
                .map_or(0.0, |w| white_noise_std(w)),
            lag_s: self.machine.thermometer().map_or(0.0, |t| t.lag_s),
            nominal_speed: drivetrain.nominal_speed_rad_s,
            nominal_torque,
            inertias: drivetrain.inertias.iter().map(|i| i.name.clone()).collect(),
            ratios: drivetrain.inertias.iter().map(|i| i.speed_ratio).collect(),
            encoder_inertia: (motion.encoder.iter())
                .map(|e| self.torsion.inertia(moved[*e]))
                .collect(),
            smoothing,
            speeds: motion
                .encoder
                .iter()
                .map(|e| thin.means(&derivatives(&recorded.encoders[*e], fast, recorded.dt_s).0))
                .collect(),
            count: self.machine.encoders.first().map_or(0.0, |e| {
                TAU / (e.counts_per_turn * self.torsion.ratio(&e.inertia)).abs()
            }),
            response,
        }
    }

    /// The residual of channel `k`, and which of its samples stand out alone;
    /// none where the quantity it responds to is not known.
    pub fn strain(&self, k: usize) -> Result<Option<(ResidualSignal, Outliers)>, MachineError> {
        let (machine, drivetrain) = (self.machine, self.drivetrain);
        let (recorded, thin) = (&self.recorded, &self.thin);
        let channel = &machine.channels[k];
        let Some((sensed, shaft, ratio)) = self.sensed(&channel.senses) else {
            return Ok(None);
        };
        let mut readings = recorded.channels[k].clone();
        let stuck = mask_stuck(&mut readings);
        let table = channel.sensitivity_over_angle(machine)?;
        let over_angle = table.len() > 1;
        let table = if over_angle {
            resampled(&table, ENTRIES)
        } else {
            table
        };
        let offset = channel.to_si(channel.offset);
        let n = recorded.len();
        let late = channel.late_s / recorded.dt_s;
        let (sensed, angles) = (&earlier(sensed, late), earlier(&recorded.angle, late));
        let (mut residual, mut reading) = (vec![f64::NAN; n], vec![0.0; n]);
        let (mut map, mut slope) = (vec![0.0; n], vec![0.0; n]);
        // What is sensed at the shaft itself is `sensed / ratio`.
        let nominal = ratio * drivetrain.nominal_sensed(&channel.senses);
        let crept = channel.creep.map(|creep| {
            let levels = sensed.iter().map(|s| s / nominal);
            creep.course(levels, recorded.dt_s)
        });
        let turned = (channel.hysteresis).map(|h| h.course(sensed.iter().map(|s| s / nominal)));
        let thermal = channel.thermal.unwrap_or_default();
        let zero_per_k = channel.to_si(thermal.zero_per_k);
        for i in 0..n {
            let angle = if over_angle { angles[i] } else { 0.0 };
            if angle.is_nan() {
                continue;
            }
            let (m, dm) = interpolate_map(&table, angle);
            let bent = channel.bent(sensed[i], nominal);
            let at = |zero: &Option<Vec<f64>>| zero.as_ref().map_or(0.0, |z| channel.to_si(z[i]));
            let remembered = at(&crept) + at(&turned);
            map[i] = m / ratio;
            reading[i] = map[i] * bent;
            slope[i] = dm / ratio * bent;
            let warming = recorded.warming.as_ref().map_or(0.0, |w| w[i]);
            let warm = warming * (zero_per_k + thermal.gain_per_k * reading[i]);
            residual[i] = readings[i] - offset - remembered - warm - reading[i];
        }
        let noise = channel.noise_over_angle(machine)?;
        let noise = (noise.iter().map(|s| s * s).sum::<f64>() / noise.len() as f64).sqrt();
        let outliers = mask_outliers(&mut residual, noise);
        let square = table.iter().map(|m| m * m).sum::<f64>() / table.len() as f64;
        let signal = ResidualSignal {
            name: channel.name.clone(),
            kind: Kind::Strain,
            unit: channel.unit.si().symbol(),
            group: channel.group.clone(),
            residual: thin.residual(&residual),
            fault_free: Vec::new(),
            scale: square.sqrt() * (nominal / ratio).abs(),
            noise_std: noise / (thin.every as f64).sqrt(),
            map: thin.means(&map),
            reading: thin.means(&reading),
            slope: thin.means(&slope),
            table: if over_angle {
                table.iter().map(|m| m / ratio).collect()
            } else {
                Vec::new()
            },
            sensed: thin.means(sensed),
            parameter_sensitivities: Vec::new(),
            initial_vibrations: Vec::new(),
            shaft,
            twists: Vec::new(),
            inertias: [0, 0],
            samples: n as u64,
            spikes: 0,
            stuck,
        };
        Ok(Some((signal, outliers)))
    }

    /// The quantity that a channel responds to, its shaft, and by how much the speed there differs.
    fn sensed(&self, senses: &Senses) -> Option<(&[f64], Option<usize>, f64)> {
        let drivetrain = self.drivetrain;
        match senses {
            Senses::Shaft(name) => {
                let s = drivetrain.shafts.iter().position(|s| s.name == *name)?;
                let torque = self.torques.shafts[s].as_ref()?;
                Some((torque, Some(s), drivetrain.shafts[s].speed_ratio))
            }
            Senses::Load(name) => {
                self.machine.references.iter().find(|r| r.load == *name)?;
                let j = drivetrain.loads.iter().position(|l| l.name == *name)?;
                Some((self.known[j].as_deref()?, None, 1.0))
            }
            // The motion itself is read from it.
            Senses::Speed(_) if self.machine.encoders.is_empty() => None,
            Senses::Speed(name) => {
                let i = self.torsion.inertia(name);
                Some((&self.motion.speed[i], None, 1.0 / self.torsion.ratio(name)))
            }
            _ => None,
        }
    }

    /// The residual of the torque balance, where all loads are known.
    pub fn balance(&self) -> Option<ResidualSignal> {
        let balance = self.torques.balance.as_ref()?;
        Some(ResidualSignal {
            residual: self.thin.residual(balance),
            ..self.empty_residual("torque balance".into(), Kind::Balance)
        })
    }

    /// Encoder `k` against the first one.
    fn encoder_pair(&self, k: usize) -> Encoders {
        let (torsion, recorded) = (&self.torsion, &self.recorded);
        let (zeroth, encoder) = (&self.machine.encoders[0], &self.machine.encoders[k]);
        let first = torsion.angle_row(&zeroth.inertia);
        let own = torsion.angle_row(&encoder.inertia);
        let count = |e: &Encoder| TAU / (e.counts_per_turn * torsion.ratio(&e.inertia)).abs();
        let noise = |e: &Encoder| e.noise_std_counts() * count(e);
        let angles = recorded.encoders[k].iter().zip(&recorded.encoders[0]);
        let angle: Vec<f64> = angles.map(|(own, first)| own - first).collect();
        Encoders {
            signs: (1..=self.drivetrain.shafts.len())
                .map(|i| own[i] - first[i])
                .collect(),
            angle: self.thin.means(&angle),
            noise_std: noise(encoder).hypot(noise(zeroth)) / (self.thin.every as f64).sqrt(),
            count: count(encoder).max(count(zeroth)),
            zero: 0.0,
        }
    }

    /// The residual of encoder `k` against the first one; none where the twist
    /// between them is not known.
    pub fn angle(&self, k: usize) -> Option<ResidualSignal> {
        let (torsion, recorded) = (&self.torsion, &self.recorded);
        let (zeroth, encoder) = (&self.machine.encoders[0], &self.machine.encoders[k]);
        let twist = self.twist();
        let Encoders {
            signs, noise_std, ..
        } = self.encoder_pair(k);
        let full: f64 = signs.iter().zip(&twist).map(|(s, t)| (s * t).abs()).sum();
        if full == 0.0 || self.torques.shafts.iter().any(Option::is_none) {
            return None;
        }
        let stiffness: Vec<f64> = torsion.referred_stiffness().collect();
        let mut residual: Vec<f64> = (0..recorded.len())
            .map(|i| {
                let twisted: f64 = self
                    .torques
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
        // Both count from an arbitrary zero.
        let zero = residual.iter().sum::<f64>() / residual.len() as f64;
        for r in &mut residual {
            *r -= zero;
        }
        Some(ResidualSignal {
            residual: self.thin.residual(&residual),
            scale: full,
            noise_std,
            twists: signs,
            inertias: [
                torsion.inertia(&zeroth.inertia),
                torsion.inertia(&encoder.inertia),
            ],
            ..self.empty_residual(encoder.name.clone(), Kind::Angle)
        })
    }

    /// The residuals of a filter, sensor by sensor, from its normalised innovations.
    pub fn innovations(&self, normalised: &[(String, Vec<f64>)]) -> Vec<ResidualSignal> {
        let used = normalised
            .iter()
            .filter(|(_, of)| of.iter().any(|v| v.is_finite()));
        used.map(|(name, of)| ResidualSignal {
            residual: self.thin.residual(of),
            scale: 1.0,
            noise_std: 1.0 / (self.thin.every as f64).sqrt(),
            ..self.empty_residual(name.clone(), Kind::Innovation)
        })
        .collect()
    }

    /// A signal that responds to no torque.
    fn empty_residual(&self, name: String, kind: Kind) -> ResidualSignal {
        let nominal_torque = self.nominal_torque();
        ResidualSignal {
            name,
            kind,
            unit: match kind {
                Kind::Strain => "",
                Kind::Balance => "N m",
                Kind::Angle => "rad",
                Kind::Innovation => "σ",
            },
            group: None,
            residual: Vec::new(),
            fault_free: Vec::new(),
            scale: nominal_torque,
            noise_std: 2e-4 * nominal_torque,
            map: Vec::new(),
            reading: Vec::new(),
            slope: Vec::new(),
            table: Vec::new(),
            sensed: Vec::new(),
            parameter_sensitivities: Vec::new(),
            initial_vibrations: Vec::new(),
            shaft: None,
            twists: Vec::new(),
            inertias: [0, 0],
            samples: self.recorded.len() as u64,
            spikes: 0,
            stuck: 0,
        }
    }
}
