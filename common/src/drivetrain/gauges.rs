//! Updates the drivetrain filter with its gauges, one scalar update each: predicts each reading by
//! the strain map at the carrier angle, lets the consistency tests of redundant gauges exclude
//! faulty ones, and reports innovation and fault of each gauge.

use nalgebra::{RowSVector, SVector};

use crate::drivetrain::fault_isolation::{Direction, Gauge, MISPLACED, Prior};
use crate::drivetrain::model::{Channel, Role};
use crate::drivetrain::steady_gain::gate_innovation;
use crate::drivetrain::{
    DrivetrainEstimator, DrivetrainState, PATIENCE, dot, observed_variance, to_sensor_estimate,
};
use crate::io::estimate::{Estimate, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::Measurement;
use crate::io::raw::MAX_CHANNELS;
use crate::kalman;
use crate::kalman::gaussian::Gaussian;
use crate::kalman::innovation::{Gate, Innovation};
use crate::signal::phase::Phase;

impl<const NX: usize> DrivetrainEstimator<'_, NX> {
    /// Adds one sensor for each channel to `estimate`, with its reading or the fault that replaces
    /// it, and keeps the readings of known inputs.
    pub(crate) fn open_sensors(
        &self,
        state: &mut DrivetrainState<NX>,
        m: &Measurement,
        estimate: &mut Estimate,
    ) {
        let readings = m.values.iter().zip(&mut state.known);
        for (channel, (reading, known)) in self.model.channels.iter().zip(readings) {
            let mut sensor = SensorEstimate::default();
            match reading {
                Ok(value) => {
                    if !matches!(channel.role, Role::Measure { .. }) {
                        *known = *value;
                    }
                    sensor.measured = *value * channel.unit;
                }
                Err(fault) => sensor.fault = *fault,
            }
            let _ = estimate.sensors.push(sensor);
        }
    }

    /// Fills in the gauges of a direction that have a reading; `prior`: of the quantity that they
    /// sense; `angle`: of the carrier, and whether it is homed.
    // Called for one gauge after the other, registers are saved and restored for each.
    #[inline(never)]
    pub(crate) fn fill_gauges(
        &self,
        state: &DrivetrainState<NX>,
        direction: &Direction,
        m: &Measurement,
        prior: Prior,
        angle: (Phase, bool),
        gauges: &mut [Gauge; MAX_CHANNELS],
    ) {
        for i in &direction.members {
            let i = usize::from(*i) % MAX_CHANNELS;
            if let Some(Ok(value)) = m.values.get(i) {
                self.fill_gauge(state, i, *value, prior, angle, &mut gauges[i]);
            }
        }
    }

    /// Innovation, response and variance of gauge `i`, whose reading is `value`.
    #[inline]
    fn fill_gauge(
        &self,
        state: &DrivetrainState<NX>,
        i: usize,
        value: f32,
        prior: Prior,
        (now, homed): (Phase, bool),
        gauge: &mut Gauge,
    ) {
        let Prior {
            sensed,
            variance: spread,
        } = prior;
        let Some(channel) = self.model.channels.get(i) else {
            return;
        };
        let Role::Measure {
            offset,
            map,
            map_mean,
            map_deviation,
            variance,
            biases,
            response,
            ..
        } = &channel.role
        else {
            return;
        };
        let angle = match channel.late() {
            None => now,
            Some(late) => now.wrapping_sub(Phase::from_rad(late * state.turned)),
        };
        let mut r = variance.bin(angle);
        let (sensitivity, slope) = if homed {
            map.at(angle)
        } else {
            (*map_mean, 0.0)
        };
        // `E[(m - mean)^2 s^2]` where the angle is not known: what is sensed has a spread, too. The
        // filter keeps to its estimate; that gauges differ by the spread is no sign of a fault.
        let unknown = if homed {
            0.0
        } else {
            map_deviation * map_deviation
        };
        r += unknown * sensed * sensed;
        let unknown = unknown * (sensed * sensed + spread);
        // The angle is the encoder's business: what it is unsure of makes the
        // reading less certain, but a gauge whose map is wrong must not turn it.
        let (output, steepness) = response.output(sensed, state.warming);
        let by_angle = output * slope;
        r += by_angle * by_angle * state.posterior.upper[0][0];
        let remembered = state.memories.get(i).map_or(0.0, |memory| memory.zero);
        let mut zero = offset + response.offset(remembered, state.warming);
        for bias in biases {
            let b = usize::from(bias.state);
            zero += bias.factor * state.posterior.state.get(b).copied().unwrap_or(0.0);
        }
        let response = sensitivity * output;
        *gauge = Gauge {
            value: Some(value),
            innovation: value - (zero + response),
            response,
            sensitivity: sensitivity * steepness,
            variance: r,
            persistent: unknown + by_angle * by_angle * (MISPLACED * MISPLACED),
        };
    }

    /// The full recursion: consistency tests of the gauges of each direction, then the update by
    /// them. The innovation of an excluded gauge is computed all the same.
    ///
    /// Gauges of one direction differ in their sensitivities `m_i` alone, unless they have biases.
    /// From one to the next, the variance `v` of what they sense and its estimate are numbers:
    ///
    /// `J = sum m^2 / r`, `a = sum m nu / r`, `v = v_0 / (1 + v_0 J)`, `nu_i - m_i v a`
    ///
    /// of those used so far. Together they are one measurement of it, `a / J` of variance `1 / J`.
    pub(crate) fn update_gauges(
        &self,
        state: &mut DrivetrainState<NX>,
        m: &Measurement,
        estimate: &mut Estimate,
    ) {
        let mut gauges = [Gauge::default(); MAX_CHANNELS];
        let angle = (Phase::from_rad(state.posterior.state[0]), estimate.homed);
        let mut first = 0.0;
        for (d, direction) in self.directions.iter().enumerate() {
            let Some(row) = self.row(direction.members.first()) else {
                continue;
            };
            let prior = Prior {
                sensed: dot(row, &state.posterior.state),
                variance: observed_variance(row, &state.posterior),
            };
            if d == 0 {
                first = prior.variance;
            }
            self.fill_gauges(state, direction, m, prior, angle, &mut gauges);
            (self.fault_isolation).weigh(&mut state.isolation, d, direction, &gauges, prior);
        }
        let before = state.posterior.state;
        for (d, direction) in self.directions.iter().enumerate() {
            let Some(row) = self.row(direction.members.first()) else {
                continue;
            };
            let inflation = self.fault_isolation.inflation(&state.isolation, d);
            let together = self.all_refused(state, d);
            let mut sensed = if d == 0 {
                Sensed::new(first, 0.0)
            } else {
                let moved = dot(row, &(state.posterior.state - before));
                Sensed::new(observed_variance(row, &state.posterior), moved)
            };
            for i in &direction.members {
                let i = usize::from(*i) % MAX_CHANNELS;
                let (Some(channel), Some(slot)) =
                    (self.model.channels.get(i), estimate.sensors.get_mut(i))
                else {
                    continue;
                };
                let gauge = &mut gauges[i];
                if let Some(value) = gauge.value {
                    gauge.variance *= inflation;
                    let when = (together, estimate.homed);
                    let of = (i, channel, &*gauge, value);
                    *slot = self.update_gauge(state, when, of, (&before, &mut sensed));
                    if slot.fault.is_none() && state.isolation.contradicts(d) {
                        slot.fault = Fault::Contradicted;
                    }
                }
            }
            sensed.update(&mut state.posterior, row);
        }
    }

    /// Whether every gauge of direction `d` that is not left out has been refused for as long as
    /// its gate is patient: they agree, so it is the prediction that is off.
    pub(crate) fn all_refused(&self, state: &DrivetrainState<NX>, d: usize) -> bool {
        self.directions.get(d).is_some_and(|direction| {
            let mut used = (direction
                .members
                .iter()
                .map(|i| usize::from(*i) % MAX_CHANNELS))
            .filter(|i| state.isolation.fault(*i).is_none());
            used.all(|i| state.gates[i].rejections() >= PATIENCE)
        })
    }

    pub(crate) fn row(&self, channel: Option<&u8>) -> Option<&RowSVector<f32, NX>> {
        self.channel_rows.get(usize::from(*channel?))
    }

    /// The update by one gauge; `before` is the state that its innovation is of, `sensed` takes in
    /// one that has no bias.
    fn update_gauge(
        &self,
        state: &mut DrivetrainState<NX>,
        (together, homed): (bool, bool),
        (i, channel, gauge, value): (usize, &Channel<'_>, &Gauge, f32),
        (before, sensed): (&SVector<f32, NX>, &mut Sensed),
    ) -> SensorEstimate {
        let left_out = state.isolation.fault(i);
        let mut fixed = if left_out.is_some() {
            Gate::closed()
        } else {
            Gate::open()
        };
        let gate = if left_out.is_some() || together {
            &mut fixed
        } else {
            &mut state.gates[i % MAX_CHANNELS]
        };
        let update = if channel.has_bias() {
            let of = (gauge, gate, homed);
            self.update_biased(&mut state.posterior, (i, channel), of, (before, sensed))
        } else {
            sensed.take(gauge, gate)
        };
        if update.used() {
            state.age = 0;
        }
        if together && update.nis <= self.model.gate_nis {
            state.gates[i % MAX_CHANNELS] = self.gate;
        }
        to_sensor_estimate(
            value,
            &update,
            channel.unit,
            left_out.unwrap_or(Fault::Erratic),
        )
    }

    /// The update by gauge `i`, to whose reading states are added, after those that have none.
    fn update_biased(
        &self,
        posterior: &mut Gaussian<NX>,
        (i, channel): (usize, &Channel<'_>),
        (gauge, gate, homed): (&Gauge, &mut Gate, bool),
        (before, sensed): (&SVector<f32, NX>, &mut Sensed),
    ) -> Innovation {
        let Some(row) = self.channel_rows.get(i) else {
            return Innovation::INVALID;
        };
        sensed.update(posterior, row);
        let mut gradient = row * gauge.sensitivity;
        // Until the angle is known, the map's changes over it look like a zero that moves.
        if let Role::Measure { biases, .. } = &channel.role
            && homed
        {
            for bias in biases {
                if let Some(g) = gradient.get_mut(usize::from(bias.state)) {
                    *g += bias.factor;
                }
            }
        }
        // The angle is not in a channel's row: the encoder alone measures it.
        let moved = dot(&gradient, &(posterior.state - before));
        let innovation = gauge.innovation - moved;
        let update = kalman::update(posterior, &gradient, innovation, gauge.variance, gate);
        *sensed = Sensed::new(
            observed_variance(row, posterior),
            dot(row, &(posterior.state - before)),
        );
        update
    }
}

/// What the gauges of a direction sense, between their updates.
struct Sensed {
    /// Its variance before them.
    variance: f32,
    /// By how much updates before moved it since the innovations were computed.
    moved: f32,
    /// `J` and `a` of those taken in.
    information: f32,
    score: f32,
}

impl Sensed {
    fn new(variance: f32, moved: f32) -> Self {
        Self {
            variance,
            moved,
            information: 0.0,
            score: 0.0,
        }
    }

    /// Takes in the innovation of a gauge, where its gate accepts it.
    fn take(&mut self, gauge: &Gauge, gate: &mut Gate) -> Innovation {
        let (m, r) = (gauge.sensitivity, gauge.variance);
        let variance = self.variance / (1.0 + self.variance * self.information);
        let nu = gauge.innovation - m * self.moved;
        let after = nu - m * (variance * self.score);
        let update = gate_innovation(after, m * m * variance + r, gate);
        if update.used() {
            let weight = m / r;
            self.score += weight * nu;
            self.information += weight * m;
        }
        update
    }

    /// Corrects `posterior` by those taken in, whose row is `row`.
    fn update<const NX: usize>(&self, posterior: &mut Gaussian<NX>, row: &RowSVector<f32, NX>) {
        if self.information > 0.0 {
            let variance = 1.0 / self.information;
            let innovation = self.score * variance;
            kalman::update(posterior, row, innovation, variance, &mut Gate::open());
        }
    }
}
