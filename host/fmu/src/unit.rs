//! Gives the name of a unit as FMI writes it (`N.m`), and the exponents of the SI base units by
//! which FMI defines a quantity.

use loadtwin_recording::{Quantity as Q, Unit};

/// Name of a unit; a product has a point.
pub(crate) fn name(unit: Unit) -> &'static str {
    match unit.symbol() {
        "Nm" => "N.m",
        "kNm" => "kN.m",
        symbol => symbol,
    }
}

/// Exponents of the base units that a quantity has.
pub(crate) fn exponents(quantity: Q) -> &'static [(&'static str, &'static str)] {
    match quantity {
        Q::Torque => &[("kg", "1"), ("m", "2"), ("s", "-2")],
        Q::Force => &[("kg", "1"), ("m", "1"), ("s", "-2")],
        Q::Angle => &[("rad", "1")],
        Q::AngularSpeed => &[("rad", "1"), ("s", "-1")],
        Q::Time => &[("s", "1")],
        Q::Temperature => &[("K", "1")],
        Q::Length => &[("m", "1")],
        Q::Speed => &[("m", "1"), ("s", "-1")],
        Q::Acceleration => &[("m", "1"), ("s", "-2")],
        Q::Pressure => &[("kg", "1"), ("m", "-1"), ("s", "-2")],
        Q::Power => &[("kg", "1"), ("m", "2"), ("s", "-3")],
        Q::Frequency => &[("s", "-1")],
        Q::Voltage => &[("kg", "1"), ("m", "2"), ("s", "-3"), ("A", "-1")],
        Q::Current => &[("A", "1")],
        Q::Resistance => &[("kg", "1"), ("m", "2"), ("s", "-3"), ("A", "-2")],
        Q::Strain | Q::BridgeRatio | Q::Counts | Q::Number => &[],
    }
}
