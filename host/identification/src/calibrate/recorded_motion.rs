//! Reads carrier angle, speed and reference loads of a recording over time, referred to the
//! carrier, by an encoder or by a speed; and computes from them what each channel senses: shaft
//! torque, load, speed or drive torque.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

use loadtwin_common::image::Image;
use loadtwin_common::io::measurement::{EncoderScaling, IndexPulse, SignalConditioner};

use crate::calibrate::CalibrateError;
use loadtwin_design::gearbox::Torsion;
use loadtwin_design::image_build::{self, Filter, Sensors};
use loadtwin_machine::{CREEP, Channel, Direction, Drivetrain, Inertia, Machine, Senses};
use loadtwin_replay::{ReplayError, Samples};

/// Half the span over which speed and acceleration are differences of mean
/// angles [s]: wide enough for coarse encoders, short against ramps.
const HALF_SPAN_S: f64 = 0.25;

/// Turns in one unit of a [`loadtwin_common::signal::phase::Phase`].
const TURNS_PER_PHASE: f64 = 1.0 / 18_446_744_073_709_551_616.0;

/// How a recorded machine moved and was loaded, sample by sample.
pub struct Motion {
    dt_s: f64,
    /// Angle of the shaft of the encoder that the index homes, else of the first, without encoders the
    /// integral of the first speed from 0; referred to the carrier and continuous over turns [rad].
    angle: Vec<f64>,
    speed: Vec<f64>,
    acceleration: Vec<f64>,
    /// Each load of the drivetrain, NaN where the recording has no reference.
    loads: Vec<Vec<f64>>,
    /// Samples whose angle was measured and homed and whose speed is known.
    usable: Vec<bool>,
    homed: bool,
}

/// The encoder whose angle the maps are over: that of the index pulse, else the first. Without
/// encoders the first channel that senses a speed; no index homes its integral.
fn motion_sensor(machine: &Machine) -> Option<(Sensors, &str)> {
    let encoder = (machine.homed_encoder()).or(machine.encoders.first());
    let speed = machine.channels.iter().find_map(|channel| {
        let of = channel.speed_of()?;
        machine.index.is_none().then_some((channel, of))
    });
    let (channels, encoders, inertia) = match (encoder, speed) {
        (Some(encoder), _) => (vec![], vec![encoder.clone()], encoder.inertia.as_str()),
        (None, Some((channel, of))) => (vec![channel.clone()], vec![], of),
        (None, None) => return None,
    };
    let sensors = Sensors {
        channels,
        encoders,
        name: String::new(),
        filter: Filter::default(),
        walks: BTreeMap::new(),
    };
    Some((sensors, inertia))
}

/// How the counts of the encoder and the index pulse become angles; nothing without an encoder.
fn angle_conversion(
    machine: &Machine,
    sensors: &Sensors,
) -> Result<(Vec<EncoderScaling>, Option<IndexPulse>), CalibrateError> {
    if sensors.encoders.is_empty() {
        return Ok((Vec::new(), None));
    }
    let payload = image_build::image(machine, sensors).map_err(ReplayError::from)?;
    let image = Image::from_bytes(&payload).map_err(ReplayError::Image)?;
    let model = image.model.gearbox().ok_or(CalibrateError::NoDrivetrain)?;
    let counters = model.encoders.iter().map(|encoder| encoder.counter);
    Ok((counters.collect(), model.index))
}

/// Speed of the main shaft by a channel that senses one [rad/s].
struct Tachometer<'a> {
    channel: &'a Channel,
    /// Reading for one rad/s of the main shaft (SI).
    sensitivity: f64,
}

impl<'a> Tachometer<'a> {
    fn new(channel: &'a Channel, drivetrain: &Drivetrain, inertia: &str) -> Self {
        let sensitivity = channel.sensitivity_si() * Torsion::new(drivetrain).ratio(inertia);
        Self {
            channel,
            sensitivity,
        }
    }

    fn speed(&self, word: i32) -> f64 {
        let offset = self.channel.to_si(self.channel.offset);
        (self.channel.reading(f64::from(word)) - offset) / self.sensitivity
    }
}

impl Motion {
    /// Reads encoder or speed, index pulse and references of `recording`; reports the part
    /// read so far, 0 to 1.
    ///
    /// # Errors
    /// When the recording cannot be read, or the machine has neither encoder nor speed.
    pub fn read(
        machine: &Machine,
        recording: &Path,
        mut progress: impl FnMut(f64),
    ) -> Result<Self, CalibrateError> {
        let refused = |reason: &str| CalibrateError::TooLittle {
            recording: recording.to_owned(),
            reason: reason.to_owned(),
        };
        let drivetrain = machine
            .drivetrain
            .as_ref()
            .ok_or(CalibrateError::NoDrivetrain)?;
        let (sensors, inertia) = motion_sensor(machine).ok_or_else(|| {
            refused(
                "nothing measures the motion: the machine has no encoder and, without index pulse, \
                 no channel that senses a speed",
            )
        })?;
        let error = machine.homed_error();
        let (counters, index) = angle_conversion(machine, &sensors)?;
        let tachometer =
            (sensors.channels.first()).map(|channel| Tachometer::new(channel, drivetrain, inertia));

        let load_of: Vec<usize> = (machine.load_of_references().into_iter())
            .map(Option::unwrap_or_default)
            .collect();
        let mut motion = Self {
            dt_s: 1.0 / machine.rate_hz,
            angle: Vec::new(),
            speed: Vec::new(),
            acceleration: Vec::new(),
            loads: vec![Vec::new(); drivetrain.loads.len()],
            usable: Vec::new(),
            homed: index.is_none(),
        };
        let (mut unwrap, mut last, mut angle, mut step) =
            (SignalConditioner::default(), None, 0.0, 0.0);
        let mut last_speed = None;
        let mut samples = Samples::open(machine, &sensors, recording)?;
        loop {
            let more = samples.next_block(|sample| {
                // The twist between carrier and encoder is small against what a map resolves.
                let lead = loadtwin_common::signal::phase::Phase::default();
                let m = unwrap.convert(&sample.raw, &[], &counters, index.as_ref(), lead);
                let phase = m.angles[0].ok();
                let word = sample.raw.has_word(0).then_some(sample.raw.words[0]);
                let speed = tachometer.as_ref().zip(word).map(|(t, word)| t.speed(word));
                if let Some(speed) = speed {
                    step = 0.5 * (speed + last_speed.unwrap_or(speed)) * motion.dt_s;
                    last_speed = Some(speed);
                }
                if let Some(phase) = phase {
                    let mut moved = last.map_or(phase.0, |last: u64| phase.0.wrapping_sub(last));
                    if let (Some(by), false) = (m.rehomed, motion.homed) {
                        // Earlier readings are shifted by as much.
                        moved = moved.wrapping_sub(by.0);
                        let by = by.0 as i64 as f64 * TURNS_PER_PHASE * TAU;
                        motion.home(by, &error);
                        angle += by;
                    }
                    step = moved as i64 as f64 * TURNS_PER_PHASE * TAU;
                    last = Some(phase.0);
                }
                angle += step;
                motion.angle.push(angle);
                motion.usable.push(phase.is_some() || speed.is_some());
                motion.push_loads(sample.references, &load_of);
            })?;
            progress(samples.progress());
            if !more {
                break;
            }
        }
        motion.differentiate();
        if !motion.usable.iter().any(|usable| *usable) {
            return Err(refused("it is shorter than a second"));
        }
        motion.refer_to_carrier(machine, drivetrain, inertia);
        Ok(motion)
    }

    /// Shifts the angles before the first index pulse by `by`, and subtracts the encoder's error.
    fn home(&mut self, by: f64, error: impl Fn(f64) -> f64) {
        for angle in &mut self.angle {
            *angle += by;
            *angle -= error(*angle);
        }
        self.homed = true;
    }

    /// Adds the loads of one sample: references that were measured, else NaN.
    fn push_loads(&mut self, references: &[f64], load_of: &[usize]) {
        for load in &mut self.loads {
            load.push(f64::NAN);
        }
        for (value, load) in references.iter().zip(load_of) {
            if let (false, Some(slot)) = (value.is_nan(), self.loads[*load].last_mut()) {
                *slot = *value;
            }
        }
    }

    /// Speed and acceleration from differences of moving means of the angle;
    /// the ends, where these do not reach, are not used.
    fn differentiate(&mut self) {
        let n = self.angle.len();
        let half = ((HALF_SPAN_S / self.dt_s) as usize).max(1);
        // Deviations from uniform motion, so that the sums stay small.
        let first = self.angle.first().copied().unwrap_or(0.0);
        let slope = (self.angle.last().copied().unwrap_or(0.0) - first) / n.max(1) as f64;
        let mut sums = vec![0.0];
        for (i, angle) in self.angle.iter().enumerate() {
            sums.push(sums[i] + angle - first - slope * i as f64);
        }
        let mean = |from: usize| (sums[from + half] - sums[from]) / half as f64;
        let span = half as f64 * self.dt_s;
        self.speed = vec![0.0; n];
        self.acceleration = vec![0.0; n];
        for i in 0..n {
            if i < 2 * half || i + 2 * half > n {
                self.usable[i] = false;
                continue;
            }
            let (before, now, after) = (
                mean(i - half - half / 2),
                mean(i - half / 2),
                mean(i + half - half / 2),
            );
            self.speed[i] = (after - before) / (2.0 * span) + slope / self.dt_s;
            self.acceleration[i] = (after - 2.0 * now + before) / (span * span);
        }
    }

    /// Subtracts the twist between carrier and encoder, as the estimator does.
    fn refer_to_carrier(&mut self, machine: &Machine, drivetrain: &Drivetrain, inertia: &str) {
        let torsion = Torsion::new(drivetrain);
        let row = torsion.angle_row(inertia);
        let stiffness: Vec<f64> = torsion.referred_stiffness().collect();
        for (k, stiffness) in stiffness.iter().enumerate() {
            if row[1 + k] == 0.0 {
                continue;
            }
            let shaft = &drivetrain.shafts[k];
            let Some(torque) = self.sensed(machine, &Senses::Shaft(shaft.name.clone())) else {
                continue;
            };
            for (angle, torque) in self.angle.iter_mut().zip(torque) {
                if torque.is_finite() {
                    *angle -= row[1 + k] * torque * shaft.speed_ratio / stiffness;
                }
            }
        }
    }

    /// Leaves all samples after the first `part`, 0 to 1, unused.
    pub fn use_first(&mut self, part: f64) {
        let used = (part * self.usable.len() as f64) as usize;
        self.usable
            .iter_mut()
            .skip(used)
            .for_each(|usable| *usable = false);
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.angle.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.angle.is_empty()
    }

    /// Whether the index pulse came, or none is needed.
    pub fn homed(&self) -> bool {
        self.homed
    }

    /// Carrier angle of sample `i` (rad); none where it was not measured.
    pub fn angle(&self, i: usize) -> Option<f64> {
        self.usable[i].then(|| self.angle[i])
    }

    /// Speed of the main shaft at sample `i` [rad/s].
    pub fn speed(&self, i: usize) -> f64 {
        self.speed[i]
    }

    /// Load number `j` of the drivetrain at sample `i` [N m]; NaN without reference.
    pub fn load(&self, j: usize, i: usize) -> f64 {
        self.loads[j][i]
    }

    /// What `senses` sensed in each sample (SI), NaN where unknown; none for
    /// what no reference of the recording measures.
    ///
    /// The torque of a shaft follows from the loads on one side of it, less
    /// the inertial torque there and the friction torque:
    /// `tau_i = sum_(m <= i) (loads_m - J_m dw/dt - c_m w - friction_m)`, or from the other side. The
    /// train counts as rigid: this holds while the loads change slowly against
    /// its lowest torsional mode. A drive torque follows from all loads, as that of a shaft before its
    /// inertia; from a speed that the motion itself is read from nothing follows.
    pub fn sensed(&self, machine: &Machine, senses: &Senses) -> Option<Vec<f64>> {
        let drivetrain = machine.drivetrain.as_ref()?;
        let known = |j: usize| self.loads[j].iter().any(|load| load.is_finite());
        match senses {
            Senses::Displacement(_) | Senses::OuterRing(_) | Senses::Temperature => None,
            Senses::Drive(name) => {
                let drives = |c: &Channel| matches!(c.senses, Senses::Drive(_));
                let is_only = machine.channels.iter().filter(|c| drives(c)).count() == 1;
                let side = Side::of(drivetrain, |_| true, -1.0, self);
                let ratio = Torsion::new(drivetrain).ratio(name);
                (is_only && side.loads.iter().all(|(j, _)| known(*j)))
                    .then(|| self.torques(&side, ratio))
            }
            Senses::Speed(_) if machine.encoders.is_empty() => None,
            Senses::Speed(name) => {
                let ratio = drivetrain
                    .inertias
                    .iter()
                    .find(|i| i.name == *name)?
                    .speed_ratio;
                Some(self.speed.iter().map(|speed| speed * ratio).collect())
            }
            Senses::Load(name) => {
                let j = drivetrain.loads.iter().position(|l| l.name == *name)?;
                known(j).then(|| self.loads[j].clone())
            }
            Senses::Shaft(name) => {
                let shaft = drivetrain.shafts.iter().position(|s| s.name == *name)?;
                // The side with less inertia is known better.
                let mut sides = [
                    Side::of(drivetrain, |body| body <= shaft, 1.0, self),
                    Side::of(drivetrain, |body| body > shaft, -1.0, self),
                ];
                sides.sort_by(|a, b| a.moment.total_cmp(&b.moment));
                let side = sides
                    .into_iter()
                    .find(|s| !s.loads.is_empty() && s.loads.iter().all(|(j, _)| known(*j)))?;
                let ratio = drivetrain.shafts[shaft].speed_ratio;
                Some(self.torques(&side, ratio))
            }
        }
    }

    /// The balance of torques about the main shaft in each usable sample in which every load has a
    /// reference.
    pub(crate) fn balance(&self, machine: &Machine) -> Option<Vec<BalanceSample>> {
        let all = Side::of(machine.drivetrain.as_ref()?, |_| true, 1.0, self);
        let of = |i: usize| BalanceSample {
            driven: all.driven(self, i),
            of_last_load: (all.loads.last()).map_or(0.0, |(j, factor)| factor * self.loads[*j][i]),
            lost: all.lost(self, i),
        };
        let usable = (0..self.len()).filter(|&i| self.usable[i]).map(of);
        Some(usable.filter(|sample| sample.driven.is_finite()).collect())
    }

    /// Torque of the shaft beside `side`, at a shaft that turns `ratio` times as fast.
    fn torques(&self, side: &Side, ratio: f64) -> Vec<f64> {
        let own = |i| self.torque(side, i) / ratio;
        (0..self.len()).map(own).collect()
    }

    fn torque(&self, side: &Side, i: usize) -> f64 {
        let torque = side.sign * (side.driven(self, i) - side.lost(self, i));
        // The loss of the torque carried is a part of the torque itself.
        torque / (1.0 + side.sign * side.losses[i] * torque.signum())
    }
}

/// Torques of one sample about the main shaft [N m].
pub(crate) struct BalanceSample {
    /// Of all loads.
    pub(crate) driven: f64,
    /// Of the load that is described last, part of `driven`.
    pub(crate) of_last_load: f64,
    /// Of inertia, drag and dry friction.
    pub(crate) lost: f64,
}

/// Everything on one side of a shaft, referred to the main shaft.
struct Side {
    sign: f64,
    moment: f64,
    drag: f64,
    /// Sample by sample [N m].
    dry_friction: Vec<f64>,
    /// Part of the torque carried that is lost, signed as the motion.
    losses: Vec<f64>,
    /// Number of each load and its factor.
    loads: Vec<(usize, f64)>,
}

impl Side {
    /// Of the inertias that it `has` by number; `sign` of its torque in that of the shaft.
    fn of(
        drivetrain: &Drivetrain,
        has: impl Fn(usize) -> bool,
        sign: f64,
        motion: &Motion,
    ) -> Self {
        let inertias = || {
            drivetrain
                .inertias
                .iter()
                .enumerate()
                .filter(|(m, _)| has(*m))
                .map(|(_, j)| j)
        };
        let direction = |direction: Direction| direction.sign();
        let mut dry_friction = vec![0.0; motion.len()];
        let mut losses = vec![0.0; motion.len()];
        for inertia in inertias() {
            let referred = inertia.referred_friction().unwrap_or_default();
            let known = |w: &f64| if w.is_finite() { *w } else { 0.0 };
            let speeds = || motion.speed.iter().map(known);
            let creeping = CREEP * drivetrain.nominal_speed_rad_s;
            let unloaded = speeds().map(|w| (w, 0.0));
            let course = referred.course(unloaded, motion.dt_s, creeping);
            for (sum, torque) in dry_friction.iter_mut().zip(course) {
                *sum += torque;
            }
            let course = referred.losses(speeds(), motion.dt_s, creeping);
            for (sum, part) in losses.iter_mut().zip(course) {
                *sum += part;
            }
        }
        Self {
            sign,
            moment: inertias().map(Inertia::referred_moment).sum(),
            drag: inertias().map(Inertia::referred_drag).sum(),
            dry_friction,
            losses,
            loads: drivetrain
                .loads
                .iter()
                .enumerate()
                .filter_map(|(j, load)| {
                    let inertia = inertias().find(|inertia| inertia.name == load.inertia)?;
                    Some((j, direction(load.direction) * inertia.speed_ratio))
                })
                .collect(),
        }
    }

    /// Torque of the loads at sample `i` of `motion` [N m].
    fn driven(&self, motion: &Motion, i: usize) -> f64 {
        let torques = self
            .loads
            .iter()
            .map(|(j, factor)| factor * motion.loads[*j][i]);
        torques.sum()
    }

    /// Torque that inertia, drag and dry friction take at sample `i` of `motion` [N m].
    fn lost(&self, motion: &Motion, i: usize) -> f64 {
        self.moment * motion.acceleration[i] + self.drag * motion.speed[i] + self.dry_friction[i]
    }
}
