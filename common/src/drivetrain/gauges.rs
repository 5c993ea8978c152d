//! Updates the drivetrain filter with its gauges, one scalar update each: predicts each reading by
//! the strain map at the carrier angle, lets the consistency tests of redundant gauges exclude
//! faulty ones, and reports innovation and fault of each gauge.

use nalgebra::{RowSVector, SVector};

use crate::drivetrain::fault_isolation::{Gauge, MISPLACED, Prior};
use crate::drivetrain::model::{Channel, Role};
use crate::drivetrain::{
    DrivetrainEstimator, DrivetrainState, PATIENCE, dot, observed_variance, to_sensor_estimate,
};
use crate::io::estimate::{Estimate, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::Measurement;
use crate::io::raw::MAX_CHANNELS;
use crate::kalman;
use crate::kalman::innovation::Gate;
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

    /// Innovation, response and variance of gauge `i`, whose reading is `value`; `prior`: of the
    /// quantity that its direction senses.
    pub(crate) fn gauge(
        &self,
        state: &DrivetrainState<NX>,
        i: usize,
        value: f32,
        prior: Prior,
        homed: bool,
    ) -> Gauge {
        let Prior {
            sensed,
            variance: spread,
        } = prior;
        let Some(channel) = self.model.channels.get(i) else {
            return Gauge::default();
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
            return Gauge::default();
        };
        let now = Phase::from_rad(state.posterior.state[0]);
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
        Gauge {
            value: Some(value),
            innovation: value - (zero + response),
            response,
            sensitivity: sensitivity * steepness,
            variance: r,
            persistent: unknown + by_angle * by_angle * (MISPLACED * MISPLACED),
        }
    }

    /// The full recursion: consistency tests of the gauges of each direction, then one scalar
    /// update by each. The innovation of an excluded gauge is computed all the same.
    pub(crate) fn update_gauges(
        &self,
        state: &mut DrivetrainState<NX>,
        m: &Measurement,
        estimate: &mut Estimate,
    ) {
        self.open_sensors(state, m, estimate);
        let mut gauges = [Gauge::default(); MAX_CHANNELS];
        for (d, direction) in self.directions.iter().enumerate() {
            let Some(row) = self.row(direction.members.first()) else {
                continue;
            };
            let prior = Prior {
                sensed: dot(row, &state.posterior.state),
                variance: observed_variance(row, &state.posterior),
            };
            for i in &direction.members {
                let i = usize::from(*i) % MAX_CHANNELS;
                if let Some(Ok(value)) = m.values.get(i) {
                    gauges[i] = self.gauge(state, i, *value, prior, estimate.homed);
                }
            }
            (self.fault_isolation).weigh(&mut state.isolation, d, direction, &gauges, prior);
        }
        let before = state.posterior.state;
        for (d, direction) in self.directions.iter().enumerate() {
            let inflation = self.fault_isolation.inflation(&state.isolation, d);
            let together = self.all_refused(state, d);
            for i in &direction.members {
                let i = usize::from(*i) % MAX_CHANNELS;
                let (Some(channel), Some(slot)) =
                    (self.model.channels.get(i), estimate.sensors.get_mut(i))
                else {
                    continue;
                };
                if let Some(value) = gauges[i].value {
                    let gauge = Gauge {
                        variance: gauges[i].variance * inflation,
                        ..gauges[i]
                    };
                    let when = (together, estimate.homed);
                    let of = (i, channel, &gauge, value);
                    *slot = self.update_gauge(state, when, of, &before);
                    if slot.fault.is_none() && state.isolation.contradicts(d) {
                        slot.fault = Fault::Contradicted;
                    }
                }
            }
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

    /// The update by one gauge; `before` is the state that its innovation is of.
    fn update_gauge(
        &self,
        state: &mut DrivetrainState<NX>,
        (together, homed): (bool, bool),
        (i, channel, gauge, value): (usize, &Channel<'_>, &Gauge, f32),
        before: &SVector<f32, NX>,
    ) -> SensorEstimate {
        let Some(row) = self.channel_rows.get(i) else {
            return SensorEstimate::default();
        };
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
        let moved = dot(&gradient, &(state.posterior.state - before));
        let innovation = gauge.innovation - moved;
        let left_out = state.isolation.fault(i);
        let own = &mut state.gates[i % MAX_CHANNELS];
        let (mut shut, mut open) = (Gate::closed(), Gate::open());
        let gate = match left_out {
            Some(_) => &mut shut,
            None if together => &mut open,
            None => own,
        };
        let r = gauge.variance;
        let update = kalman::update(&mut state.posterior, &gradient, innovation, r, gate);
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
}
