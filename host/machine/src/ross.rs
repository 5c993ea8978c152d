//! Reads shaft, discs and bearings of a rotor from a model that ROSS, a Python package for
//! rotordynamics, saved as TOML or JSON. Refuses elements that loadtwin's rotor model lacks.

use std::path::Path;

use serde_json::{Map, Value};
use thiserror::Error;

use loadtwin_files::bounded;

use crate::{BearingAt, Coefficients, Disc, Material, Rotor, RotorBearing, Section};

/// Largest relative difference of two diameters that count as equal.
const EQUAL: f64 = 1e-12;

/// Why a model file cannot be used; one line.
#[derive(Debug, Error)]
pub enum RossError {
    /// The file cannot be read.
    #[error("{0}")]
    Read(#[from] std::io::Error),
    /// Neither TOML nor JSON.
    #[error("neither TOML nor JSON as ROSS saves a rotor")]
    Syntax,
    /// An element lacks a number.
    #[error("{element}: no number {field:?}")]
    Lacks {
        /// Name of the element's table.
        element: String,
        /// What is missing.
        field: &'static str,
    },
    /// An element does what this model cannot.
    #[error("{element}: {what}")]
    Unsupported {
        /// Name of the element's table.
        element: String,
        /// What it does.
        what: &'static str,
    },
}

/// Reads shaft, discs and bearings of the ROSS model (2.x, TOML or JSON) in
/// `path` into `rotor`.
///
/// Lateral motion only: axial and torsional coefficients are not looked at.
///
/// # Errors
/// [`RossError`] for a file that is none, and for elements that are no
/// cylinder, disc or bearing without mass.
pub fn read_ross(path: &Path, rotor: &mut Rotor) -> Result<(), RossError> {
    let text = bounded::read_text(path, bounded::DESCRIPTION)?;
    let tables: Map<String, Value> = serde_json::from_str(&text)
        .ok()
        .or_else(|| toml::from_str(&text).ok())
        .ok_or(RossError::Syntax)?;
    let mut elements: Vec<(usize, Section)> = Vec::new();
    for (name, value) in &tables {
        let Value::Object(fields) = value else {
            continue;
        };
        let element = Element { name, fields };
        let (kind, _) = name.split_once('_').unwrap_or((name, ""));
        match kind {
            "parameters" | "metadata" => {}
            "ShaftElement" | "ShaftElement6DoF" => {
                let node = element.number("n")? as usize;
                elements.push((node, element.section(&mut rotor.materials)?));
            }
            "DiskElement" | "DiskElement6DoF" => rotor.discs.push(Disc {
                node: element.number("n")? as usize,
                mass_kg: element.number("m")?,
                polar_kg_m2: element.number("Ip")?,
                diametral_kg_m2: element.number("Id")?,
            }),
            "BearingElement"
            | "SealElement"
            | "BallBearingElement"
            | "RollerBearingElement"
            | "PlainJournal"
            | "TiltingPad"
            | "MagneticBearingElement" => {
                rotor.bearings.push(element.bearing()?);
            }
            _ => return Err(element.unsupported("an element that this model does not have")),
        }
    }
    elements.sort_by_key(|(node, _)| *node);
    for (k, (node, _)) in elements.iter().enumerate() {
        if *node != k {
            return Err(RossError::Unsupported {
                element: format!("shaft element at node {node}"),
                what: "layered, or a gap in the shaft",
            });
        }
    }
    rotor.sections = elements.into_iter().map(|(_, section)| section).collect();
    Ok(())
}

/// The name of `material` in `materials`, to which it is added unless it is there. A name that
/// belongs to a material of other values gets a number.
fn among(materials: &mut Vec<Material>, material: Material) -> String {
    let first = material.name.clone();
    let mut material = material;
    for k in 2.. {
        match materials.iter().find(|m| m.name == material.name) {
            Some(same) if *same == material => break,
            Some(_) => material.name = format!("{first} {k}"),
            None => {
                materials.push(material.clone());
                break;
            }
        }
    }
    material.name
}

struct Element<'a> {
    name: &'a str,
    fields: &'a Map<String, Value>,
}

impl Element<'_> {
    fn unsupported(&self, what: &'static str) -> RossError {
        RossError::Unsupported {
            element: self.name.into(),
            what,
        }
    }

    fn find(&self, field: &str) -> Option<f64> {
        self.fields.get(field).and_then(Value::as_f64)
    }

    fn number(&self, field: &'static str) -> Result<f64, RossError> {
        self.find(field).ok_or_else(|| RossError::Lacks {
            element: self.name.into(),
            field,
        })
    }

    fn section(&self, materials: &mut Vec<Material>) -> Result<Section, RossError> {
        let near = |a: f64, b: f64| (a - b).abs() <= EQUAL * a.abs().max(b.abs());
        let (outer_m, inner_m) = (self.number("odl")?, self.number("idl")?);
        if !near(outer_m, self.find("odr").unwrap_or(outer_m))
            || !near(inner_m, self.find("idr").unwrap_or(inner_m))
        {
            return Err(self.unsupported("conical; allowed: cylinders, several of them for a cone"));
        }
        if self.find("axial_force").unwrap_or(0.0) != 0.0
            || self.find("torque").unwrap_or(0.0) != 0.0
        {
            return Err(self.unsupported("under axial force or torque; allowed: neither"));
        }
        for effect in ["shear_effects", "rotary_inertia", "gyroscopic"] {
            if self.fields.get(effect) == Some(&Value::Bool(false)) {
                return Err(self.unsupported(
                    "without shear, rotary inertia or gyroscopic effect; allowed: all three",
                ));
            }
        }
        let method = self.fields.get("shear_method_calc").and_then(Value::as_str);
        if method.is_some_and(|method| method != "cowper") {
            return Err(self.unsupported("another shear coefficient; allowed: \"cowper\""));
        }
        let Some(Value::Object(fields)) = self.fields.get("material") else {
            return Err(RossError::Lacks {
                element: self.name.into(),
                field: "material",
            });
        };
        let material = Element {
            name: self.name,
            fields,
        };
        let young_pa = material.number("E")?;
        let poisson = match (material.find("Poisson"), material.find("G_s")) {
            (Some(poisson), _) => poisson,
            (None, Some(shear_pa)) => young_pa / (2.0 * shear_pa) - 1.0,
            (None, None) => material.number("G_s")?,
        };
        let name = (fields.get("name"))
            .and_then(Value::as_str)
            .unwrap_or("shaft");
        let described = Material {
            name: name.to_owned(),
            young_pa,
            density_kg_per_m3: material.number("rho")?,
            poisson,
        };
        let name = among(materials, described);
        Ok(Section {
            length_m: self.number("L")?,
            elements: 1,
            outer_m,
            inner_m,
            material: Some(name),
            alpha_per_s: self.find("alpha").unwrap_or(0.0),
            beta_s: self.find("beta").unwrap_or(0.0),
        })
    }

    /// Coefficient `field` at row `k` of the table; 0 where there is none.
    fn coefficient(&self, field: &str, k: usize) -> f64 {
        match self.fields.get(field) {
            Some(Value::Array(values)) => values
                .get(k)
                .or(values.first())
                .and_then(Value::as_f64)
                .unwrap_or(0.0),
            Some(value) => value.as_f64().unwrap_or(0.0),
            None => 0.0,
        }
    }

    fn coefficients(&self, letter: char, k: usize) -> Coefficients {
        ["xx", "xy", "yx", "yy"]
            .map(|end| self.coefficient(&format!("{letter}{end}"), k))
            .as_chunks::<2>()
            .0
            .try_into()
            .unwrap_or_default()
    }

    fn bearing(&self) -> Result<RotorBearing, RossError> {
        if self
            .coefficients('m', 0)
            .iter()
            .flatten()
            .any(|m| *m != 0.0)
        {
            return Err(self.unsupported("a bearing with mass; allowed: without"));
        }
        if self
            .fields
            .get("n_link")
            .is_some_and(|link| !link.is_null())
        {
            return Err(self.unsupported("linked to another node; allowed: to ground"));
        }
        let node = self.number("n")? as usize;
        let speeds: Vec<f64> = match self.fields.get("frequency") {
            Some(Value::Array(speeds)) => speeds.iter().filter_map(Value::as_f64).collect(),
            _ => Vec::new(),
        };
        Ok(if speeds.len() < 2 {
            RotorBearing {
                node,
                stiffness_n_per_m: Some(self.coefficients('k', 0)),
                damping_n_s_per_m: self.coefficients('c', 0),
                table: Vec::new(),
            }
        } else {
            RotorBearing {
                node,
                stiffness_n_per_m: None,
                damping_n_s_per_m: Coefficients::default(),
                table: speeds
                    .iter()
                    .enumerate()
                    .map(|(k, speed)| BearingAt {
                        speed_rad_s: *speed,
                        stiffness_n_per_m: self.coefficients('k', k),
                        damping_n_s_per_m: self.coefficients('c', k),
                    })
                    .collect(),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_of_one_name_are_distinguished_by_their_values() {
        let steel = |young_pa: f64| Material {
            name: "steel".into(),
            young_pa,
            density_kg_per_m3: 7800.0,
            poisson: 0.3,
        };
        let mut materials = Vec::new();
        let names =
            [2.1e11, 2.0e11, 2.1e11, 2.0e11, 1.9e11].map(|e| among(&mut materials, steel(e)));
        assert_eq!(names, ["steel", "steel 2", "steel", "steel 2", "steel 3"]);
        assert_eq!(materials.len(), 3);
    }
}
