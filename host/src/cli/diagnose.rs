//! `loadtwin diagnose`.

use std::path::PathBuf;

use clap::Args;

use super::balance;
use crate::balance::Request;
use crate::machine::Machine;

/// Find which physical effect a model lacks, and add it.
///
/// Looks for the effect in the recordings, reports the error before and after
/// on recordings that took no part in the fit, and writes the improved
/// description.
#[derive(Debug, Args)]
pub struct Diagnose {
    /// Machine description (TOML).
    machine: PathBuf,
    /// Recordings (CSV, Parquet or MDF4) to find the effect in.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Recordings to report the error on; where none is given, a third of each
    /// fitted one is kept for that.
    #[arg(long, num_args = 1.., value_name = "RECORDING")]
    validate: Vec<PathBuf>,
    /// Write the machine description with what was found.
    #[arg(short, long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// Judge a balance below this frequency [Hz]; the description's
    /// `tuning.cutoff_hz` where absent.
    #[arg(long, value_name = "HZ")]
    cutoff_hz: Option<f64>,
}

impl Diagnose {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let machine = Machine::load(&self.machine)?;
        let cutoff_hz = self.cutoff_hz.unwrap_or(machine.tuning.cutoff_hz);
        anyhow::ensure!(
            cutoff_hz > 0.0 && cutoff_hz.is_finite(),
            "--cutoff-hz {cutoff_hz}: allowed: above 0"
        );
        let request = Request {
            machine: &machine,
            fit: &self.recordings,
            validate: &self.validate,
            cutoff_hz,
            machine_out: self.out.as_deref(),
        };
        balance::run(&request, as_json)
    }
}
