//! Orders of the carrier and of other shafts that the maps lack.

use super::{Effect, GaugeModel, Linear, Shape, each, one_shape};
use crate::stream::{Session, Stream, Term, product};

/// Highest order of the carrier that is tried.
const HIGHEST: usize = 12;

const AMPLITUDES: &[Linear] = &[
    Linear {
        name: "cosine, part of full scale at nominal load",
        prior_std: 0.1,
    },
    Linear {
        name: "sine, part of full scale at nominal load",
        prior_std: 0.1,
    },
];

/// `scale level (a cos(k angle) + b sin(k angle))`.
pub struct CarrierOrder;

impl Effect for CarrierOrder {
    fn name(&self) -> &'static str {
        "carrier-order"
    }
    fn about(&self) -> &'static str {
        "an order of the carrier angle that the maps lack"
    }
    fn linear(&self) -> &'static [Linear] {
        AMPLITUDES
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "order",
            unit: "per turn of the carrier",
            bounds: (1.0, HIGHEST as f64),
            step: 0.0,
            logarithmic: false,
        }]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        (1..=HIGHEST).map(|k| vec![k as f64]).collect()
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let level = &session.signals.level;
        waves(session, shape[0])
            .map(|wave| Term::Zero(product(&wave, level)))
            .into()
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let (full, order) = (gauge.rms(), shape[0]);
        gauge.over_angle(|m, angle| {
            m + full
                * (parameters[0] * (order * angle).cos() + parameters[1] * (order * angle).sin())
        });
        true
    }
    fn experiment(&self) -> &'static str {
        "constant torque over many turns of the carrier"
    }
}

/// `reading (a cos(angle) + b sin(angle))` where the map is made of planets passing.
pub struct PlanetSharing;

impl Effect for PlanetSharing {
    fn name(&self) -> &'static str {
        "planet-sharing"
    }
    fn about(&self) -> &'static str {
        "the planets carry unequal parts"
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine, part of the reading",
                prior_std: 0.1,
            },
            Linear {
                name: "sine, part of the reading",
                prior_std: 0.1,
            },
        ]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        one_shape()
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.over_angle() && is_intermittent(&stream.map)
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        waves(session, 1.0).map(Term::Gain).into()
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        gauge.over_angle(|m, angle| {
            m * (1.0 + parameters[0] * angle.cos() + parameters[1] * angle.sin())
        });
        true
    }
    fn experiment(&self) -> &'static str {
        "constant torque over many turns of the carrier"
    }
}

/// `scale level (a cos(r angle) + b sin(r angle))` with the speed ratio `r` of
/// another inertia: what comes once a turn of its shaft.
pub struct ShaftOrder;

impl Effect for ShaftOrder {
    fn name(&self) -> &'static str {
        "shaft-order"
    }
    fn about(&self) -> &'static str {
        "what comes once or twice a turn of another shaft"
    }
    fn linear(&self) -> &'static [Linear] {
        AMPLITUDES
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "order",
            unit: "per turn of the carrier",
            bounds: (0.0, f64::INFINITY),
            step: 0.0,
            logarithmic: false,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        // An order is only seen where it is sampled more than twice a period.
        let most = std::f64::consts::PI / session.signals.dt_s / session.signals.nominal_speed;
        let of_carrier = |r: f64| r.fract() == 0.0 && r <= HIGHEST as f64;
        let orders: Vec<f64> = session
            .signals
            .ratios
            .iter()
            .flat_map(|r| [r.abs(), 2.0 * r.abs()])
            .filter(|r| !of_carrier(*r) && *r < 0.8 * most)
            .collect();
        each(&orders)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let level = &session.signals.level;
        waves(session, shape[0])
            .map(|wave| Term::Zero(product(&wave, level)))
            .into()
    }
    fn experiment(&self) -> &'static str {
        "constant torque at two speeds"
    }
}

/// Cosine and sine of an order of the carrier angle, as the mean of the raw samples in one has them:
/// of `n` samples `2 x` apart `sin(n x) / (n sin(x))` is left of a wave.
pub fn waves(session: &Session, order: f64) -> [Vec<f64>; 2] {
    let signals = &session.signals;
    let n = signals.means_of as f64;
    let left = |speed: &f64| {
        let x = 0.5 * order * speed * signals.dt_s / n;
        let whole = n * x.sin();
        if whole.abs() < 1e-9 {
            1.0
        } else {
            (n * x).sin() / whole
        }
    };
    let along = |wave: fn(f64) -> f64| {
        let samples = signals.angle.iter().zip(&signals.speed);
        samples.map(|(a, w)| left(w) * wave(order * a)).collect()
    };
    [along(f64::cos), along(f64::sin)]
}

/// Whether a map is made of narrow peaks, as under passing planets.
fn is_intermittent(map: &[f64]) -> bool {
    let square = map.iter().map(|m| m * m).sum::<f64>() / map.len().max(1) as f64;
    let peak = map.iter().fold(0.0_f64, |peak, m| peak.max(m.abs()));
    peak > 2.0 * square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signals::Signals;
    use crate::stream::Told;

    /// Order 3 at 50 rad/s, 4 samples of 2 ms in a mean: sin(0.6) / (4 sin(0.15)) = 0.945 of it is left.
    #[test]
    fn a_wave_is_the_mean_of_the_samples_in_it() {
        const EVERY: usize = 4;
        let (raw_s, speed) = (0.002, 50.0);
        let raw = |i: usize| speed * raw_s * i as f64;
        let of_wave = |i: usize| (3.0 * raw(i)).cos();
        let mean = |of: &dyn Fn(usize) -> f64, k: usize| {
            (EVERY * k..EVERY * (k + 1)).map(of).sum::<f64>() / EVERY as f64
        };
        let session = Session {
            signals: Signals {
                dt_s: EVERY as f64 * raw_s,
                means_of: EVERY,
                angle: (0..100).map(|k| mean(&raw, k)).collect(),
                speed: vec![speed; 100],
                ..Signals::default()
            },
            streams: Vec::new(),
            twist: Vec::new(),
            course: None,
            told: Told::References,
            reference_noise: Vec::new(),
        };
        let [cosine, _] = waves(&session, 3.0);
        for (k, value) in cosine.iter().enumerate() {
            assert!((value - mean(&of_wave, k)).abs() < 1e-12, "{k}");
        }
        let most = cosine.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
        assert!((0.93..0.945).contains(&most), "{most}");
    }
}
