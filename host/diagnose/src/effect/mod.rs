//! The library of effects, a file for each family; a new one is its `impl` and a line in [`LIBRARY`].

pub(super) mod bending;
mod clock;
mod creep;
mod eccentricity;
mod friction;
mod gain;
mod mains;
mod order;
mod resonance;
mod step;
mod thermal;
mod torsion;
mod word;

use super::observed::Observed;
use super::stream::Session;
use loadtwin_machine::{Creep, Hysteresis, MAP_ENTRIES, Machine, Thermal};

/// Whether an effect has its parameters in each channel or once for all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coupling {
    /// Each stream has its own.
    Own,
    /// One set says what happens in every stream.
    Shared,
}

/// A linear parameter.
#[derive(Clone, Copy, Debug)]
pub struct Linear {
    /// Its name, with what it is a part of.
    pub name: &'static str,
    /// Standard deviation that known errors have, in the same unit.
    pub prior_std: f64,
}

/// A parameter that the residual is not linear in.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Smallest and largest value.
    pub bounds: (f64, f64),
    /// First step of its refinement; 0 for one that only takes the values of
    /// the grid.
    pub step: f64,
    /// Whether the step is a factor (of e).
    pub logarithmic: bool,
}

/// A small piece of model that the machine description may lack.
///
/// The residual is `sum_j c_j term_j(shape)` with linear parameters `c`, found
/// by least squares, and a shape that is found by search.
pub trait Effect<S: Observed = Session>: Sync {
    /// Name in verdicts.
    fn name(&self) -> &'static str;

    /// What it is, in a few words.
    fn about(&self) -> &'static str;

    /// Where its parameters stand.
    fn coupling(&self) -> Coupling {
        Coupling::Own
    }

    /// The linear parameters.
    fn linear(&self) -> &'static [Linear];

    /// The parameters of the shape.
    fn shape(&self) -> &'static [Shape] {
        &[]
    }

    /// How many numbers it may choose: what explains the same with fewer is the simpler one.
    fn numbers(&self) -> usize {
        self.linear().len() + self.shape().len()
    }

    /// Shapes from which the search starts; none where the recording cannot
    /// show the effect.
    fn grid(&self, session: &S) -> Vec<Vec<f64>>;

    /// One term for each linear parameter.
    fn terms(&self, session: &S, shape: &[f64]) -> Vec<S::Term>;

    /// Whether the terms stay the same however large the parameters are.
    fn is_linear(&self) -> bool {
        true
    }

    /// Terms with which `sum_j c_j term_j` is what it predicts at these
    /// parameters (`[stream]`, empty where it does not act), and nearly so
    /// around them.
    fn terms_about(&self, session: &S, shape: &[f64], _: &[Vec<f64>]) -> Vec<S::Term> {
        self.terms(session, shape)
    }

    /// What may be beside it in each stream by itself, one standard deviation of each: a changed
    /// chain begins with other vibrations.
    fn nuisances(&self, _: &S, _shape: &[f64]) -> Vec<S::Term> {
        Vec::new()
    }

    /// Part, in amplitude, of what it explains by which its form may be off: what it leaves so
    /// is no further effect.
    fn form(&self, _: &S) -> f64 {
        0.15
    }

    /// Where in the machine this shape is, in words.
    fn place(&self, _: &S, _shape: &[f64]) -> Option<String> {
        None
    }

    /// Which streams it can act on.
    fn acts_on(&self, _: &S::Stream) -> bool {
        true
    }

    /// Natural logarithm of the odds for it that a stream's faulty samples
    /// tell by themselves.
    fn evidence_of_faults(&self, _: &S::Stream) -> f64 {
        0.0
    }

    /// Whether its parameters are those of the machine, and not of one recording.
    fn lasts(&self) -> bool {
        true
    }

    /// Latent degrees of freedom that its terms took from the data.
    fn latent(&self, _: &S) -> f64 {
        0.0
    }

    /// Takes its parameters into the description, so that the line runs it; false where that
    /// has no place for it.
    fn mend(&self, _shape: &[f64], _parameters: &[f64], _place: &mut S::Place) -> bool {
        false
    }

    /// The same, into what is not one channel's.
    fn mend_machine(
        &self,
        _: &S,
        _shape: &[f64],
        _parameters: &[f64],
        _machine: &mut Machine,
    ) -> bool {
        false
    }

    /// The experiment that shows it best.
    fn experiment(&self) -> &'static str;
}

/// A gauge as the line knows it [SI].
pub struct GaugeModel {
    /// Reading at no torque.
    pub offset: f64,
    /// Sensitivity over the carrier angle, in equal steps; one value where it
    /// is the same everywhere.
    pub map: Vec<f64>,
    /// Reading at nominal torque, root mean square.
    pub full_scale: f64,
    /// Part of the reading by which it is larger at nominal torque than in proportion.
    pub nonlinearity: f64,
    /// Creep of the zero.
    pub creep: Option<Creep>,
    /// What it remembers of the way on which the load came.
    pub hysteresis: Option<Hysteresis>,
    /// Reading of a load that all gauges read and that is not torque, of which one unit is a
    /// mean reading of full scale; 0 where none is described.
    pub bending: f64,
    /// Its weight in that mean.
    pub weight: f64,
    /// How old its readings are [s].
    pub late_s: f64,
    /// What warmth does; none where the board samples no temperature.
    pub thermal: Option<Thermal>,
}

impl GaugeModel {
    /// Changes the sensitivity over the angle: each value, by its angle.
    pub fn over_angle(&mut self, change: impl Fn(f64, f64) -> f64) {
        if self.map.len() == 1 {
            self.map = vec![self.map[0]; MAP_ENTRIES];
        }
        let step = std::f64::consts::TAU / self.map.len() as f64;
        for (i, m) in self.map.iter_mut().enumerate() {
            *m = change(*m, i as f64 * step);
        }
    }

    /// Root mean square of the map.
    pub fn rms(&self) -> f64 {
        (self.map.iter().map(|m| m * m).sum::<f64>() / self.map.len() as f64).sqrt()
    }
}

/// Every effect that is tried.
pub static LIBRARY: &[&dyn Effect] = &[
    &gain::GainError,
    &gain::Position,
    &gain::Nonlinearity,
    &thermal::DRIFT,
    &thermal::Unrecorded,
    &thermal::GAIN,
    &creep::GaugeCreep,
    &creep::Drift,
    &creep::StrainHysteresis,
    &step::STEP,
    &step::DEBONDING,
    &order::CarrierOrder,
    &order::PlanetSharing,
    &order::ShaftOrder,
    &bending::Bending,
    &friction::COULOMB,
    &friction::STRIBECK,
    &friction::VISCOUS,
    &friction::LOAD_DEPENDENT,
    &friction::PRESLIDING,
    &torsion::Backlash,
    &torsion::Ripple,
    &resonance::Resonance,
    &clock::Delay,
    &eccentricity::Eccentricity,
    &mains::PickUp,
    &word::DROPPED_BITS,
    &word::STUCK,
];

/// The grid of an effect without shape.
fn one_shape() -> Vec<Vec<f64>> {
    vec![Vec::new()]
}

/// The grid of one parameter.
fn each(values: &[f64]) -> Vec<Vec<f64>> {
    values.iter().map(|v| vec![*v]).collect()
}
