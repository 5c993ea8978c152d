//! Replay of an archive: recordings of many machines over many days, with the state of estimator and
//! load counts carried from day to day.
//!
//! ```text
//! archive/recordings/machine=M/day=D/*.parquet --replay--> results/estimates/machine=M/day=D/*.parquet
//!                                              --sums----> results/days/machine=M/days.parquet
//! all machines --write_outcome--> machines.parquet, faults.parquet, contradicting.csv, page/
//! ```
//!
//! [`run`] works with threads of one computer. An engine with many computers hands out the
//! [`MachineTask`]s of [`prepared`] to [`replay_machine`], and their rows to [`write_outcome`].
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

mod carried_state;
mod complete_file;
mod day;
mod day_replay;
mod days_table;
mod described_machine;
mod description_table;
mod error;
mod layout;
mod load_counting;
mod machine_history;
mod machine_page;
mod options;
mod outcome;
mod overview;
mod run;
mod table;
mod verdict;

pub use description_table::Entry;
pub use error::{ArchiveError, message};
pub use machine_history::MachineTask;
pub use options::{Columns, Options};
pub use outcome::{Figures, write_outcome};
pub use overview::{Fault, Overview};
pub use run::{Watch, prepared, replay_machine, run};
pub use verdict::Verdict;
