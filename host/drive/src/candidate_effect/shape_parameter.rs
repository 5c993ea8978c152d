//! Defines a shape parameter of an effect, a number that its columns are not linear in: its name,
//! the kind of its unit, and its label with the unit that it has in a balance (rad or m).

use loadtwin_machine::Balance;

/// A parameter that the drive is not linear in.
#[derive(Clone, Copy, Debug)]
pub struct ShapeParameter {
    /// Its name.
    pub name: &'static str,
    /// What it is measured in.
    pub unit: ShapeUnit,
}

/// What a parameter of a shape is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShapeUnit {
    /// A plain number.
    Number,
    /// rad of an angle, m of a position.
    Travel,
    /// rad/s or m/s.
    Speed,
    /// s.
    Time,
    /// K.
    Temperature,
}

impl ShapeParameter {
    /// Parameter `name` in `unit`.
    pub const fn new(name: &'static str, unit: ShapeUnit) -> Self {
        Self { name, unit }
    }

    /// Name with the unit that it has in `balance`, e.g. `distance to build up [rad]`.
    pub fn label(&self, balance: &Balance) -> String {
        let unit = match (self.unit, balance.is_angle()) {
            (ShapeUnit::Number, _) => return self.name.to_owned(),
            (ShapeUnit::Travel, true) => "rad",
            (ShapeUnit::Travel, false) => "m",
            (ShapeUnit::Speed, true) => "rad/s",
            (ShapeUnit::Speed, false) => "m/s",
            (ShapeUnit::Time, _) => "s",
            (ShapeUnit::Temperature, _) => "K",
        };
        format!("{} [{unit}]", self.name)
    }
}
