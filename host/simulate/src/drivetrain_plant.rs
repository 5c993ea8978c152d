//! Simulates the motion of a drivetrain under given torques: a torsional chain finer than the
//! estimator's model, with backlash, friction and speed control, integrated by Runge-Kutta steps.
//!
//! Each shaft is split into an elastic part and a mesh with a gear between
//! them, so a machine of n inertias becomes one of 2 n - 1. With body i
//! between the segments i - 1 and i, all referred to speed ratio 1:
//!
//! `J_i dw_i/dt = tau_(i-1) - tau_i - friction_i + load_i`,
//! `d(delta_i)/dt = w_i - w_(i+1)`,
//! `tau_i = k_i(angle) zone(delta_i) + c_i d(delta_i)/dt`,
//!
//! where `zone` is the dead zone of the backlash. In a mesh with backlash a tooth that pushes
//! cannot pull: `tau_i` is 0 inside the gap, and never has the sign opposite to `zone(delta_i)`.

use crate::chain_parameters::{Body, Chain, Presliding, Ripple};

/// Bodies of the largest machine, 2 * 6 - 1.
const BODIES: usize = 11;

/// Longest integration step [s].
const LONGEST_STEP_S: f64 = 1e-4;

/// Periods of the mesh's stiffness per turn of the main shaft.
const MESH_ORDER: f64 = 99.0;

/// Part `c` of the nominal speed over which Coulomb friction reverses, `tanh(w / c w_nominal)`.
const CREEP: f64 = 0.005;

/// Part of the nominal speed over which Stribeck friction falls, where the description gives none.
const STRIBECK: f64 = 0.05;

/// What drives the plant from outside.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Drive {
    /// Torque on each body, referred [N m].
    loads: [f64; BODIES],
    /// Torque that the speed controller starts from, referred [N m].
    pub feed: f64,
    /// Speed that it holds [rad/s of the main shaft].
    pub speed: f64,
}

impl Drive {
    /// No torque, at `speed` [rad/s of the main shaft].
    pub(crate) fn at_speed(speed: f64) -> Self {
        Self {
            speed,
            ..Self::default()
        }
    }

    /// What acts at `part` of the way from one to the other, 0 to 1.
    pub(crate) fn between(from: &Self, to: &Self, part: f64) -> Self {
        let between = |a: f64, b: f64| a + part * (b - a);
        Self {
            loads: std::array::from_fn(|i| between(from.loads[i], to.loads[i])),
            feed: between(from.feed, to.feed),
            speed: between(from.speed, to.speed),
        }
    }

    /// Adds a torque on inertia `i` of the machine description, referred [N m].
    pub(crate) fn load(&mut self, i: usize, torque: f64) {
        self.loads[2 * i] += torque;
    }
}

/// The machine that holds the speed: PI control through a lagging torque loop,
///
/// `d(torque)/dt = (feed + p e + integral - torque) / LAG`, `e = speed - w`.
///
/// It acts on the body whose speed it measures and `i/p < 1/LAG`, so it is
/// passive: it takes energy out of every torsional vibration.
#[derive(Clone, Copy, Debug, Default)]
struct Controller {
    body: usize,
    proportional: f64,
    integral: f64,
}

/// Time constant of the controlled machine's torque [s].
pub(crate) const LAG: f64 = 0.02;

#[derive(Clone, Copy, Debug, Default)]
struct Segment {
    stiffness: f64,
    damping: f64,
    half_backlash: f64,
    variation: f64,
    loss_before: f64,
    loss: f64,
}

/// Angles and speeds, or their rates.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct State {
    /// Angle of the first body [rad].
    angle: f64,
    /// Angle of body i less that of body i + 1 [rad].
    twist: [f64; BODIES],
    /// [rad/s].
    speed: [f64; BODIES],
    /// Each pre-sliding friction [N m].
    friction: [f64; BODIES],
    /// Torque of the machine that holds the speed [N m].
    drive: f64,
    /// Integral part of its controller [N m].
    integral: f64,
}

impl State {
    /// Each part becomes `of` itself, that of `x` and its rate, for the first `bodies` and the first
    /// `sliding` frictions.
    fn each(
        &mut self,
        (bodies, sliding): (usize, usize),
        x: &Self,
        rate: &Self,
        of: impl Fn(f64, f64, f64) -> f64,
    ) {
        let each = |own: &mut [f64], x: &[f64], rate: &[f64]| {
            for ((own, x), rate) in own.iter_mut().zip(x).zip(rate) {
                *own = of(*own, *x, *rate);
            }
        };
        self.angle = of(self.angle, x.angle, rate.angle);
        self.drive = of(self.drive, x.drive, rate.drive);
        self.integral = of(self.integral, x.integral, rate.integral);
        each(&mut self.twist[..bodies], &x.twist, &rate.twist);
        each(&mut self.speed[..bodies], &x.speed, &rate.speed);
        each(&mut self.friction[..sliding], &x.friction, &rate.friction);
    }
}

/// The plant and where it is.
#[derive(Clone, Debug)]
pub(crate) struct Plant {
    count: usize,
    bodies: [Body; BODIES],
    segments: [Segment; BODIES],
    /// Whether the stiffness of any mesh varies.
    varies: bool,
    ripples: Vec<Ripple>,
    presliding: Vec<Presliding>,
    controller: Controller,
    nominal_speed: f64,
    state: State,
}

/// Why a plant cannot be integrated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TooStiff {
    /// Step that would resolve its fastest motion [s].
    pub needed_s: f64,
    /// Shortest step that is taken [s].
    pub least_s: f64,
}

impl Plant {
    /// The plant of `chain` whose inertia `held` is driven so that the speed
    /// follows with a bandwidth of `bandwidth` [rad/s].
    pub(crate) fn new(chain: &Chain, held: usize, bandwidth: f64) -> Self {
        let mut plant = Self {
            count: 2 * chain.bodies.len() - 1,
            bodies: [Body::default(); BODIES],
            segments: [Segment::default(); BODIES],
            varies: chain.shafts.iter().any(|s| s.variation != 0.0),
            ripples: chain.ripples.clone(),
            presliding: chain.presliding.clone(),
            controller: Controller::default(),
            nominal_speed: chain.nominal_speed,
            state: State::default(),
        };
        for (i, body) in chain.bodies.iter().enumerate() {
            plant.bodies[2 * i] = *body;
        }
        for ripple in &mut plant.ripples {
            ripple.body *= 2;
        }
        for presliding in &mut plant.presliding {
            presliding.body *= 2;
        }
        for (i, shaft) in chain.shafts.iter().enumerate() {
            // The gear's inertia is taken from both neighbours: that of the
            // whole chain stays.
            let gear = shaft.gear * chain.bodies[i].inertia.min(chain.bodies[i + 1].inertia);
            plant.bodies[2 * i].inertia -= 0.5 * gear;
            plant.bodies[2 * i + 2].inertia -= 0.5 * gear;
            plant.bodies[2 * i + 1].inertia = gear;
            // Two equal springs in series.
            let half = Segment {
                stiffness: 2.0 * shaft.stiffness,
                damping: 2.0 * shaft.damping,
                ..Segment::default()
            };
            plant.segments[2 * i] = Segment {
                loss_before: shaft.loss_before,
                ..half
            };
            plant.segments[2 * i + 1] = Segment {
                half_backlash: 0.5 * shaft.backlash,
                variation: shaft.variation,
                loss: shaft.loss,
                ..half
            };
        }
        // Critically damped with the inertia of the whole chain.
        let proportional = plant.inertia() * bandwidth;
        plant.controller = Controller {
            body: 2 * held,
            proportional,
            integral: 0.25 * proportional * bandwidth,
        };
        plant
    }

    /// Steps per sample, so that each resolves the fastest motion.
    ///
    /// Bounds the highest eigenfrequency and decay rate by Gershgorin's circles.
    pub(crate) fn steps_per_sample(&self, dt_s: f64) -> Result<u32, TooStiff> {
        /// Most integration steps in a sample: beyond, a machine is too stiff to simulate.
        const MOST: f64 = 20_000.0;
        let slow = CREEP * self.nominal_speed;
        let mut step = LONGEST_STEP_S;
        for i in 0..self.count {
            let body = &self.bodies[i];
            let (mut spring, mut damper) = (0.0, body.viscous + body.coulomb / slow);
            for (segment, neighbour) in [(i.wrapping_sub(1), i.wrapping_sub(1)), (i, i + 1)] {
                if segment < self.count - 1 {
                    let s = &self.segments[segment];
                    let coupling = (body.inertia / self.bodies[neighbour].inertia).sqrt();
                    spring += s.stiffness * (1.0 + s.variation.abs()) * (1.0 + coupling);
                    damper += s.damping * (1.0 + coupling);
                }
            }
            for p in self.presliding.iter().filter(|p| p.body == i) {
                spring += p.torque / p.angle;
            }
            step = step
                .min(0.25 / (spring / body.inertia).sqrt())
                .min(0.5 * body.inertia / damper);
        }
        let steps = (dt_s / step).ceil().max(1.0);
        if steps <= MOST {
            Ok(steps as u32)
        } else {
            Err(TooStiff {
                needed_s: step,
                least_s: dt_s / MOST,
            })
        }
    }

    /// Puts the plant where `drive` turns it steadily.
    ///
    /// The loads and the feed must balance but for the losses of the meshes.
    pub(crate) fn settle(&mut self, angle: f64, drive: &Drive) {
        let speed = drive.speed;
        self.state = State {
            angle,
            drive: drive.feed,
            ..State::default()
        };
        self.state.speed[..self.count].fill(speed);
        self.state.friction = self.slid(speed);
        let mut torque = 0.0;
        for i in 0..self.count - 1 {
            torque += drive.loads[i] - self.friction(i, &self.state);
            if i == self.controller.body {
                torque += drive.feed;
            }
            let s = &self.segments[i];
            let side = if torque < 0.0 { -1.0 } else { 1.0 };
            torque /= 1.0 + s.loss_before * side * self.direction(speed);
            self.state.twist[i] = torque / s.stiffness + s.half_backlash * side;
            torque -= s.loss * torque.abs() * self.direction(speed);
        }
    }

    /// Friction of all bodies at `speed` without that of the meshes [N m].
    pub(crate) fn drag(&self, speed: f64) -> f64 {
        let mut state = State {
            friction: self.slid(speed),
            ..State::default()
        };
        state.speed[..self.count].fill(speed);
        (0..self.count).map(|i| self.friction(i, &state)).sum()
    }

    /// Pre-sliding frictions once all slide at `speed` [N m].
    fn slid(&self, speed: f64) -> [f64; BODIES] {
        let mut friction = [0.0; BODIES];
        for (friction, p) in friction.iter_mut().zip(&self.presliding) {
            *friction = p.torque * self.direction(speed);
        }
        friction
    }

    /// Moment of inertia of all bodies [kg m^2].
    pub(crate) fn inertia(&self) -> f64 {
        self.bodies[..self.count].iter().map(|b| b.inertia).sum()
    }

    /// One step of the classical Runge-Kutta method with constant loads.
    pub(crate) fn step(&mut self, h: f64, drive: &Drive) {
        let size = (self.count, self.presliding.len().min(BODIES));
        let x = self.state;
        let (mut stage, mut rate) = (x, State::default());
        for (weight, onward) in [
            (1.0, Some(0.5)),
            (2.0, Some(0.5)),
            (2.0, Some(1.0)),
            (1.0, None),
        ] {
            self.rate(&stage, drive, &mut rate);
            let weight = weight * h / 6.0;
            (self.state).each(size, &x, &rate, |next, _, rate| next + weight * rate);
            if let Some(part) = onward {
                let h = part * h;
                stage.each(size, &x, &rate, |_, x, rate| x + h * rate);
            }
        }
    }

    /// `rate` at `x`, of what the plant has.
    fn rate(&self, x: &State, drive: &Drive, rate: &mut State) {
        rate.angle = x.speed[0];
        let mesh = self.mesh(x);
        let mut before = 0.0;
        for i in 0..self.count.min(BODIES) {
            let mut torque = before + drive.loads[i] - self.friction(i, x);
            if i + 1 < self.count {
                rate.twist[i] = x.speed[i] - x.speed[i + 1];
                let carried = self.torque(i, x, mesh);
                let lost = |part: f64| match part {
                    0.0 => 0.0,
                    part => part * carried.abs() * self.direction(x.speed[i]),
                };
                let s = &self.segments[i];
                torque -= carried + lost(s.loss_before);
                before = carried - lost(s.loss);
            }
            rate.speed[i] = torque / self.bodies[i].inertia;
        }
        let c = &self.controller;
        let error = drive.speed - x.speed[c.body];
        rate.speed[c.body] += x.drive / self.bodies[c.body].inertia;
        rate.drive = (drive.feed + c.proportional * error + x.integral - x.drive) / LAG;
        rate.integral = c.integral * error;
        for ripple in &self.ripples {
            rate.speed[ripple.body] += ripple.amplitude
                * (ripple.order * x.angle + ripple.phase).cos()
                / self.bodies[ripple.body].inertia;
        }
        for ((rate, friction), p) in rate
            .friction
            .iter_mut()
            .zip(x.friction)
            .zip(&self.presliding)
        {
            let w = x.speed[p.body];
            *rate = (w * p.torque - w.abs() * friction) / p.angle;
        }
    }

    /// Where the teeth of the meshes are, -1 to 1; 0 where no stiffness varies with it.
    fn mesh(&self, x: &State) -> f64 {
        if self.varies {
            (MESH_ORDER * x.angle).cos()
        } else {
            0.0
        }
    }

    /// Torque that segment `i` carries from body i to body i + 1, the teeth being at `mesh`.
    fn torque(&self, i: usize, x: &State, mesh: f64) -> f64 {
        let s = &self.segments[i];
        let mut stiffness = s.stiffness;
        if s.variation != 0.0 {
            stiffness *= 1.0 + s.variation * mesh;
        }
        let damping = s.damping * (x.speed[i] - x.speed[i + 1]);
        if s.half_backlash == 0.0 {
            return stiffness * x.twist[i] + damping;
        }
        if x.twist[i] > s.half_backlash {
            (stiffness * (x.twist[i] - s.half_backlash) + damping).max(0.0)
        } else if x.twist[i] < -s.half_backlash {
            (stiffness * (x.twist[i] + s.half_backlash) + damping).min(0.0)
        } else {
            0.0
        }
    }

    /// Torque that brakes body `i`.
    fn friction(&self, i: usize, x: &State) -> f64 {
        let body = &self.bodies[i];
        let w = x.speed[i];
        let mut torque = body.viscous * w;
        if body.coulomb != 0.0 || body.stribeck != 0.0 {
            let fade = if body.stribeck_speed > 0.0 {
                w / body.stribeck_speed
            } else {
                w / (STRIBECK * self.nominal_speed)
            };
            torque += (body.coulomb + body.stribeck * (-fade * fade).exp()) * self.direction(w);
        }
        for (p, friction) in self.presliding.iter().zip(x.friction) {
            if p.body == i {
                torque += friction;
            }
        }
        torque
    }

    /// -1 to 1, smooth over standstill.
    fn direction(&self, speed: f64) -> f64 {
        (speed / (CREEP * self.nominal_speed)).tanh()
    }

    /// Angle of inertia `i` of the machine description, referred [rad].
    pub(crate) fn angle_of(&self, i: usize) -> f64 {
        self.state.angle - self.state.twist[..2 * i].iter().sum::<f64>()
    }

    /// Speed of inertia `i` of the machine description, referred [rad/s].
    pub(crate) fn speed_of(&self, i: usize) -> f64 {
        self.state.speed[2 * i]
    }

    /// Torque in the mesh of shaft `i` of the machine description, referred [N m].
    pub(crate) fn torque_of(&self, i: usize) -> f64 {
        self.torque(2 * i + 1, &self.state, self.mesh(&self.state))
    }

    /// Torque of the machine that holds the speed, referred [N m].
    pub(crate) fn drive(&self) -> f64 {
        self.state.drive
    }
}

#[cfg(test)]
mod tests;
