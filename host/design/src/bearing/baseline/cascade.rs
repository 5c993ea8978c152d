//! Estimates `Fx, Fz, Mx, Mz` from four gauge strains by the cascade of Kerst et al. 2019, sample
//! by sample: adaptive high-pass of the strains; an extended Kalman filter for each gauge
//! (ball-pass frequency, phase, contact load); an unscented Kalman filter of the inner ring's
//! displacement. The wheel's speed starts and stops it, with known loads at a start.
//!
//! As printed, but for what does not work so: the transition's off-diagonals are `t_s` and not
//! `1 / t_s`; each row bends a ring of its own, and its offset is part of the lever; predicted
//! approaches end at 0, where a contact is unloaded, as the measured ones do.

use std::f64::consts::{PI, TAU};

use loadtwin_common::bearing::contact::Contacts;
use loadtwin_common::bearing::{GAUGES, LOADS, ROWS};
use loadtwin_common::kalman::gaussian::Gaussian;
use loadtwin_common::kalman::innovation::Gate;
use loadtwin_common::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use loadtwin_common::kalman::unscented::Unscented;
use loadtwin_common::kalman::{predict, predict_constant, update};
use loadtwin_common::signal::butterworth::{Butterworth, ButterworthState};
use loadtwin_common::signal::phase::wrap_rad;
use nalgebra::{Matrix6, RowVector6, SVector, Vector6};

use crate::bearing::baseline::load_model::{Contact, Displacement, LoadModel, Ring, shapes};
use crate::bearing::baseline::strain_model::{CUTOFF, StrainModel};
use crate::bearing::baseline::{ESTIMATED, Loads};
use crate::error::BuildError;
use loadtwin_machine::{Bearing, Machine};

/// Random walk of the frequency of ball passing [rad/s/sqrt(s)]. The paper does not give the noise
/// of its filters (section VI-E): this and those below were chosen here.
const FREQUENCY_WALK: f32 = 15.0;

/// Random walk of a contact's load [kN/sqrt(s)].
const LOAD_WALK: f32 = 0.7;
/// Random walk of the phase [rad/sqrt(s)].
const PHASE_WALK: f32 = 0.1;
/// Error of the local strain's model without load [um/m].
const RESTING: f32 = 3.0;

/// Error of the local strain's model as part of the strain.
const RELATIVE: f32 = 0.15;
/// Standard deviation with which each gauge takes over the frequency of the most certain one
/// [rad/s].
const TRUSTED: f32 = 3.0;
/// Random walk of the displacements [um/sqrt(s)].
const DISPLACEMENT_WALK: f32 = 20.0;
/// Error of an approach without load [um].
const APPROACH: f32 = 0.5;

/// Error of an approach as part of it.
const APPROACH_RELATIVE: f32 = 0.03;
/// Share of the way that the ring goes in a sample to where the contacts push it: all at once it
/// swings.
const RELAXATION: f64 = 0.05;
/// Turn of the wheel over which its speed is taken at a start [rad].
const STARTING_TURN: f64 = PI;
/// Change of the speed from one such turn to the next with which the cascade may start, relative.
const STEADY: f64 = 0.01;

/// States of the strain models: three for each row.
const STATES: usize = 3 * ROWS;

/// The cascade, sample by sample.
pub(crate) struct Cascade {
    strain: Vec<StrainModel>,
    load: LoadModel,
    dt_s: f64,
    passes_per_turn: f64,
    lowest: f64,
    ranges: [f64; LOADS],
    transition: Transition<STATES, 0>,
    noise: ProcessNoise<STATES>,
    load_noise: ProcessNoise<LOADS>,
    wheel: Wheel,
    running: Option<Running>,
}

/// States of a cascade that runs.
struct Running {
    high_pass: Butterworth,
    low: [ButterworthState; GAUGES],
    /// `(omega, phi, Q)` of both rows at each gauge.
    gauges: [Gaussian<STATES>; GAUGES],
    /// `(dx, dy, dz, R gx, R gz)`.
    inner: Gaussian<LOADS>,
    ring: [Ring; ROWS],
}

/// The wheel's speed, from its angle [rad/s].
#[derive(Default)]
struct Wheel {
    angle: Option<f64>,
    turned: f64,
    since_s: f64,
    speed: f64,
    /// Whether it is that of the turn before, so that the filter that follows the wheel has come in.
    steady: bool,
}

impl Wheel {
    fn follow(&mut self, angle: f64, dt_s: f64) {
        let last = self.angle.replace(angle).unwrap_or(angle);
        self.turned += (angle - last + PI).rem_euclid(TAU) - PI;
        self.since_s += dt_s;
        if self.turned.abs() > STARTING_TURN || self.since_s > 1.0 {
            let speed = self.turned / self.since_s;
            self.steady = (speed - self.speed).abs() < STEADY * speed.abs();
            self.speed = speed;
            (self.turned, self.since_s) = (0.0, 0.0);
        }
    }
}

impl Cascade {
    pub(crate) fn try_new(
        machine: &Machine,
        bearing: &Bearing,
        strain: &[StrainModel],
    ) -> Result<Self, BuildError> {
        let load = LoadModel::try_new(bearing)?;
        let g = load.geometry();
        let dt_s = 1.0 / machine.rate_hz;
        let ratio = 0.5 * (1.0 - f64::from(g.ball_over_pitch * g.contact_angle.0));
        let mut transition = Matrix6::identity();
        for row in 0..ROWS {
            transition[(3 * row + 1, 3 * row)] = dt_s as f32;
        }
        let walk = [FREQUENCY_WALK, PHASE_WALK, LOAD_WALK].map(|w| w * w * dt_s as f32);
        let walk = Vector6::from_fn(|i, _| walk[i % 3]);
        let displacement = DISPLACEMENT_WALK * DISPLACEMENT_WALK * dt_s as f32;
        Ok(Self {
            strain: strain.to_vec(),
            dt_s,
            passes_per_turn: f64::from(bearing.balls) * ratio,
            lowest: TAU * bearing.filter.lowest_hz,
            ranges: bearing.range.all().map(|[from, to]| to - from),
            transition: Transition::try_new(&transition, RandomWalk).map_err(BuildError::Model)?,
            noise: ProcessNoise::independent(&walk).map_err(BuildError::Model)?,
            load_noise: ProcessNoise::independent(&SVector::repeat(displacement))
                .map_err(BuildError::Model)?,
            load,
            wheel: Wheel::default(),
            running: None,
        })
    }

    /// Loads [ranges] by the strains [um/m] and the wheel's angle [rad], while the wheel turns fast
    /// enough; `known`: loads given at a start [N, N m], as it cannot distinguish the rows.
    pub(crate) fn step(
        &mut self,
        strain: &[f64; GAUGES],
        angle: f64,
        known: &[f64; LOADS],
    ) -> Option<Loads> {
        self.wheel.follow(angle, self.dt_s);
        let passing = (self.wheel.speed * self.passes_per_turn).abs();
        if passing < self.lowest {
            self.running = None;
            return None;
        }
        let mut running = match self.running.take() {
            Some(running) => running,
            None if self.wheel.steady => self.start(strain, passing, known).ok()?,
            None => return None,
        };
        let loads = self.advance(&mut running, strain);
        // What is no number any more starts anew.
        self.running = loads.is_some().then_some(running);
        loads
    }

    fn start(
        &self,
        strain: &[f64; GAUGES],
        passing: f64,
        known: &[f64; LOADS],
    ) -> Result<Running, loadtwin_common::Error> {
        let g = self.load.geometry();
        let unit = |i: usize| {
            if i < 3 {
                1e-3
            } else {
                1.0 / f64::from(g.radius_mm)
            }
        };
        let known = std::array::from_fn(|i| (known[i] * unit(i)) as f32);
        let rest = Contacts::try_new(g.clone())?.solve_equilibrium(&known, 0.0);
        let position = rest.position.map(f64::from);
        let (inner, ring) = position.split_at(LOADS);
        let inner = Displacement::from_row_slice(inner);
        let (row0, row1) = ring.split_at(ring.len() / ROWS);
        let ring = [row0, row1].map(Ring::from_row_slice);
        let mut gauges = Vec::new();
        for g in 0..GAUGES {
            let mut x = Vector6::zeros();
            for row in 0..ROWS {
                let contact = self.contact(&inner, &ring, g, row);
                x[3 * row] = passing as f32;
                x[3 * row + 2] = self.load.load(contact.approach) as f32;
            }
            // The rows are distinguished by their loads.
            let variance = [25.0, 4.0, 0.01];
            gauges.push(Gaussian::independent(
                x,
                &Vector6::from_fn(|i, _| variance[i % 3]),
            )?);
        }
        let dt_s = self.dt_s as f32;
        Ok(Running {
            high_pass: Butterworth::try_new((CUTOFF * passing / TAU) as f32, dt_s)?,
            low: strain.map(|strain| ButterworthState::settled(strain as f32)),
            gauges: std::array::from_fn(|g| gauges[g]),
            inner: Gaussian::independent(inner.cast(), &SVector::repeat(100.0))?,
            ring,
        })
    }

    fn contact(&self, inner: &Displacement, ring: &[Ring; ROWS], g: usize, row: usize) -> Contact {
        let psi = f64::from(self.load.geometry().gauges_rad[g]);
        self.load
            .contact(inner, shapes(psi).dot(&ring[row]), row, psi)
    }

    fn advance(&self, running: &mut Running, strain: &[f64; GAUGES]) -> Option<Loads> {
        let inner: Displacement = running.inner.state.cast();
        // The frequency of each row that is trusted most.
        let trusted: [f32; ROWS] = std::array::from_fn(|row| {
            let by = |a: &&Gaussian<STATES>, b: &&Gaussian<STATES>| {
                a.variances()[3 * row].total_cmp(&b.variances()[3 * row])
            };
            running
                .gauges
                .iter()
                .min_by(by)
                .map_or(0.0, |g| g.state[3 * row])
        });
        running.high_pass.retune(
            CUTOFF as f32 * 0.5 * (trusted[0] + trusted[1]) / std::f32::consts::TAU,
            self.dt_s as f32,
        );
        let mut approaches = SVector::<f32, { ROWS * GAUGES }>::zeros();
        let mut variances = approaches;
        for g in 0..GAUGES {
            let local = running
                .high_pass
                .step(&mut running.low[g], strain[g] as f32)
                .high;
            let angles = [0, 1].map(|row| self.contact(&inner, &running.ring, g, row).angle);
            let estimate = &mut running.gauges[g];
            self.follow(estimate, g, local, &angles, trusted);
            for row in 0..ROWS {
                let approach = self.load.approach(f64::from(estimate.state[3 * row + 2])) as f32;
                approaches[ROWS * g + row] = approach;
                variances[ROWS * g + row] = (APPROACH + APPROACH_RELATIVE * approach).powi(2);
            }
        }
        predict_constant(&mut running.inner, &self.load_noise);
        let ring = running.ring;
        let observe = |z: &SVector<f32, LOADS>| {
            let inner: Displacement = z.cast();
            SVector::<f32, { ROWS * GAUGES }>::from_fn(|i, _| {
                self.contact(&inner, &ring, i / ROWS, i % ROWS)
                    .approach
                    .max(0.0) as f32
            })
        };
        (Unscented::default())
            .update(
                &mut running.inner,
                observe,
                &approaches,
                &variances,
                &mut [Gate::open(); ROWS * GAUGES],
            )
            .ok()?;
        let (loads, pushed) = self.load.loads(&running.inner.state.cast(), &running.ring);
        for (ring, pushed) in running.ring.iter_mut().zip(&pushed) {
            *ring += (pushed - *ring) * RELAXATION;
        }
        let radius = f64::from(self.load.geometry().radius_mm);
        let si = |l: usize| loads[l] * if l < 3 { 1e3 } else { radius };
        let loads = Loads::from(ESTIMATED.map(|l| si(l) / self.ranges[l]));
        let finite = running
            .gauges
            .iter()
            .all(|g| g.state.iter().all(|x| x.is_finite()));
        (finite && loads.iter().all(|load| load.is_finite())).then_some(loads)
    }

    /// The strain-model filter of one gauge.
    ///
    /// Source: Kerst et al. 2019, eq. (12)-(15).
    fn follow(
        &self,
        estimate: &mut Gaussian<STATES>,
        g: usize,
        local: f32,
        angles: &[f64; ROWS],
        trusted: [f32; ROWS],
    ) {
        predict(estimate, &self.transition, &self.noise);
        let mut predicted = 0.0;
        let mut slope = RowVector6::zeros();
        for row in 0..ROWS {
            let phi = &mut estimate.state[3 * row + 1];
            *phi = wrap_rad(*phi);
            let (shape, turned) = self.strain[g].transfer(f64::from(*phi));
            let sensitivity = self.strain[g].sensitivity(angles[row]);
            let load = estimate.state[3 * row + 2];
            predicted += load * (sensitivity * shape) as f32;
            slope[3 * row + 1] = load * (sensitivity * turned) as f32;
            slope[3 * row + 2] = (sensitivity * shape) as f32;
        }
        let variance = RESTING * RESTING + (RELATIVE * local).powi(2);
        update(
            estimate,
            &slope,
            local - predicted,
            variance,
            &mut Gate::open(),
        );
        for row in 0..ROWS {
            let mut h = RowVector6::zeros();
            h[3 * row] = 1.0;
            let nu = trusted[row] - estimate.state[3 * row];
            update(estimate, &h, nu, TRUSTED * TRUSTED, &mut Gate::open());
            // A contact only pushes.
            estimate.state[3 * row + 2] = estimate.state[3 * row + 2].max(0.0);
        }
    }
}
