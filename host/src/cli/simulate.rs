//! The command `loadtwin simulate`: writes a recording of a simulated drivetrain, rotor or bearing
//! for a scenario, a seed and chosen effects, and lists scenarios and effects in its help. The
//! simulations are in the crate `loadtwin_simulate`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::printing::{say, shown};
use super::progress::Progress;
use crate::machine::{Bearing, Kind, Machine, Rotor};
use crate::recording::SIMULATED;
use crate::simulate::{
    Applied, BEARING_EFFECTS, BearingEffect, BearingScenario, BearingSimulation, EFFECTS,
    ROTOR_EFFECTS, ROTOR_SCENARIOS, RotorEffect, RotorScenario, RotorSimulation, Scenario,
    Simulation,
};

/// Write a recording of a machine that is not there, from an independent,
/// finer plant.
#[derive(Debug, Args)]
#[command(after_long_help = lists())]
pub struct Simulate {
    /// Machine description (TOML).
    machine: PathBuf,
    /// What the bench does; see the list below. Where absent: start-stop; of a rotor constant, of
    /// a bearing lc1.
    #[arg(long, value_name = "NAME")]
    scenario: Option<String>,
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
    #[command(flatten)]
    replace: Replace,
}

impl Simulate {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = Instant::now();
        Plan::new(self.replace)
            .description(&self.machine)
            .writes("--output", Some(&self.output), SIMULATED)
            .check(as_json)?;
        let machine = Machine::load(&self.machine)?;
        match machine.kind() {
            Some(Kind::Rotor(rotor)) => return self.run_rotor(&machine, rotor, started, as_json),
            Some(Kind::Bearing(bearing)) => {
                return self.run_bearing(&machine, bearing, started, as_json);
            }
            _ => {}
        }
        let mut scenario = Scenario::by_name(self.scenario_or("start-stop"))?;
        if let Some(duration_s) = self.duration_s {
            scenario.duration_s = duration_s;
        }
        let effects = Applied::list(&self.effect)?;
        let simulation =
            Simulation::new(&machine, &scenario, self.seed, self.individual, &effects)?;
        let rows = simulation.rows();
        let progress = Progress::new("simulate");
        simulation.write(&self.output, |part| progress.show(part))?;
        self.say(&machine, scenario.name(), rows, started, as_json);
        Ok(())
    }

    fn run_rotor(
        &self,
        machine: &Machine,
        rotor: &Rotor,
        started: Instant,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let effects = (self.effect.iter())
            .map(|text| text.parse())
            .collect::<Result<Vec<RotorEffect>, _>>()?;
        let individual = self.individual.unwrap_or(self.seed);
        let name = self.scenario_or("constant");
        let scenario = RotorScenario {
            seed: self.seed,
            ..RotorScenario::by_name(name, rotor, individual, self.duration_s)?
        };
        let simulation =
            RotorSimulation::with_effects(machine, rotor, scenario, individual, &effects)?;
        let rows = simulation.rows();
        let progress = Progress::new("simulate");
        simulation.write(&self.output, |part| progress.show(part))?;
        self.say(machine, name, rows, started, as_json);
        Ok(())
    }

    fn run_bearing(
        &self,
        machine: &Machine,
        bearing: &Bearing,
        started: Instant,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let name = self.scenario_or("lc1");
        let (scenario, usual_s) = BearingScenario::by_name(name)?;
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
        self.say(machine, name, rows, started, as_json);
        Ok(())
    }

    fn scenario_or<'a>(&'a self, usual: &'a str) -> &'a str {
        self.scenario.as_deref().unwrap_or(usual)
    }

    fn say(&self, machine: &Machine, scenario: &str, rows: u64, started: Instant, as_json: bool) {
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let report = json!({
                "machine": machine.name,
                "recording": shown(&self.output),
                "scenario": scenario,
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
    }
}

/// Scenarios and effects, for the long help. Each description is on a line of its
/// own: where that is wrapped, it goes on below itself and not below the names.
fn lists() -> String {
    let list = |heading: &str, entries: &[(&str, &str)]| {
        let line = |(name, what): &(&str, &str)| format!("  {name}\n          {what}\n");
        let lines: String = entries.iter().map(line).collect();
        format!("{heading}:\n{lines}\n")
    };
    let effects: Vec<_> = EFFECTS.iter().map(|e| (e.name, e.typical)).collect();
    [
        list("Scenarios", &Scenario::all().collect::<Vec<_>>()),
        list(
            "Scenarios of a bearing",
            &BearingScenario::all().collect::<Vec<_>>(),
        ),
        list("Scenarios of a rotor", &ROTOR_SCENARIOS),
        list("Effects, and what strength 1 is", &effects),
        list("Effects of a rotor", &ROTOR_EFFECTS),
        list("Effects of a bearing", &BEARING_EFFECTS),
    ]
    .concat()
}
