//! Commands that are killed at a random time, or whose disk is full at a random byte: outputs
//! are complete or absent.
//!
//! A share of them in every test run; `LOADTWIN_KILLS` and `LOADTWIN_FULL_DISKS` set how many.

use std::collections::BTreeMap;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::bench::{Bench, Contents};

/// A command that writes, as a line of words, with another that writes the same files
/// with other contents.
const JOBS: [(&str, &str); 12] = [
    (
        "replay machine.toml good.csv --estimates e.csv --report e.html",
        "replay machine.toml other.csv --estimates e.csv --report e.html",
    ),
    (
        "replay machine.toml good.csv --estimates e.parquet",
        "replay machine.toml other.csv --estimates e.parquet",
    ),
    (
        "replay machine.toml good.csv --estimates e.mf4",
        "replay machine.toml other.csv --estimates e.mf4",
    ),
    (
        "simulate machine.toml --duration-s 60 -o s.csv",
        "simulate machine.toml --duration-s 60 --seed 2 -o s.csv",
    ),
    (
        "simulate machine.toml --duration-s 60 -o s.parquet",
        "simulate machine.toml --duration-s 60 --seed 2 -o s.parquet",
    ),
    (
        "simulate machine.toml --duration-s 20 -o s.mf4",
        "simulate machine.toml --duration-s 20 --seed 2 -o s.mf4",
    ),
    (
        "build machine.toml --issue 7 --key bench.pem -o m.image",
        "build machine.toml --issue 8 --key bench.pem -o m.image",
    ),
    (
        "zero bridge.toml constant zero.csv --date 2026-11-21 -o z.toml",
        "zero bridge.toml constant zero.csv --date 2026-11-22 -o z.toml",
    ),
    (
        "calibrate machine.toml ramps.parquet -o c.toml --report c.html",
        "calibrate machine.toml ramps.parquet -o c.toml --report c.html --maps measured",
    ),
    (
        "tune machine.toml ramps.parquet --keep-r -o t.toml --response t.csv",
        "tune machine.toml ramps.parquet --keep-r -o t.toml --response t.csv --cutoff 5",
    ),
    (
        "reduce housing.toml loads.csv strains.csv -o maps.csv --patches patches.csv",
        "reduce housing.toml loads.csv strains.csv -o maps.csv --patches patches.csv --entries 64",
    ),
    ("man .", "man ."),
];

/// What a whole output is called between its link and its rename.
const NAMELESS: &str = ".loadtwin-new";

/// How a run ends early.
#[derive(Clone, Copy, Debug)]
enum End {
    /// A signal after a part of the time that a whole run takes.
    Signal(&'static str),
    /// A limit of the size of files, in half of the cases with the signal that comes with it.
    FullDisk { signal: bool },
}

/// A job with the contents of its outputs after each of its two commands.
struct Job {
    bench: Bench,
    lines: [&'static str; 2],
    outputs: [Contents; 2],
    seconds: f64,
}

impl Job {
    fn new(lines: (&'static str, &'static str)) -> Self {
        let bench = Bench::new();
        prepare(&bench, lines.0);
        let before = bench.contents();
        let lines = [lines.0, lines.1];
        let started = Instant::now();
        let outputs = [lines[1], lines[0]].map(|line| {
            bench.succeeds(line);
            let mut after = bench.contents();
            after.retain(|name, _| !before.contains_key(name));
            assert!(!after.is_empty(), "{line}: no output");
            after
        });
        let seconds = started.elapsed().as_secs_f64() / 2.0;
        let [other, own] = outputs;
        assert!(own.keys().eq(other.keys()), "{lines:?}");
        Self {
            bench,
            lines,
            outputs: [own, other],
            seconds,
        }
    }

    /// One run that ends early; gives what is wrong with the folder then, and what a kill between
    /// the two system calls that name an output, or between two outputs, may leave.
    fn run(&self, end: End, rng: &mut ChaCha8Rng) -> (Vec<String>, Vec<String>) {
        let [own, other] = &self.outputs;
        let replaces = rng.random::<bool>();
        for (name, bytes) in other {
            if replaces {
                self.bench.write(name, bytes);
            } else {
                let _ = std::fs::remove_file(self.bench.path(name));
            }
        }
        let before = self.bench.contents();
        self.interrupt(end, own, rng);
        let after = self.bench.contents();
        let (mut wrong, mut between) = (Vec::new(), Vec::new());
        for name in before
            .keys()
            .chain(after.keys().filter(|n| !before.contains_key(*n)))
        {
            let is_whole = match (after.get(name), own.get(name)) {
                (found, Some(own)) => found == Some(own) || found == before.get(name),
                (found, None) => found == before.get(name),
            };
            if !is_whole {
                let said = format!("{}, {end:?}: {name}", self.lines[0]);
                if name == NAMELESS {
                    between.push(said);
                } else {
                    wrong.push(said);
                }
            }
        }
        // What belongs together is of one run.
        let changes = own
            .keys()
            .filter(|name| before.get(*name) != own.get(*name));
        let is_new: Vec<bool> = changes
            .map(|name| after.get(name) == own.get(name))
            .collect();
        if is_new.contains(&true) && is_new.contains(&false) {
            between.push(format!("{}, {end:?}: outputs of two runs", self.lines[0]));
        }
        if !between.is_empty() {
            // The next run puts it right.
            self.bench.succeeds(self.lines[0]);
            if self.bench.contents().contains_key(NAMELESS) {
                wrong.push(format!("{}: {NAMELESS} stays", self.lines[0]));
            }
        }
        (wrong, between)
    }

    fn interrupt(&self, end: End, own: &Contents, rng: &mut ChaCha8Rng) {
        match end {
            End::Signal(signal) => {
                let mut command = self.bench.command(self.lines[0]);
                let command = command.stdout(Stdio::null()).stderr(Stdio::null());
                let mut child = command.spawn().unwrap();
                let after = rng.random::<f64>() * self.seconds * 1.05;
                std::thread::sleep(Duration::from_secs_f64(after));
                let id = child.id().to_string();
                let _ = Command::new("kill").args([signal, &id]).status();
                child.wait().unwrap();
            }
            End::FullDisk { signal } => {
                let most = own.values().map(Vec::len).max().unwrap_or(0);
                // `ulimit -f` counts 512 bytes.
                let limit = rng.random_range(0..=most / 512);
                let trap = if signal { "" } else { "trap '' XFSZ; " };
                let command = self.bench.command(self.lines[0]);
                let mut shell = Command::new("sh");
                let script = format!("{trap}ulimit -f {limit}; exec \"$0\" \"$@\"");
                let shell = (shell.arg("-c").arg(script).arg(command.get_program()))
                    .args(command.get_args())
                    .current_dir(self.bench.folder())
                    .process_group(0);
                let status = shell.stdout(Stdio::null()).stderr(Stdio::null()).status();
                let code = status.unwrap().code();
                assert!(
                    matches!(code, None | Some(0 | 1)),
                    "{}: {code:?}",
                    self.lines[0]
                );
            }
        }
    }
}

/// Makes what the command of `line` reads.
fn prepare(bench: &Bench, line: &str) {
    if line.contains("bench.pem") {
        bench.succeeds("key --machine bench -o bench.pem");
    }
    if line.contains("ramps.parquet") {
        bench.succeeds(
            "simulate machine.toml --scenario torque-ramps --duration-s 20 -o ramps.parquet",
        );
    }
    if line.starts_with("reduce") {
        write_housing(bench);
    }
}

/// One gauge on the gearbox's housing, and a strain under each unit load.
fn write_housing(bench: &Bench) {
    const HOUSING: &str = include_str!("../../../examples/gearbox/housing/machine.toml");
    let (head, channels) = HOUSING.split_once("[[channel]]").unwrap();
    let first = channels.split("[[channel]]").next().unwrap();
    bench.write("housing.toml", format!("{head}[[channel]]{first}"));
    let machine = loadtwin::machine::Machine::load(&bench.path("housing.toml")).unwrap();
    let place = machine.channels[0].place.clone().unwrap();
    let [x, y, z] = place.position_m;
    let mut loads = String::from("place,angle [deg],axis,force [N]\n");
    let mut strains = String::from(
        "step,node,x [m],y [m],z [m],exx [m/m],eyy [m/m],ezz [m/m],exy [m/m],eyz [m/m],ezx [m/m]\n",
    );
    let mut step = 0;
    let mut add = |place: &str, angle: &str, axis: &str| {
        step += 1;
        loads += &format!("{place},{angle},{axis},1\n");
        let e = 1e-12 * f64::from(step);
        strains += &format!("{step},77,{x},{y},{z},{e},{e},{e},0,0,0\n");
    };
    for degrees in (0..360).step_by(15) {
        for axis in ["x", "y", "z"] {
            add("ring", &degrees.to_string(), axis);
        }
    }
    let seats = [
        "sun front",
        "sun rear",
        "middle front",
        "middle rear",
        "fast front",
        "fast rear",
    ];
    for place in seats {
        for axis in ["x", "y", "z"] {
            add(place, "", axis);
        }
    }
    bench.write("loads.csv", loads);
    bench.write("strains.csv", strains);
}

/// How many runs the environment asks for.
fn asked(variable: &str, usual: usize) -> usize {
    std::env::var(variable).map_or(usual, |text| text.parse().unwrap())
}

/// Runs all jobs in turn, `count` times in all.
fn campaign(count: usize, ends: &[End]) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let jobs: Vec<Job> = JOBS.into_iter().map(Job::new).collect();
    let (mut wrong, mut between) = (Vec::new(), Vec::new());
    let mut runs: BTreeMap<&str, usize> = BTreeMap::new();
    for i in 0..count {
        let job = &jobs[i % jobs.len()];
        let (is_wrong, is_between) = job.run(ends[i / jobs.len() % ends.len()], &mut rng);
        wrong.extend(is_wrong);
        between.extend(is_between);
        *runs.entry(job.lines[0]).or_default() += 1;
    }
    println!(
        "{count} runs, {} wrong, {} between two names: {runs:#?}",
        wrong.len(),
        between.len()
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(between.len() * 20 <= count, "{between:#?}");
}

#[test]
fn killed_at_any_time_it_leaves_whole_outputs_and_nothing_hidden() {
    let ends = ["-KILL", "-INT", "-TERM"].map(End::Signal);
    campaign(asked("LOADTWIN_KILLS", 100), &ends);
}

#[test]
fn a_disk_full_at_any_byte_leaves_whole_outputs_and_nothing_hidden() {
    let ends = [false, true].map(|signal| End::FullDisk { signal });
    campaign(asked("LOADTWIN_FULL_DISKS", 40), &ends);
}
