//! `loadtwin reduce`: strain maps from unit loads. Those of an analytic housing agree with the sum
//! of its influences to 1e-5 of the peak; those of the example's housing, solved anew by
//! `CalculiX`, with the solution under all forces at once to 1 % of each gauge's peak.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use loadtwin::image_build::{Sensors, image};
use loadtwin::machine::{Machine, read_columns, resampled, write_columns};
use loadtwin::recording::Unit;
use loadtwin::reduce::{HousingForces, Node, Reduction, read_cases, read_nodes};

const HOUSING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/gearbox/housing");

fn loadtwin(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

/// Influence on the analytic gauge of a unit force at `angle` on the ring: a
/// narrow peak, all others along x, y and z.
fn influence(angle: f64, axis: usize) -> f64 {
    let near = (4.0 * ((angle - 0.7).cos() - 1.0)).exp();
    1e-12 * [3.0 * near + 0.4, near * (angle - 0.5).sin(), 0.2 - near][axis]
}

/// Loads and strains as another FE package might write them: millimetres,
/// microstrain, kilonewtons, steps in any order.
fn write_analytic(folder: &Path, positions: usize) {
    let machine = std::fs::read_to_string(format!("{HOUSING}/machine.toml")).unwrap();
    let (head, channels) = machine.split_once("[[channel]]").unwrap();
    let first = channels.split("[[channel]]").next().unwrap();
    std::fs::write(
        folder.join("machine.toml"),
        format!("{head}[[channel]]{first}"),
    )
    .unwrap();
    let place = Machine::load(&folder.join("machine.toml"))
        .unwrap()
        .channels[0]
        .place
        .clone()
        .unwrap();
    let mut loads = String::from("place,angle [deg],axis,force [kN]\n");
    let mut strains: Vec<String> = Vec::new();
    let [x, y, z] = place.position_m.map(|x| 1e3 * x);
    let [a, b, c] = place.direction;
    let mut add = |place: &str, angle: &str, axis: usize, per_newton: f64| {
        writeln!(loads, "{place},{angle},{},2", ["x", "y", "z"][axis]).unwrap();
        // Uniaxial along the gauge: e = per_newton (d d'), times 2 kN, in um/m.
        let e = per_newton * 2e3 * 1e6;
        let step = strains.len() + 1;
        let tensor = [a * a, b * b, c * c, a * b, b * c, c * a].map(|d| (d * e).to_string());
        strains.push(format!("{step},77,{x},{y},{z},{}\n", tensor.join(",")));
    };
    for i in 0..positions {
        let angle = TAU * i as f64 / positions as f64;
        for axis in 0..3 {
            add(
                "ring",
                &format!("{:.6}", angle.to_degrees()),
                axis,
                influence(angle, axis),
            );
        }
    }
    for name in [
        "sun front",
        "sun rear",
        "middle front",
        "middle rear",
        "fast front",
        "fast rear",
    ] {
        for axis in 0..3 {
            add(name, "", axis, 1e-12 * (1.0 + axis as f64));
        }
    }
    strains.reverse();
    let units = "[um/m]";
    let head = format!(
        "step,node,x [mm],y [mm],z [mm],exx {units},eyy {units},ezz {units},exy {units},eyz {units},ezx {units}\n"
    );
    std::fs::write(folder.join("loads.csv"), loads).unwrap();
    std::fs::write(folder.join("strains.csv"), head + &strains.concat()).unwrap();
}

#[test]
fn a_table_of_unit_loads_becomes_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_analytic(folder, 72);
    let arguments = [
        "reduce",
        "machine.toml",
        "loads.csv",
        "strains.csv",
        "-o",
        "maps.csv",
    ];
    let output = loadtwin(&[&arguments[..], &["--json"]].concat(), folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["load_cases"], 72 * 3 + 18);
    assert_eq!(report["channels"][0]["node"], 77);

    let machine = Machine::load(&folder.join("machine.toml")).unwrap();
    let gears = machine.drivetrain.as_ref().unwrap().gears.as_ref().unwrap();
    let forces = HousingForces::new(gears);
    let seats: f64 = forces
        .bearings
        .iter()
        .map(|[x, y, z]| 1e-12 * (x + 2.0 * y + 3.0 * z))
        .sum();
    let expected = |carrier: f64| {
        let contacts: f64 = forces
            .planets
            .iter()
            .map(|planet| {
                let force = forces.contact.at(carrier + planet);
                let parts = (0..200).map(|i| forces.arc_rad * ((f64::from(i) + 0.5) / 200.0 - 0.5));
                let over_arc = parts.map(|at| {
                    (0..3)
                        .map(|k| force[k] * influence(carrier + planet + at, k))
                        .sum::<f64>()
                });
                over_arc.sum::<f64>() / 200.0
            })
            .sum();
        seats + contacts
    };
    let map = &read_columns(&folder.join("maps.csv"), |_| true).unwrap()[0].1;
    let peak = map.iter().fold(0.0_f64, |peak, m| peak.max(m.abs()));
    for (i, found) in map.iter().enumerate() {
        let expected = expected(TAU * i as f64 / map.len() as f64);
        assert!(
            (found - expected).abs() < 1e-5 * peak,
            "{i}: {found} {expected}"
        );
    }
}

#[test]
fn what_does_not_fit_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // File, what is replaced, by what, and what is said.
    for (file, from, to, says) in [
        (
            "loads.csv",
            "sun rear",
            "sun read",
            "found place \"sun read\", allowed: ring",
        ),
        (
            "loads.csv",
            "ring,15.000000,y",
            "ring,16.000000,y",
            "allowed: 15.0000",
        ),
        (
            "loads.csv",
            "ring,15.000000,y,2",
            "ring,15.000000,y,none",
            "loads.csv:6: force: found \"none\"",
        ),
        (
            "loads.csv",
            "sun rear,,z",
            "sun rear,,y",
            "\"sun rear\" along Y, allowed: 1",
        ),
        (
            "strains.csv",
            "\n90,77,",
            "\n91,77,",
            "strains.csv:2: step: found \"91\", allowed: 1 to 90",
        ),
        (
            "strains.csv",
            "\n90,77,",
            "\n89,77,",
            "node 77 has no strain in step 90",
        ),
        ("strains.csv", "eyy", "eyx", "no column \"eyy\""),
        (
            "machine.toml",
            "ring_teeth = 90",
            "ring_teeth = 87",
            "allowed: 61.8",
        ),
        (
            "machine.toml",
            "sun_teeth = 18",
            "sun_teeth = 19",
            "a multiple of planets",
        ),
        (
            "machine.toml",
            "position_m = [-0.8",
            "position_m = [-9",
            "no node with strain within 0.06 m",
        ),
    ] {
        write_analytic(folder, 24);
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from}");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let output = loadtwin(
            &[
                "reduce",
                "machine.toml",
                "loads.csv",
                "strains.csv",
                "-o",
                "maps.csv",
            ],
            folder,
        );
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(message.contains(says), "{message}");
        assert_eq!(message.trim().lines().count(), 1, "{message}");
        assert!(!folder.join("maps.csv").exists());
    }
}

#[test]
fn five_gauges_fit_an_image() {
    let machine = Machine::load(Path::new(&format!("{HOUSING}/machine.toml"))).unwrap();
    assert_eq!(machine.channels.len(), 101);
    for (group, count) in [
        ("torque arm", 17),
        ("ring gear", 55),
        ("high-speed housing", 29),
    ] {
        let of = machine
            .channels
            .iter()
            .filter(|c| c.group.as_deref() == Some(group));
        assert_eq!(of.count(), count, "{group}");
    }
    let sensors = Sensors::choose(&machine, Some("ring-gear-5")).unwrap();
    assert_eq!(sensors.channels.len(), 5);
    let bytes = image(&machine, &sensors).unwrap().len();
    println!("image of 5 gauges: {bytes} bytes");
    assert!(bytes <= 32 * 1024, "{bytes}");
}

/// Meshes, solves and reduces the example anew. The maps are the committed
/// ones, and equal the solution with all forces at once, each planet between
/// the nodes, to 1 % of every gauge's peak.
#[test]
fn maps_are_those_of_the_solver() {
    let folder = tempfile::tempdir().unwrap();
    let build = folder.path();
    let angles = std::env::var("LOADTWIN_DIRECT_ANGLES").map_or(3, |n| n.parse().unwrap());
    // Two solutions at a time, each in one thread.
    let output = Command::new("make")
        .args(["-j2", "-C", HOUSING, "all", "direct"])
        .arg(format!("BUILD={}", build.display()))
        .arg(format!("COUNT={angles}"))
        .arg(format!("LOADTWIN={}", env!("CARGO_BIN_EXE_loadtwin")))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "make: {said}");
    for file in ["maps.csv", "patches.csv"] {
        let columns = |folder: &Path| read_columns(&folder.join(file), |_| true).unwrap();
        let (committed, rebuilt) = (columns(Path::new(HOUSING)), columns(build));
        assert_eq!(committed.len(), rebuilt.len(), "{file}");
        for ((name, committed), (other, rebuilt)) in committed.iter().zip(&rebuilt) {
            assert_eq!(name, other);
            let off = largest_difference(committed, rebuilt);
            assert!(off < 1e-3, "{file}: {name} is off by {off} of its peak");
        }
    }
    let machine = Machine::load(&build.join("machine.toml")).unwrap();
    let m: Unit = "m".parse().unwrap();
    let loads = build.join("loads.csv");
    let cases = read_cases(&loads).unwrap();
    // At 3600 steps every angle of the direct solution is one of the map's, to 0.05 degrees.
    let reduction = Reduction::new(&machine, &cases, &loads, 3600).unwrap();
    let reduced = read_nodes(&machine, &build.join("unit.frd"), cases.len(), m).unwrap();
    let direct = read_nodes(&machine, &build.join("direct.frd"), angles, m).unwrap();
    let at: Vec<f64> = std::fs::read_to_string(build.join("direct.csv"))
        .unwrap()
        .lines()
        .skip(1)
        .map(|line| line.parse().unwrap())
        .collect();
    let gauges = reduction.gauges(&machine, &reduced, &loads).unwrap();
    let mut worst: Vec<(f64, &str)> = Vec::new();
    for gauge in &gauges {
        let channel = &machine.channels[gauge.channel];
        let direction = channel.place.as_ref().unwrap().direction;
        let node: &Node = direct
            .iter()
            .find(|node| node.number == gauge.node)
            .unwrap();
        let off = at.iter().enumerate().map(|(case, degrees)| {
            let position = 10.0 * degrees;
            let (i, u) = (position as usize, position.fract());
            let map = gauge.described();
            let found = map[i % 3600] * (1.0 - u) + map[(i + 1) % 3600] * u;
            // The direct solution is for 1 kN m.
            (found - 1e-3 * node.along(direction, case)).abs() / gauge.peak()
        });
        worst.push((off.fold(0.0, f64::max), &channel.name));
    }
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!(
        "{} gauges, {angles} angles, parts of the gauge's peak: {:.5?}",
        gauges.len(),
        &worst[..8]
    );
    assert!(gauges.len() == 101 && worst[0].0 < 0.01, "{worst:?}");
}

/// A gauge that really sits at another node of its patch, with another gain: the
/// calibration says where, and the page shows it.
#[test]
fn calibration_finds_the_node_of_the_patch() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = std::fs::read_to_string(format!("{HOUSING}/machine.toml")).unwrap();
    let names = ["ta5", "ta11", "rg2", "rg8", "rg14", "rg20", "hsh10"];
    let mut parts = text.split("[[channel]]");
    let mut short = parts.next().unwrap().to_owned();
    let mut sets = String::new();
    for channel in parts {
        let (channel, set) = channel
            .split_once("[[sensor_set]]")
            .unwrap_or((channel, ""));
        sets += set;
        if names
            .iter()
            .any(|name| channel.contains(&format!("name = \"{name}\"\n")))
        {
            short += &format!("[[channel]]{channel}");
        }
    }
    assert!(sets.contains("ring-gear-5"));
    std::fs::write(folder.join("machine.toml"), &short).unwrap();
    let actual = short.replace("\"maps.csv\"", "\"actual.csv\"");
    std::fs::write(folder.join("actual.toml"), actual).unwrap();
    for file in ["maps.csv", "patches.csv"] {
        std::fs::copy(Path::new(HOUSING).join(file), folder.join(file)).unwrap();
    }
    let patch = read_columns(&folder.join("patches.csv"), |name| name.starts_with("rg2/")).unwrap();
    let (node, map) = patch.last().unwrap();
    let mut columns = read_columns(&folder.join("maps.csv"), |name| names.contains(&name)).unwrap();
    let rg2 = columns.iter_mut().find(|(name, _)| name == "rg2").unwrap();
    rg2.1 = resampled(map, rg2.1.len());
    for (name, map) in &mut columns {
        if name == "rg2" {
            for m in map {
                *m *= 1.1;
            }
        }
        *name += " [m/m/Nm]";
    }
    write_columns(&folder.join("actual.csv"), &columns).unwrap();
    let simulate =
        "simulate actual.toml --scenario torque-ramps --seed 1 --duration-s 60 -o ramps.parquet";
    let output = loadtwin(&simulate.split(' ').collect::<Vec<_>>(), folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let arguments = [
        "calibrate",
        "machine.toml",
        "ramps.parquet",
        "--json",
        "--report",
        "page.html",
    ];
    let output = loadtwin(&arguments, folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for channel in report["channels"].as_array().unwrap() {
        let number = |key: &str| channel[key].as_f64().unwrap();
        let found = format!(
            "{}/{}",
            channel["name"].as_str().unwrap(),
            channel["node"].as_str().unwrap()
        );
        assert!(channel["fault"].is_null(), "{channel}");
        if channel["name"] == "rg2" {
            assert_eq!(&found, node);
            assert!((number("gain") - 1.1).abs() < 0.02, "{channel}");
            assert!(number("mae") < 0.1 * number("mae_before"), "{channel}");
        } else {
            assert!((number("gain") - 1.0).abs() < 0.02, "{channel}");
        }
        assert!(number("adjusted_r2") > 0.9, "{channel}");
    }
    let page = std::fs::read_to_string(folder.join("page.html")).unwrap();
    for section in [
        "Pareto fronts",
        "Simulated and measured",
        "Surfaces",
        "Proposed gauges",
    ] {
        assert!(page.contains(section), "{section}");
    }
    // Two plots a gauge; a front for each group and one overall.
    assert_eq!(page.matches("data-plot=").count(), 2 * names.len() + 4);
}

/// Largest difference of two maps as part of the first one's peak.
fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let peak = a.iter().fold(0.0_f64, |peak, a| peak.max(a.abs()));
    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    off.fold(0.0, f64::max) / peak
}
