//! Stepwise selection of effects by cross-validated evidence: ranking, search of parameters,
//! equivalence, relevance and hold-out of candidates. The verdict is in `assessment`.
//!
//! The limits here and of the verdict were set with benchmark seeds up to 243; 257 and 263 took no part
//! (docs/lab/results.md).

pub mod candidates;
pub mod equivalence;
pub mod holdout;
pub mod model_error;
pub mod parameter_search;
pub mod relevance;
pub mod score;
mod simplex_search;
pub mod stepwise;
