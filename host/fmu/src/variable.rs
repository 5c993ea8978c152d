//! Lists the variables of an FMU from the machine's `Interface`: time, outputs named as columns of
//! estimates, inputs named as columns of recordings; where a name is taken, with a suffix. Real
//! variables have a unit, loads a nominal value. The place in the list is the value reference.

use std::collections::HashSet;

use loadtwin_common::io::fault::Fault;
use loadtwin_recording::Unit;

use crate::interface::Interface;
use crate::role::{LoadField, Role, SensorField};

/// A variable. Its value reference is its place in the list.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Its name, which no other variable has.
    pub name: String,
    /// What it stands for.
    pub role: Role,
    /// Unit of a real number.
    pub unit: Option<Unit>,
    /// Usual size (in `unit`).
    pub nominal: Option<f64>,
    /// What it is, for a person.
    pub description: String,
}

/// Variables with names of their own.
struct Names {
    variables: Vec<Variable>,
    taken: HashSet<String>,
}

impl Names {
    /// Adds a variable; where its name is taken, with `suffix` behind it.
    fn add(&mut self, (mut name, suffix): (String, &str), role: Role, of: Of) {
        while !self.taken.insert(name.clone()) {
            name.push_str(suffix);
        }
        self.variables.push(Variable {
            name,
            role,
            unit: of.unit,
            nominal: of.nominal,
            description: of.description,
        });
    }
}

/// The remainder of a variable.
struct Of {
    unit: Option<Unit>,
    nominal: Option<f64>,
    description: String,
}

fn of(unit: impl Into<Option<Unit>>, description: impl Into<String>) -> Of {
    Of {
        unit: unit.into(),
        nominal: None,
        description: description.into(),
    }
}

/// The variables of a machine: time, outputs, inputs. Outputs are named as columns of estimates, inputs as
/// columns of recordings.
pub fn variables(interface: &Interface) -> Vec<Variable> {
    let mut names = Names {
        variables: Vec::new(),
        taken: HashSet::new(),
    };
    let time = of(Unit::SECOND, "time");
    names.add(("time".into(), ""), Role::Time, time);
    add_loads(&mut names, interface);
    add_sensors(&mut names, interface);
    add_inputs(&mut names, interface);
    names.variables
}

/// The numbers of faults, for a description.
fn codes() -> String {
    let codes: Vec<String> = (Fault::ALL.iter())
        .map(|fault| format!("{} {}", *fault as u8, fault.name()))
        .collect();
    codes.join(", ")
}

fn add_loads(names: &mut Names, interface: &Interface) {
    const SUFFIX: &str = "_out";
    let lag = match interface.lag_samples {
        0 => String::new(),
        lag => format!(", of the sample {lag} before"),
    };
    for (i, load) in interface.loads.iter().enumerate() {
        let name = &load.name;
        let value = Of {
            nominal: Some(load.nominal),
            ..of(load.unit, format!("estimate of the load{lag}"))
        };
        let std = of(load.unit, "standard deviation of the estimate");
        let valid = of(None, "whether the estimate is valid");
        let fault = of(None, format!("why it is not valid: {}", codes()));
        let role = |field| Role::Load(i, field);
        names.add((name.clone(), SUFFIX), role(LoadField::Value), value);
        names.add((format!("{name}_std"), SUFFIX), role(LoadField::Std), std);
        names.add(
            (format!("{name}_valid"), SUFFIX),
            role(LoadField::Valid),
            valid,
        );
        names.add(
            (format!("{name}_fault"), SUFFIX),
            role(LoadField::Fault),
            fault,
        );
    }
}

fn add_sensors(names: &mut Names, interface: &Interface) {
    const SUFFIX: &str = "_sensor";
    let channels = interface.channels.iter().map(|c| (&c.name, c.unit));
    let encoders = (interface.encoders.iter()).map(|e| {
        let is_counts = e.unit == Unit::COUNTS;
        (&e.name, if is_counts { Unit::RADIAN } else { e.unit })
    });
    for (i, (name, unit)) in channels.chain(encoders).enumerate() {
        let innovation = of(
            unit,
            "reading minus prediction; 0 where no reading was used",
        );
        let nis = of(Unit::ONE, "normalised innovation squared");
        let fault = of(None, format!("why the reading was not used: {}", codes()));
        let role = |field| Role::Sensor(i, field);
        let named = |end| (format!("{name}_{end}"), SUFFIX);
        names.add(
            named("innovation"),
            role(SensorField::Innovation),
            innovation,
        );
        names.add(named("nis"), role(SensorField::Nis), nis);
        names.add(named("fault"), role(SensorField::Fault), fault);
    }
    let angle = of(Unit::RADIAN, "angle of carrier or shaft");
    names.add(("angle".into(), SUFFIX), Role::ShaftAngle, angle);
    let homed = of(None, "whether the angle is homed on an index pulse");
    names.add(("homed".into(), SUFFIX), Role::Homed, homed);
    let steady = of(None, "whether gains computed beforehand were used");
    names.add(("steady".into(), SUFFIX), Role::Steady, steady);
}

fn add_inputs(names: &mut Names, interface: &Interface) {
    const SUFFIX: &str = "_in";
    let delivered = "whether the reading was delivered";
    for (i, channel) in interface.channels.iter().enumerate() {
        let reading = of(channel.unit, "reading of the channel");
        names.add((channel.name.clone(), SUFFIX), Role::Reading(i), reading);
        let name = format!("{}_delivered", channel.name);
        names.add(
            (name, SUFFIX),
            Role::ReadingDelivered(i),
            of(None, delivered),
        );
    }
    for (i, encoder) in interface.encoders.iter().enumerate() {
        let angle = of(
            encoder.unit,
            "angle or travel of the encoder, as far as it goes",
        );
        names.add((encoder.name.clone(), SUFFIX), Role::Angle(i), angle);
        let name = format!("{}_delivered", encoder.name);
        names.add((name, SUFFIX), Role::AngleDelivered(i), of(None, delivered));
    }
    if let Some(index) = &interface.index {
        let pulse = of(None, "index pulse: its rising edge homes the angle");
        names.add((index.name.clone(), SUFFIX), Role::Index, pulse);
        if let Some(encoder) = index.encoder.and_then(|at| interface.encoders.get(at)) {
            let since = of(
                encoder.unit,
                "how far the encoder has turned since the pulse",
            );
            names.add(
                (format!("{}_since", index.name), SUFFIX),
                Role::SinceIndex,
                since,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::variables;
    use crate::interface::Interface;
    use crate::role::Role;

    /// A machine whose names meet those of outputs.
    const MACHINE: &str = r#"
        format = 1
        machine = "names"
        rate_hz = 1000
        lag_samples = 0
        [[load]]
        name = "time"
        unit = "Nm"
        nominal = 100
        [[channel]]
        name = "time_std"
        unit = "m/m"
        quantiser = { lsb = 1e-7, zero = 0, bits = 24 }
        [[encoder]]
        name = "angle"
        unit = "rad"
        counter = { counts_per_turn = -1024, bits = 16 }
        [index]
        name = "homed"
        encoder = 0
    "#;

    #[test]
    fn no_name_stands_for_two_variables() {
        let interface = Interface::from_toml(MACHINE).unwrap();
        let variables = variables(&interface);
        let named = |role| &variables.iter().find(|v| v.role == role).unwrap().name;
        assert_eq!(named(Role::Time), "time");
        assert_eq!(named(Role::Reading(0)), "time_std_in");
        assert_eq!(named(Role::Angle(0)), "angle_in");
        assert_eq!(named(Role::Index), "homed_in");
        let mut names: Vec<_> = variables.iter().map(|v| &v.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), variables.len());
    }
}
