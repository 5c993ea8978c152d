//! Finds the kind of a machine (drivetrain, rotor, bearing, drive) by the table that its
//! description has, and lists its loads with name, unit and nominal value in the order of the
//! estimates.

use super::{BEARING_LOADS, Balance, Bearing, Drivetrain, Estimated, Machine, Rotor};
use loadtwin_recording::Unit;

/// The kind of a machine, with the part of the description that says so.
#[derive(Clone, Copy, Debug)]
pub enum Kind<'a> {
    /// A gearbox or another torsional drivetrain.
    Drivetrain(&'a Drivetrain),
    /// A rotor on bearings.
    Rotor(&'a Rotor),
    /// A wheel bearing.
    Bearing(&'a Bearing),
    /// A measured drive.
    Drive(&'a Balance),
}

/// A load as tables, estimates and references know it.
#[derive(Clone, Copy, Debug)]
pub struct NamedLoad<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its SI unit.
    pub unit: Unit,
    /// Nominal value or range [`unit`], the denominator of relative errors, > 0.
    pub nominal: f64,
}

/// Name of a drive's unknown load.
pub const UNKNOWN_LOAD: &str = "load";

impl Machine {
    /// The machine's kind; none in a description that [`Machine::check`] refuses.
    pub fn kind(&self) -> Option<Kind<'_>> {
        let drivetrain = self.drivetrain.as_ref().map(Kind::Drivetrain);
        let rotor = || self.rotor.as_ref().map(Kind::Rotor);
        let bearing = || self.bearing.as_ref().map(Kind::Bearing);
        let drive = || self.balance.as_ref().map(Kind::Drive);
        drivetrain.or_else(rotor).or_else(bearing).or_else(drive)
    }

    /// For each reference, the place of the load that it measures in [`Self::loads`].
    pub fn load_of_references(&self) -> Vec<Option<usize>> {
        let loads = self.loads();
        (self.references.iter())
            .map(|r| loads.iter().position(|load| load.name == r.load))
            .collect()
    }

    /// The loads in the order of the estimates.
    pub fn loads(&self) -> Vec<NamedLoad<'_>> {
        match self.kind() {
            Some(Kind::Drivetrain(drivetrain)) => drivetrain
                .loads
                .iter()
                .map(|load| NamedLoad {
                    name: &load.name,
                    unit: Unit::NEWTON_METRE,
                    nominal: load.nominal_nm,
                })
                .collect(),
            Some(Kind::Rotor(rotor)) => (rotor.loads.iter())
                .flat_map(|load| {
                    load.names.iter().map(|name| NamedLoad {
                        name,
                        unit: Unit::NEWTON,
                        nominal: load.nominal_n,
                    })
                })
                .collect(),
            Some(Kind::Bearing(bearing)) => BEARING_LOADS
                .into_iter()
                .zip(bearing.range.all())
                .enumerate()
                .map(|(i, (name, [from, to]))| NamedLoad {
                    name,
                    unit: if i < 3 {
                        Unit::NEWTON
                    } else {
                        Unit::NEWTON_METRE
                    },
                    nominal: to - from,
                })
                .collect(),
            Some(Kind::Drive(drive)) => (drive.nominal.into_iter())
                .map(|nominal| NamedLoad {
                    name: match drive.estimate {
                        Estimated::Load => UNKNOWN_LOAD,
                        Estimated::Drive => &drive.drive.name,
                    },
                    unit: drive.unit,
                    nominal,
                })
                .collect(),
            None => Vec::new(),
        }
    }
}
