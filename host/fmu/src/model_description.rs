//! Writes the `modelDescription.xml` of an FMU, in FMI 3.0 or 2.0, from the machine's `Interface`:
//! capabilities, units, variables and outputs. It states that no output depends on an input of the
//! same time.

use std::io;

use loadtwin_recording::Unit;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};

use crate::interface::Interface;
use crate::package::FmiVersion;
use crate::role::{Role, Type};
use crate::variable::{Variable, variables};
use crate::{library, unit};

type Xml = Writer<Vec<u8>>;

/// One element: its name and attributes.
fn element<'x>(xml: &'x mut Xml, name: &str, attributes: &[(&str, &str)]) -> Element<'x> {
    let element = xml.create_element(name.to_owned());
    element.with_attributes(attributes.iter().copied())
}

type Element<'x> = quick_xml::writer::ElementWriter<'x, Vec<u8>>;

/// The description of `interface`; `token` binds it to the resources.
///
/// # Errors
/// None: it is written to memory.
pub(crate) fn xml(interface: &Interface, token: &str, version: FmiVersion) -> io::Result<Vec<u8>> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let tool = concat!("loadtwin ", env!("CARGO_PKG_VERSION"));
    let token_name = match version {
        FmiVersion::V3 => "instantiationToken",
        FmiVersion::V2 => "guid",
    };
    let root = [
        ("fmiVersion", version.name()),
        ("modelName", &interface.machine),
        (token_name, token),
        ("description", "virtual load sensor"),
        ("generationTool", tool),
        ("variableNamingConvention", "flat"),
    ];
    let variables = variables(interface);
    element(&mut xml, "fmiModelDescription", &root).write_inner_content(|xml| {
        co_simulation(xml, interface, version)?;
        units(xml, &variables)?;
        element(xml, "LogCategories", &[]).write_inner_content(|xml| {
            let category = [("name", "logStatusError")];
            element(xml, "Category", &category).write_empty().map(drop)
        })?;
        let step = interface.period_s().to_string();
        element(xml, "DefaultExperiment", &[("stepSize", &step)]).write_empty()?;
        element(xml, "ModelVariables", &[]).write_inner_content(|xml| {
            (variables.iter().enumerate()).try_for_each(|(reference, variable)| match version {
                FmiVersion::V3 => variable_3(xml, reference, variable),
                FmiVersion::V2 => variable_2(xml, reference, variable),
            })
        })?;
        structure(xml, &variables, version)
    })?;
    Ok(xml.into_inner())
}

fn co_simulation(xml: &mut Xml, interface: &Interface, version: FmiVersion) -> io::Result<()> {
    let step = interface.period_s().to_string();
    let attributes: &[_] = match version {
        FmiVersion::V3 => &[
            ("modelIdentifier", library::IDENTIFIER),
            ("canGetAndSetFMUState", "true"),
            ("canSerializeFMUState", "true"),
            ("canHandleVariableCommunicationStepSize", "false"),
            ("fixedInternalStepSize", &step),
        ],
        FmiVersion::V2 => &[
            ("modelIdentifier", library::IDENTIFIER),
            ("canHandleVariableCommunicationStepSize", "false"),
            ("canGetAndSetFMUstate", "true"),
            ("canSerializeFMUstate", "true"),
        ],
    };
    element(xml, "CoSimulation", attributes).write_empty()?;
    Ok(())
}

fn units(xml: &mut Xml, variables: &[Variable]) -> io::Result<()> {
    let mut used: Vec<Unit> = variables.iter().filter_map(|v| v.unit).collect();
    used.sort_unstable_by_key(|unit| unit::name(*unit));
    used.dedup();
    element(xml, "UnitDefinitions", &[]).write_inner_content(|xml| {
        used.iter().try_for_each(|used| {
            let (factor, offset) = (used.to_si(1.0) - used.to_si(0.0), used.to_si(0.0));
            let (factor, offset) = (factor.to_string(), offset.to_string());
            let mut base = unit::exponents(used.quantity()).to_vec();
            if factor != "1" {
                base.push(("factor", &factor));
            }
            if offset != "0" {
                base.push(("offset", &offset));
            }
            let named = [("name", unit::name(*used))];
            element(xml, "Unit", &named)
                .write_inner_content(|xml| element(xml, "BaseUnit", &base).write_empty().map(drop))
                .map(drop)
        })
    })?;
    Ok(())
}

/// Attributes of an element: name and value of each.
type Attributes = Vec<(&'static str, String)>;

/// Causality and variability.
fn kind(variable: &Variable) -> [(&'static str, &'static str); 2] {
    let is_real = variable.role.of_type() == Type::Real;
    let (causality, variability) = match variable.role {
        Role::Time => ("independent", "continuous"),
        role if role.is_input() && is_real => ("input", "continuous"),
        role if role.is_input() => ("input", "discrete"),
        // They change at samples alone.
        _ => ("output", "discrete"),
    };
    [("causality", causality), ("variability", variability)]
}

/// Attributes of a type: start, unit, usual size.
fn typed(variable: &Variable) -> Attributes {
    let mut typed = Vec::new();
    if let Some(unit) = variable.unit {
        typed.push(("unit", unit::name(unit).to_owned()));
    }
    if let Some(nominal) = variable.nominal {
        typed.push(("nominal", nominal.to_string()));
    }
    if variable.role.is_input() {
        let start = match variable.role.of_type() {
            Type::Boolean => variable.role.starts_true().to_string(),
            Type::Real | Type::Integer => "0".to_owned(),
        };
        typed.push(("start", start));
    }
    typed
}

/// What both versions say of a variable: its name and kind, and its type.
fn attributes(reference: usize, variable: &Variable) -> [Attributes; 2] {
    let mut own = vec![
        ("name", variable.name.clone()),
        ("valueReference", reference.to_string()),
    ];
    own.extend(kind(variable).map(|(name, value)| (name, value.to_owned())));
    own.push(("description", variable.description.clone()));
    [own, typed(variable)]
}

fn variable_3(xml: &mut Xml, reference: usize, variable: &Variable) -> io::Result<()> {
    let tag = match variable.role.of_type() {
        Type::Real => "Float64",
        Type::Integer => "Int32",
        Type::Boolean => "Boolean",
    };
    let all = attributes(reference, variable).concat();
    element(xml, tag, &borrowed(&all)).write_empty()?;
    Ok(())
}

fn variable_2(xml: &mut Xml, reference: usize, variable: &Variable) -> io::Result<()> {
    let tag = match variable.role.of_type() {
        Type::Real => "Real",
        Type::Integer => "Integer",
        Type::Boolean => "Boolean",
    };
    let [own, typed] = attributes(reference, variable);
    element(xml, "ScalarVariable", &borrowed(&own))
        .write_inner_content(|xml| element(xml, tag, &borrowed(&typed)).write_empty().map(drop))?;
    Ok(())
}

fn borrowed(attributes: &Attributes) -> Vec<(&'static str, &str)> {
    (attributes.iter())
        .map(|(name, value)| (*name, value.as_str()))
        .collect()
}

/// The outputs; none depends on an input of the same time.
fn structure(xml: &mut Xml, variables: &[Variable], version: FmiVersion) -> io::Result<()> {
    let is_output = |v: &Variable| v.role != Role::Time && !v.role.is_input();
    let outputs: Vec<usize> = (0..variables.len())
        .filter(|i| is_output(&variables[*i]))
        .collect();
    let unknown = |xml: &mut Xml, tag, at: usize| {
        let (name, at) = match version {
            FmiVersion::V3 => ("valueReference", at),
            FmiVersion::V2 => ("index", at + 1),
        };
        let attributes = [(name, &*at.to_string()), ("dependencies", "")];
        element(xml, tag, &attributes).write_empty().map(drop)
    };
    element(xml, "ModelStructure", &[]).write_inner_content(|xml| match version {
        FmiVersion::V3 => {
            outputs
                .iter()
                .try_for_each(|at| unknown(xml, "Output", *at))?;
            outputs
                .iter()
                .try_for_each(|at| unknown(xml, "InitialUnknown", *at))
        }
        FmiVersion::V2 => ["Outputs", "InitialUnknowns"]
            .into_iter()
            .try_for_each(|list| {
                element(xml, list, &[])
                    .write_inner_content(|xml| {
                        outputs
                            .iter()
                            .try_for_each(|at| unknown(xml, "Unknown", *at))
                    })
                    .map(drop)
            }),
    })?;
    Ok(())
}
