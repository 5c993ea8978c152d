//! Recordings of a rotor that is not there.
//!
//! Nothing here is shared with the estimator but the machine description: twice
//! as many elements, integrated numerically from the shape functions; many
//! modes with the stiffness that the rest of them adds; Runge-Kutta steps with
//! the speed as it is at each moment.

use std::f64::consts::TAU;
use std::path::Path;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::draw::Draw;
use super::error::SimulateError;
use crate::machine::{Machine, Rotor, Senses};
use crate::recording::{BLOCK_ROWS, OutputColumn, RecordingError, Unit, Writer};

/// What the bench does; name and what it is.
pub const ROTOR_SCENARIOS: [(&str, &str); 2] = [
    (
        "constant",
        "from rest in the bearings, at constant speed, the unbalance acting at once",
    ),
    (
        "run-up",
        "from the lowest to the highest speed of the schedule",
    ),
];

/// Elements of the plant for one of the description.
const FINER: usize = 2;

/// Modes of the plant.
const MODES: usize = 24;

/// Largest angle of the fastest mode in one Runge-Kutta step [rad].
const STEP_RAD: f64 = 0.5;

/// Points and weights of the Gauss rule on [0, 1], exact to degree 7.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_9, 0.326_072_577_431_273_1),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_1),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// A force that the plant applies at one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppliedUnbalance {
    /// Mass times distance [kg m].
    pub moment_kg_m: f64,
    /// Angle at time 0 [rad].
    pub phase_rad: f64,
}

/// How a recording of a rotor is made.
#[derive(Clone, Debug, PartialEq)]
pub struct RotorScenario {
    /// Length [s].
    pub duration_s: f64,
    /// Speed at the start and at the end [rad/s], linear between.
    pub speeds_rad_s: [f64; 2],
    /// One for each load of the description.
    pub unbalances: Vec<AppliedUnbalance>,
    /// Noise of the sensors, in that of the description.
    pub noise: f64,
    /// Draws the noise.
    pub seed: u64,
}

impl RotorScenario {
    /// The scenario `name`; `seed` draws unbalances of half to the whole nominal load.
    ///
    /// # Errors
    /// When there is no such scenario.
    pub fn by_name(
        name: &str,
        rotor: &Rotor,
        seed: u64,
        duration_s: Option<f64>,
    ) -> Result<Self, SimulateError> {
        let (speeds_rad_s, usual_s) = match (name, rotor.schedule_rad_s) {
            ("constant", _) => ([rotor.speed_rad_s; 2], 2.0),
            ("run-up", Some(schedule)) => (schedule, 10.0),
            ("run-up", None) => {
                return Err(SimulateError::Scenario {
                    found: name.into(),
                    allowed: "constant; run-up where rotor.schedule_rad_s gives its speeds".into(),
                });
            }
            _ => {
                let names: Vec<&str> = ROTOR_SCENARIOS.iter().map(|(name, _)| *name).collect();
                return Err(SimulateError::Scenario {
                    found: name.into(),
                    allowed: names.join(", "),
                });
            }
        };
        let mut rng = Draw::new("unbalance", seed, seed).individual;
        let unbalances = (rotor.loads.iter())
            .map(|load| AppliedUnbalance {
                moment_kg_m: rng.random_range(0.5..1.0) * load.nominal_n
                    / rotor.speed_rad_s.powi(2),
                phase_rad: rng.random_range(0.0..TAU),
            })
            .collect();
        let duration_s = duration_s.unwrap_or(usual_s);
        if !(duration_s > 0.0 && duration_s <= super::LONGEST_S) {
            return Err(SimulateError::Duration {
                found: duration_s,
                most: super::LONGEST_S,
            });
        }
        Ok(Self {
            duration_s,
            speeds_rad_s,
            unbalances,
            noise: 1.0,
            seed,
        })
    }
}

/// A recording of a rotor in the making.
pub struct RotorSimulation<'a> {
    machine: &'a Machine,
    rotor: &'a Rotor,
    scenario: RotorScenario,
    plant: Plant,
    rng: ChaCha8Rng,
    dt: f64,
    steps: usize,
    rows: u64,
}

impl<'a> RotorSimulation<'a> {
    /// Sets up the recording of `scenario`.
    ///
    /// # Errors
    /// When the rotor cannot be computed.
    pub fn new(
        machine: &'a Machine,
        rotor: &'a Rotor,
        scenario: RotorScenario,
    ) -> Result<Self, SimulateError> {
        let plant = Plant::new(rotor).ok_or_else(|| SimulateError::NotHeld {
            machine: machine.name.clone(),
        })?;
        let dt = 1.0 / machine.rate_hz;
        let steps = (plant.fastest() * dt / STEP_RAD).ceil().max(1.0) as usize;
        Ok(Self {
            machine,
            rotor,
            rng: Draw::new("sensors", scenario.seed, scenario.seed).recording,
            rows: (scenario.duration_s * machine.rate_hz).round().max(1.0) as u64,
            scenario,
            plant,
            dt,
            steps,
        })
    }

    /// Samples of the whole recording.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    fn columns(&self) -> Vec<OutputColumn> {
        let channels = (self.machine.channels.iter()).map(|c| (c.name.clone(), c.unit));
        let encoders = (self.machine.encoders.iter()).map(|e| (e.name.clone(), Unit::COUNTS));
        let references = (self.machine.references.iter()).map(|r| (r.name.clone(), r.unit));
        let nodes = (0..self.rotor.nodes())
            .flat_map(|node| ["x", "y"].map(|axis| (format!("node{node}_{axis}"), Unit::METRE)));
        channels
            .chain(encoders)
            .chain(references)
            .chain(nodes)
            .map(|(name, unit)| OutputColumn {
                name,
                unit,
                single: false,
            })
            .collect()
    }

    /// Writes the recording: sensors, encoder, forces, displacements of every node.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be written.
    pub fn write(
        mut self,
        path: &Path,
        mut progress: impl FnMut(f64),
    ) -> Result<(), RecordingError> {
        let columns = self.columns();
        let rate = self.machine.rate_hz.to_string();
        let seed = self.scenario.seed.to_string();
        let metadata = [
            ("machine", self.machine.name.as_str()),
            ("seed", seed.as_str()),
            ("rate_hz", rate.as_str()),
        ];
        let mut writer = Writer::create(path, &columns, &metadata)?;
        let (mut t, mut block) = (Vec::new(), vec![Vec::new(); columns.len()]);
        for row in 0..self.rows {
            t.push(row as f64 * self.dt);
            self.sample(row, &mut block);
            self.advance(row);
            if t.len() == BLOCK_ROWS || row + 1 == self.rows {
                let slices: Vec<&[f64]> = block.iter().map(Vec::as_slice).collect();
                writer.write(&t, &slices)?;
                t.clear();
                block.iter_mut().for_each(Vec::clear);
                progress((row + 1) as f64 / self.rows as f64);
            }
        }
        writer.finish()
    }

    fn motion(&self, t: f64) -> Motion {
        let [from, to] = self.scenario.speeds_rad_s;
        let acceleration = (to - from) / self.scenario.duration_s;
        Motion {
            angle: from * t + 0.5 * acceleration * t * t,
            speed: from + acceleration * t,
            acceleration,
        }
    }

    /// Forces along x and y of each load [N].
    fn forces(&self, motion: &Motion) -> Vec<f64> {
        (self.scenario.unbalances.iter())
            .flat_map(|unbalance| {
                let (sine, cosine) = (motion.angle + unbalance.phase_rad).sin_cos();
                let (radial, along) = (
                    unbalance.moment_kg_m * motion.speed.powi(2),
                    unbalance.moment_kg_m * motion.acceleration,
                );
                [
                    radial * cosine + along * sine,
                    radial * sine - along * cosine,
                ]
            })
            .collect()
    }

    fn sample(&mut self, row: u64, columns: &mut [Vec<f64>]) {
        let motion = self.motion(row as f64 * self.dt);
        let forces = self.forces(&motion);
        let q = self.plant.displacements(&forces);
        let mut values = Vec::with_capacity(columns.len());
        for channel in &self.machine.channels {
            if let Senses::Displacement(at) = &channel.senses {
                let (sine, cosine) = at.direction_deg.to_radians().sin_cos();
                let along = q[2 * at.node] * cosine + q[2 * at.node + 1] * sine;
                let noise = self.rng.sample::<f64, _>(StandardNormal);
                let noise = self.scenario.noise * channel.to_si(channel.noise_std) * noise;
                let reading = channel.sensitivity.unwrap_or(1.0) * along
                    + channel.to_si(channel.offset)
                    + noise;
                let lsb = channel.lsb_si();
                values.push(channel.unit.from_si((reading / lsb).round() * lsb));
            }
        }
        for encoder in &self.machine.encoders {
            values.push((motion.angle / TAU * encoder.counts_per_turn).floor());
        }
        for reference in &self.machine.references {
            let names = self.rotor.loads.iter().flat_map(|l| &l.names);
            let force = (names.zip(&forces))
                .find(|(name, _)| **name == reference.load)
                .map_or(f64::NAN, |(_, force)| *force);
            values.push(reference.unit.from_si(force / reference.gain) + reference.zero);
        }
        values.extend(q);
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
    }

    fn advance(&mut self, row: u64) {
        let h = self.dt / self.steps as f64;
        for step in 0..self.steps {
            let t = row as f64 * self.dt + step as f64 * h;
            let at = |part: f64| {
                let motion = self.motion(t + part * h);
                (motion.speed, self.forces(&motion))
            };
            let moments = [at(0.0), at(0.5), at(1.0)];
            self.plant.step(h, &moments);
        }
    }
}

/// The shaft's rotation at one moment.
struct Motion {
    angle: f64,
    speed: f64,
    acceleration: f64,
}

/// The finer rotor in its modes.
struct Plant {
    squares: Vec<f64>,
    /// Damping and gyroscopic coupling of the modes, row by row.
    damping: Vec<f64>,
    gyroscopic: Vec<f64>,
    /// What bearings add to stiffness and damping at each speed of their tables.
    bearings: Vec<(crate::machine::RotorBearing, [Vec<f64>; 2])>,
    speed: f64,
    /// Modal forces of each component of the loads.
    inputs: Vec<Vec<f64>>,
    /// Shapes at the nodes of the description along x and y.
    shapes: Vec<Vec<f64>>,
    /// Displacements there under unit forces that the modes do not have.
    rest: Vec<Vec<f64>>,
    z: Vec<f64>,
    v: Vec<f64>,
}

impl Plant {
    /// None where the rotor is not held.
    fn new(rotor: &Rotor) -> Option<Self> {
        let matrices = Assembly::new(rotor);
        let n = matrices.mass.nrows();
        // From the flexibility: from the stiffness the slow modes would lose their
        // digits beside the stiff bearings.
        let factor = matrices.stiffness.llt(Side::Lower).ok()?;
        let l = factor.L();
        let mut a = matrices.mass.clone();
        l.solve_lower_triangular_in_place(a.as_mut());
        let mut a = a.transpose().to_owned();
        l.solve_lower_triangular_in_place(a.as_mut());
        let eigen = a.self_adjoint_eigen(Side::Lower).ok()?;
        let count = MODES.min(n);
        let squares: Vec<f64> = (0..count).map(|k| 1.0 / eigen.S()[n - 1 - k]).collect();
        if !squares.iter().all(|w2| *w2 > 0.0) {
            return None;
        }
        let mut phi = Mat::from_fn(n, count, |i, k| {
            eigen.U()[(i, n - 1 - k)] * squares[k].sqrt()
        });
        l.transpose().solve_upper_triangular_in_place(phi.as_mut());
        let project = |m: &Mat<f64>| -> Vec<f64> {
            let p = phi.transpose() * (m * &phi);
            (0..count * count)
                .map(|k| p[(k / count, k % count)])
                .collect()
        };
        let row = |dof: usize| -> Vec<f64> { (0..count).map(|k| phi[(dof, k)]).collect() };
        let shapes: Vec<Vec<f64>> = (0..rotor.nodes())
            .flat_map(|node| [row(4 * FINER * node), row(4 * FINER * node + 2)])
            .collect();
        let forced: Vec<usize> = (rotor.loads.iter())
            .flat_map(|load| [4 * FINER * load.node, 4 * FINER * load.node + 2])
            .collect();
        let unit = Mat::from_fn(n, forced.len(), |i, j| f64::from(u8::from(i == forced[j])));
        let statics = matrices.stiffness.llt(Side::Lower).ok()?.solve(&unit);
        let inputs: Vec<Vec<f64>> = forced.iter().map(|dof| row(*dof)).collect();
        let rest = (0..shapes.len())
            .map(|k| {
                let dof = 4 * FINER * (k / 2) + 2 * (k % 2);
                (0..forced.len())
                    .map(|j| {
                        let modal: f64 = (0..count)
                            .map(|i| shapes[k][i] * inputs[j][i] / squares[i])
                            .sum();
                        statics[(dof, j)] - modal
                    })
                    .collect()
            })
            .collect();
        let bearings = (rotor.bearings.iter())
            .map(|b| {
                let at = 4 * FINER * b.node;
                (b.clone(), [row(at), row(at + 2)])
            })
            .collect();
        Some(Self {
            damping: project(&matrices.damping),
            gyroscopic: project(&matrices.gyroscopic),
            squares,
            bearings,
            speed: rotor.speed_rad_s,
            inputs,
            shapes,
            rest,
            z: vec![0.0; count],
            v: vec![0.0; count],
        })
    }

    /// Frequency of the fastest mode [rad/s].
    fn fastest(&self) -> f64 {
        self.squares.iter().copied().fold(0.0, f64::max).sqrt()
    }

    /// Displacements at the nodes of the description [m].
    fn displacements(&self, forces: &[f64]) -> Vec<f64> {
        (self.shapes.iter().zip(&self.rest))
            .map(|(shape, rest)| dot(shape, &self.z) + dot(rest, forces))
            .collect()
    }

    /// One Runge-Kutta step of fourth order over `h` [s].
    fn step(&mut self, h: f64, moments: &[(f64, Vec<f64>); 3]) {
        let (z, v) = (self.z.clone(), self.v.clone());
        let moved = |base: &[f64], by: &[f64], part: f64| -> Vec<f64> {
            base.iter().zip(by).map(|(a, b)| a + part * h * b).collect()
        };
        let (z1, v1) = (v.clone(), self.acceleration(&z, &v, &moments[0]));
        let z2 = moved(&v, &v1, 0.5);
        let v2 = self.acceleration(&moved(&z, &z1, 0.5), &z2, &moments[1]);
        let z3 = moved(&v, &v2, 0.5);
        let v3 = self.acceleration(&moved(&z, &z2, 0.5), &z3, &moments[1]);
        let z4 = moved(&v, &v3, 1.0);
        let v4 = self.acceleration(&moved(&z, &z3, 1.0), &z4, &moments[2]);
        for i in 0..z.len() {
            self.z[i] += h / 6.0 * (z1[i] + 2.0 * z2[i] + 2.0 * z3[i] + z4[i]);
            self.v[i] += h / 6.0 * (v1[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
        }
    }

    fn acceleration(&self, z: &[f64], v: &[f64], (speed, forces): &(f64, Vec<f64>)) -> Vec<f64> {
        let n = z.len();
        let mut a: Vec<f64> = (0..n)
            .map(|i| {
                let row = i * n..(i + 1) * n;
                let damped = dot(&self.damping[row.clone()], v);
                let turned = dot(&self.gyroscopic[row], v);
                -self.squares[i] * z[i] - damped - speed * turned
            })
            .collect();
        for (input, force) in self.inputs.iter().zip(forces) {
            for i in 0..n {
                a[i] += input[i] * force;
            }
        }
        for (bearing, shapes) in self.bearings.iter().filter(|(b, _)| !b.table.is_empty()) {
            let ((k, c), (k0, c0)) = (bearing.at(*speed), bearing.at(self.speed));
            let (x, w) = (
                shapes.each_ref().map(|shape| dot(shape, z)),
                shapes.each_ref().map(|shape| dot(shape, v)),
            );
            for p in 0..2 {
                let pull: f64 = (0..2)
                    .map(|q| (k[p][q] - k0[p][q]) * x[q] + (c[p][q] - c0[p][q]) * w[q])
                    .sum();
                for i in 0..n {
                    a[i] -= shapes[p][i] * pull;
                }
            }
        }
        // Cross-coupled stiffness at the speed that the modes were made for.
        for (bearing, shapes) in &self.bearings {
            let (k, _) = bearing.at(self.speed);
            let skew = 0.5 * (k[0][1] - k[1][0]);
            if skew != 0.0 {
                let x = shapes.each_ref().map(|shape| dot(shape, z));
                for i in 0..n {
                    a[i] -= skew * (shapes[0][i] * x[1] - shapes[1][i] * x[0]);
                }
            }
        }
        a
    }
}

/// Matrices over `x`, `x'`, `y`, `y'` of each node: slopes, not rotations.
struct Assembly {
    mass: Mat<f64>,
    damping: Mat<f64>,
    gyroscopic: Mat<f64>,
    stiffness: Mat<f64>,
}

impl Assembly {
    fn new(rotor: &Rotor) -> Self {
        let n = 4 * (FINER * (rotor.nodes() - 1) + 1);
        let zeros = || Mat::<f64>::zeros(n, n);
        let mut all = Self {
            mass: zeros(),
            damping: zeros(),
            gyroscopic: zeros(),
            stiffness: zeros(),
        };
        let mut node = 0;
        for section in &rotor.sections {
            let Some(material) = rotor.material(section) else {
                continue;
            };
            let l = section.length_m / (FINER * section.elements) as f64;
            let (d, b) = (section.outer_m, section.inner_m);
            let area = TAU / 8.0 * (d * d - b * b);
            let inertia = TAU / 128.0 * (d.powi(4) - b.powi(4));
            let nu = material.poisson;
            let hollow = (b / d).powi(2);
            let cowper = 6.0 * (1.0 + nu) * (1.0 + hollow).powi(2)
                / ((7.0 + 6.0 * nu) * (1.0 + hollow).powi(2) + (20.0 + 12.0 * nu) * hollow);
            let bending = material.young_pa * inertia;
            let shearing = cowper * material.young_pa / (2.0 * (1.0 + nu)) * area;
            let phi = 12.0 * bending / (shearing * l * l);
            let density = material.density_kg_per_m3;
            for _ in 0..FINER * section.elements {
                for (xi, weight) in GAUSS {
                    let s = Shape::at(xi, l, phi);
                    for i in 0..4 {
                        for j in 0..4 {
                            let da = weight * l;
                            let k = da
                                * (bending * s.curvature[i] * s.curvature[j]
                                    + shearing
                                        * (s.slope[i] - s.turn[i])
                                        * (s.slope[j] - s.turn[j]));
                            let turning = da * density * inertia * s.turn[i] * s.turn[j];
                            let m = da * density * area * s.sag[i] * s.sag[j] + turning;
                            for plane in [0, 2] {
                                let at = (place(node, i) + plane, place(node, j) + plane);
                                all.stiffness[at] += k;
                                all.mass[at] += m;
                                all.damping[at] += section.alpha_per_s * m + section.beta_s * k;
                            }
                            let (x, y) = (place(node, i), place(node, j) + 2);
                            all.gyroscopic[(x, y)] += 2.0 * turning;
                            all.gyroscopic[(y, x)] -= 2.0 * turning;
                        }
                    }
                }
                node += 1;
            }
        }
        for disc in &rotor.discs {
            let at = 4 * FINER * disc.node;
            for plane in [0, 2] {
                all.mass[(at + plane, at + plane)] += disc.mass_kg;
                all.mass[(at + plane + 1, at + plane + 1)] += disc.diametral_kg_m2;
            }
            all.gyroscopic[(at + 1, at + 3)] += disc.polar_kg_m2;
            all.gyroscopic[(at + 3, at + 1)] -= disc.polar_kg_m2;
        }
        for bearing in &rotor.bearings {
            let at = 4 * FINER * bearing.node;
            let (k, c) = bearing.at(rotor.speed_rad_s);
            for p in 0..2 {
                for q in 0..2 {
                    let mean = 0.5 * (k[p][q] + k[q][p]);
                    all.stiffness[(at + 2 * p, at + 2 * q)] += mean;
                    all.damping[(at + 2 * p, at + 2 * q)] += c[p][q];
                }
            }
        }
        all
    }
}

/// Where `w1, w1', w2, w2'` of the element behind `node` stand in the plane of x.
fn place(node: usize, i: usize) -> usize {
    4 * node + 4 * (i / 2) + i % 2
}

/// Shape functions of a Timoshenko beam for `w1, turn1, w2, turn2`.
struct Shape {
    sag: [f64; 4],
    slope: [f64; 4],
    turn: [f64; 4],
    curvature: [f64; 4],
}

impl Shape {
    fn at(x: f64, l: f64, phi: f64) -> Self {
        let (x2, x3, s) = (x * x, x * x * x, 1.0 / (1.0 + phi));
        let scaled = |f: [f64; 4]| f.map(|value| s * value);
        Self {
            sag: scaled([
                1.0 + phi * (1.0 - x) - 3.0 * x2 + 2.0 * x3,
                l * (x - 2.0 * x2 + x3 + 0.5 * phi * (x - x2)),
                phi * x + 3.0 * x2 - 2.0 * x3,
                l * (x3 - x2 - 0.5 * phi * (x - x2)),
            ]),
            slope: scaled([
                (-phi - 6.0 * x + 6.0 * x2) / l,
                1.0 - 4.0 * x + 3.0 * x2 + 0.5 * phi * (1.0 - 2.0 * x),
                (phi + 6.0 * x - 6.0 * x2) / l,
                3.0 * x2 - 2.0 * x - 0.5 * phi * (1.0 - 2.0 * x),
            ]),
            turn: scaled([
                6.0 * (x2 - x) / l,
                1.0 - 4.0 * x + 3.0 * x2 + phi * (1.0 - x),
                6.0 * (x - x2) / l,
                3.0 * x2 - 2.0 * x + phi * x,
            ]),
            curvature: scaled([
                6.0 * (2.0 * x - 1.0) / (l * l),
                (6.0 * x - 4.0 - phi) / l,
                6.0 * (1.0 - 2.0 * x) / (l * l),
                (6.0 * x - 2.0 + phi) / l,
            ]),
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
