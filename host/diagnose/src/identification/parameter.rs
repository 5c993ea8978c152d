//! Lists the parameters of a drivetrain that recordings with known loads may show: moments of inertia,
//! drag, stiffness and damping; with the standard deviation that a description has of each.

use loadtwin_machine::{Drivetrain, Inertia, Shaft};

/// Standard deviation of a moment of inertia whose description states none, relative: a computed solid
/// with what is mounted on it.
const INERTIA_STD: f64 = 0.05;

/// The same of a torsional stiffness: computed shafts, keys and meshes in series.
const STIFFNESS_STD: f64 = 0.1;

/// The same of a damping and of a drag, which are hardly ever computed.
const DAMPING_STD: f64 = 0.5;

/// Least standard deviation of a drag whose description states none, torque at nominal speed in parts of
/// nominal torque: friction coefficient of rolling bearings, 0.001 to 0.002.
///
/// Source: SKF, Rolling bearings (general catalogue), section "Friction".
const DRAG_PART_STD: f64 = 0.002;

/// Standard deviation of an inertia or a stiffness that a chain of lumped inertias has at best, relative: half of
/// the inertia of a gear or coupling between two of them that a description has in its neighbours, 1 % of these.
const LUMPED_STD: f64 = 0.005;

/// The same of a damping: of a vibration, what torques lack between samples, 7 % at a fifth of the sample rate and
/// 0.5 % at a tenth (`(sin x / x) (1 + (1 - cos x) / 3)`, `x = 2 pi f dt`).
const SAMPLED_STD: f64 = 0.05;

/// Least value of inertia, stiffness and damping, part of the described one.
const LEAST_PART: f64 = 0.05;

/// Kind of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Moment of inertia.
    Inertia,
    /// Viscous drag of an inertia.
    Drag,
    /// Torsional stiffness of a shaft.
    Stiffness,
    /// Torsional damping of a shaft.
    Damping,
}

impl Quantity {
    /// Its name in tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Inertia => "inertia",
            Self::Drag => "drag",
            Self::Stiffness => "stiffness",
            Self::Damping => "damping",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Inertia => "kg m^2",
            Self::Stiffness => "Nm/rad",
            Self::Drag | Self::Damping => "Nm s/rad",
        }
    }

    /// Keys of its value and of its standard deviation in a description.
    pub fn keys(self) -> [&'static str; 2] {
        match self {
            Self::Inertia => ["moment_kg_m2", "moment_std_kg_m2"],
            Self::Drag => ["drag_nm_s_per_rad", "drag_std_nm_s_per_rad"],
            Self::Stiffness => ["stiffness_nm_per_rad", "stiffness_std_nm_per_rad"],
            Self::Damping => ["damping_nm_s_per_rad", "damping_std_nm_s_per_rad"],
        }
    }

    /// The list of a description that has it.
    pub fn list(self) -> &'static str {
        match self {
            Self::Inertia | Self::Drag => "drivetrain.inertia",
            Self::Stiffness | Self::Damping => "drivetrain.shaft",
        }
    }
}

/// A parameter as described.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// What it is.
    pub quantity: Quantity,
    /// Inertia or shaft that has it.
    pub part: String,
    /// Number of that.
    pub(super) index: usize,
    /// Value as described.
    pub described: f64,
    /// Standard deviation of that, stated or by default, > 0.
    pub prior_std: f64,
}

impl Parameter {
    /// All of `drivetrain` whose standard deviation is not zero. A shaft that is described without
    /// damping is left so.
    pub(super) fn all(drivetrain: &Drivetrain) -> Vec<Self> {
        let least_drag = |inertia: &Inertia| {
            let at_nominal = drivetrain.nominal_speed_rad_s * inertia.speed_ratio.powi(2);
            DRAG_PART_STD * drivetrain.nominal_torque() / at_nominal
        };
        let of_inertia = |(index, inertia): (usize, &Inertia)| {
            let (moment, drag) = (inertia.moment_kg_m2, inertia.drag_nm_s_per_rad);
            let moment_std = inertia.moment_std_kg_m2.unwrap_or(INERTIA_STD * moment);
            let by_default = (DAMPING_STD * drag).max(least_drag(inertia));
            let drag_std = inertia.drag_std_nm_s_per_rad.unwrap_or(by_default);
            let at = |quantity, described, prior_std| Self {
                quantity,
                part: inertia.name.clone(),
                index,
                described,
                prior_std,
            };
            [
                at(Quantity::Inertia, moment, moment_std),
                at(Quantity::Drag, drag, drag_std),
            ]
        };
        let of_shaft = |(index, shaft): (usize, &Shaft)| {
            let (stiffness, damping) = (shaft.stiffness_nm_per_rad, shaft.damping_nm_s_per_rad);
            let by_default = [STIFFNESS_STD * stiffness, DAMPING_STD * damping];
            let at = |quantity, described, prior_std| Self {
                quantity,
                part: shaft.name.clone(),
                index,
                described,
                prior_std,
            };
            [
                at(
                    Quantity::Stiffness,
                    stiffness,
                    shaft.stiffness_std_nm_per_rad.unwrap_or(by_default[0]),
                ),
                at(
                    Quantity::Damping,
                    damping,
                    shaft.damping_std_nm_s_per_rad.unwrap_or(by_default[1]),
                ),
            ]
        };
        let inertias = drivetrain.inertias.iter().enumerate().flat_map(of_inertia);
        let shafts = drivetrain.shafts.iter().enumerate().flat_map(of_shaft);
        let all = inertias.chain(shafts);
        all.filter(|p| p.prior_std > 0.0 && (p.described > 0.0 || p.quantity == Quantity::Drag))
            .collect()
    }

    /// Standard deviation that the model of the chain leaves it, however long a recording is.
    pub(super) fn model_std(&self) -> f64 {
        match self.quantity {
            Quantity::Inertia | Quantity::Stiffness => LUMPED_STD * self.described,
            Quantity::Damping => SAMPLED_STD * self.described,
            Quantity::Drag => 0.0,
        }
    }

    /// Its value `offset` standard deviations from the described one, within what is possible.
    pub(super) fn value(&self, offset: f64) -> f64 {
        let least = match self.quantity {
            Quantity::Drag => 0.0,
            _ => LEAST_PART * self.described,
        };
        (self.described + offset * self.prior_std).max(least)
    }

    /// Least offset that is possible.
    pub(super) fn least_offset(&self) -> f64 {
        (self.value(f64::NEG_INFINITY) - self.described) / self.prior_std
    }

    fn set(&self, drivetrain: &mut Drivetrain, value: f64) {
        let inertias = &mut drivetrain.inertias;
        match self.quantity {
            Quantity::Inertia => inertias[self.index].moment_kg_m2 = value,
            Quantity::Drag => inertias[self.index].drag_nm_s_per_rad = value,
            Quantity::Stiffness => {
                drivetrain.shafts[self.index].stiffness_nm_per_rad = value;
            }
            Quantity::Damping => drivetrain.shafts[self.index].damping_nm_s_per_rad = value,
        }
    }
}

/// `drivetrain` with each of `parameters` as many standard deviations from the described value as
/// `offsets` say.
pub(super) fn with_offsets(
    drivetrain: &Drivetrain,
    parameters: &[Parameter],
    offsets: &[f64],
) -> Drivetrain {
    let mut changed = drivetrain.clone();
    for (parameter, offset) in parameters.iter().zip(offsets) {
        parameter.set(&mut changed, parameter.value(*offset));
    }
    changed
}
