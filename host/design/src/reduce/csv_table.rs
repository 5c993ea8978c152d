//! Reads CSV tables whose header gives units: cells as text or numbers, SI factor of each column,
//! errors with file and line. `read` makes from such a table the nodes and strains of a
//! finite-element model, whatever program computed them.

use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use csv::StringRecord;

use crate::reduce::{Node, ReduceError};
use loadtwin_recording::Unit;

/// Names of the strains' columns, in the order of [`Node::strains`].
const COMPONENTS: [&str; 6] = ["exx", "eyy", "ezz", "exy", "eyz", "ezx"];

/// A CSV file with a header; lines that begin with `#` are comments.
pub struct Table {
    path: PathBuf,
    reader: csv::Reader<File>,
    header: StringRecord,
    row: StringRecord,
}

/// One row.
pub struct Row<'a> {
    path: &'a Path,
    header: &'a StringRecord,
    cells: &'a StringRecord,
}

impl Table {
    /// Opens the table in `path` and reads its header.
    pub fn open(path: &Path) -> Result<Self, ReduceError> {
        let file = File::open(path).map_err(ReduceError::read(path))?;
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(file);
        let header = reader
            .headers()
            .map_err(|error| ReduceError::line(path, 1, error.to_string()))?
            .clone();
        Ok(Self {
            path: path.to_owned(),
            reader,
            header,
            row: StringRecord::new(),
        })
    }

    /// Number of the column called `name`, whatever its unit.
    pub fn column(&self, name: &str) -> Result<usize, ReduceError> {
        self.header
            .iter()
            .position(|title| split(title).0 == name)
            .ok_or_else(|| {
                let there: Vec<&str> = self.header.iter().map(|title| split(title).0).collect();
                ReduceError::line(
                    &self.path,
                    1,
                    format!("no column {name:?}; there are {}", there.join(", ")),
                )
            })
    }

    /// SI value of one unit of a column; 1 where the header gives none.
    pub fn factor(&self, column: usize) -> Result<f64, ReduceError> {
        let (_, unit) = split(&self.header[column]);
        unit.map_or(Ok(1.0), |unit| {
            unit.parse::<Unit>()
                .map(|unit| unit.to_si(1.0))
                .map_err(|error| ReduceError::line(&self.path, 1, error.to_string()))
        })
    }

    /// The next row; none at the end.
    pub fn next(&mut self) -> Result<Option<Row<'_>>, ReduceError> {
        match self.reader.read_record(&mut self.row) {
            Ok(true) => Ok(Some(Row {
                path: &self.path,
                header: &self.header,
                cells: &self.row,
            })),
            Ok(false) => Ok(None),
            Err(error) => {
                let line = error.position().map_or(0, csv::Position::line);
                Err(ReduceError::line(&self.path, line, error.to_string()))
            }
        }
    }
}

impl Row<'_> {
    /// The cell in a column; empty where the row is shorter.
    pub fn text(&self, column: usize) -> &str {
        self.cells.get(column).unwrap_or("")
    }

    /// The finite number in a column, in the unit of the header.
    pub fn number(&self, column: usize) -> Result<f64, ReduceError> {
        let text = self.text(column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.refused(column, text, "a finite number")),
        }
    }

    /// Error about a cell.
    pub fn refused(&self, column: usize, found: &str, allowed: &str) -> ReduceError {
        let line = self.cells.position().map_or(0, csv::Position::line);
        let name = split(&self.header[column]).0;
        ReduceError::line(
            self.path,
            line,
            format!("{name}: found {found:?}, allowed: {allowed}"),
        )
    }
}

/// Name and unit of a column, from `name [unit]`.
fn split(title: &str) -> (&str, Option<&str>) {
    match title.split_once('[') {
        Some((name, unit)) => (name.trim(), Some(unit.trim_end_matches(']').trim())),
        None => (title.trim(), None),
    }
}

/// Reads strains from a table with the columns `step` (from 1), `node`, `x`, `y`,
/// `z` with their unit, and the tensor strain `exx` to `ezx`: a row for each
/// node and step, in any order.
pub fn read(
    path: &Path,
    cases: usize,
    wanted: impl Fn([f64; 3]) -> bool,
) -> Result<Vec<Node>, ReduceError> {
    let mut table = Table::open(path)?;
    let (step, node) = (table.column("step")?, table.column("node")?);
    let mut place = [(0, 1.0); 3];
    for (slot, name) in place.iter_mut().zip(["x", "y", "z"]) {
        let column = table.column(name)?;
        *slot = (column, table.factor(column)?);
    }
    let mut strain = [(0, 1.0); 6];
    for (slot, name) in strain.iter_mut().zip(COMPONENTS) {
        let column = table.column(name)?;
        *slot = (column, table.factor(column)?);
    }
    let mut nodes: Vec<Node> = Vec::new();
    let mut known: HashMap<u64, usize> = HashMap::new();
    while let Some(row) = table.next()? {
        let whole = |column: usize, least: u64, most: u64| match row.text(column).parse::<u64>() {
            Ok(n) if (least..=most).contains(&n) => Ok(n),
            _ => Err(row.refused(column, row.text(column), &format!("{least} to {most}"))),
        };
        let mut position_m = [0.0; 3];
        for (x, (column, factor)) in position_m.iter_mut().zip(place) {
            *x = row.number(column)? * factor;
        }
        if !wanted(position_m) {
            continue;
        }
        let number = whole(node, 0, u64::MAX)?;
        let case = whole(step, 1, cases as u64)? as usize - 1;
        let i = *known.entry(number).or_insert_with(|| {
            nodes.push(Node {
                number,
                position_m,
                strains: vec![[f64::NAN; 6]; cases],
            });
            nodes.len() - 1
        });
        for (e, (column, factor)) in nodes[i].strains[case].iter_mut().zip(strain) {
            *e = row.number(column)? * factor;
        }
    }
    complete(path, nodes)
}

/// Refuses nodes that lack a step.
pub fn complete(path: &Path, nodes: Vec<Node>) -> Result<Vec<Node>, ReduceError> {
    for node in &nodes {
        let lacks = node
            .strains
            .iter()
            .position(|e| e.iter().any(|e| e.is_nan()));
        if let Some(case) = lacks {
            return Err(ReduceError::misfit(
                path,
                format!("node {} has no strain in step {}", node.number, case + 1),
            ));
        }
    }
    Ok(nodes)
}
