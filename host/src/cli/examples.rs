//! Lists example command lines of each command and the meaning of the exit status, and adds both to
//! the help of the commands; the man pages have them, too.

use clap::Command;

/// Meaning of the exit codes.
pub(super) const EXIT_STATUS: [(&str, &str); 3] = [
    ("0", "done"),
    (
        "1",
        "not done; standard error says what is wrong, what is allowed, and the next step",
    ),
    ("2", "wrong usage of the command line"),
];

/// Command lines of each command, without `loadtwin`; "" is the program itself.
const EXAMPLES: [(&str, &[&str]); 26] = [
    ("", &["", "replay machine.toml run.csv", "help diagnose"]),
    ("init", &["init bench.csv -o mine.toml"]),
    (
        "replay",
        &[
            "replay machine.toml run.csv",
            "replay machine.toml run.parquet --sensors all --estimates estimates.parquet --report run.html",
        ],
    ),
    (
        "reduce",
        &["reduce machine.toml loads.csv unit.frd -o maps.csv"],
    ),
    (
        "calibrate",
        &[
            "calibrate machine.toml ramps.parquet -o calibrated.toml --report calibration.html",
            "calibrate machine.toml loads.csv --static motor_flange -o calibrated.toml",
        ],
    ),
    (
        "identify",
        &["identify calibrated.toml ramps.parquet start-stop.parquet -o identified.toml"],
    ),
    (
        "simulate",
        &[
            "simulate machine.toml --scenario start-stop --duration-s 20 --seed 1 -o run.parquet",
            "simulate machine.toml --duration-s 20 --seed 2 --effect gauge-creep -o creep.parquet",
        ],
    ),
    (
        "diagnose",
        &[
            "diagnose machine.toml fit.parquet --validate other.parquet --report diagnosis.html",
            "diagnose machine.toml fit.parquet -o extended.toml",
        ],
    ),
    (
        "life",
        &["life estimates.parquet --exponents 3,9 -o counts.parquet"],
    ),
    ("tables", &["tables --individuals 1 --report tables.html"]),
    (
        "tune",
        &["tune machine.toml constant.parquet ramps.parquet -o tuned.toml"],
    ),
    (
        "zero",
        &["zero machine.toml left_upper unloaded.csv --date 2026-11-26 -o zeroed.toml"],
    ),
    (
        "build",
        &[
            "build machine.toml --key bench.pem -o machine.image",
            "build machine.toml --fmu machine.fmu",
        ],
    ),
    ("key", &["key --machine \"bench 3\" -o bench.pem"]),
    ("node", &["node machine.toml raw.log -o bus.log"]),
    (
        "send",
        &[
            "send machine.toml run.parquet --log raw.log",
            "send machine.toml run.parquet vcan0",
        ],
    ),
    ("twin", &["twin machine.toml vcan0 --log bus.log"]),
    (
        "monitor",
        &[
            "monitor can0 machine.toml",
            "monitor bus.log machine.toml --web",
        ],
    ),
    (
        "record",
        &[
            "record machine.toml can0 -o archive --name press-7",
            "record machine.toml slcan:/dev/ttyACM0@500000 -o archive --mqtt mqtt://broker",
        ],
    ),
    ("prove", &["prove machine.toml bus.log"]),
    ("upload", &["upload machine.image can0"]),
    ("dbc", &["dbc machine.toml > machine.dbc"]),
    ("schema", &["schema > machine.schema.json"]),
    (
        "explain",
        &[
            "explain stuck",
            "explain gauge-creep",
            "explain refuses image",
        ],
    ),
    ("completions", &["completions bash > loadtwin.bash"]),
    ("man", &["man man1"]),
];

/// Command lines of the command called `name`.
pub(super) fn of(name: &str) -> impl Iterator<Item = String> {
    let name = if name == "loadtwin" { "" } else { name };
    (EXAMPLES.iter())
        .filter(move |(command, _)| *command == name)
        .flat_map(|(_, lines)| lines.iter())
        .map(|line| format!("loadtwin {line}").trim_end().to_owned())
}

/// `command` and its subcommands with examples and exit status below their help.
pub(super) fn shown_in_help(command: Command) -> Command {
    with_examples(command).mut_subcommands(with_examples)
}

fn with_examples(command: Command) -> Command {
    let lines: Vec<String> = of(command.get_name())
        .map(|line| format!("  {line}\n"))
        .collect();
    if lines.is_empty() {
        return command;
    }
    let codes = EXIT_STATUS.map(|(code, meaning)| format!("  {code}  {meaning}\n"));
    let own = (command.get_after_long_help().or(command.get_after_help()))
        .map_or_else(String::new, |text| format!("\n{text}"));
    let examples = format!("Examples:\n{}", lines.concat());
    let status = format!("\nExit status:\n{}", codes.concat());
    command
        .after_help(examples.clone())
        .after_long_help(format!("{examples}{status}{own}"))
}

#[cfg(test)]
mod tests {
    use super::super::Cli;
    use clap::{CommandFactory, Parser};

    /// Each command has examples, which it understands.
    #[test]
    fn examples_are_accepted() {
        for command in Cli::command().get_subcommands() {
            let name = command.get_name();
            assert!(
                name == "version" || super::of(name).next().is_some(),
                "{name}"
            );
            for line in super::of(name) {
                let line = line.split(" > ").next().unwrap_or_default();
                let words = line.replace('"', "");
                // The only word with a blank is a name, and its parts are words as well.
                let words = words.replace("bench 3", "bench_3");
                let parsed = Cli::try_parse_from(words.split_whitespace());
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
            }
        }
    }
}
