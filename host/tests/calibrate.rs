//! Calibration of simulated gearboxes with displaced, scaled, swapped, dead or stuck gauges:
//! positions are found within 0.1 degrees and gains within 1 %, faults are named, too little data
//! is refused; the calibrated description of `loadtwin calibrate` estimates better.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::Command;

use loadtwin::calibrate::{Gauge, GaugeFault, MapSource, Observations, calibrate};
use loadtwin::image_build::Sensors;
use loadtwin::machine::Machine;
use loadtwin::replay::{Figures, run};
use loadtwin::simulate::{Applied, Scenario, Simulation};

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/gearbox");

/// A folder with the example's machine as described and as it is.
struct Bench {
    folder: tempfile::TempDir,
}

/// A map's column: name and values.
type Column = (String, Vec<f64>);

impl Bench {
    /// `change` alters the sensitivity maps of the machine that is recorded.
    fn new(change: impl Fn(&mut Vec<Column>)) -> Self {
        let bench = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let map = std::fs::read_to_string(format!("{EXAMPLE}/sensitivity.csv")).unwrap();
        let mut lines = map.lines().filter(|line| !line.starts_with('#'));
        let header: Vec<&str> = lines.next().unwrap().split(',').collect();
        let rows: Vec<Vec<f64>> = lines
            .map(|line| line.split(',').map(|x| x.parse().unwrap()).collect())
            .collect();
        let mut columns: Vec<Column> = header
            .iter()
            .enumerate()
            .map(|(j, name)| {
                (
                    name.split(' ').next().unwrap().into(),
                    rows.iter().map(|row| row[j]).collect(),
                )
            })
            .collect();
        change(&mut columns);
        let mut text = header.join(",");
        for i in 0..rows.len() {
            let cells: Vec<String> = columns.iter().map(|c| c.1[i].to_string()).collect();
            text += &format!("\n{}", cells.join(","));
        }
        let example = std::fs::read_to_string(format!("{EXAMPLE}/machine.toml")).unwrap();
        std::fs::write(bench.path("sensitivity.csv"), map).unwrap();
        std::fs::write(bench.path("actual.csv"), text).unwrap();
        std::fs::write(bench.path("machine.toml"), &example).unwrap();
        let actual = example.replace("\"sensitivity.csv\"", "\"actual.csv\"");
        std::fs::write(bench.path("actual.toml"), actual).unwrap();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn machine(&self) -> Machine {
        Machine::load(&self.path("machine.toml")).unwrap()
    }

    fn record(&self, scenario: &str, duration_s: f64, seed: u64, effects: &[&str]) -> PathBuf {
        let path = self.path(&format!("{scenario}-{seed}.parquet"));
        let mut scenario = Scenario::by_name(scenario).unwrap();
        scenario.duration_s = duration_s;
        let effects = Applied::list(effects).unwrap();
        let machine = Machine::load(&self.path("actual.toml")).unwrap();
        Simulation::new(&machine, &scenario, seed, Some(7), &effects)
            .unwrap()
            .write(&path, |_| ())
            .unwrap();
        path
    }

    fn calibrate(&self, recordings: &[PathBuf]) -> Result<Vec<Gauge>, String> {
        let machine = self.machine();
        let observations =
            Observations::read(&machine, recordings, |_| ()).map_err(|e| e.to_string())?;
        calibrate(
            &machine,
            &observations,
            &recordings[0],
            0.1,
            MapSource::Placed,
        )
        .map_err(|e| e.to_string())
    }

    fn gauge<'a>(&self, gauges: &'a [Gauge], name: &str) -> &'a Gauge {
        let machine = self.machine();
        gauges
            .iter()
            .find(|g| machine.channels[g.channel].name == name)
            .unwrap()
    }
}

fn scale(columns: &mut [Column], name: &str, factor: f64) {
    for m in column(columns, name) {
        *m *= factor;
    }
}

fn column<'a>(columns: &'a mut [Column], name: &str) -> &'a mut Vec<f64> {
    &mut columns.iter_mut().find(|c| c.0 == name).unwrap().1
}

/// NMAE of the main shaft with one set of sensors [%].
fn nmae(machine: &Path, set: &str, recording: &Path) -> f64 {
    let machine = Machine::load(machine).unwrap();
    let sensors = Sensors::choose(&machine, Some(set)).unwrap();
    let mut figures = Figures::new(&machine);
    run(&machine, &sensors, recording, |sample, estimate, _| {
        figures.push(sample, estimate);
    })
    .unwrap();
    figures.loads().next().unwrap().1.nmae_percent["full"].unwrap()
}

#[test]
fn position_gain_and_offset_of_a_gauge_are_found() {
    let shift = 8; // entries of 512: 5.6 degrees
    let bench = Bench::new(|columns| {
        column(columns, "rg1").rotate_right(shift);
        scale(columns, "rg1", 1.2);
        column(columns, "ta1").rotate_left(2);
    });
    let ramps = bench.record("torque-ramps", 60.0, 1, &["gauge-offset@ta2=4"]);
    let gauges = bench.calibrate(&[ramps]).unwrap();
    let placed = |name| bench.gauge(&gauges, name).placement.as_ref().unwrap();
    let degrees = 360.0 / 512.0;
    let (rg1, ta1, ta2) = (placed("rg1"), placed("ta1"), placed("ta2"));
    assert!(
        (rg1.shift_rad.to_degrees() - 8.0 * degrees).abs() < 0.1,
        "{rg1:?}"
    );
    assert!((rg1.gain - 1.2).abs() < 0.01, "{rg1:?}");
    assert!(
        rg1.mae < 0.02 * rg1.mae_before,
        "{} {}",
        rg1.mae,
        rg1.mae_before
    );
    assert!(
        (ta1.shift_rad.to_degrees() + 2.0 * degrees).abs() < 0.1,
        "{ta1:?}"
    );
    assert!((ta1.gain - 1.0).abs() < 2e-3, "{ta1:?}");
    let surface = bench.gauge(&gauges, "ta2").surface.as_ref().unwrap();
    assert!((surface.offset - ta2.offset).abs() < 2e-8);
    assert!(
        ta2.offset.abs() > 1e-7,
        "the gauge was given an offset: {}",
        ta2.offset
    );
    assert!(surface.adjusted_r2 > 0.999 && (0.25e-6..0.35e-6).contains(&surface.rmse));
    // The described noise, 0.3 um/m, is all that is left.
    let noise = bench.gauge(&gauges, "ta2").noise.as_ref().unwrap();
    assert!(
        noise
            .plain
            .iter()
            .all(|sigma| (0.2e-6..0.6e-6).contains(sigma))
    );
    assert!(gauges.iter().all(|g| g.fault.is_none()));
}

#[test]
fn bad_gauges_are_named() {
    let bench = Bench::new(|columns| {
        scale(columns, "ta1", 0.01);
        scale(columns, "ta2", -1.0);
        let rg2 = column(columns, "rg2").clone();
        let rg4 = std::mem::replace(column(columns, "rg4"), rg2);
        *column(columns, "rg2") = rg4;
    });
    let ramps = bench.record("torque-ramps", 60.0, 1, &["stuck-values@hsh1=2"]);
    let gauges = bench.calibrate(&[ramps]).unwrap();
    let fault = |name| bench.gauge(&gauges, name).fault.clone();
    assert!(
        matches!(fault("ta1"), Some(GaugeFault::Dead(_))),
        "{:?}",
        fault("ta1")
    );
    assert!(
        matches!(fault("ta2"), Some(GaugeFault::WrongSign(_))),
        "{:?}",
        fault("ta2")
    );
    assert!(
        matches!(fault("hsh1"), Some(GaugeFault::Stuck(_))),
        "{:?}",
        fault("hsh1")
    );
    assert_eq!(fault("rg2"), Some(GaugeFault::SwappedWith("rg4".into())));
    assert_eq!(fault("rg4"), Some(GaugeFault::SwappedWith("rg2".into())));
    for name in ["ta3", "ta4", "ta5", "rg1", "rg3", "rg5", "hsh2", "hsh3"] {
        assert_eq!(fault(name), None, "{name}");
    }
}

#[test]
fn a_bridge_recorded_in_millivolts_per_volt_is_calibrated_as_one_in_strain() {
    let bench = Bench::new(|_| ());
    let strain = bench.path("strain.csv");
    let mut scenario = Scenario::by_name("torque-ramps").unwrap();
    scenario.duration_s = 30.0;
    let effects = Applied::list::<&str>(&[]).unwrap();
    Simulation::new(&bench.machine(), &scenario, 1, Some(7), &effects)
        .unwrap()
        .write(&strain, |_| ())
        .unwrap();
    // A full bridge of gauge factor 2: one m/m gives 2000 mV/V.
    let described = std::fs::read_to_string(bench.path("machine.toml")).unwrap();
    let (before, channel) = described.split_once("name = \"ta1\"").unwrap();
    let (fields, rest) = channel.split_once("adc = ").unwrap();
    let (_, rest) = rest.split_once('\n').unwrap();
    let bridge = "bridge = { bridge = \"full-1\", gauge_factor = 2.0, gauge_resistance_ohm = 350.0, \
                  tension_reads = \"positive\" }";
    let text = format!("{before}name = \"ta1\"{fields}adc = {{ lsb = 1e-6 }}\n{bridge}\n{rest}");
    std::fs::write(bench.path("bridge.toml"), text).unwrap();
    let recording = std::fs::read_to_string(&strain).unwrap();
    let mut lines = recording.lines().filter(|line| !line.starts_with('#'));
    let mut header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let ta1 = header.iter().position(|name| *name == "ta1 [m/m]").unwrap();
    header[ta1] = "ta1 [mV/V]";
    let mut text = header.join(",") + "\n";
    for line in lines {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[ta1] = (cells[ta1].parse::<f64>().unwrap() * 2000.0).to_string();
        text += &(cells.join(",") + "\n");
    }
    let ratio = bench.path("ratio.csv");
    std::fs::write(&ratio, text).unwrap();
    let placement = |machine: &str, recording: &PathBuf| {
        let machine = Machine::load(&bench.path(machine)).unwrap();
        let observed =
            Observations::read(&machine, std::slice::from_ref(recording), |_| ()).unwrap();
        let gauges = calibrate(&machine, &observed, recording, 0.1, MapSource::Placed).unwrap();
        bench.gauge(&gauges, "ta1").placement.clone().unwrap()
    };
    let strain = placement("machine.toml", &strain);
    let ratio = placement("bridge.toml", &ratio);
    assert!(
        (ratio.gain - strain.gain).abs() < 1e-5,
        "{ratio:?} {strain:?}"
    );
    assert!(
        (ratio.offset - strain.offset).abs() < 1e-9,
        "{ratio:?} {strain:?}"
    );
}

#[test]
fn too_little_data_is_refused_with_the_reason() {
    let bench = Bench::new(|_| ());
    let constant = bench.record("constant", 20.0, 1, &[]);
    let message = bench
        .calibrate(std::slice::from_ref(&constant))
        .err()
        .unwrap();
    assert!(
        message.contains("torque ramps") && message.contains("varies by"),
        "{message}"
    );
    let short = bench.record("torque-ramps", 1.5, 2, &[]);
    let message = bench.calibrate(&[short]).err().unwrap();
    assert!(message.contains("turn"), "{message}");
    let mut machine = bench.machine();
    machine.references.clear();
    let message = Observations::read(&machine, &[constant], |_| ())
        .err()
        .unwrap()
        .to_string();
    assert!(message.contains("no reference load"), "{message}");
}

#[test]
fn the_calibrated_description_estimates_better_and_keeps_its_comments() {
    let bench = Bench::new(|_| ());
    let ramps = bench.record("torque-ramps", 60.0, 1, &["paper"]);
    let constant = bench.record("constant", 30.0, 2, &["paper"]);
    let start_stop = bench.record("start-stop", 90.0, 3, &["paper"]);
    let (from, to) = (bench.path("machine.toml"), bench.path("better.toml"));
    let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(["calibrate", "--json"])
        .args([&from, &ramps, &constant])
        .arg("-o")
        .arg(&to)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["channels"].as_array().unwrap().len(), 13);
    assert!((report["turns"].as_f64().unwrap() - 86.0 * 2.72 / TAU).abs() < 3.0);
    assert_eq!(
        report["selection"]["ring gear"]["3"]
            .as_array()
            .unwrap()
            .len(),
        3
    );
    let (before, after) = (
        std::fs::read_to_string(&from).unwrap(),
        std::fs::read_to_string(&to).unwrap(),
    );
    for comment in before
        .lines()
        .filter(|line| line.trim_start().starts_with('#'))
    {
        assert!(after.contains(comment), "{comment}");
    }
    for set in ["torque-arm-1", "ring-gear-1", "high-speed-housing-1"] {
        let (was, is) = (nmae(&from, set, &start_stop), nmae(&to, set, &start_stop));
        assert!(is < 10.0 && is < 0.7 * was, "{set}: {was} -> {is}");
    }
    // Of three gauges the line leaves out the one that contradicts, calibrated or not.
    let is = nmae(&to, "torque-arm-3", &start_stop);
    assert!(is < 1.5, "torque-arm-3: {is}");
}

/// A reversed encoder leaves offsets wrong by the drag and fits as well; only the balance shows it.
#[test]
fn an_encoder_that_counts_the_other_way_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let described = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/bench/machine.toml"
    );
    let text = std::fs::read_to_string(described).unwrap();
    let counts = "counts_per_turn = 4096";
    let reversed = text.replace(counts, "counts_per_turn = -4096");
    assert_ne!(text, reversed);
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let right = write("right.toml", &text);
    let reversed = write("reversed.toml", &reversed);
    let bench = Machine::load(&right).unwrap();
    for (name, effects) in [
        ("torque-ramps", &["gain-error", "gauge-offset"][..]),
        ("start-stop", &["coulomb-friction"][..]),
    ] {
        let recording = folder.path().join(format!("{name}.parquet"));
        let mut scenario = Scenario::by_name(name).unwrap();
        scenario.duration_s = 30.0;
        let effects = Applied::list(effects).unwrap();
        Simulation::new(&bench, &scenario, 3, Some(3), &effects)
            .unwrap()
            .write(&recording, |_| ())
            .unwrap();
        let note = |machine: &Path| {
            let machine = Machine::load(machine).unwrap();
            let recordings = std::slice::from_ref(&recording);
            let observed = Observations::read(&machine, recordings, |_| ()).unwrap();
            observed.balance.direction_note(&machine)
        };
        assert_eq!(note(&right), None, "{name}");
        let said = note(&reversed).unwrap_or_default();
        assert!(
            said.contains("if encoder counts the other way"),
            "{name}: {said}"
        );
        // At constant speed inertia and drag are a constant, as a zero error is.
        let is_constant = name == "torque-ramps";
        assert_eq!(
            said.contains("zeros of the references that are"),
            is_constant,
            "{name}: {said}"
        );
    }
}

/// A flange with another gain fits as well: only the balance with the other flange shows it.
#[test]
fn references_that_contradict_each_other_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let described = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/bench/machine.toml"
    );
    let text = std::fs::read_to_string(described).unwrap();
    let bench = Machine::load(Path::new(described)).unwrap();
    let recording = folder.path().join("ramps.parquet");
    let mut scenario = Scenario::by_name("torque-ramps").unwrap();
    scenario.duration_s = 60.0;
    Simulation::new(&bench, &scenario, 3, Some(3), &[])
        .unwrap()
        .write(&recording, |_| ())
        .unwrap();
    let note = |gain: &str| {
        let flange = "name = \"brake_flange\"\n";
        let path = folder.path().join("machine.toml");
        std::fs::write(
            &path,
            text.replace(flange, &format!("{flange}gain = {gain}\n")),
        )
        .unwrap();
        let machine = Machine::load(&path).unwrap();
        let recordings = std::slice::from_ref(&recording);
        let observed = Observations::read(&machine, recordings, |_| ()).unwrap();
        observed.balance.reference_note(&machine)
    };
    assert_eq!(note("1.0"), None);
    let said = note("0.95").unwrap();
    assert!(
        said.contains("the reference of brake_torque times 1.05"),
        "{said}"
    );
}
