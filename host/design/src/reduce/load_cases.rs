//! Reads the load cases of the finite-element solution from a CSV table: place, direction and size
//! (N) of the force on the housing in each step.

use std::path::Path;

use crate::reduce::ReduceError;
use crate::reduce::csv_table::Table;

/// Direction of a unit force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Along x.
    X = 0,
    /// Along y.
    Y = 1,
    /// Along z.
    Z = 2,
}

/// One step of the finite-element solution: a force on the housing.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadCase {
    /// `ring`, or the name of a bearing.
    pub place: String,
    /// Where on the ring gear (rad); 0 for a bearing.
    pub angle_rad: f64,
    /// Direction, in the coordinates of the model.
    pub axis: Axis,
    /// Size (N).
    pub force_n: f64,
}

/// Reads load cases in the order of the steps: a CSV table with the columns
/// `place`, `angle [deg]` (empty for bearings), `axis` (x, y or z), and `force`
/// with its unit where it is not 1 N.
///
/// # Errors
/// When the file cannot be read or a cell cannot be used; the error names file and line.
pub fn read_cases(path: &Path) -> Result<Vec<LoadCase>, ReduceError> {
    let mut table = Table::open(path)?;
    let (place, angle, axis) = (
        table.column("place")?,
        table.column("angle")?,
        table.column("axis")?,
    );
    let force = table.column("force").ok();
    let (degree, newton) = (
        table.factor(angle)?,
        force.map(|c| table.factor(c)).transpose()?,
    );
    let mut cases = Vec::new();
    while let Some(row) = table.next()? {
        let name = row.text(place);
        let is_ring = name == "ring";
        cases.push(LoadCase {
            place: name.to_owned(),
            angle_rad: if is_ring {
                row.number(angle)? * degree
            } else {
                0.0
            },
            axis: match row.text(axis) {
                "x" => Axis::X,
                "y" => Axis::Y,
                "z" => Axis::Z,
                other => return Err(row.refused(axis, other, "x, y or z")),
            },
            force_n: match force.zip(newton) {
                Some((column, factor)) => match row.number(column)? * factor {
                    0.0 => return Err(row.refused(column, "0", "a force other than 0")),
                    force => force,
                },
                None => 1.0,
            },
        });
    }
    Ok(cases)
}
