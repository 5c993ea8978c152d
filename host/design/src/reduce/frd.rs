//! Reads nodes and strains of every load case from the ASCII result file (`.frd`) of the
//! finite-element program `CalculiX`, for the nodes that the caller wants.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use crate::reduce::csv_table::complete;
use crate::reduce::{Node, ReduceError};
use loadtwin_recording::Unit;

/// Columns of a node's number, from column 4 on (format of `CalculiX` results).
const NUMBER: usize = 10;

/// Columns of a value.
const VALUE: usize = 12;

/// Reads every block of strain (`*EL FILE` with `E`), one for each load case.
///
/// Source: G. Dhondt, `CalculiX` `CrunchiX` manual 2.20; K. Wittig, `CalculiX`
/// `GraphiX` manual, result file format.
pub fn read(
    path: &Path,
    cases: usize,
    length: Unit,
    wanted: impl Fn([f64; 3]) -> bool,
) -> Result<Vec<Node>, ReduceError> {
    let file = BufReader::new(File::open(path).map_err(ReduceError::read(path))?);
    let mut nodes: Vec<Node> = Vec::new();
    let mut known: HashMap<u64, usize> = HashMap::new();
    let mut block = Block::Other;
    let mut steps = 0;
    for (number, line) in (1..).zip(file.lines()) {
        let line = line.map_err(ReduceError::read(path))?;
        match block {
            Block::Other if line.starts_with("    2C") => block = Block::Nodes,
            Block::Other if line.starts_with(" -4  TOSTRAIN") => {
                steps += 1;
                block = Block::Strain;
            }
            Block::Other => {}
            _ if line.starts_with(" -3") => block = Block::Other,
            Block::Nodes => {
                let (node, [x, y, z]) = values::<3>(path, number, &line)?;
                let position_m = [x, y, z].map(|x| length.to_si(x));
                if wanted(position_m) {
                    known.insert(node, nodes.len());
                    nodes.push(Node {
                        number: node,
                        position_m,
                        strains: vec![[f64::NAN; 6]; cases],
                    });
                }
            }
            Block::Strain if line.starts_with(" -1") && steps <= cases => {
                let (node, strain) = values::<6>(path, number, &line)?;
                if let Some(&i) = known.get(&node) {
                    nodes[i].strains[steps - 1] = strain;
                }
            }
            Block::Strain => {}
        }
    }
    if steps != cases {
        return Err(ReduceError::misfit(
            path,
            format!("found strain of {steps} steps, allowed: {cases}, the number of load cases"),
        ));
    }
    // Nodes for which strain was not asked for are no candidates.
    nodes.retain(|node| node.strains.iter().flatten().any(|e| !e.is_nan()));
    complete(path, nodes)
}

enum Block {
    Nodes,
    Strain,
    Other,
}

/// Node and values of a line ` -1`, in fixed columns.
fn values<const N: usize>(
    path: &Path,
    number: u64,
    line: &str,
) -> Result<(u64, [f64; N]), ReduceError> {
    let field = |from: usize, width: usize| line.get(from..from + width).map(str::trim);
    let parsed = || {
        let node = field(3, NUMBER)?.parse().ok()?;
        let mut values = [0.0_f64; N];
        for (i, value) in values.iter_mut().enumerate() {
            *value = field(3 + NUMBER + VALUE * i, VALUE)?.parse().ok()?;
        }
        Some((node, values))
    };
    parsed().filter(|(_, v)| v.iter().all(|v| v.is_finite())).ok_or_else(|| {
        ReduceError::line(
            path,
            number,
            format!("found {line:?}, allowed: a node and {N} numbers, as *NODE FILE and *EL FILE write them"),
        )
    })
}
