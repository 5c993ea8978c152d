//! Computes the table of steady gains of the drivetrain filter over the carrier angle, by the
//! covariance recursion over whole turns until it repeats (periodic Riccati equation). Also chooses
//! the range of speeds in which the table is used.

use std::f64::consts::TAU;

use loadtwin_common::drivetrain::{GearboxModel, LOADS, Role, SteadyGains};
use loadtwin_common::signal::phase::Phase;

/// Most bins of a turn, 2^7.
const MOST_LOG2_BINS: u32 = 7;

/// Relative change of the loads' variances over a turn at which they are steady.
const TOLERANCE: f64 = 1e-6;

/// Turns after which a filter that is not yet steady never will be.
const MOST_TURNS: usize = 400;

/// How much larger a load's standard deviation may be with the table than with
/// the best gains, at a speed that the table is used for.
const LOSS: f64 = 1.1;

/// Slower speeds at which that is looked at, in parts of the nominal one. At
/// standstill a gauge may be blind for good, so the least of them is the end.
const SLOWER: [f64; 4] = [0.5, 0.25, 0.125, 0.0625];

/// A table that borrows nothing yet.
#[derive(Clone, Debug)]
pub struct SteadyTable {
    bytes: Vec<u8>,
    log2_bins: u32,
    turn: [f32; 2],
}

impl SteadyTable {
    /// The table as it lies in an image.
    pub fn gains(&self) -> SteadyGains<'_> {
        SteadyGains::new(&self.bytes, self.log2_bins as u8, self.turn)
    }
}

/// The steady gains of `model` for a carrier that turns by `turn_rad` in a sample;
/// none where the covariance does not become periodic: a load or a state is
/// not observed.
///
/// `P- = F P F' + Q`, then by the encoders and by each direction of the channels
/// `g = P c'`, `v = c g`, `P <- P - g g' J / (1 + v J)` with the information
/// `J = sum m_i(theta)^2 / r_i(theta)` of its channels, sample by sample around the
/// turn until it repeats: the periodic solution of the Riccati equation. The table
/// holds the means of `g` and `v` over its bins.
///
/// Source: Bosmans et al. 2023, eq. (11)-(14), (19); Bittanti, Colaneri, De Nicolao,
/// The periodic Riccati equation, 1991.
pub fn steady_gains(model: &GearboxModel<'_>, turn_rad: f64) -> Option<SteadyTable> {
    let recursion = Recursion::new(model);
    let samples = (TAU / turn_rad.abs()).ceil();
    // Constant maps and noise: one bin, at any speed.
    let constant = recursion.is_constant();
    let most = if constant { 1.0 } else { 0.5 * samples };
    let log2_bins = (most.max(1.0).log2().floor() as u32).min(MOST_LOG2_BINS);
    let mut p = recursion.initial.clone();
    recursion.settle(&mut p, turn_rad)?;
    let table = recursion.table(&mut p, turn_rad, log2_bins);
    let turn = if constant {
        [f32::MIN, f32::MAX]
    } else {
        let holds = |part: f64| recursion.loss(&table, turn_rad * part, log2_bins) <= LOSS;
        let slowest = SLOWER.into_iter().take_while(|part| holds(*part)).last();
        let lowest = slowest.unwrap_or(0.75);
        let highest = if holds(2.0) { 2.0 } else { 1.1 };
        [lowest, highest].map(|part| (part * turn_rad) as f32)
    };
    Some(SteadyTable {
        bytes: table
            .iter()
            .flatten()
            .flat_map(|value| (*value as f32).to_le_bytes())
            .collect(),
        log2_bins,
        turn,
    })
}

/// The covariance of the filter in f64, with the numbers of the image.
struct Recursion<'a> {
    model: &'a GearboxModel<'a>,
    n: usize,
    f: Vec<f64>,
    q: Vec<f64>,
    initial: Vec<f64>,
    /// Rows of the encoders, then of the directions of the channels.
    rows: Vec<Vec<f64>>,
    /// Numbers of the channels of each direction of the channels.
    channels: Vec<Vec<usize>>,
}

impl<'a> Recursion<'a> {
    fn new(model: &'a GearboxModel<'a>) -> Self {
        let n = model.scale.len();
        let top = n - LOADS;
        let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect::<Vec<f64>>();
        let mut f = wide(&model.transition);
        f.resize(n * n, 0.0);
        let mut q = vec![0.0; n * n];
        let mut triangle = model.process_noise.iter().copied().map(f64::from);
        for i in 0..top {
            for j in 0..=i {
                let value = triangle.next().unwrap_or(0.0);
                q[i * n + j] = value;
                q[j * n + i] = value;
            }
        }
        let mut initial = vec![0.0; n * n];
        for i in 0..n {
            initial[i * n + i] = f64::from(model.initial_std[i]).powi(2);
        }
        for (j, noise) in model.load_noise.iter().enumerate() {
            f[(top + j) * n + top + j] = 1.0;
            q[(top + j) * n + top + j] = f64::from(*noise);
        }
        let (firsts, of) = model.directions();
        let rows = (model.encoders.iter().map(|e| wide(&e.row)))
            .chain(
                firsts
                    .iter()
                    .map(|i| wide(&model.channels[usize::from(*i)].row)),
            )
            .collect();
        let channels = (0..firsts.len())
            .map(|d| (0..of.len()).filter(|i| usize::from(of[*i]) == d).collect())
            .collect();
        Self {
            model,
            n,
            f,
            q,
            initial,
            rows,
            channels,
        }
    }

    fn is_constant(&self) -> bool {
        self.model
            .channels
            .iter()
            .all(|channel| match &channel.role {
                Role::Measure { map, variance, .. } => map.len() == 1 && variance.len() == 1,
                Role::Drive | Role::Temperature { .. } => true,
            })
    }

    /// `P <- F P F' + Q`.
    fn predict(&self, p: &mut [f64]) {
        let n = self.n;
        let mut m = vec![0.0; n * n];
        for i in 0..n {
            for k in 0..n {
                let f = self.f[i * n + k];
                if f != 0.0 {
                    for j in 0..n {
                        m[i * n + j] += f * p[k * n + j];
                    }
                }
            }
        }
        p.copy_from_slice(&self.q);
        for j in 0..n {
            for k in 0..n {
                let f = self.f[j * n + k];
                if f != 0.0 {
                    for i in 0..n {
                        p[i * n + j] += m[i * n + k] * f;
                    }
                }
            }
        }
        if self.model.loads.len() < LOADS {
            p[n * n - 1] = f64::from(self.model.load_noise[LOADS - 1]);
        }
    }

    /// `J` of direction `d` at `angle` under nominal load.
    fn information(&self, d: usize, angle: Phase, angle_variance: f64) -> f64 {
        let encoders = self.model.encoders.len();
        match d.checked_sub(encoders) {
            None => 1.0 / f64::from(self.model.encoders[d].variance),
            Some(d) => (self.channels[d].iter())
                .map(|i| {
                    let Role::Measure { map, variance, .. } = &self.model.channels[*i].role else {
                        return 0.0;
                    };
                    // What is sensed is 1 at nominal load.
                    let (m, slope) = map.at(angle);
                    let (m, slope) = (f64::from(m), f64::from(slope));
                    m * m / (f64::from(variance.bin(angle)) + slope * slope * angle_variance)
                })
                .sum(),
        }
    }

    /// `g = P c'` and `v = c g`.
    fn gain(&self, p: &[f64], d: usize) -> (Vec<f64>, f64) {
        let n = self.n;
        let row = &self.rows[d];
        let g: Vec<f64> = (0..n)
            .map(|i| (0..n).map(|j| p[i * n + j] * row[j]).sum())
            .collect();
        let v = row.iter().zip(&g).map(|(c, g)| c * g).sum();
        (g, v)
    }

    /// One sample at `angle`; shows `g` and `v` of each direction.
    fn step(&self, p: &mut [f64], angle: f64, mut each: impl FnMut(usize, &[f64], f64)) {
        let n = self.n;
        self.predict(p);
        let phase = Phase::from_rad(angle as f32);
        for d in 0..self.rows.len() {
            let (g, v) = self.gain(p, d);
            each(d, &g, v);
            let j = self.information(d, phase, p[0]);
            let factor = j / (1.0 + v * j);
            for i in 0..n {
                for k in 0..n {
                    p[i * n + k] -= factor * g[i] * g[k];
                }
            }
        }
    }

    fn load_variances<'p>(&'p self, p: &'p [f64]) -> impl Iterator<Item = f64> + 'p {
        let n = self.n;
        (0..self.model.loads.len()).map(move |j| p[(n - LOADS + j) * (n + 1)])
    }

    /// Turns until P repeats from turn to turn.
    fn settle(&self, p: &mut [f64], turn: f64) -> Option<()> {
        let samples = (TAU / turn.abs()).ceil() as usize;
        for _ in 0..MOST_TURNS {
            let before: Vec<f64> = self.load_variances(p).collect();
            for k in 0..samples {
                self.step(p, turn * k as f64, |_, _, _| ());
            }
            let same = |(now, before): (f64, &f64)| (now - before).abs() <= TOLERANCE * before;
            if self.load_variances(p).zip(&before).all(same) {
                return Some(());
            }
        }
        None
    }

    /// Means over the bins of the next turn of a P that is steady.
    fn table(&self, p: &mut [f64], turn: f64, log2_bins: u32) -> Vec<Vec<f64>> {
        let n = self.n;
        let width = SteadyGains::width(n, self.rows.len());
        let mut bins = vec![(vec![0.0; width], 0.0); 1 << log2_bins];
        let samples = (TAU / turn.abs()).ceil() as usize;
        for k in 0..samples {
            let angle = turn * k as f64;
            let bin = Phase::from_rad(angle as f32).table_index(log2_bins).0;
            let (entries, count) = &mut bins[bin];
            *count += 1.0;
            self.step(p, angle, |d, g, v| {
                let slots = &mut entries[d * (n + 1)..];
                for (slot, value) in slots.iter_mut().zip(g.iter().chain([&v])) {
                    *slot += value;
                }
            });
            for j in 0..LOADS {
                entries[width - LOADS + j] += p[(n - LOADS + j) * (n + 1)];
            }
        }
        bins.into_iter()
            .map(|(entries, count)| entries.into_iter().map(|sum| sum / count).collect())
            .collect()
    }

    /// Largest ratio of a load's standard deviation, the root of the mean over a turn,
    /// with the gains of `table` to that with the best gains, at `turn` in a sample.
    fn loss(&self, table: &[Vec<f64>], turn: f64, log2_bins: u32) -> f64 {
        let n = self.n;
        let mut best = self.initial.clone();
        if self.settle(&mut best, turn).is_none() {
            return f64::INFINITY;
        }
        let mut fixed = best.clone();
        let samples = (TAU / turn.abs()).ceil() as usize;
        let mut sums = Vec::new();
        // The second turn is the one that counts.
        for _ in 0..2 {
            sums = vec![[0.0; 2]; self.model.loads.len()];
            for k in 0..samples {
                let angle = turn * k as f64;
                self.step(&mut best, angle, |_, _, _| ());
                self.predict(&mut fixed);
                let phase = Phase::from_rad(angle as f32);
                let bin = &table[phase.table_index(log2_bins).0];
                for d in 0..self.rows.len() {
                    let (g, v) = (&bin[d * (n + 1)..][..n], bin[d * (n + 1) + n]);
                    let j = self.information(d, phase, fixed[0]);
                    let gain: Vec<f64> = g.iter().map(|g| g * j / (1.0 + v * j)).collect();
                    // Joseph's form, P - k w' - w k' + k (c w + 1/J) k' with w = P c'.
                    let (w, s) = self.gain(&fixed, d);
                    let s = if j > 0.0 { s + 1.0 / j } else { 0.0 };
                    for a in 0..n {
                        for b in 0..n {
                            fixed[a * n + b] +=
                                gain[a] * gain[b] * s - gain[a] * w[b] - w[a] * gain[b];
                        }
                    }
                }
                for (j, sum) in sums.iter_mut().enumerate() {
                    let at = (n - LOADS + j) * (n + 1);
                    sum[0] += fixed[at];
                    sum[1] += best[at];
                }
            }
        }
        sums.iter()
            .map(|[fixed, best]| (fixed / best).sqrt())
            .fold(1.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gearbox::OperatingPoint;
    use crate::image_build::image;
    use crate::sensor_set::Sensors;
    use loadtwin_common::image::{Image, Model};
    use loadtwin_machine::Machine;
    use loadtwin_math::riccati::steady_covariance;

    fn machine() -> Machine {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/gearbox/calibrated.toml"
        );
        Machine::load(std::path::Path::new(path)).unwrap()
    }

    /// With constant maps the periodic equation is the algebraic one.
    #[test]
    fn constant_maps_give_the_algebraic_solution() {
        let mut machine = machine();
        for channel in &mut machine.channels {
            channel.sensitivity_map = None;
            channel.noise_map = None;
            channel.sensitivity = Some(3e-10);
        }
        let payload = image(&machine, &Sensors::choose(&machine, None).unwrap()).unwrap();
        let Model::Gearbox(model) = Image::from_bytes(&payload).unwrap().model else {
            unreachable!("a gearbox")
        };
        let table = steady_gains(&model, 0.005).unwrap();
        assert_eq!(table.log2_bins, 0);
        let point = OperatingPoint::new(&model, machine.drivetrain.as_ref().unwrap(), 0.0);
        let noise = model.load_noise.map(f64::from);
        let p = steady_covariance(
            &point.transition,
            &point.observation,
            &point.with_load_noise(&noise),
            &point.measurement_noise,
        )
        .unwrap();
        let entries: Vec<f64> = (table.bytes.as_chunks::<4>().0.iter())
            .map(|bytes| f64::from(f32::from_le_bytes(*bytes)))
            .collect();
        // The encoder comes first: v = c P c' of the prediction itself.
        let encoder = point.observation.nrows() - 1;
        let row = point.observation.row(encoder).to_owned();
        let v = &row * &p * row.transpose();
        let n = model.scale.len();
        assert!((entries[n] / v - 1.0).abs() < 1e-3, "{} {v}", entries[n]);
        // The loads after all channels.
        let k = loadtwin_math::riccati::gain(&p, &point.observation, &point.measurement_noise);
        let posterior = &p - &k * &point.observation * &p;
        for j in 0..2 {
            let ours = entries[entries.len() - 2 + j];
            let expected = posterior[(n - 2 + j, n - 2 + j)];
            assert!((ours / expected - 1.0).abs() < 1e-3, "{ours} {expected}");
        }
    }

    #[test]
    fn what_is_never_observed_has_no_steady_gains() {
        let mut machine = machine();
        machine.sensor_sets[0].channels.clear();
        let payload = image(&machine, &Sensors::choose(&machine, None).unwrap()).unwrap();
        let Model::Gearbox(model) = Image::from_bytes(&payload).unwrap().model else {
            unreachable!("a gearbox")
        };
        assert!(steady_gains(&model, 0.005).is_none());
    }
}
