//! `loadtwin simulate`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::output::say;
use super::progress::Progress;
use crate::machine::{Bearing, Kind, Machine};
use crate::simulate::{
    Applied, BEARING_EFFECTS, BearingEffect, BearingScenario, BearingSimulation, EFFECTS, Scenario,
    Simulation,
};

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
        if let Some(Kind::Bearing(bearing)) = machine.kind() {
            return self.bearing(&machine, bearing, as_json);
        }
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
        self.say_written(&machine, scenario.name(), rows, started, as_json);
        Ok(())
    }

    fn bearing(&self, machine: &Machine, bearing: &Bearing, as_json: bool) -> anyhow::Result<()> {
        let started = std::time::Instant::now();
        let (scenario, usual_s) = BearingScenario::by_name(&self.scenario)?;
        let effects = (self.effect.iter())
            .map(|text| text.parse())
            .collect::<Result<Vec<BearingEffect>, _>>()?;
        let simulation = BearingSimulation::new(
            machine,
            bearing,
            scenario,
            self.duration_s.unwrap_or(usual_s),
            self.seed,
            self.individual,
            &effects,
        )?;
        let rows = simulation.rows();
        let progress = Progress::new("simulate");
        simulation.write(&self.output, |part| progress.show(part))?;
        self.say_written(machine, &self.scenario, rows, started, as_json);
        Ok(())
    }

    fn say_written(
        &self,
        machine: &Machine,
        scenario: &str,
        rows: u64,
        started: std::time::Instant,
        as_json: bool,
    ) {
        if as_json {
            let report = json!({
                "machine": machine.name,
                "recording": self.output,
                "scenario": scenario,
                "seed": self.seed,
                "samples": rows,
                "rate_hz": machine.rate_hz,
                "seconds": started.elapsed().as_secs_f64(),
            });
            say!("{report}");
        } else {
            say!(
                "{}: {rows} samples at {} Hz",
                self.output.display(),
                machine.rate_hz
            );
        }
    }
}

/// Scenarios and effects, for the long help.
fn lists() -> String {
    let mut text = "Scenarios:\n".to_owned();
    for (name, what) in Scenario::all().chain(BearingScenario::all()) {
        text += &format!("  {name:<20}{what}\n");
    }
    text += "\nEffects, and what strength 1 is:\n";
    for effect in EFFECTS {
        text += &format!("  {:<20}{}\n", effect.name, effect.typical);
    }
    for (name, what) in BEARING_EFFECTS {
        text += &format!("  {name:<20}{what}\n");
    }
    text
}
