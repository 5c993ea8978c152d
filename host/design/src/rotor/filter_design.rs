//! Designs the filter of a rotor from description and displacement sensors: reduces the rotor at
//! each speed of a grid, and computes scales of the states, transitions, observation rows, process
//! noise and the maps from states to the displacements of all nodes. Gives error of the reduction
//! and instability, too.

use faer::Mat;
use faer::linalg::solvers::Solve;
use loadtwin_common::estimator::ROTOR_SIZES;
use loadtwin_common::rotor::filter::{BIASES, FORCES};

use crate::error::BuildError;
use crate::rotor::discretisation::{
    DiscreteModel, discrete, force_rotation, force_transition, held,
};
use crate::rotor::fe_model::RotorModel;
use crate::rotor::gain_convergence::triangle;
use crate::rotor::modal_truncation::{Coordinates, ModalModel, Ports, truncated};
use crate::rotor::model_image::bytes;
use crate::rotor::stability::Instability;
use crate::rotor::undamped_mode_reduction::ReductionError;
use loadtwin_machine::{Channel, Drift, LoadKind, Machine, Rotor, Senses};

/// Speeds of the tables where the machine has a range of them.
const SPEEDS: usize = 17;

/// Unit of readings and displacements in the filter [m]: micrometres.
pub(crate) const UNIT_M: f64 = 1e-6;

/// Everything that the image of a rotor is made of.
pub struct RotorFilterDesign {
    model: RotorModel,
    coordinates: Coordinates,
    /// At each of `speeds`, then at the machine's.
    rotors: Vec<ModalModel>,
    /// Displacements of all nodes along x and y over the states of the filter [m], at each of
    /// `speeds`.
    displacements: Vec<Mat<f64>>,
    /// Modal displacements and states of the filter.
    pub(crate) size: (usize, usize),
    pub(crate) scale: Vec<f64>,
    pub(crate) dt_s: f64,
    pub(crate) speeds: Vec<f64>,
    pub(crate) nominal_speed: f64,
    pub(crate) turning: Vec<bool>,
    pub(crate) nominal: Vec<f64>,
    /// Drifts of the sensors that have one [SI], by name.
    drifts: Vec<(String, Drift)>,
}

impl RotorFilterDesign {
    /// Assembles and reduces `rotor`, measured by `channels`.
    ///
    /// # Errors
    /// When it is not held, or is larger than an image.
    pub fn new(machine: &Machine, rotor: &Rotor, channels: &[Channel]) -> Result<Self, BuildError> {
        let model = RotorModel::new(rotor);
        let forces: Vec<Vec<f64>> = (rotor.loads.iter())
            .flat_map(|load| {
                [0.0, std::f64::consts::FRAC_PI_2].map(|a| model.direction(load.node, a))
            })
            .collect();
        let drifts: Vec<(String, Drift)> = (channels.iter())
            .filter_map(|channel| {
                let drift = channel.drift?;
                let std = channel.to_si(drift.std);
                Some((channel.name.clone(), Drift { std, ..drift }))
            })
            .collect();
        if drifts.len() > BIASES {
            return Err(BuildError::TooMany {
                what: "channels with a drift",
                found: drifts.len(),
                most: BIASES,
            });
        }
        let wanted = rotor.reduction.modes.map(|modes| modes + forces.len());
        let [.., most] = ROTOR_SIZES;
        let size = (ROTOR_SIZES.into_iter())
            .find(|(nz, nx)| nx - 2 * nz >= FORCES + drifts.len() && *nz >= wanted.unwrap_or(*nz))
            .ok_or(BuildError::TooManyModes {
                found: rotor.reduction.modes.unwrap_or(2),
                most: most.0 - forces.len(),
                loads: rotor.loads.len(),
            })?;
        let kept = rotor.reduction.modes.unwrap_or(size.0 - forces.len());
        let [low, high] = rotor.schedule();
        let count = if high > low { SPEEDS } else { 1 };
        let speeds = (0..count)
            .map(|k| low + (high - low) * k as f64 / (count.max(2) - 1) as f64)
            .collect::<Vec<f64>>();
        let turning: Vec<bool> = (rotor.loads.iter())
            .map(|load| load.kind == LoadKind::Unbalance)
            .collect();
        let rows: Vec<Vec<f64>> = (channels.iter())
            .filter_map(|channel| match &channel.senses {
                Senses::Displacement(at) => {
                    Some(model.direction(at.node, at.direction_deg.to_radians()))
                }
                _ => None,
            })
            .collect();
        let count = kept + forces.len();
        let ports = Ports {
            forces: &forces,
            turning: &turning,
            sensors: &rows,
        };
        let (coordinates, rotors) = truncated(&model, rotor.speed_rad_s, &speeds, count, &ports)?;
        let mut plan = Self {
            model,
            coordinates,
            rotors,
            displacements: Vec::new(),
            size,
            scale: Vec::new(),
            dt_s: 1.0 / machine.rate_hz,
            speeds,
            nominal_speed: rotor.speed_rad_s,
            turning,
            nominal: rotor.loads.iter().flat_map(|l| [l.nominal_n; 2]).collect(),
            drifts,
        };
        plan.scale = plan.scales();
        plan.displacements = (0..plan.speeds.len())
            .map(|at| plan.displacements_at(at))
            .collect::<Result<_, _>>()?;
        Ok(plan)
    }

    /// Bit k: pair k turns with the shaft.
    pub(crate) fn turning_bits(&self) -> u8 {
        (self.turning.iter().enumerate())
            .map(|(k, turns)| u8::from(*turns) << k)
            .sum()
    }

    /// Displacement at `node` in the direction of `angle_rad` over the modal displacements.
    pub(super) fn shape(&self, node: usize, angle_rad: f64) -> Vec<f64> {
        self.coordinates.row(&self.model.direction(node, angle_rad))
    }

    /// Diagonal of the modal stiffness [1/s^2].
    pub(super) fn squares(&self) -> &[f64] {
        &self.coordinates.squares
    }

    /// Displacements of all nodes over the states of the filter [m], at each speed of the tables.
    pub(super) fn displacement_maps(&self) -> &[Mat<f64>] {
        &self.displacements
    }

    /// Modal displacements kept.
    pub fn modes(&self) -> usize {
        self.coordinates.squares.len()
    }

    /// Amplitude of each state under the nominal loads; 1 for a state that nothing depends on.
    fn scales(&self) -> Vec<f64> {
        let (nz, nx) = self.size;
        let mut scale = vec![1.0_f64; nx];
        for i in 0..self.modes() {
            let sizes = (self.rotors.iter())
                .flat_map(|rotor| self.amplitudes(rotor, &rotor.steady).map(move |of| of(i)));
            scale[i] = sizes.fold(1e-12, f64::max);
        }
        // The change in a sample is added to the displacement: in its unit.
        scale.copy_within(0..nz, nz);
        for (j, nominal) in self.nominal.iter().enumerate() {
            scale[2 * nz + j] = *nominal;
        }
        // A bias is in the unit of the reading.
        for state in self.first_bias()..self.first_bias() + self.drifts.len() {
            scale[state] = UNIT_M;
        }
        scale
    }

    fn first_bias(&self) -> usize {
        2 * self.size.0 + FORCES
    }

    /// The state that is the bias of `channel`.
    pub(crate) fn bias_state(&self, channel: &Channel) -> Option<usize> {
        let at = (self.drifts.iter()).position(|(name, _)| *name == channel.name)?;
        Some(self.first_bias() + at)
    }

    /// Decay of each bias over a sample.
    pub(crate) fn left(&self) -> [f64; BIASES] {
        let left = |at: usize| (self.drifts.get(at)).map(|(_, drift)| -self.dt_s / drift.time_s);
        std::array::from_fn(|at| left(at).map_or(0.0, f64::exp))
    }

    /// `m` with the result of `of` for each bias, given its decay over a sample and its
    /// stationary variance [`UNIT_M`].
    fn with_biases(&self, mut m: Mat<f64>, of: impl Fn(f64, f64) -> f64) -> Mat<f64> {
        for (at, ((_, drift), left)) in self.drifts.iter().zip(self.left()).enumerate() {
            let state = self.first_bias() + at;
            m[(state, state)] = of(left, (drift.std / UNIT_M).powi(2));
        }
        m
    }

    /// For each pair of loads: amplitude of row `i` of what `over` the forces gives, at their
    /// nominal size.
    fn amplitudes<'a>(
        &'a self,
        rotor: &'a ModalModel,
        over: &'a Mat<f64>,
    ) -> impl Iterator<Item = impl Fn(usize) -> f64 + 'a> + 'a {
        let growth = (rotor.speed_rad_s / self.nominal_speed).powi(2);
        self.turning.iter().enumerate().map(move |(pair, turns)| {
            let size = self.nominal[2 * pair] * if *turns { growth } else { 1.0 };
            move |i: usize| size * over[(i, 2 * pair)].hypot(over[(i, 2 * pair + 1)])
        })
    }

    /// Index in the filter of reduced state `i` of `2 modes + loads`.
    fn place(&self, i: usize) -> usize {
        let (modes, nz) = (self.modes(), self.size.0);
        match i {
            _ if i < modes => i,
            _ if i < 2 * modes => nz + i - modes,
            _ => 2 * nz + i - 2 * modes,
        }
    }

    /// The rotor at the machine's speed.
    pub(crate) fn nominal_rotor(&self) -> &ModalModel {
        &self.rotors[self.speeds.len()]
    }

    /// The rotor at each speed of the tables.
    pub(crate) fn rotors(&self) -> &[ModalModel] {
        &self.rotors[..self.speeds.len()]
    }

    pub(crate) fn discrete(&self, rotor: &ModalModel) -> Result<DiscreteModel, BuildError> {
        let moved = force_transition(&self.turning, rotor.speed_rad_s * self.dt_s);
        discrete(&held(rotor, self.dt_s), &moved).ok_or(BuildError::Sampled)
    }

    fn displacements_at(&self, at: usize) -> Result<Mat<f64>, BuildError> {
        let rotor = &self.rotors[at];
        let coordinates = self.discrete(rotor)?.coordinates;
        // Over (z, e, f) in place of (z, z', f), solved from the right.
        let lu = coordinates.transpose().partial_piv_lu();
        let over = lu.solve(&rotor.shapes);
        let mut map = Mat::<f64>::zeros(2 * self.model.nodes, self.size.1);
        for k in 0..map.nrows() {
            let row = 4 * (k / 2) + k % 2;
            for j in 0..over.nrows() {
                let place = self.place(j);
                map[(k, place)] = over[(j, row)] * self.scale[place];
            }
        }
        Ok(map)
    }

    /// A matrix over the reduced states, in the scale and the places of the filter:
    /// `m_ij s_j / s_i`, or `m_ij / (s_i s_j)` for a covariance.
    pub(crate) fn scaled(&self, m: &Mat<f64>, covariance: bool) -> Mat<f64> {
        let nx = self.size.1;
        let mut scaled = Mat::<f64>::zeros(nx, nx);
        for i in 0..m.nrows() {
            for j in 0..m.ncols() {
                let (a, b) = (self.place(i), self.place(j));
                let (si, sj) = (self.scale[a], self.scale[b]);
                let factor = if covariance { 1.0 / (si * sj) } else { sj / si };
                scaled[(a, b)] = m[(i, j)] * factor;
            }
        }
        scaled
    }

    /// Row of a displacement sensor over the states of the filter [`UNIT_M`]; its bias has 1.
    pub(crate) fn row(&self, channel: &Channel) -> Vec<f64> {
        let mut row = vec![0.0; self.size.1];
        if let Senses::Displacement(at) = &channel.senses {
            let direction = self.model.direction(at.node, at.direction_deg.to_radians());
            for (i, value) in self.coordinates.row(&direction).iter().enumerate() {
                row[i] = channel.sensitivity.unwrap_or(1.0) * value * self.scale[i] / UNIT_M;
            }
        }
        if let Some(state) = self.bias_state(channel) {
            row[state] = 1.0;
        }
        row
    }

    /// Rows of `channels` over the states of the filter, and their variances [`UNIT_M`].
    pub(super) fn observation(&self, channels: &[Channel]) -> (Mat<f64>, Vec<f64>) {
        let rows: Vec<Vec<f64>> = channels.iter().map(|c| self.row(c)).collect();
        let variances = (channels.iter())
            .map(|c| (c.to_si(c.noise_std) / UNIT_M).powi(2))
            .collect();
        let h = Mat::from_fn(rows.len(), self.size.1, |i, j| rows[i][j]);
        (h, variances)
    }

    /// Displacements along x and y of every node (m), node by node, of the
    /// filter's state in the image's scale at a speed [rad/s].
    pub fn displacements(&self, state: &[f32], speed_rad_s: f64, into: &mut [f64]) {
        into.fill(0.0);
        let (low, part) = self.place_of_speed(speed_rad_s);
        for (map, share) in self.displacements[low..].iter().zip([1.0 - part, part]) {
            for (column, value) in map.col_iter().zip(state) {
                for (slot, shape) in into.iter_mut().zip(column.iter()) {
                    *slot += share * shape * f64::from(*value);
                }
            }
        }
    }

    /// The speed of the tables at or below `speed_rad_s`, and the part of the way to the next.
    pub fn place_of_speed(&self, speed_rad_s: f64) -> (usize, f64) {
        let last = self.speeds.len() - 1;
        let step = (self.speeds[last] - self.speeds[0]) / last.max(1) as f64;
        let place = ((speed_rad_s - self.speeds[0]) / step).clamp(0.0, last as f64);
        let place = if last == 0 { 0.0 } else { place };
        (place as usize, place.fract())
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.model.nodes
    }

    /// What the reduction loses of a start under the nominal loads over the speeds: steady
    /// motion is exact, and of what begins as minus it the modes left out have an end.
    pub fn reduction_error(&self) -> ReductionError {
        let mut error = ReductionError::default();
        for rotor in &self.rotors {
            let (whole, lost) = (
                self.amplitudes(rotor, &rotor.whirls),
                self.amplitudes(rotor, &rotor.residual),
            );
            for (whole, lost) in whole.zip(lost) {
                for i in (0..rotor.whirls.nrows()).filter(|i| i % 4 < 2) {
                    error.push(rotor.speed_rad_s, whole(i), lost(i));
                }
            }
        }
        error
    }

    /// Where the rotor as described is unstable, at the speeds of the tables and the machine's.
    pub fn instability(&self) -> Option<Instability> {
        let least = self.rotors.iter();
        Instability::among(
            least
                .map(|rotor| (rotor.speed_rad_s, rotor.least_damped))
                .collect(),
        )
    }

    /// Q and the covariance before the first sample, in the scale of the filter.
    pub(crate) fn covariances(
        &self,
        rotor: &Rotor,
        discrete: &DiscreteModel,
    ) -> (Mat<f64>, Mat<f64>) {
        let modes = self.modes();
        let n = 2 * modes + self.nominal.len();
        let (mut q, mut p) = (Mat::<f64>::zeros(n, n), Mat::<f64>::zeros(n, n));
        for i in 0..modes {
            let (z, w2) = (self.scale[i].powi(2), self.coordinates.squares[i]);
            let (model, start) = (
                rotor.reduction.model_std.powi(2),
                rotor.reduction.initial_std.powi(2),
            );
            q[(i, i)] = model * z;
            q[(modes + i, modes + i)] = model * z * w2;
            p[(i, i)] = start * z;
            p[(modes + i, modes + i)] = start * z * w2;
        }
        for (j, nominal) in self.nominal.iter().enumerate() {
            let walk = rotor.loads[j / 2].walk(self.nominal_speed);
            q[(2 * modes + j, 2 * modes + j)] = walk * walk * self.dt_s;
            p[(2 * modes + j, 2 * modes + j)] = nominal * nominal;
        }
        // What modes left out have of a force is there as soon as it is.
        let begins = &self.nominal_rotor().begins;
        let at_once = Mat::from_fn(n, n, |i, j| match j.checked_sub(2 * modes) {
            Some(force) if i < 2 * modes => begins[(i, force)],
            _ => f64::from(u8::from(i == j)),
        });
        let t = &discrete.coordinates * at_once;
        let (q, p) = (force_rotation(&t, &q), force_rotation(&t, &p));
        (
            self.with_biases(self.scaled(&q, true), |left, variance| {
                variance * (1.0 - left * left)
            }),
            self.with_biases(self.scaled(&p, true), |_, variance| variance),
        )
    }

    /// The transition that `discrete` is, in the scale of the filter.
    pub(crate) fn transition_of(&self, discrete: &DiscreteModel) -> Mat<f64> {
        self.with_biases(self.scaled(&discrete.transition, false), |left, _| left)
    }

    /// The transition at each speed of the tables and at the machine's [rad/s], in the scale of the filter.
    ///
    /// # Errors
    /// [`BuildError::Sampled`] where a mode is sampled at a multiple of half its period.
    pub fn transitions(&self) -> Result<Vec<(f64, Mat<f64>)>, BuildError> {
        (self.rotors.iter())
            .map(|rotor| {
                Ok((
                    rotor.speed_rad_s,
                    self.transition_of(&self.discrete(rotor)?),
                ))
            })
            .collect()
    }

    /// Q and the covariance before the first sample as the image has them, with the noise of
    /// `rotor`.
    ///
    /// # Errors
    /// As [`RotorFilterDesign::transitions`].
    pub fn noise(&self, rotor: &Rotor) -> Result<[Vec<u8>; 2], BuildError> {
        let (q, p) = self.covariances(rotor, &self.discrete(self.nominal_rotor())?);
        Ok([&q, &p].map(|m| bytes(triangle(m))))
    }
}
