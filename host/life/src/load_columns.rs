//! Finds the columns of a file whose loads are counted, and their SI units (`Loads`): those named
//! by the caller, else all with columns of standard deviation and fault beside them. Keeps the name
//! of the speed column and the ratio of the shafts.

use std::path::Path;

use loadtwin_recording::{Unit, columns};

use crate::LoadFileError;
use crate::file_layout::layout;

/// Which loads of a file, and the speed beside them.
#[derive(Clone, Debug, PartialEq)]
pub struct Loads {
    /// Names and units.
    pub loads: Vec<(String, Unit)>,
    /// Column of the shaft's speed.
    pub speed: Option<String>,
    /// Turns of the second shaft for one of the first.
    pub ratio: f64,
}

impl Loads {
    /// The columns `names` of a file; where none are given, those with a
    /// standard deviation and a fault beside them.
    ///
    /// # Errors
    /// When the file cannot be read, or has no such column or no unit of it.
    pub fn find(
        path: &Path,
        names: &[String],
        speed: Option<&str>,
        ratio: f64,
    ) -> Result<Self, LoadFileError> {
        let columns = columns(path, &layout(), &[])?;
        let has = |name: &str| columns.iter().any(|column| column.name == name);
        let estimated =
            |name: &String| has(&format!("{name}_std")) && has(&format!("{name}_fault"));
        let names: Vec<String> = if names.is_empty() {
            columns
                .iter()
                .map(|c| c.name.clone())
                .filter(estimated)
                .collect()
        } else {
            names.to_vec()
        };
        if names.is_empty() {
            return Err(LoadFileError::NoLoad(path.into()));
        }
        let unit = |name: String| {
            let column = columns.iter().find(|column| column.name == name);
            let Some(column) = column else {
                let found: Vec<_> = columns.iter().take(20).map(|c| c.name.as_str()).collect();
                let found = found.join(", ");
                return Err(LoadFileError::Missing {
                    file: path.into(),
                    name,
                    found,
                });
            };
            match column.unit.as_deref().map(str::parse::<Unit>) {
                Some(Ok(unit)) => Ok((name, unit.si())),
                _ => Err(LoadFileError::Unit {
                    file: path.into(),
                    name,
                }),
            }
        };
        Ok(Self {
            loads: names.into_iter().map(unit).collect::<Result<_, _>>()?,
            speed: speed.map(Into::into),
            ratio,
        })
    }
}
