//! A surface that is out of true.

use super::{RUN_UP, place, places};
use crate::diagnose::effect::{Coupling, Effect, Linear, Shape};
use crate::diagnose::rotor::{Readings, RotorPlace, RotorSession, displacement, nodes};

const NODE: &[Shape] = &[place("node", "of those with sensors")];

/// `a cos(angle - d) + b sin(angle - d)` in the sensors at one node, along their directions `d`:
/// once a turn, of the same size at every speed.
pub struct Runout;

/// As [`Runout`], two and three times a turn: what a surface has beside it, and no unbalance does.
pub struct SurfaceLobes;

impl Effect<RotorSession> for Runout {
    fn name(&self) -> &'static str {
        "runout"
    }
    fn about(&self) -> &'static str {
        "the surface that sensors look at is out of true"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        const ALL: &[Linear] = &[metres("cosine [m]", 5e-5), metres("sine [m]", 5e-5)];
        ALL
    }
    fn shape(&self) -> &'static [Shape] {
        NODE
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        places(session.nodes().len())
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        waves(session, shape, 1..=1)
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        Some(node(session, shape))
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], place: &mut RotorPlace) -> bool {
        take(place, shape, parameters, 1)
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}

impl Effect<RotorSession> for SurfaceLobes {
    fn name(&self) -> &'static str {
        "surface-lobes"
    }
    fn about(&self) -> &'static str {
        "the surface that sensors look at is not round"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        const ALL: &[Linear] = &[
            metres("twice a turn, cosine [m]", 5e-6),
            metres("twice a turn, sine [m]", 5e-6),
            metres("three times a turn, cosine [m]", 5e-6),
            metres("three times a turn, sine [m]", 5e-6),
        ];
        ALL
    }
    fn shape(&self) -> &'static [Shape] {
        NODE
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        places(session.nodes().len())
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        waves(session, shape, 2..=3)
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        Some(node(session, shape))
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], place: &mut RotorPlace) -> bool {
        take(place, shape, parameters, 2)
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}

const fn metres(name: &'static str, prior_std: f64) -> Linear {
    Linear { name, prior_std }
}

fn node(session: &RotorSession, shape: &[f64]) -> String {
    format!("node {}", session.nodes()[shape[0] as usize])
}

/// The cosine and the sine of each order in the sensors at a node.
fn waves(
    session: &RotorSession,
    shape: &[f64],
    orders: std::ops::RangeInclusive<u8>,
) -> Vec<Readings> {
    let node = session.nodes()[shape[0] as usize];
    let wave = |order: u8, of: fn(f64) -> f64| {
        session.each(|k, i| match session.place(k) {
            (at, direction) if at == node => {
                of(f64::from(order) * (session.turning().angle[i] - direction))
            }
            _ => 0.0,
        })
    };
    orders
        .flat_map(|order| [wave(order, f64::cos), wave(order, f64::sin)])
        .collect()
}

/// Adds waves of `first` turns a turn and more to what the sensors at a node are known to read.
fn take(place: &mut RotorPlace, shape: &[f64], parameters: &[f64], first: usize) -> bool {
    let nodes = nodes(&place.machine.channels);
    let told = !place.machine.encoders.is_empty();
    for channel in &mut place.machine.channels {
        let (at, direction) = displacement(channel);
        if at != nodes[shape[0] as usize] {
            continue;
        }
        let unit = channel.unit;
        for (order, wave) in (first..).zip(parameters.chunks_exact(2)) {
            // cos(k (angle - d)) = cos(k d) cos(k angle) + sin(k d) sin(k angle)
            let (sine, cosine) = (order as f64 * direction).sin_cos();
            if channel.runout.len() < order {
                channel.runout.resize(order, [0.0; 2]);
            }
            channel.runout[order - 1][0] += unit.from_si(wave[0] * cosine - wave[1] * sine);
            channel.runout[order - 1][1] += unit.from_si(wave[0] * sine + wave[1] * cosine);
        }
    }
    told
}
