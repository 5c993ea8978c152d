//! What is in the model, and what an effect would add, as columns.

use super::effect::Effect;
use super::fit::Prior;
use super::select::Found;
use super::stream::{Columns, Kind, Session};

/// Columns that are in the model anyway: a zero for each strain and angle,
/// the reference's zero and an error of the inertia in the balance, an error
/// of the stiffness in an angle; what is only known roughly; and what a clean
/// machine leaves when it does the same.
fn nuisances(session: &Session, k: usize) -> Vec<Prior> {
    let stream = &session.streams[k];
    let n = session.signals.len();
    let constant = |part: f64| Prior {
        column: vec![1.0; n],
        std: part * stream.scale,
    };
    let mut own = match stream.kind {
        Kind::Strain => vec![constant(1.0)],
        Kind::Balance => {
            let moment: f64 = session
                .signals
                .response
                .as_ref()
                .map_or(0.0, |r| r.bodies.iter().map(|b| b.0).sum());
            vec![
                constant(1e-3),
                Prior {
                    column: session
                        .signals
                        .acceleration
                        .iter()
                        .map(|a| a * moment)
                        .collect(),
                    std: 0.02,
                },
            ]
        }
        Kind::Angle => vec![
            constant(1e3),
            Prior {
                column: session
                    .signals
                    .level
                    .iter()
                    .map(|l| l * stream.scale)
                    .collect(),
                std: 0.1,
            },
        ],
    };
    own.extend(stream.roughly.iter().map(|column| Prior {
        column: column.clone(),
        std: 1.0,
    }));
    let mut clean = stream.clean.clone();
    clean.resize(n, 0.0);
    own.push(Prior {
        column: clean,
        std: 1.0,
    });
    own
}

pub(super) fn joined(sessions: &[Session], of: impl Fn(&Session) -> Vec<f64>) -> Vec<f64> {
    sessions.iter().flat_map(of).collect()
}

/// Nuisances, and each effect found with parameters free in each stream.
pub(super) fn base_columns(sessions: &[Session], found: &[Found]) -> Vec<Vec<Prior>> {
    let mut base: Vec<Vec<Prior>> = (0..sessions[0].streams.len())
        .map(|k| {
            let per_session: Vec<Vec<Prior>> = sessions.iter().map(|s| nuisances(s, k)).collect();
            (0..per_session[0].len())
                .map(|j| Prior {
                    column: per_session
                        .iter()
                        .flat_map(|p| p[j].column.clone())
                        .collect(),
                    std: per_session[0][j].std,
                })
                .collect()
        })
        .collect();
    for f in found {
        let columns = columns(sessions, f.effect, &f.shape, &f.parameters);
        for (linear, columns) in f.effect.linear().iter().zip(columns) {
            for (k, column) in columns.into_iter().enumerate() {
                if !column.is_empty() {
                    base[k].push(Prior {
                        column,
                        std: linear.prior_std,
                    });
                }
            }
        }
    }
    base
}

/// Columns of an effect over all sessions, taken as linear about `parameters`
/// (`[stream]`): `[parameter][stream]`.
pub(super) fn columns(
    sessions: &[Session],
    effect: &dyn Effect,
    shape: &[f64],
    parameters: &[Vec<f64>],
) -> Vec<Columns> {
    let per_session: Vec<Vec<Columns>> = sessions
        .iter()
        .map(|session| {
            effect
                .terms_about(session, shape, parameters)
                .iter()
                .map(|term| {
                    let mut columns = session.columns(term);
                    for (stream, column) in session.streams.iter().zip(&mut columns) {
                        if !effect.acts_on(stream) {
                            column.clear();
                        }
                    }
                    columns
                })
                .collect()
        })
        .collect();
    (0..effect.linear().len())
        .map(|j| {
            (0..sessions[0].streams.len())
                .map(|k| per_session.iter().flat_map(|s| s[j][k].clone()).collect())
                .collect()
        })
        .collect()
}
