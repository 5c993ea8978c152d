//! `loadtwin simulate`: start and stop, converter grid, index pulse, seeds, individuals,
//! refusals, the shipped recording.

mod effects;

use std::collections::BTreeMap;
use std::path::Path;

use loadtwin::machine::Machine;
use loadtwin::recording::{Reader, Wanted};
use loadtwin::simulate::{Applied, EFFECTS, Scenario, SimulateError, Simulation};

const GEARBOX: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/gearbox/machine.toml"
);

type Columns = BTreeMap<String, Vec<f64>>;

fn gearbox() -> Machine {
    Machine::load(Path::new(GEARBOX)).unwrap()
}

fn collect(simulation: Simulation) -> Columns {
    let names: Vec<String> = simulation
        .columns()
        .iter()
        .map(|c| c.name.clone())
        .collect();
    let mut columns = Columns::new();
    for block in simulation {
        columns.entry("t".into()).or_default().extend(&block.t);
        for (name, values) in names.iter().zip(block.columns) {
            columns
                .entry(name.clone())
                .or_default()
                .extend(values.unwrap());
        }
    }
    columns
}

fn run(
    machine: &Machine,
    scenario: &str,
    duration_s: f64,
    seeds: (u64, u64),
    effects: &[&str],
) -> Columns {
    let mut scenario = Scenario::by_name(scenario).unwrap();
    scenario.duration_s = duration_s;
    let effects: Vec<Applied> = effects.iter().map(|e| e.parse().unwrap()).collect();
    collect(Simulation::new(machine, &scenario, seeds.0, Some(seeds.1), &effects).unwrap())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn std(values: &[f64]) -> f64 {
    let mean = mean(values);
    mean_of(values, |v| (v - mean).powi(2)).sqrt()
}

fn mean_of(values: &[f64], f: impl Fn(f64) -> f64) -> f64 {
    values.iter().map(|v| f(*v)).sum::<f64>() / values.len() as f64
}

/// Bits, so that two missing samples are equal.
fn bits(columns: &Columns) -> BTreeMap<&str, Vec<u64>> {
    columns
        .iter()
        .map(|(n, v)| (n.as_str(), v.iter().map(|x| x.to_bits()).collect()))
        .collect()
}

#[test]
fn start_stop_reads_as_on_the_bench() {
    let c = run(&gearbox(), "start-stop", 90.0, (1, 1), &[]);
    assert_eq!(c["t"].len(), 45_000);
    assert!((c["t"][44_999] - 89.998).abs() < 1e-9);
    let at = |name: &str, from: f64, to: f64| {
        c[name][(from * 500.0) as usize..(to * 500.0) as usize].to_vec()
    };
    // By hand: 312 kNm less 1100 * 2.72 on the main shaft, through the ratio,
    // less 0.3 * 2.72 * 61.8 on the generator's.
    let (main, hss) = (
        mean(&at("torque_main", 30.0, 55.0)),
        mean(&at("torque_hss", 30.0, 55.0)),
    );
    assert!((main / 312e3 - 1.0).abs() < 1e-4, "{main}");
    let expected = (312e3 - 1100.0 * 2.72) / 61.8 - 0.3 * 2.72 * 61.8;
    assert!((hss / expected - 1.0).abs() < 1e-3, "{hss} {expected}");
    // The spike goes negative after 70 s, the end is at rest.
    let lowest = at("torque_main", 70.0, 75.0)
        .into_iter()
        .fold(f64::MAX, f64::min);
    assert!((-0.13..-0.10).contains(&(lowest / 312e3)), "{lowest}");
    assert!(mean(&at("torque_main", 80.0, 90.0)).abs() < 100.0);
    // Gauges: about 100, 200 at the peaks, 40 micrometre/m.
    let span = |name| {
        at(name, 30.0, 55.0)
            .into_iter()
            .fold(0.0, |m: f64, v| m.max(v.abs()))
    };
    assert!((95e-6..115e-6).contains(&span("ta1")), "{}", span("ta1"));
    assert!((200e-6..225e-6).contains(&span("rg1")), "{}", span("rg1"));
    assert!((30e-6..60e-6).contains(&span("hsh2")), "{}", span("hsh2"));
    assert!(
        mean(&at("ta2", 30.0, 55.0)) < -80e-6,
        "left and right have different signs"
    );
    // The housing warms by about a kelvin.
    let warming =
        mean(&at("housing_temperature", 85.0, 90.0)) - mean(&at("housing_temperature", 0.0, 5.0));
    assert!((0.3..3.0).contains(&warming), "{warming}");
}

#[test]
fn values_lie_on_the_grid_of_the_converter_and_stop_at_its_ends() {
    let mut machine = gearbox();
    let adc = machine.channels[0].adc.as_mut().unwrap();
    (adc.bits, adc.zero, adc.lsb) = (16, 1000, 2.5e-9);
    let c = run(&machine, "constant", 4.0, (1, 1), &[]);
    for value in &c["ta1"] {
        let word = value / 2.5e-9 + 1000.0;
        assert!(
            (word - word.round()).abs() < 1e-6 && word < 32_767.5,
            "{word}"
        );
    }
    // 16 bits end at 31767 * 2.5e-9 = 79.4 micrometre/m: saturated most of the time.
    assert!(c["ta1"].iter().filter(|v| **v == 31_767.0 * 2.5e-9).count() > 1000);
    let lsb = machine.channels[1].converter().lsb;
    assert!(c["ta2"].iter().all(|v| (v / lsb).fract() == 0.0));
    assert!(
        c["encoder_hss"]
            .iter()
            .all(|v| v.fract() == 0.0 && (0.0..4_294_967_296.0).contains(v))
    );
}

#[test]
fn the_index_comes_once_a_turn_at_its_angle() {
    let machine = gearbox();
    let c = run(&machine, "constant", 30.0, (3, 3), &[]);
    let pulses: Vec<usize> = (0..c["t"].len())
        .filter(|i| !c["index"][*i].is_nan())
        .collect();
    let turns = (c["encoder_main"][c["t"].len() - 1] - c["encoder_main"][0]) / 16_384.0;
    assert!(
        (pulses.len() as f64 - turns).abs() <= 1.0,
        "{} pulses in {turns} turns",
        pulses.len()
    );
    for pair in pulses.windows(2) {
        let counts = c["index"][pair[1]] - c["index"][pair[0]];
        assert!((counts - 16_384.0).abs() <= 1.0, "{counts}");
    }
    for &row in &pulses {
        // It is latched between this row and the one before.
        assert!(c["index"][row] <= c["encoder_main"][row]);
        assert!(c["index"][row] >= c["encoder_main"][row - 1]);
        // Where the strain is that of the angle of the pulse: the map of ta1
        // there, 0.5 rad after its highest point, over a turn of 1153 samples.
        let near = c["ta1"][row - 1];
        let x: f64 = 3.0 * 0.5;
        let torque = 312e3 - 1100.0 * 2.72;
        let expected =
            104e-6 / 312e3 * torque * (1.0 + 0.045 * x.cos() + 0.015 * (2.0 * x + 0.7).cos());
        assert!((near - expected).abs() < 2e-6, "{near} {expected}");
    }
}

#[test]
fn peaks_pass_three_times_a_turn() {
    let c = run(&gearbox(), "constant", 23.1 * 4.0, (5, 5), &[]);
    let rising = c["rg1"]
        .windows(2)
        .filter(|w| w[0] < 150e-6 && w[1] >= 150e-6)
        .count();
    // 40 turns; noise may add a crossing at the threshold now and then.
    assert!((118..=126).contains(&rising), "{rising}");
}

#[test]
fn the_same_seed_gives_the_same_recording_and_another_one_another() {
    let machine = gearbox();
    let effects = ["parameter-spread=1", "gauge-position=1", "bending-load=1"];
    let a = run(&machine, "turbulent", 2.0, (7, 7), &effects);
    assert_eq!(
        bits(&a),
        bits(&run(&machine, "turbulent", 2.0, (7, 7), &effects))
    );
    let b = run(&machine, "turbulent", 2.0, (8, 7), &effects);
    assert!(["ta1", "rg1", "torque_main"].iter().all(|n| a[*n] != b[*n]));
}

#[test]
fn an_individual_keeps_its_gauges_from_recording_to_recording() {
    let machine = gearbox();
    let effects = ["gauge-position=1", "gauge-offset=1"];
    let level = |seeds| mean(&run(&machine, "constant", 23.1, seeds, &effects)["ta1"]);
    let (a, again, other) = (level((1, 10)), level((2, 10)), level((1, 11)));
    assert!((a - again).abs() < 1e-7, "noise only: {a} {again}");
    assert!((a - other).abs() > 1e-7, "another machine: {a} {other}");
}

#[test]
fn what_is_not_there_is_answered_with_what_is() {
    let machine = gearbox();
    let scenario = Scenario::by_name("constant").unwrap();
    let refused = |text: &str| -> String {
        let effect: Result<Applied, SimulateError> = text.parse();
        match effect {
            Err(error) => error.to_string(),
            Ok(effect) => Simulation::new(&machine, &scenario, 1, None, &[effect])
                .err()
                .unwrap()
                .to_string(),
        }
    };
    let text = refused("rust=1");
    assert!(
        EFFECTS.iter().all(|e| text.contains(e.name)) && text.contains("rust"),
        "{text}"
    );
    assert!(refused("backlash=-1").contains("0 to 100"));
    assert!(refused("backlash=much").contains("much"));
    assert!(refused("gain-error@ta9=1").contains("ta1, "));
    assert!(refused("gain-error@ta9=1").contains("torque arm"));
    assert!(refused("backlash@ta1=1").contains("drivetrain"));
    assert!(refused("encoder-eccentricity@x").contains("encoder_hss"));
    let mut plain = gearbox();
    for channel in &mut plain.channels {
        channel.sensitivity_map = None;
        channel.sensitivity = Some(1e-10);
    }
    let peak = ["peak-overestimated".parse().unwrap()];
    let error = Simulation::new(&plain, &scenario, 1, None, &peak)
        .err()
        .unwrap();
    assert!(error.to_string().contains("nothing"), "{error}");
    assert!(
        Simulation::new(
            &plain,
            &scenario,
            1,
            None,
            &Applied::list(&["paper"]).unwrap()
        )
        .is_ok()
    );
    let mut never = scenario;
    never.duration_s = f64::NAN;
    assert!(Simulation::new(&machine, &never, 1, None, &[]).is_err());
}

/// Machines that are not the example: one load, six inertias, any ratio.
#[test]
fn any_drivetrain_can_be_simulated() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("machine.toml");
    let chain = |n: usize, ratio: f64, moment: f64, stiffness: f64, second: bool| {
        let mut text = String::from(
            "format = 1\nname = \"m\"\nrate_hz = 1000\n[drivetrain]\nnominal_speed_rad_s = 20\n",
        );
        for i in 0..n {
            let r = ratio.powi(i as i32);
            text += &format!(
                "[[drivetrain.inertia]]\nname = \"j{i}\"\nmoment_kg_m2 = {}\nspeed_ratio = {r:?}\ndrag_nm_s_per_rad = 0.01\n",
                moment / (r * r)
            );
        }
        for i in 1..n {
            text += &format!(
                "[[drivetrain.shaft]]\nname = \"s{i}\"\nstiffness_nm_per_rad = {stiffness}\n"
            );
            text += &format!(
                "[[channel]]\nname = \"c{i}\"\nunit = \"Nm\"\nsenses = {{ shaft = \"s{i}\" }}\nsensitivity = 1\nnoise_std = 0.01\nadc = {{ lsb = 1e-4 }}\n"
            );
        }
        text += "[[drivetrain.load]]\nname = \"in\"\ninertia = \"j0\"\ndirection = \"drives\"\nnominal_nm = 100\n";
        text +=
            "[[reference]]\nname = \"r_in\"\nload = \"in\"\nunit = \"kNm\"\ngain = 2\nzero = 0.5\n";
        if second {
            text += &format!(
                "[[drivetrain.load]]\nname = \"out\"\ninertia = \"j{}\"\ndirection = \"brakes\"\nnominal_nm = 100\n",
                n - 1
            );
        }
        text
    };
    for (n, ratio, moment, stiffness, second) in [
        (2, 1.0, 0.5, 5e4, true),
        (3, -4.0, 0.2, 1e3, true),
        (6, 2.0, 1.0, 1e5, true),
        (2, 1.0, 0.1, 1e3, false),
    ] {
        std::fs::write(&path, chain(n, ratio, moment, stiffness, second)).unwrap();
        let machine = Machine::load(&path).unwrap();
        for (scenario, _) in Scenario::all() {
            let c = run(
                &machine,
                scenario,
                6.0,
                (1, 1),
                &["parameter-spread", "backlash", "coulomb-friction"],
            );
            let largest = c["c1"].iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            assert!(
                largest > 0.0 && largest < 500.0,
                "{n} inertias, {scenario}: {largest} Nm"
            );
            if second && scenario == "constant" {
                let (carried, given) = (mean(&c["c1"]), (mean(&c["r_in"]) - 0.5) * 2.0 * 1e3);
                assert!((given - 100.0).abs() < 0.1, "{given}");
                assert!((carried - 98.0).abs() < 0.5, "2 % of friction: {carried}");
            }
        }
    }
    std::fs::write(&path, chain(2, 1.0, 1e-9, 1e9, true)).unwrap();
    let machine = Machine::load(&path).unwrap();
    let scenario = Scenario::by_name("constant").unwrap();
    let error = Simulation::new(&machine, &scenario, 1, None, &[])
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("steps of"), "{error}");
}

/// Whoever changes the plant records the shipped recording anew:
/// `loadtwin simulate examples/gearbox/machine.toml --scenario start-stop --seed 1
/// --effect paper` and an output of that name.
#[test]
fn the_shipped_recording_is_what_the_plant_gives() {
    let machine = gearbox();
    let path = Path::new(GEARBOX).with_file_name("start-stop.parquet");
    let effects = Applied::list(&["paper"]).unwrap();
    let scenario = Scenario::by_name("start-stop").unwrap();
    let mut simulation = Simulation::new(&machine, &scenario, 1, None, &effects).unwrap();
    let columns = simulation.columns().to_vec();
    let wanted: Vec<Wanted> = columns
        .iter()
        .map(|c| Wanted {
            name: &c.name,
            unit: c.unit,
            required: true,
        })
        .collect();
    let shipped = Reader::open(&path, &machine.recording, &wanted).unwrap();
    for block in shipped {
        let (block, expected) = (block.unwrap(), simulation.next().unwrap());
        assert_eq!(block.t, expected.t);
        for ((column, a), b) in columns.iter().zip(&block.columns).zip(&expected.columns) {
            let (a, b) = (a.as_ref().unwrap(), b.as_ref().unwrap());
            // A last digit of another platform's sine may cost one count.
            let count = match column.unit.symbol() {
                "m/m" => machine.channels[0].converter().lsb,
                "counts" => 1.0,
                "°C" => 0.01,
                _ => 10.0,
            };
            for (a, b) in a.iter().zip(b) {
                assert!(a.is_nan() == b.is_nan(), "{}", column.name);
                assert!(
                    a.is_nan() || (a - b).abs() <= 1.01 * count,
                    "{}: {a} {b}",
                    column.name
                );
            }
        }
    }
    assert!(simulation.next().is_none());
    // Nothing in the file says which effects it was made with.
    let bytes = std::fs::read(&path).unwrap();
    for effect in EFFECTS {
        let name = effect.name.as_bytes();
        assert!(
            !bytes.windows(name.len()).any(|w| w == name),
            "{} leaks",
            effect.name
        );
    }
    assert!(bytes.len() < 3_000_000);
}
