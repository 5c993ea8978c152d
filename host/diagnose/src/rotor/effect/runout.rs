//! A surface that is out of true.

use super::{RUN_UP, place, places};
use crate::effect::{Coupling, Effect, Linear, Shape};
use crate::rotor::{Readings, RotorPlace, RotorSession, displacement, nodes};

/// `a cos(k (angle - d)) + b sin(k (angle - d))` in the sensors at one node, along their
/// directions `d`, for each order `k`: of the same size at every speed.
pub struct Surface {
    name: &'static str,
    about: &'static str,
    amplitudes: &'static [Linear],
    /// The first of the orders, each with two amplitudes.
    first: u8,
}

/// Once a turn.
pub const RUNOUT: Surface = Surface {
    name: "runout",
    about: "the surface that sensors look at is out of true",
    amplitudes: &[metres("cosine [m]", 5e-5), metres("sine [m]", 5e-5)],
    first: 1,
};

/// Two and three times a turn: what a surface has beside it, and no unbalance does.
pub const SURFACE_LOBES: Surface = Surface {
    name: "surface-lobes",
    about: "the surface that sensors look at is not round",
    amplitudes: &[
        metres("twice a turn, cosine [m]", 5e-6),
        metres("twice a turn, sine [m]", 5e-6),
        metres("three times a turn, cosine [m]", 5e-6),
        metres("three times a turn, sine [m]", 5e-6),
    ],
    first: 2,
};

impl Effect<RotorSession> for Surface {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        self.amplitudes
    }
    fn shape(&self) -> &'static [Shape] {
        const NODE: &[Shape] = &[place("node", "of those with sensors")];
        NODE
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        places(session.nodes().len())
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        let node = session.nodes()[shape[0] as usize];
        let wave = |order: f64, of: fn(f64) -> f64| {
            session.each(|k, i| match session.place(k) {
                (at, direction) if at == node => {
                    of(order * (session.turning().angle[i] - direction))
                }
                _ => 0.0,
            })
        };
        self.orders()
            .map(f64::from)
            .flat_map(|order| [wave(order, f64::cos), wave(order, f64::sin)])
            .collect()
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        Some(format!("node {}", session.nodes()[shape[0] as usize]))
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], place: &mut RotorPlace) -> bool {
        let nodes = nodes(&place.machine.channels);
        for channel in &mut place.machine.channels {
            let (at, direction) = displacement(channel);
            if at != nodes[shape[0] as usize] {
                continue;
            }
            let unit = channel.unit;
            for (order, wave) in self.orders().zip(parameters.chunks_exact(2)) {
                // cos(k (angle - d)) = cos(k d) cos(k angle) + sin(k d) sin(k angle)
                let (sine, cosine) = (f64::from(order) * direction).sin_cos();
                let order = usize::from(order);
                if channel.runout.len() < order {
                    channel.runout.resize(order, [0.0; 2]);
                }
                channel.runout[order - 1][0] += unit.from_si(wave[0] * cosine - wave[1] * sine);
                channel.runout[order - 1][1] += unit.from_si(wave[0] * sine + wave[1] * cosine);
            }
        }
        !place.machine.encoders.is_empty()
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}

impl Surface {
    fn orders(&self) -> impl Iterator<Item = u8> {
        (self.first..).take(self.amplitudes.len() / 2)
    }
}

const fn metres(name: &'static str, prior_std: f64) -> Linear {
    Linear { name, prior_std }
}
