//! Simulates the lateral motion of a rotor under given forces, a bow of its shaft among them, at a
//! given course of its speed (`Plant`): Timoshenko beam elements, two for each of the description,
//! with gyroscopic coupling and bearings by speed; reduced to 24 modes at most with the residual
//! flexibility of the others; integrated by Runge-Kutta steps.

use std::f64::consts::TAU;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use loadtwin_machine::{Rotor, RotorBearing};

/// Elements of the plant for one of the description.
const FINER: usize = 2;

/// Modes of the plant.
const MODES: usize = 24;

/// Points and weights of the Gauss rule on [0, 1], exact to degree 7.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_9, 0.326_072_577_431_273_1),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_1),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// The finer rotor in its modes.
pub(crate) struct Plant {
    squares: Vec<f64>,
    /// Damping and gyroscopic coupling of the modes, column by column.
    damping: Vec<f64>,
    gyroscopic: Vec<f64>,
    /// `K_st` as a part of `G`.
    accelerating: f64,
    /// What bearings add to stiffness and damping at each speed of their tables.
    bearings: Vec<(RotorBearing, [Vec<f64>; 2])>,
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

/// How the shaft turns at one moment, and what acts on it.
pub(crate) struct Moment {
    /// [rad/s]
    pub speed: f64,
    /// [rad/s^2]
    pub acceleration: f64,
    /// Along x and y of each load, then of what pulls [N].
    pub forces: Vec<f64>,
}

/// A force beside the loads, by its components along x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pull {
    /// At a node of the description [N].
    Node(usize),
    /// What a shaft that is bent pulls itself back with, half a wave between its outermost
    /// bearings, by its sag [m].
    Bow,
}

impl Plant {
    /// The loads of `rotor`, then `pulls`. None where the rotor is not held.
    pub fn new(rotor: &Rotor, pulls: &[Pull]) -> Option<Self> {
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
                .map(|k| p[(k % count, k / count)])
                .collect()
        };
        let row = |dof: usize| -> Vec<f64> { (0..count).map(|k| phi[(dof, k)]).collect() };
        let shapes: Vec<Vec<f64>> = (0..rotor.nodes())
            .flat_map(|node| [row(4 * FINER * node), row(4 * FINER * node + 2)])
            .collect();
        let loads = (rotor.loads.iter()).map(|load| Pull::Node(load.node));
        let columns: Vec<Vec<f64>> = (loads.chain(pulls.iter().copied()))
            .flat_map(|pull| pull.columns(rotor, n))
            .collect();
        let unit = Mat::from_fn(n, columns.len(), |i, j| columns[j][i]);
        let statics = matrices.stiffness.llt(Side::Lower).ok()?.solve(&unit);
        let modal = phi.transpose() * &unit;
        let inputs: Vec<Vec<f64>> = (modal.col_iter())
            .map(|column| column.iter().copied().collect())
            .collect();
        let rest = (0..shapes.len())
            .map(|k| {
                let dof = 4 * FINER * (k / 2) + 2 * (k % 2);
                (0..columns.len())
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
            accelerating: rotor.acceleration_stiffness,
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
    pub fn fastest(&self) -> f64 {
        self.squares.iter().copied().fold(0.0, f64::max).sqrt()
    }

    /// A bound of the fastest decay that dampers make [1/s]: the norm of `C`, at any speed.
    pub fn damped(&self) -> f64 {
        let tables = self.bearings.iter().filter(|(b, _)| !b.table.is_empty());
        let more: f64 = tables
            .map(|(bearing, shapes)| {
                let largest = (bearing.table.iter())
                    .flat_map(|at| at.damping_n_s_per_m.as_flattened())
                    .fold(0.0, |most: f64, c| most.max(c.abs()));
                let participation: f64 = shapes.iter().map(|shape| dot(shape, shape)).sum();
                2.0 * largest * participation
            })
            .sum();
        dot(&self.damping, &self.damping).sqrt() + more
    }

    /// Displacements at the nodes of the description [m].
    pub fn displacements(&self, forces: &[f64]) -> Vec<f64> {
        (self.shapes.iter().zip(&self.rest))
            .map(|(shape, rest)| dot(shape, &self.z) + dot(rest, forces))
            .collect()
    }

    /// One Runge-Kutta step of fourth order over `h` [s].
    pub fn step(&mut self, h: f64, moments: &[Moment; 3]) {
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

    /// `z'' = -K z - C z' - G (speed z' + c speed' z) + forces`.
    fn acceleration(&self, z: &[f64], v: &[f64], moment: &Moment) -> Vec<f64> {
        let n = z.len();
        let (speed, forces) = (moment.speed, &moment.forces);
        let along = self.accelerating * moment.acceleration;
        let carried: Vec<f64> = (v.iter().zip(z))
            .map(|(v, z)| speed * v + along * z)
            .collect();
        let mut a: Vec<f64> = (self.squares.iter().zip(z))
            .map(|(square, z)| -square * z)
            .collect();
        let coupling = (self.damping.chunks_exact(n)).zip(self.gyroscopic.chunks_exact(n));
        for ((damping, gyroscopic), (v, carried)) in coupling.zip(v.iter().zip(&carried)) {
            for ((a, c), g) in a.iter_mut().zip(damping).zip(gyroscopic) {
                *a -= c * v + g * carried;
            }
        }
        for (input, force) in self.inputs.iter().zip(forces) {
            for i in 0..n {
                a[i] += input[i] * force;
            }
        }
        for (bearing, shapes) in self.bearings.iter().filter(|(b, _)| !b.table.is_empty()) {
            let ((k, c), (k0, c0)) = (bearing.at(speed), bearing.at(self.speed));
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

impl Pull {
    /// Forces on `n` degrees of freedom, along x and along y.
    fn columns(self, rotor: &Rotor, n: usize) -> [Vec<f64>; 2] {
        let Self::Node(node) = self else {
            return bow(rotor, n);
        };
        [0, 2].map(|plane| {
            let mut column = vec![0.0; n];
            column[4 * FINER * node + plane] = 1.0;
            column
        })
    }
}

/// `K q` of the shaft without its bearings for `q = sin(pi (s - first) / span)`.
fn bow(rotor: &Rotor, n: usize) -> [Vec<f64>; 2] {
    let free = Rotor {
        bearings: Vec::new(),
        ..rotor.clone()
    };
    let lengths = (rotor.sections.iter())
        .flat_map(|s| std::iter::repeat_n(s.length_m / s.elements as f64, s.elements));
    let mut places = vec![0.0];
    for length in lengths {
        let before = places[places.len() - 1];
        places.extend((1..=FINER).map(|k| before + length * k as f64 / FINER as f64));
    }
    let at = |node: usize| places[FINER * node];
    let nodes = || rotor.bearings.iter().map(|b| b.node);
    let first = at(nodes().min().unwrap_or(0));
    let span = at(nodes().max().unwrap_or(rotor.nodes() - 1)) - first;
    let stiffness = Assembly::new(&free).stiffness;
    [0, 2].map(|plane| {
        let mut bent = Mat::<f64>::zeros(n, 1);
        for (node, place) in places.iter().enumerate() {
            let wave = TAU / 2.0 * (place - first) / span;
            bent[(4 * node + plane, 0)] = wave.sin();
            bent[(4 * node + plane + 1, 0)] = TAU / 2.0 / span * wave.cos();
        }
        let force = &stiffness * bent;
        (0..n).map(|i| force[(i, 0)]).collect()
    })
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
