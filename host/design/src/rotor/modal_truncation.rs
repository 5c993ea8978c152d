//! Reduces the finite-element rotor to a few of its complex eigenpairs at each speed, in modal
//! displacements that are the same at all speeds. The other modes are replaced by their stationary
//! response to the forces (residual flexibility): exact under steady forces.

use std::f64::consts::FRAC_PI_2;

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale, Side, c64};
use rayon::prelude::*;

use crate::rotor::RotorError;
use crate::rotor::eigenpairs::Eigenpairs;
use crate::rotor::fe_model::RotorModel;
use crate::rotor::harmonic_response::forced_response;
use crate::rotor::undamped_mode_reduction::{Reduced, over, project};

/// Undamped modes beyond four times the eigenpairs kept that these are computed in.
const SPARE: usize = 24;

/// Least part of a motion that the coordinates and their speeds must observe.
const LEAST_OBSERVED: f64 = 0.01;

/// Displacements that are the coordinates of the reduced rotor, `z = L q`, the same at every speed.
///
/// `L = T' M + (H T)^+ (H - H T T' M)`, `T' M T = I`, `L T = I`: every reading `H q` is
/// `H T z`, whatever `q` is. The columns of `T` are the directions that the eigenpairs at one
/// speed have most of, turned so that `T' K T` is diagonal.
#[derive(Clone, Debug)]
pub(crate) struct Coordinates {
    /// `T`, degrees of freedom x kept.
    basis: Mat<f64>,
    /// Diagonal of `T' K T` [1/s^2].
    pub squares: Vec<f64>,
    /// `L`, kept x degrees of freedom.
    rows: Mat<f64>,
}

/// A rotor at one speed in few of its eigenpairs: `z'' + C z' + K z = B f`, `f' = W f`.
///
/// `C` and `K` have the eigenvalues of the whole rotor, `B` its steady motion. Displacements of all degrees of
/// freedom are `q = Y (z, z') + N f`: exact under forces that stay or turn with the shaft, and
/// in free motion of the eigenpairs kept. Other modes are replaced by their stationary response to
/// the forces (residual flexibility).
///
/// Source: Craig, Kurdila, Fundamentals of Structural Dynamics (2006), section 11.4,
/// mode acceleration; Rezende et al. 2023, eq. (1), (16).
#[derive(Clone, Debug)]
pub(crate) struct ModalModel {
    /// Speed [rad/s].
    pub speed_rad_s: f64,
    /// The eigenvalue of what decays least in the whole rotor, or grows most.
    pub least_damped: c64,
    /// `K`.
    pub stiffness: Mat<f64>,
    /// `C`, with gyroscopic terms.
    pub damping: Mat<f64>,
    /// `B`, kept x forces.
    pub input: Mat<f64>,
    /// `W`: pairs of forces that turn, or stay.
    pub turning: Mat<f64>,
    /// `[Y N]'`, (2 kept + forces) x degrees of freedom.
    pub shapes: Mat<f64>,
    /// Steady motion under the forces: all degrees of freedom.
    pub whirls: Mat<f64>,
    /// Steady `z`, kept x forces.
    pub steady: Mat<f64>,
    /// What modes left out have of the steady motion: all degrees of freedom.
    pub residual: Mat<f64>,
    /// `(z, z')` of it: where the motion begins as a force sets in.
    pub begins: Mat<f64>,
}

impl Coordinates {
    fn new(
        model: &RotorModel,
        fine: &Reduced,
        speed_rad_s: f64,
        kept: &Mat<f64>,
        sensors: &[Vec<f64>],
    ) -> Result<Self, RotorError> {
        let (r, count) = (fine.len(), kept.ncols() / 2);
        let shapes = kept.submatrix(0, 0, r, 2 * count);
        let eigen = |m: Mat<f64>| {
            m.self_adjoint_eigen(Side::Lower)
                .map_err(|_| RotorError::NoEigenvalues)
        };
        let directions = eigen(shapes * shapes.transpose())?;
        // Rising order: what there is most of comes last.
        let t = &fine.basis * directions.U().subcols(r - count, count);
        let k = model.stiffness(speed_rad_s);
        let turned = eigen(project(&t, &(Scale(0.5) * (&k + k.transpose()))))?;
        let basis = &t * turned.U();
        let weighted = basis.transpose() * &model.mass;
        let h = Mat::from_fn(sensors.len(), model.len(), |i, j| sensors[i][j]);
        let observed = &h * &basis;
        let inverse = observed
            .svd()
            .map_err(|_| RotorError::NoEigenvalues)?
            .pseudoinverse();
        let rows = &weighted + inverse * (&h - &observed * &weighted);
        Ok(Self {
            squares: (0..count).map(|i| turned.S()[i]).collect(),
            basis,
            rows,
        })
    }

    /// `row T`: a measured displacement over `z`.
    pub fn row(&self, row: &[f64]) -> Vec<f64> {
        over(&self.basis, row)
    }
}

/// What acts on a rotor, and what sees it.
pub(crate) struct Ports<'a> {
    /// Forces in pairs along x and y, rows over the degrees of freedom.
    pub forces: &'a [Vec<f64>],
    /// Whether a pair turns with the shaft, or stays.
    pub turning: &'a [bool],
    /// Readings, rows over the degrees of freedom.
    pub sensors: &'a [Vec<f64>],
}

/// The rotor at each of `speeds` [rad/s], and then at `speed_rad_s`, in `count` eigenpairs.
///
/// At `speed_rad_s` they are those that a start under the forces excites most; from speed to
/// speed those closest to the last ones.
///
/// # Errors
/// [`RotorError`] where the rotor is not held, or is undamped at its critical speed.
pub(crate) fn truncated(
    model: &RotorModel,
    speed_rad_s: f64,
    speeds: &[f64],
    count: usize,
    ports: &Ports<'_>,
) -> Result<(Coordinates, Vec<ModalModel>), RotorError> {
    // What bearings and loads do close to them, few modes do not show.
    let held = (model.held_nodes())
        .flat_map(|node| [0.0, FRAC_PI_2].map(|angle| model.direction(node, angle)));
    let mut ends: Vec<Vec<f64>> = Vec::new();
    for end in held.chain(ports.forces.iter().cloned()) {
        // A node may be held, and have an unbalance beside a process force.
        if !ends.contains(&end) {
            ends.push(end);
        }
    }
    let fine = Reduced::with_statics(model, speed_rad_s, 4 * count + SPARE, &ends)?;
    let turning: Vec<f64> = speeds.iter().copied().chain([speed_rad_s]).collect();
    let whole: Vec<Whole> = (turning.par_iter())
        .map(|speed| Whole::new(model, &fine, *speed, ports))
        .collect::<Result<_, _>>()?;
    // Overdamped motions go to the residual flexibility only where the coordinates do not observe them.
    let mut best: Option<(f64, Reduction)> = None;
    for all in [true, false] {
        let least = (whole.iter().map(|whole| whole.pairs.swinging())).min();
        let most = if all { fine.len() } else { least.unwrap_or(0) };
        let count = count.min(most);
        let found = reduction(model, &fine, &whole, ports.sensors, count, all)?;
        let observed = found.as_ref().map_or(0.0, |(observed, _)| *observed);
        best = match best {
            Some((most, best)) if most >= observed => Some((most, best)),
            _ => found,
        };
        if observed > LEAST_OBSERVED {
            break;
        }
    }
    best.map(|(_, reduction)| reduction)
        .ok_or(RotorError::NoEigenvalues)
}

/// Coordinates, and the rotor in them at each speed.
type Reduction = (Coordinates, Vec<ModalModel>);

/// The `whole` rotor, at rising speeds and then at its own, in `count` coordinates with or without
/// what does not swing, and the part observed of the motion that they observe least; none where
/// there are not so many motions.
fn reduction(
    model: &RotorModel,
    fine: &Reduced,
    whole: &[Whole],
    sensors: &[Vec<f64>],
    count: usize,
    all: bool,
) -> Result<Option<(f64, Reduction)>, RotorError> {
    let Some((nominal, others)) = whole.split_last() else {
        return Ok(None);
    };
    let first = nominal.pairs.leading(&nominal.motion, count, all);
    let (shapes, _) = nominal.pairs.basis(&first);
    if count == 0 || shapes.ncols() != 2 * count {
        return Ok(None);
    }
    let speed_rad_s = nominal.speed_rad_s;
    let coordinates = Coordinates::new(model, fine, speed_rad_s, &shapes, sensors)?;
    let begun = nominal.pairs.span(&first);
    let mut kept = vec![first; whole.len()];
    let above = others.partition_point(|other| other.speed_rad_s < speed_rad_s);
    let up: Vec<usize> = (above..others.len()).collect();
    for way in [up, (0..above).rev().collect()] {
        let mut last = begun.clone();
        for k in way {
            kept[k] = whole[k].pairs.leading(&last, count, all);
            last = whole[k].pairs.span(&kept[k]);
        }
    }
    let mut least: f64 = 1.0;
    let mut at_speeds = Vec::with_capacity(whole.len());
    for (whole, kept) in whole.iter().zip(&kept) {
        let Some((observed, truncated)) = whole.truncated(fine, &coordinates, kept) else {
            return Ok(None);
        };
        least = least.min(observed);
        at_speeds.push(truncated);
    }
    Ok(Some((least, (coordinates, at_speeds))))
}

/// The whole rotor at a speed: eigenpairs on a fine basis, and steady motion.
struct Whole {
    speed_rad_s: f64,
    pairs: Eigenpairs,
    turning: Mat<f64>,
    whirls: Mat<f64>,
    /// Steady `(z, z')` on the fine basis, a column for each force.
    motion: Mat<f64>,
}

impl Whole {
    fn new(
        model: &RotorModel,
        fine: &Reduced,
        speed_rad_s: f64,
        ports: &Ports<'_>,
    ) -> Result<Self, RotorError> {
        let (whirls, turning) = whirls(model, speed_rad_s, ports)?;
        let z = fine.basis.transpose() * (&model.mass * &whirls);
        Ok(Self {
            speed_rad_s,
            pairs: Eigenpairs::new(model, fine, speed_rad_s)?,
            motion: stacked(&z, &(&z * &turning)),
            turning,
            whirls,
        })
    }

    /// In the eigenpairs `kept`, whose `x = (q, q')` span `X`: `(z, z') = U c`, `z'' = L q''` of
    /// `A X c`, so that `[-K -C] = L (A X)_q'' U^-1`; `B = Z W^2 + C Z W + K Z` for the steady
    /// `Z = L G`, and `N = G - Y (Z, Z W)`.
    ///
    /// With the smallest singular value of `U` over orthonormal motions, speeds in units of the
    /// fastest: the part observed of the least observable motion. None where `kept` fit
    /// other coordinates.
    fn truncated(
        &self,
        fine: &Reduced,
        coordinates: &Coordinates,
        kept: &[usize],
    ) -> Option<(f64, ModalModel)> {
        let (r, count) = (fine.len(), coordinates.squares.len());
        let upper = |m: &Mat<f64>| m.subrows(0, r).to_owned();
        let lower = |m: &Mat<f64>| m.subrows(r, r).to_owned();
        let rows = &coordinates.rows * &fine.basis;
        let both = |m: &Mat<f64>| stacked(&(&rows * upper(m)), &(&rows * lower(m)));
        let (x, derivative) = self.pairs.basis(kept);
        if x.ncols() != 2 * count {
            return None;
        }
        let rate = self.pairs.fastest(kept);
        let alike = |m: &Mat<f64>| stacked(&upper(m), &(Scale(1.0 / rate) * lower(m)));
        let orthonormal = alike(&x).qr().compute_thin_Q();
        let within = stacked(
            &(&rows * upper(&orthonormal)),
            &(&rows * lower(&orthonormal)),
        );
        let least = within.singular_values().ok()?.last().copied()?;
        // Solved from the right.
        let u = both(&x).transpose().partial_piv_lu();
        let over = |m: Mat<f64>| u.solve(m.transpose()).transpose().to_owned();
        let pulled = over(&rows * lower(&derivative));
        let stiffness = Scale(-1.0) * pulled.subcols(0, count);
        let damping = Scale(-1.0) * pulled.subcols(count, count);
        let free = over(&fine.basis * upper(&x));
        let steady = &coordinates.rows * &self.whirls;
        let moving = &steady * &self.turning;
        let state = stacked(&steady, &moving);
        let forced = &self.whirls - &free * &state;
        let part = self.pairs.part(kept, &self.motion);
        let truncated = ModalModel {
            speed_rad_s: self.speed_rad_s,
            least_damped: self.pairs.least_damped(),
            input: &moving * &self.turning + &damping * &moving + &stiffness * &steady,
            stiffness,
            damping,
            turning: self.turning.clone(),
            shapes: stacked(&free.transpose().to_owned(), &forced.transpose().to_owned()),
            residual: &self.whirls - &fine.basis * upper(&part),
            begins: state - both(&part),
            whirls: self.whirls.clone(),
            steady,
        };
        Some((least, truncated))
    }
}

/// `a` over `b`.
fn stacked(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    let r = a.nrows();
    Mat::from_fn(r + b.nrows(), a.ncols(), |i, j| {
        if i < r { a[(i, j)] } else { b[(i - r, j)] }
    })
}

/// `G` of steady motion `q = G f` under the pairs of forces, and `W`, `f' = W f`.
fn whirls(
    model: &RotorModel,
    speed_rad_s: f64,
    ports: &Ports<'_>,
) -> Result<(Mat<f64>, Mat<f64>), RotorError> {
    let (n, m) = (model.len(), ports.forces.len());
    let (mut whirls, mut w) = (Mat::<f64>::zeros(n, m), Mat::<f64>::zeros(m, m));
    for (k, (pair, turns)) in ports.forces.chunks_exact(2).zip(ports.turning).enumerate() {
        let frequency = if *turns { speed_rad_s } else { 0.0 };
        let force = Mat::from_fn(n, 1, |i, _| c64::new(pair[0][i], -pair[1][i]));
        let whirl = forced_response(model, speed_rad_s, frequency, &force)?;
        let (x, y) = (2 * k, 2 * k + 1);
        for (i, whirl) in whirl.iter().enumerate() {
            (whirls[(i, x)], whirls[(i, y)]) = (whirl.re, -whirl.im);
        }
        (w[(x, y)], w[(y, x)]) = (-frequency, frequency);
    }
    Ok((whirls, w))
}
