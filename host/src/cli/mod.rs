//! The command-line interface of `loadtwin`: lists the commands with their help (`Cli`), parses the
//! arguments, and calls the file that holds the command.

mod build;
mod calibrate;
mod can;
mod demo;
mod diagnose;
mod diagnose_drive;
mod examples;
mod explain;
mod file_plan;
mod identify;
mod init;
mod key;
mod layout_option;
mod life;
mod manual;
mod printing;
mod program;
mod progress;
mod reduce;
mod replay;
mod schema;
mod simulate;
mod spool;
mod tables;
mod tune;
mod tune_output;
mod tune_rotor;
mod unloaded_readings;
mod zero;

use std::ffi::OsString;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

pub use program::program;

/// Virtual load sensor for rotating machines.
///
/// Estimates torque, forces and moments from strain gauges and encoders, with
/// the same bits on the host as on the microcontroller. Without a command it
/// runs the recording that comes with the project.
#[derive(Debug, Parser)]
#[command(version, about, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Print one JSON object on standard output instead of text.
    #[arg(long, global = true)]
    json: bool,
    /// Show no progress on standard error.
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Begin a machine description from a recording.
    Init(init::Init),
    /// Run the estimator on a recording and report its error.
    Replay(replay::Replay),
    /// Turn finite-element strains for unit loads into strain maps over the carrier angle.
    Reduce(reduce::Reduce),
    /// Fit gauges to recordings with reference loads.
    Calibrate(calibrate::Calibrate),
    /// Fit inertias, stiffness, damping and drag to recordings with reference loads.
    Identify(identify::Identify),
    /// Write a recording of a machine that is not there.
    Simulate(simulate::Simulate),
    /// Find which physical effect a model lacks, and add it.
    Diagnose(diagnose::Diagnose),
    /// Count load cycles and compute damage-equivalent loads.
    Life(life::Life),
    /// Reproduce the tables of the gearbox paper on simulated individuals.
    Tables(tables::Tables),
    /// Choose the noise of the filter from recordings and from the wanted bandwidth.
    Tune(tune::Tune),
    /// Zero a strain bridge, and adjust its gauge factor by a shunt resistor.
    Zero(zero::Zero),
    /// Make the model image that firmware and host run.
    Build(build::Build),
    /// Make a key pair that signs model images.
    Key(key::Key),
    /// Stand in for the microcontroller on a CAN bus.
    Node(can::Node),
    /// Put a recording's raw samples on a CAN bus.
    Send(can::Send),
    /// Recompute what a machine sends on a CAN bus and compare it bit for bit.
    Twin(can::Twin),
    /// Watch a machine's frames on a CAN bus.
    Monitor(can::Monitor),
    /// Record a machine on a CAN bus into an archive, and publish its loads over MQTT.
    Record(can::record::Record),
    /// As twin, on a log taken earlier: candump, ASC, BLF, TRC.
    Prove(can::Prove),
    /// Send a signed model image to a board.
    Upload(can::Upload),
    /// Print the DBC file that describes the frames.
    Dbc(can::Dbc),
    /// Print the JSON schema of the machine description.
    Schema,
    /// Explain a flag, an effect or an error.
    Explain(explain::Explain),
    /// Print shell completions.
    Completions(manual::Completions),
    /// Write the man pages.
    Man(manual::Man),
    /// Print the version.
    Version,
}

impl Cli {
    /// Reads the command line. A negative number after an option is its value, which
    /// the command refuses by its range, and no other option.
    ///
    /// # Errors
    /// On wrong usage; also to show the help or the version.
    fn from_arguments(arguments: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let command = examples::shown_in_help(Self::command()).mut_subcommands(|command| {
            command.mut_args(|argument| {
                let takes_value = argument.get_action().takes_values();
                let is_option = argument.get_long().is_some();
                argument.allow_negative_numbers(takes_value && is_option)
            })
        });
        Self::from_arg_matches(&command.try_get_matches_from(arguments)?)
    }

    /// Does what was asked.
    ///
    /// # Errors
    /// What cannot be done with this input, as one line.
    pub fn run(self) -> anyhow::Result<()> {
        let json = self.json;
        if self.quiet {
            progress::hide();
        }
        match self.command {
            None => demo::run(json),
            Some(Command::Init(init)) => init.run(json),
            Some(Command::Replay(replay)) => replay.run(json),
            Some(Command::Reduce(reduce)) => reduce.run(json),
            Some(Command::Calibrate(calibrate)) => calibrate.run(json),
            Some(Command::Identify(identify)) => identify.run(json),
            Some(Command::Simulate(simulate)) => simulate.run(json),
            Some(Command::Diagnose(diagnose)) => diagnose.run(json),
            Some(Command::Life(life)) => life.run(json),
            Some(Command::Tables(tables)) => tables.run(json),
            Some(Command::Tune(tune)) => tune.run(json),
            Some(Command::Zero(zero)) => zero.run(json),
            Some(Command::Build(build)) => build.run(json),
            Some(Command::Key(key)) => key.run(json),
            Some(Command::Node(node)) => node.run(json),
            Some(Command::Send(send)) => send.run(json),
            Some(Command::Twin(twin)) => twin.run(json),
            Some(Command::Monitor(monitor)) => monitor.run(json),
            Some(Command::Record(record)) => record.run(json),
            Some(Command::Prove(prove)) => prove.run(json),
            Some(Command::Upload(upload)) => upload.run(json),
            Some(Command::Dbc(dbc)) => dbc.run(),
            Some(Command::Schema) => schema::run(),
            Some(Command::Explain(explain)) => explain.run(json),
            Some(Command::Completions(completions)) => {
                completions.run();
                Ok(())
            }
            Some(Command::Man(man)) => man.run(),
            Some(Command::Version) => {
                printing::say!("loadtwin {}", env!("CARGO_PKG_VERSION"));
                Ok(())
            }
        }
    }
}
