//! Simulates the strains of a wheel bearing under given loads: an individual bearing with random
//! deviations, each ball a contact of its own, an elastic ring with more shapes than the
//! estimator's, equilibrium by Newton's method.
//!
//! Nothing here is shared with the estimator but the machine description.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use loadtwin_machine::Bearing;

/// Shapes of the ring under a row: breathing, then cosine and sine of orders 2 to 6.
const SHAPES: usize = 11;

/// Degrees of freedom: five of the inner ring, shapes of both rows.
const DOF: usize = 5 + 2 * SHAPES;

/// Force out of balance at which equilibrium is reached [kN].
const BALANCED: f64 = 1e-5;

/// Most steps of Newton's method to it.
const MOST_STEPS: usize = 20;

/// An individual bearing in its seat.
#[derive(Clone, Debug)]
pub(crate) struct Individual {
    balls: usize,
    ball_over_pitch: f64,
    /// Radius of the inner groove's centre [mm].
    radius: f64,
    offset: f64,
    groove: f64,
    angle: f64,
    /// [kN/um^1.5].
    pub(crate) stiffness: f64,
    /// [um].
    pub(crate) preload: f64,
    /// [um/kN], over both rows.
    compliance: Mat<f64>,
    /// Where each ball is off its place in the cage [rad], and its excess diameter [um].
    scatter: [Vec<(f64, f64)>; 2],
    pub(crate) gauges: Vec<Gauge>,
}

/// Response of one gauge.
#[derive(Clone, Debug)]
pub(crate) struct Gauge {
    azimuth: f64,
    /// Peak of the strain by a ball under the gauge, for each row [um/m / kN].
    pub(crate) gain: [f64; 2],
    width: f64,
    skew: f64,
    angle_slope: f64,
    angle_curvature: f64,
    /// Bending strain by a shape [um/m / um / (k^2 - 1)].
    bending: f64,
    /// Bulk strain by the loads [um/m / kN] and by the square of the moment.
    pub(crate) bulk: [f64; 5],
    square: f64,
}

impl Individual {
    /// `road`: seated in a vehicle instead of the rig.
    pub(crate) fn draw(bearing: &Bearing, rng: &mut ChaCha8Rng, road: bool) -> Self {
        let mut normal = move || rng.sample::<f64, _>(StandardNormal).clamp(-2.5, 2.5);
        let balls = usize::from(bearing.balls);
        let angle = (bearing.contact_angle_deg + 0.5 * normal()).to_radians();
        let groove = (2.0 * bearing.conformity - 1.0) * bearing.ball_mm * 1e3;
        let arm = (bearing.conformity - 0.5) * bearing.ball_mm;
        let softness = 1.0 + 0.12 * normal();
        let seat = 1.0 + if road { 0.08 } else { 0.0 };
        let coupling = (bearing.row_coupling * (1.0 + 0.1 * normal())).min(0.95);
        // Orders 0, 2, 3 as described, those above falling as 1 / k^3.
        let mut one = Mat::<f64>::zeros(SHAPES, SHAPES);
        for k in 0..5 {
            for l in 0..5 {
                one[(k, l)] = bearing.compliance_um_per_kn[k][l] * softness * seat;
            }
        }
        for k in 5..SHAPES {
            let order = (k.div_ceil(2) + 1) as f64;
            one[(k, k)] = one[(3, 3)] * (3.0 / order).powi(3);
        }
        // Coupling by the knuckle, which the description does not have.
        for k in 1..SHAPES {
            for l in 1..k {
                let cross = 0.06 * normal() * (one[(k, k)] * one[(l, l)]).sqrt();
                one[(k, l)] += cross;
                one[(l, k)] += cross;
            }
        }
        if road {
            for (k, share) in [(1, 0.10), (2, -0.08), (3, 0.06)] {
                one[(k, k)] *= 1.0 + share;
            }
        }
        let compliance = Mat::from_fn(2 * SHAPES, 2 * SHAPES, |i, j| {
            let same = i / SHAPES == j / SHAPES;
            one[(i % SHAPES, j % SHAPES)] * if same { 1.0 } else { coupling }
        });
        let scatter = [(); 2].map(|()| {
            (0..balls)
                .map(|_| (2.5e-3 * normal(), 0.12 * normal()))
                .collect()
        });
        let gauges = (bearing.gauges.iter())
            .map(|gauge| {
                let gain = 30.0 * (1.0 + 0.1 * normal());
                let unequal = 0.06 * normal();
                // The seat holds one side: moments bend the ring one way.
                let psi = gauge.azimuth_deg.to_radians();
                let (sin, cos) = psi.sin_cos();
                let bulk = [
                    -6.0 * cos + 1.5 * normal(),
                    2.0 + 1.0 * normal(),
                    -6.0 * sin + 1.5 * normal(),
                    0.9 * (-sin + 0.25 * normal()),
                    0.9 * (cos + 0.25 * normal()),
                ];
                let other_seat =
                    |value: f64, n: f64| value * if road { 1.0 + 0.1 * n } else { 1.0 };
                Gauge {
                    azimuth: psi + 0.5_f64.to_radians() * normal(),
                    gain: [gain * (1.0 + unequal), gain * (1.0 - unequal)],
                    width: 0.11 * (1.0 + 0.06 * normal()),
                    skew: 0.12 + 0.08 * normal(),
                    angle_slope: 1.2 + 0.3 * normal(),
                    angle_curvature: 1.5 + 0.5 * normal(),
                    bending: 0.5 * (1.0 + 0.1 * normal()),
                    bulk: bulk.map(|value| other_seat(value * 2.0, normal())),
                    square: 0.4 * normal(),
                }
            })
            .collect();
        Self {
            balls,
            ball_over_pitch: bearing.ball_mm / bearing.pitch_mm,
            radius: 0.5 * bearing.pitch_mm + arm * angle.cos(),
            offset: 0.5 * bearing.rows_mm,
            groove,
            angle,
            stiffness: bearing.stiffness_n_per_mm_1_5 * 1e-3 / 1e3_f64.powf(1.5)
                * (1.0 + 0.04 * normal()),
            preload: bearing.axial_preload_um(angle) * (1.0 + 0.05 * normal()),
            compliance,
            scatter,
            gauges,
        }
    }
}

/// One ball's contact.
#[derive(Clone, Copy, Default)]
struct Ball {
    row: usize,
    azimuth: f64,
    load: f64,
    angle: f64,
}

/// Where a ball is, what of the ring's shapes is there, and its excess diameter.
struct Place {
    row: usize,
    azimuth: f64,
    cos: f64,
    sin: f64,
    shapes: [f64; SHAPES],
    excess: f64,
}

/// A bearing that turns under load, always in equilibrium.
pub(crate) struct Plant {
    individual: Individual,
    /// Preload's approach of the cold bearing [um].
    preload_cold: f64,
    stiffness: Mat<f64>,
    position: [f64; DOF],
    /// Azimuth of the first ball of each row [rad].
    cage: [f64; 2],
    balls: Vec<Ball>,
    loads: [f64; 5],
}

fn shapes(psi: f64) -> [f64; SHAPES] {
    let mut f = [1.0; SHAPES];
    let (sin1, cos1) = psi.sin_cos();
    let (mut sin, mut cos) = (sin1, cos1);
    for order in 2..=6 {
        (sin, cos) = (sin * cos1 + cos * sin1, cos * cos1 - sin * sin1);
        f[2 * order - 3] = cos;
        f[2 * order - 2] = sin;
    }
    f
}

impl Plant {
    pub(crate) fn new(individual: Individual, cage: [f64; 2], loads: [f64; 5]) -> Self {
        let n = 2 * SHAPES;
        let stiffness = match individual.compliance.llt(Side::Lower) {
            Ok(factor) => factor.solve(Mat::<f64>::identity(n, n)),
            // A description that is not positive is refused before.
            Err(_) => Mat::identity(n, n),
        };
        let mut plant = Self {
            preload_cold: individual.preload,
            individual,
            stiffness,
            position: [0.0; DOF],
            cage,
            balls: Vec::new(),
            loads: [0.0; 5],
        };
        plant.balance(loads);
        plant
    }

    /// Moves to equilibrium with `Fx, Fy, Fz` [N], `Mx, Mz` [N m] by Newton's method.
    fn balance(&mut self, loads: [f64; 5]) {
        self.loads = loads;
        let places: Vec<Place> = (0..2).flat_map(|row| self.places(row)).collect();
        let mut before = f64::INFINITY;
        let mut step = Mat::<f64>::zeros(DOF, 1);
        for _ in 0..MOST_STEPS {
            let (rest, stiffness) = self.imbalance(&places);
            let size = rest.norm_max();
            if size < BALANCED {
                break;
            }
            if size > before {
                // A contact opened or closed on the way: half the step back.
                step *= faer::Scale(-0.5);
            } else if let Ok(factor) = stiffness.llt(Side::Lower) {
                step = factor.solve(&rest);
            } else {
                break;
            }
            before = size;
            for (i, z) in self.position.iter_mut().enumerate() {
                *z += step[(i, 0)].clamp(-20.0, 20.0);
            }
        }
    }

    /// Where the balls of a row are.
    fn places(&self, row: usize) -> impl Iterator<Item = Place> {
        let spacing = std::f64::consts::TAU / self.individual.balls as f64;
        let scatter = &self.individual.scatter[row];
        scatter.iter().enumerate().map(move |(i, (off, excess))| {
            let azimuth = self.cage[row] + spacing * i as f64 + off;
            let (sin, cos) = azimuth.sin_cos();
            Place {
                row,
                azimuth,
                cos,
                sin,
                shapes: shapes(azimuth),
                excess: *excess,
            }
        })
    }

    /// What is out of balance at the position [kN], and the stiffness there; leaves the balls.
    fn imbalance(&mut self, places: &[Place]) -> (Mat<f64>, Mat<f64>) {
        let ind = &self.individual;
        let units = [1e-3, 1e-3, 1e-3, 1.0 / ind.radius, 1.0 / ind.radius];
        let mut k = Mat::<f64>::zeros(DOF, DOF);
        let mut rest = Mat::<f64>::zeros(DOF, 1);
        for (i, unit) in units.iter().enumerate() {
            rest[(i, 0)] = self.loads[i] * unit;
            k[(i, i)] = 1e-5;
        }
        for j in 0..2 * SHAPES {
            for i in 0..2 * SHAPES {
                rest[(5 + i, 0)] -= self.stiffness[(i, j)] * self.position[5 + j];
                k[(5 + i, 5 + j)] = self.stiffness[(i, j)];
            }
        }
        self.balls.clear();
        let lever = ind.offset / ind.radius;
        for place in places {
            let (row, cos, sin) = (place.row, place.cos, place.sin);
            let side = if row == 0 { 1.0 } else { -1.0 };
            let z = &self.position;
            let tilt = z[4] * cos - z[3] * sin;
            let ring: f64 = (0..SHAPES)
                .map(|k| place.shapes[k] * z[5 + row * SHAPES + k])
                .sum();
            let d =
                ind.groove * ind.angle.cos() + z[0] * cos + z[2] * sin + side * lever * tilt - ring;
            let w = ind.groove * ind.angle.sin() + ind.preload + side * (z[1] + tilt);
            let distance = d.hypot(w);
            let delta = distance - ind.groove + place.excess;
            let load = if delta > 0.0 {
                ind.stiffness * delta * delta.sqrt()
            } else {
                0.0
            };
            self.balls.push(Ball {
                row,
                azimuth: place.azimuth,
                load,
                angle: w.atan2(d),
            });
            if load == 0.0 {
                continue;
            }
            let (sa, ca) = (w / distance, d / distance);
            let by_d = [cos, 0.0, sin, -side * lever * sin, side * lever * cos];
            let by_w = [0.0, side, 0.0, -side * sin, side * cos];
            let (mut normal, mut across) = ([0.0; 5 + SHAPES], [0.0; 5 + SHAPES]);
            for i in 0..5 {
                normal[i] = ca * by_d[i] + sa * by_w[i];
                across[i] = ca * by_w[i] - sa * by_d[i];
            }
            for s in 0..SHAPES {
                normal[5 + s] = -ca * place.shapes[s];
                across[5 + s] = sa * place.shapes[s];
            }
            let degree = |i: usize| if i < 5 { i } else { i + row * SHAPES };
            let (slope, turning) = (1.5 * load / delta, load / distance);
            for j in 0..5 + SHAPES {
                rest[(degree(j), 0)] -= load * normal[j];
                let (n, t) = (slope * normal[j], turning * across[j]);
                for i in 0..5 + SHAPES {
                    k[(degree(i), degree(j))] += n * normal[i] + t * across[i];
                }
            }
        }
        (rest, k)
    }

    /// One sample further: the wheel has turned by `turned` [rad], the cages have slipped
    /// by `slip`, relative.
    pub(crate) fn advance(&mut self, turned: f64, slip: [f64; 2], loads: [f64; 5]) {
        for row in 0..2 {
            let (mut sum, mut weight) = (0.0, 1e-9);
            for ball in self.balls.iter().filter(|ball| ball.row == row) {
                sum += ball.load * ball.angle.cos();
                weight += ball.load;
            }
            let ratio = 0.5 * (1.0 - self.individual.ball_over_pitch * sum / weight);
            self.cage[row] += turned * ratio * (1.0 + slip[row]);
        }
        self.balance(loads);
    }

    /// Sets the factor on the preload's approach.
    pub(crate) fn warm(&mut self, factor: f64) {
        self.individual.preload = self.preload_cold * factor;
    }

    /// Strain at each gauge [um/m].
    pub(crate) fn strains(&self) -> Vec<f64> {
        let ind = &self.individual;
        (ind.gauges.iter())
            .map(|gauge| {
                let f = shapes(gauge.azimuth);
                let mut strain: f64 = (0..5)
                    .map(|i| {
                        let unit = if i < 3 { 1e-3 } else { 1.0 / ind.radius };
                        gauge.bulk[i] * self.loads[i] * unit
                    })
                    .sum();
                strain += gauge.square * (self.loads[3] * 1e-3).powi(2);
                for row in 0..2 {
                    for s in 1..SHAPES {
                        let order = (s.div_ceil(2) + 1) as f64;
                        strain += 0.5
                            * gauge.bending
                            * (order * order - 1.0)
                            * f[s]
                            * self.position[5 + row * SHAPES + s];
                    }
                }
                for ball in &self.balls {
                    let x = (ball.azimuth - gauge.azimuth + std::f64::consts::PI)
                        .rem_euclid(std::f64::consts::TAU)
                        - std::f64::consts::PI;
                    let off = ball.angle - ind.angle;
                    let width = gauge.width * (1.0 + 0.3 * off);
                    let u = x / width;
                    let local = (1.0 + gauge.skew * u) / (1.0 + u * u).powi(2);
                    let by_angle =
                        1.0 + gauge.angle_slope * off + gauge.angle_curvature * off * off;
                    strain += ball.load * gauge.gain[ball.row] * by_angle * local;
                }
                strain
            })
            .collect()
    }
}
