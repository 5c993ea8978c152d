//! An encoder disc that is not centred.

use super::order::waves;
use super::{Coupling, Effect, Linear, Shape};
use crate::stream::{Kind, Session, Term};
use loadtwin_machine::{Encoder, Machine};

/// Standard deviation of what errs twice per turn [rad of the main shaft].
const TWICE_RAD: f64 = 0.0005;

/// `a cos(r angle) + b sin(r angle) + c` on the angle of an inertia with speed
/// ratio `r`; `c` is what the index pulse takes of it, less what all maps told.
pub struct Eccentricity;

impl Effect for Eccentricity {
    fn name(&self) -> &'static str {
        "encoder-eccentricity"
    }
    fn about(&self) -> &'static str {
        "an encoder errs once per turn"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine [rad of the main shaft]",
                prior_std: 0.005,
            },
            Linear {
                name: "sine [rad of the main shaft]",
                prior_std: 0.005,
            },
            Linear {
                name: "at the index [rad of the main shaft]",
                prior_std: 0.005,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "inertia",
            unit: "number",
            bounds: (0.0, 6.0),
            step: 0.0,
            logarithmic: false,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        let mut bodies: Vec<usize> = session
            .streams
            .iter()
            .filter(|s| s.kind == Kind::Angle)
            .flat_map(|s| s.inertias)
            .collect();
        bodies.sort_unstable();
        bodies.dedup();
        bodies.iter().map(|b| vec![*b as f64]).collect()
    }
    fn is_linear(&self) -> bool {
        false
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        self.terms_about(session, shape, &[])
    }
    fn terms_about(&self, session: &Session, shape: &[f64], parameters: &[Vec<f64>]) -> Vec<Term> {
        let body = shape[0] as usize;
        let [cosine, sine] = waves(session, session.signals.ratios[body]);
        let u = [cosine, sine, vec![1.0; session.signals.len()]];
        let now = parameters.iter().find(|p| !p.is_empty());
        let about: Vec<f64> = (0..session.signals.len())
            .map(|i| now.map_or(0.0, |p| p.iter().zip(&u).map(|(p, u)| p * u[i]).sum()))
            .collect();
        u.map(|u| Term::Angle {
            body,
            u,
            about: about.clone(),
        })
        .into()
    }
    /// A disc that errs once per turn errs twice as well, a little.
    fn nuisances(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let body = shape[0] as usize;
        let waves = waves(session, 2.0 * session.signals.ratios[body]);
        let error = |wave: Vec<f64>| Term::Angle {
            body,
            u: wave.iter().map(|w| TWICE_RAD * w).collect(),
            about: vec![0.0; wave.len()],
        };
        waves.map(error).into()
    }
    fn mend_machine(
        &self,
        session: &Session,
        shape: &[f64],
        parameters: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let inertia = session.signals.inertias.get(shape[0] as usize);
        let has_place = |e: &Encoder| Some(&e.inertia) == inertia && machine.index_turns_with(e);
        let Some(at) = machine.encoders.iter().position(has_place) else {
            return false;
        };
        let encoder = &mut machine.encoders[at];
        let [cosine, sine] = encoder.eccentricity.map_or([0.0; 2], |e| e.parts_from(0.0));
        let found = [cosine + parameters[0], sine + parameters[1]];
        encoder.eccentricity = Some(loadtwin_machine::Eccentricity::from_parts(found));
        true
    }
    fn experiment(&self) -> &'static str {
        "constant speed over many turns with a second encoder"
    }
}
