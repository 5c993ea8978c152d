//! `loadtwin simulate`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::output::say;
use super::progress::Progress;
use crate::machine::Machine;
use crate::simulate::{Applied, EFFECTS, Scenario, Simulation};

/// Write a recording of a machine that is not there, from an independent,
/// finer plant.
#[derive(Debug, Args)]
#[command(after_long_help = lists())]
pub struct Simulate {
    /// Machine description (TOML).
    machine: PathBuf,
    /// What the bench does; see the list below.
    #[arg(long, value_name = "NAME", default_value = "start-stop")]
    scenario: String,
    /// Draws the noise, and the machine's individual where that is not given.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Draws the machine's individual: parameters, positions, offsets.
    #[arg(long, value_name = "N")]
    individual: Option<u64>,
    /// Adds an effect that the recording does not declare: NAME, NAME=STRENGTH
    /// or NAME@CHANNEL=STRENGTH, `paper` for those of the paper's test bench.
    #[arg(long, value_name = "EFFECT")]
    effect: Vec<String>,
    /// Length of the recording [s]; the scenario's own where absent.
    #[arg(long, value_name = "S")]
    duration_s: Option<f64>,
    /// The recording (.csv, .parquet or .mf4).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Simulate {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = std::time::Instant::now();
        let machine = Machine::load(&self.machine)?;
        let mut scenario = Scenario::by_name(&self.scenario)?;
        if let Some(duration_s) = self.duration_s {
            scenario.duration_s = duration_s;
        }
        let effects = Applied::list(&self.effect)?;
        let simulation =
            Simulation::new(&machine, &scenario, self.seed, self.individual, &effects)?;
        let rows = simulation.rows();
        let progress = Progress::new("simulate");
        simulation.write(&self.output, |part| progress.show(part))?;
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let report = json!({
                "machine": machine.name,
                "recording": self.output,
                "scenario": scenario.name(),
                "seed": self.seed,
                "samples": rows,
                "rate_hz": machine.rate_hz,
                "seconds": seconds,
            });
            say!("{report}");
        } else {
            say!(
                "{}: {rows} samples at {} Hz",
                self.output.display(),
                machine.rate_hz
            );
        }
        Ok(())
    }
}

/// Scenarios and effects, for the long help.
fn lists() -> String {
    let mut text = "Scenarios:\n".to_owned();
    for (name, what) in Scenario::all() {
        text += &format!("  {name:<20}{what}\n");
    }
    text += "\nEffects, and what strength 1 is:\n";
    for effect in EFFECTS {
        text += &format!("  {:<20}{}\n", effect.name, effect.typical);
    }
    text
}
