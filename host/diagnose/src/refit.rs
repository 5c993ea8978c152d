//! All parameters together, and what they leave of the residuals.

use faer::Mat;

use super::columns::{columns_of, joined, leaving, less, nuisances};
use super::effect::Coupling;
use super::fit::Prior;
use super::observed::Observed;
use super::rank::RELINEARISED;
use super::select::{Found, is_latent};
use super::stream::Columns;
use super::sums::{Eliminated, products, solved};

/// Evidence that a stream must give for an effect with parameters of its own
/// to be taken to act on it.
const ACTS: f64 = 4.0;

/// Fits all parameters together: nuisances of each stream, effects of each stream
/// by itself, and effects that the streams share; gives the nuisances.
pub(super) fn refit<S: Observed>(
    sessions: &[S],
    found: &mut [Found<S>],
    newest: Option<&[f64]>,
) -> Vec<Vec<f64>> {
    let streams = sessions[0].streams().len();
    let base = nuisances(sessions, found);
    let residuals: Vec<Vec<f64>> = (0..streams)
        .map(|k| joined(sessions, |s| s.residual(k).to_vec()))
        .collect();
    if let (Some(gains), Some(last)) = (newest, found.last_mut()) {
        // Which streams the newest one acts on.
        let least = ACTS.max(0.005 * gains.iter().copied().fold(0.0, f64::max));
        last.parameters = (0..streams)
            .map(|k| {
                let acts = last.effect.coupling() == Coupling::Shared || gains[k] > least;
                vec![0.0; if acts { last.effect.linear().len() } else { 0 }]
            })
            .collect();
    }
    let linear = |f: &Found<S>| f.effect.is_linear() && !is_latent(sessions, f.effect);
    let turns = if found.len() == 1 && found[0].effect.is_linear() || found.iter().all(linear) {
        1
    } else {
        RELINEARISED
    };
    let mut nuisance = Vec::new();
    for _ in 0..turns {
        let all = columns_of(sessions, found);
        let normals: Vec<Normal> = (0..streams)
            .map(|k| {
                let weight = sessions[0].noise_std(k).powi(-2);
                let independent = 1.0 / sessions[0].inflation(k);
                Normal::new(k, weight, independent, &base[k], &residuals[k], found, &all)
            })
            .collect();
        let shared = shared_parameters(found, &normals);
        nuisance = normals
            .iter()
            .enumerate()
            .map(|(k, normal)| {
                let own = normal.own(&shared);
                let (zeros, mut own) = (own[..base[k].len()].to_vec(), &own[base[k].len()..]);
                let mut all_shared = shared.as_slice();
                for (f, columns) in found.iter_mut().zip(&all) {
                    let count = columns.len();
                    match f.effect.coupling() {
                        Coupling::Own if acts(f, columns, k) => {
                            f.parameters[k] = own[..count].to_vec();
                            own = &own[count..];
                        }
                        Coupling::Own => {}
                        Coupling::Shared => {
                            let known = acts(f, columns, k);
                            f.parameters[k] = all_shared[..if known { count } else { 0 }].to_vec();
                            all_shared = &all_shared[count..];
                        }
                    }
                }
                zeros
            })
            .collect();
    }
    nuisance
}

/// Whether `f` predicts stream `k`.
pub(super) fn acts<S: Observed>(f: &Found<S>, columns: &[Columns], k: usize) -> bool {
    !f.parameters[k].is_empty() && columns.iter().all(|c| !c[k].is_empty())
}

/// Normal equations of one stream, its own columns eliminated from the shared ones.
struct Normal {
    /// Own parameters beside the shared ones, whose products these are.
    eliminated: Eliminated,
    /// Place of each shared column among all shared parameters.
    places: Vec<usize>,
    /// Weight of what it says of them.
    weight: f64,
}

impl Normal {
    /// Of stream `k` with `weight` for each sample, of which the part `independent` is new.
    fn new<S: Observed>(
        k: usize,
        weight: f64,
        independent: f64,
        base: &[Prior],
        residual: &[f64],
        found: &[Found<S>],
        all: &[Vec<Columns>],
    ) -> Self {
        let mut own: Vec<(&[f64], f64)> =
            base.iter().map(|p| (p.column.as_slice(), p.std)).collect();
        let (mut shared, mut places) = (Vec::new(), Vec::new());
        let (mut place, mut overdispersion) = (0, 1.0_f64);
        for (f, columns) in found.iter().zip(all) {
            let is_shared = f.effect.coupling() == Coupling::Shared;
            if acts(f, columns, k) {
                if is_shared {
                    shared.extend(columns.iter().map(|c| c[k].as_slice()));
                    places.extend(place..place + columns.len());
                    overdispersion = overdispersion.max(f.overdispersion[k]);
                } else {
                    let linear = f.effect.linear().iter();
                    own.extend(
                        linear
                            .zip(columns)
                            .map(|(l, c)| (c[k].as_slice(), l.prior_std)),
                    );
                }
            }
            place += if is_shared { columns.len() } else { 0 };
        }
        let columns: Vec<&[f64]> = own.iter().map(|o| o.0).chain(shared).collect();
        let (gram, right) = products(&columns, residual, weight);
        let ridge: Vec<f64> = (own.iter())
            .map(|(_, std)| 1.0 / (independent * std * std))
            .collect();
        Self {
            eliminated: Eliminated::new(&gram, &right, &ridge),
            places,
            weight: independent / overdispersion,
        }
    }

    /// Own parameters beside the shared ones.
    fn own(&self, shared: &[f64]) -> Vec<f64> {
        let Eliminated { by, free, .. } = &self.eliminated;
        (0..free.nrows())
            .map(|i| {
                let taken = self.places.iter().enumerate();
                let taken: f64 = taken.map(|(j, p)| by[(i, j)] * shared[*p]).sum();
                free[(i, 0)] - taken
            })
            .collect()
    }
}

/// The parameters that all streams share, effect by effect.
fn shared_parameters<S: Observed>(found: &[Found<S>], normals: &[Normal]) -> Vec<f64> {
    let ridge: Vec<f64> = found
        .iter()
        .filter(|f| f.effect.coupling() == Coupling::Shared)
        .flat_map(|f| f.effect.linear())
        .map(|l| 1.0 / (l.prior_std * l.prior_std))
        .collect();
    let c = ridge.len();
    let mut gram = Mat::<f64>::zeros(c, c);
    let mut right = Mat::<f64>::zeros(c, 1);
    for normal in normals {
        let Eliminated { own, told, .. } = &normal.eliminated;
        for (i, a) in normal.places.iter().enumerate() {
            right[(*a, 0)] += normal.weight * told[(i, 0)];
            for (j, b) in normal.places.iter().enumerate() {
                gram[(*a, *b)] += normal.weight * own[(i, j)];
            }
        }
    }
    let solution = solved(gram, &right, &ridge);
    (0..c).map(|i| solution[(i, 0)]).collect()
}

/// Residuals of `sessions` less nuisances and effects: `[session][stream]`.
pub(super) fn rest<S: Observed>(
    sessions: &[S],
    found: &[Found<S>],
    nuisance: &[Vec<f64>],
) -> Vec<Vec<Vec<f64>>> {
    let base = nuisances(sessions, found);
    let all = columns_of(sessions, found);
    let effects = found.iter().zip(all.iter().map(Vec::as_slice));
    less(sessions, &base, nuisance, &effects.collect::<Vec<_>>())
}

/// `sessions` with what nuisances and effects leave as their residuals.
pub(super) fn without<S: Observed>(
    sessions: &[S],
    found: &[Found<S>],
    nuisance: &[Vec<f64>],
) -> Vec<S> {
    leaving(sessions, rest(sessions, found, nuisance))
}
