//! Computes the error covariance of a rotor's steady filter under nominal loads where the stiffness
//! of bearings and shaft, the damping of bearings and the gains of sensors deviate from the
//! description by usual tolerances, one standard deviation each.

use std::f64::consts::FRAC_PI_2;

use faer::linalg::solvers::Solve;
use faer::{Mat, c64};

use crate::rotor::filter_design::RotorFilterDesign;
use crate::rotor::modal_truncation::ModalModel;
use loadtwin_machine::Rotor;

/// Standard deviation of a bearing's stiffness, as part of it: bearings are computed or taken from
/// tables.
///
/// Source: Lees, Sinha, Friswell, Model-based identification of rotating machines, Mech. Syst.
/// Signal Process. 23 (2009): foundations and bearings are the uncertain part of a rotor's model.
const BEARING: f64 = 0.3;

/// Standard deviation of a bearing's damping, as part of it.
const DAMPING: f64 = 0.3;

/// Standard deviation of the shaft's stiffness, as part of it: moduli and diameters are measured.
const SHAFT: f64 = 0.01;

/// Standard deviation of a sensor's gain, as part of it. At five tolerances, the most that a level allows for, it is
/// 3 %: that of an even distribution over the ±5 % that are allowed for the incremental scale factor of a proximity
/// probe.
///
/// Source: API Standard 670, Machinery Protection Systems, 5th edition (2014), accuracy requirements.
const GAIN: f64 = 0.006;

/// A steady filter at one speed.
pub(super) struct SteadyFilter<'a> {
    /// Transition.
    pub f: &'a Mat<f64>,
    /// Rows of the sensors.
    pub h: &'a Mat<f64>,
    /// Gain.
    pub k: &'a Mat<f64>,
}

/// A tolerance: what it adds to stiffness and damping of the reduced rotor at one sigma.
struct Tolerance {
    stiffness: Mat<f64>,
    damping: Mat<f64>,
}

/// What one tolerance at one sigma makes of the steady filter where one pair of loads has its nominal size: phasors.
struct Response {
    /// Of each sensor.
    innovation: Mat<c64>,
    /// Of each state of the filter.
    error: Mat<c64>,
}

/// Responses of one pair of loads to every tolerance, in the order of the tolerances.
type Responses = Vec<Response>;

/// Covariances of the filter's error over the states of the filter, in its scale.
pub(super) struct ModelErrors {
    /// Where the rotor is off by the usual tolerances.
    pub usual: Mat<f64>,
    /// The same where the innovations are white: of what they do not show.
    pub unseen: Mat<f64>,
}

impl RotorFilterDesign {
    /// Covariances of the filter's error under the nominal loads, where stiffness and damping of the
    /// rotor and the gain of each sensor differ from the description by one standard deviation each.
    ///
    /// The rotor's steady motion changes by `dz = -D^-1 (dK + i w dC) z`, `D = K - w^2 + i w C`, under a
    /// load that turns (`w` the speed) or stays (`w = 0`); the readings by `H dz`, and the
    /// estimate by `dx = (e^(i w dt) - F (I - K H))^-1 F K dy`, `dy = H dz`, corrected by the last
    /// reading. The error is `dx` less `(dz, dz (e^(i w dt) - 1), 0)`. A gain changes one reading by
    /// its part of `H z`, and no motion.
    ///
    /// Innovations of `passed` (variance of each sensor) are taken for white. The tolerances `t`, independent and of
    /// variance `tau^2` ([`Rotor::tolerance`]), with innovations `J t` have the posterior covariance
    /// `(I / tau^2 + J' R^-1 J)^-1`, `R` of `passed`. Loads that do not turn show no such error.
    ///
    /// Source: Kaipio, Somersalo, Statistical and Computational Inverse Problems (2005), section 3.4: posterior of a
    /// linear Gaussian model.
    pub(super) fn model_errors(
        &self,
        description: &Rotor,
        rotor: &ModalModel,
        filter: &SteadyFilter<'_>,
        passed: &[f64],
    ) -> ModelErrors {
        let nx = filter.f.nrows();
        let pairs: Vec<Responses> = (0..self.turning.len())
            .map(|pair| self.responses(description, rotor, filter, pair))
            .collect();
        let turning: Vec<&Responses> = (pairs.iter().zip(&self.turning))
            .filter_map(|(of, turns)| turns.then_some(of))
            .collect();
        let count = pairs.first().map_or(0, Vec::len);
        let precision = Mat::from_fn(count, count, |a, b| {
            let shown: f64 = (turning.iter())
                .map(|of| {
                    let (x, y) = (&of[a].innovation, &of[b].innovation);
                    let terms = passed.iter().enumerate();
                    terms
                        .map(|(i, r)| mean_product(x[(i, 0)], y[(i, 0)]) / r)
                        .sum::<f64>()
                })
                .sum();
            shown
                + if a == b {
                    description.tolerance.powi(-2)
                } else {
                    0.0
                }
        });
        let posterior = precision
            .partial_piv_lu()
            .solve(Mat::<f64>::identity(count, count));
        let covariance = |pairs: &[&Responses], between: &Mat<f64>| {
            Mat::from_fn(nx, nx, |i, j| {
                let mut sum = 0.0;
                for of in pairs {
                    for (a, x) in of.iter().enumerate() {
                        for (b, y) in of.iter().enumerate() {
                            sum += between[(a, b)] * mean_product(x.error[(i, 0)], y.error[(j, 0)]);
                        }
                    }
                }
                sum
            })
        };
        let all: Vec<&Responses> = pairs.iter().collect();
        ModelErrors {
            usual: covariance(&all, &Mat::identity(count, count)),
            unseen: covariance(&turning, &posterior),
        }
    }

    /// Responses to every tolerance where `pair` of the loads is nominal.
    fn responses(
        &self,
        description: &Rotor,
        rotor: &ModalModel,
        filter: &SteadyFilter<'_>,
        pair: usize,
    ) -> Responses {
        let (modes, nx) = (rotor.stiffness.nrows(), filter.f.nrows());
        let turns = self.turning[pair];
        let w = if turns { rotor.speed_rad_s } else { 0.0 };
        let growth = if turns {
            (w / self.nominal_speed).powi(2)
        } else {
            1.0
        };
        let nominal = self.nominal[2 * pair] * growth;
        let step = c64::new((w * self.dt_s).cos(), (w * self.dt_s).sin());
        let dynamic = complex(modes, modes, |i, j| {
            let inertia = if i == j { w * w } else { 0.0 };
            c64::new(rotor.stiffness[(i, j)] - inertia, w * rotor.damping[(i, j)])
        });
        let dynamic = dynamic.partial_piv_lu();
        let steady = complex(modes, 1, |i, _| {
            c64::new(
                rotor.steady[(i, 2 * pair)],
                -rotor.steady[(i, 2 * pair + 1)],
            ) * nominal
        });
        let closed = filter.f - filter.f * filter.k * filter.h;
        let closed = complex(nx, nx, |i, j| {
            let unit = if i == j { step } else { c64::new(0.0, 0.0) };
            unit - closed[(i, j)]
        });
        let closed = closed.partial_piv_lu();
        let response = |dy: Mat<c64>, truth: Mat<c64>| {
            let prior = closed.solve(real(&(filter.f * filter.k)) * &dy);
            let innovation = &dy - real(filter.h) * &prior;
            let error = prior + real(filter.k) * &innovation - truth;
            Response { innovation, error }
        };
        let motion = |z: &Mat<c64>| complex(nx, 1, |i, _| self.place_of(i, z, step));
        let of_tolerances = self
            .tolerances(description, rotor)
            .into_iter()
            .map(|tolerance| {
                let changed = complex(modes, modes, |i, j| {
                    c64::new(-tolerance.stiffness[(i, j)], -w * tolerance.damping[(i, j)])
                });
                let truth = motion(&dynamic.solve(changed * &steady));
                response(real(filter.h) * &truth, truth)
            });
        let readings = real(filter.h) * motion(&steady);
        let of_gains = (0..readings.nrows()).map(|sensor| {
            let part = |i: usize| if i == sensor { GAIN } else { 0.0 };
            let dy = complex(readings.nrows(), 1, |i, _| readings[(i, 0)] * part(i));
            response(dy, complex(nx, 1, |_, _| c64::new(0.0, 0.0)))
        });
        of_tolerances.chain(of_gains).collect()
    }

    /// State `i` of the filter of the motion `z`.
    fn place_of(&self, i: usize, z: &Mat<c64>, step: c64) -> c64 {
        let (modes, nz) = (z.nrows(), self.size.0);
        match i {
            _ if i < modes => z[(i, 0)] / self.scale[i],
            _ if (nz..nz + modes).contains(&i) => z[(i - nz, 0)] * (step - 1.0) / self.scale[i],
            _ => c64::new(0.0, 0.0),
        }
    }

    /// Each bearing along x and y, and the shaft, one standard deviation off.
    fn tolerances(&self, description: &Rotor, rotor: &ModalModel) -> Vec<Tolerance> {
        let modes = rotor.stiffness.nrows();
        let squares = self.squares();
        let mut shaft = Mat::from_fn(modes, modes, |i, j| if i == j { squares[i] } else { 0.0 });
        let mut tolerances = Vec::new();
        for bearing in &description.bearings {
            let (k, c) = bearing.at(rotor.speed_rad_s);
            let (of_squares, _) = bearing.at(self.nominal_speed);
            for axis in [0, 1] {
                let at = self.shape(bearing.node, axis as f64 * FRAC_PI_2);
                let outer = |part: f64| Mat::from_fn(modes, modes, |i, j| part * at[i] * at[j]);
                shaft -= outer(of_squares[axis][axis]);
                tolerances.push(Tolerance {
                    stiffness: outer(BEARING * k[axis][axis]),
                    damping: outer(DAMPING * c[axis][axis]),
                });
            }
        }
        tolerances.push(Tolerance {
            stiffness: faer::Scale(SHAFT) * &shaft,
            damping: Mat::zeros(modes, modes),
        });
        tolerances
    }
}

/// Mean of the product of two phasors over a turn.
fn mean_product(a: c64, b: c64) -> f64 {
    0.5 * (a.re * b.re + a.im * b.im)
}

fn complex(rows: usize, columns: usize, of: impl FnMut(usize, usize) -> c64) -> Mat<c64> {
    Mat::from_fn(rows, columns, of)
}

fn real(m: &Mat<f64>) -> Mat<c64> {
    Mat::from_fn(m.nrows(), m.ncols(), |i, j| c64::new(m[(i, j)], 0.0))
}
