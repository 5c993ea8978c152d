//! Computes the standard deviation (m) of a rotor's estimated displacements at every node for each
//! sample of a replay, from the covariance of the filter and the allowed model error. Tables for
//! each noise level are interpolated over speed.

use faer::Mat;

use crate::error::BuildError;
use crate::rotor::filter_design::RotorFilterDesign;
use loadtwin_machine::{Channel, Rotor};

/// Standard deviations of the displacements of all nodes along x and y, node by node.
pub struct NodeDeviations {
    /// Displacements over the states of the filter, at each speed of the tables [m].
    maps: Vec<Mat<f64>>,
    /// For each level of noise and each speed: the variance of each displacement by the filter, and
    /// that of its error where the rotor is off by the usual tolerances [m^2].
    steady: Vec<Vec<[Vec<f64>; 2]>>,
}

/// What the deviations at a sample depend on, as the estimator gives it.
#[derive(Clone, Copy, Debug)]
pub struct Uncertainty<'a> {
    /// Index of the noise level in use.
    pub level: u8,
    /// Model error that is allowed for, in the usual tolerances.
    pub tolerance: f32,
    /// Covariance of the filter's state by rows, where it is not the steady one.
    pub covariance: Option<&'a [f32]>,
}

impl RotorFilterDesign {
    /// Standard deviations of the displacements as `channels` leave them.
    ///
    /// # Errors
    /// As [`RotorFilterDesign::image`].
    pub fn deviations(
        &self,
        rotor: &Rotor,
        channels: &[Channel],
    ) -> Result<NodeDeviations, BuildError> {
        let (h, variances) = self.observation(channels);
        let nominal = self.discrete(self.nominal_rotor())?;
        let maps = self.displacement_maps();
        let mut steady = Vec::new();
        for (level, _) in rotor.levels() {
            let (q, _) = self.covariances(&level, &nominal);
            let at_speeds = (self.rotors().iter().zip(maps))
                .map(|(at, map)| {
                    let filter = self.steady_at(&level, at, &h, &q, &variances)?;
                    Ok([
                        projected(map, &filter.covariance),
                        projected(map, &filter.errors.usual),
                    ])
                })
                .collect::<Result<_, BuildError>>()?;
            steady.push(at_speeds);
        }
        Ok(NodeDeviations {
            maps: maps.to_vec(),
            steady,
        })
    }
}

impl NodeDeviations {
    /// Fills `into` with the standard deviations (m) of a sample, between the speeds of the tables as
    /// `(low, part)` of [`RotorFilterDesign::place_of_speed`] says.
    pub fn fill(&self, of: &Uncertainty<'_>, (low, part): (usize, f64), into: &mut [f64]) {
        into.fill(0.0);
        let level = usize::from(of.level).min(self.steady.len().saturating_sub(1));
        let Some(steady) = self.steady.get(level) else {
            return;
        };
        let square = f64::from(of.tolerance).powi(2);
        let recursive = of.covariance.map(|covariance| {
            let nearest = (low + usize::from(part > 0.5)).min(self.maps.len() - 1);
            let nx = self.maps[nearest].ncols();
            let covariance = Mat::from_fn(nx, nx, |i, j| {
                covariance.get(i * nx + j).map_or(0.0, |p| f64::from(*p))
            });
            projected(&self.maps[nearest], &covariance)
        });
        for ([own, error], share) in steady[low..].iter().zip([1.0 - part, part]) {
            let own = recursive.as_ref().unwrap_or(own);
            for ((slot, own), error) in into.iter_mut().zip(own).zip(error) {
                *slot += share * (own + square * error);
            }
        }
        for slot in into {
            *slot = slot.max(0.0).sqrt();
        }
    }
}

/// Diagonal of `Y P Y'`.
fn projected(map: &Mat<f64>, covariance: &Mat<f64>) -> Vec<f64> {
    let spread = map * covariance;
    (0..map.nrows())
        .map(|i| (0..map.ncols()).map(|j| spread[(i, j)] * map[(i, j)]).sum())
        .collect()
}
