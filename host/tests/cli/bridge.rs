//! Strain bridges on the command line: recordings in mV/V, zero and shunt calibration.

use loadtwin::machine::Machine;

use crate::{Bench, MACHINE, recording};

#[test]
fn a_bridge_in_mv_per_v_gives_the_same_torque_as_its_strain() {
    let bench = Bench::new();
    // Full bridge I, gauge factor 2: strain = -ratio / 2; tension reads positive here.
    bench.write(
        "bridge.toml",
        MACHINE.replacen(
            "adc = { lsb = 0.001, stuck_after = 8 }",
            "adc = { lsb = 2e-6 }\nbridge = { bridge = \"full-1\", gauge_factor = 2.0, \
             gauge_resistance_ohm = 350.0, tension_reads = \"positive\" }",
            1,
        ),
    );
    let mut lines = recording(3000)
        .lines()
        .map(str::to_owned)
        .collect::<Vec<_>>();
    lines[0] = lines[0].replace("constant [µm/m]", "constant [mV/V]");
    for line in &mut lines[1..] {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[1] = format!("{:.6}", cells[1].parse::<f64>().unwrap() * 2.0 * 1e-3);
        *line = cells.join(",");
    }
    bench.write("ratio.csv", lines.join("\n") + "\n");
    let nmae = |machine, recording| {
        let output = bench.run(&["replay", machine, recording, "--json"]);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
        json["loads"]["main"]["nmae_percent"]["full"]
            .as_f64()
            .unwrap()
    };
    let strain = nmae("machine.toml", "good.csv");
    let ratio = nmae("bridge.toml", "ratio.csv");
    assert!((strain - ratio).abs() < 0.01, "{strain} {ratio}");
}

#[test]
fn a_bridge_is_zeroed_and_shunted_and_keeps_its_raw_gauge_factor() {
    let bench = Bench::new();
    bench.write(
        "bridge.toml",
        MACHINE.replacen(
            "adc = { lsb = 0.001, stuck_after = 8 }",
            "adc = { lsb = 2e-6 } # as mounted\nbridge = { bridge = \"quarter-1\", gauge_factor = 2.0, \
             gauge_resistance_ohm = 350.0 }",
            1,
        ),
    );
    let constant = |mv_per_v: f64| {
        let rows = (0..100).map(|i| format!("{:.3},{mv_per_v}\n", f64::from(i) / 500.0));
        "t [s],constant [mV/V]\n".to_owned() + &rows.collect::<String>()
    };
    bench.write("zero.csv", constant(0.25));
    // 174.65 kOhm across the gauge of 350 ohm: -rg / (4 rs + 2 rg) = 0.5005 mV/V; read 1 % high.
    let shunt_ratio = 350.0 / (4.0 * 174_650.0 + 700.0) * 1e3;
    bench.write("shunt.csv", constant(0.25 + 1.01 * shunt_ratio));
    let zero = |extra: &[&str]| {
        let mut arguments = vec![
            "zero",
            "bridge.toml",
            "constant",
            "zero.csv",
            "--date",
            "2026-11-21",
        ];
        arguments.extend(["-o", "zeroed.toml", "--json"]);
        arguments.extend(extra);
        bench.run(&arguments)
    };
    let output = zero(&["--shunt", "shunt.csv", "--shunt-ohm", "174650"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    assert!((json["calibration"]["zero_mv_per_v"].as_f64().unwrap() - 0.25).abs() < 1e-9);
    let adjusted = json["calibration"]["gauge_factor"].as_f64().unwrap();
    assert!((adjusted / 2.02 - 1.0).abs() < 2e-3, "{adjusted}");
    let text = std::fs::read_to_string(bench.path("zeroed.toml")).unwrap();
    for part in ["gauge_factor = 2.0", "2026-11-21", "# as mounted"] {
        assert!(text.contains(part), "{text}");
    }
    // The calibrated description is one that loadtwin takes.
    let output = bench.run(&["build", "zeroed.toml", "-o", "x.image"]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let output = zero(&["--shunt", "zero.csv", "--shunt-ohm", "174650"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("um/m"));
    bench.write("zero.csv", constant(5000.0));
    let output = zero(&[]);
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        message.contains("5000") && message.contains("unit"),
        "{message}"
    );
}

/// All bridges at once, from a recording and from the raw samples of a board's log, as near as a word
/// resolves it.
#[test]
fn all_bridges_are_zeroed_from_the_words_of_a_board() {
    let bench = Bench::new();
    let bridge = "adc = { converter = \"ads131m04\", gain = 64, excitation_v = 5, stuck_after = 0 }\n\
                  bridge = { bridge = \"full-1\", gauge_factor = 2.0, gauge_resistance_ohm = 350.0 }";
    let described = MACHINE
        .replace("adc = { lsb = 0.001, stuck_after = 8 }", bridge)
        .replace("adc = { lsb = 0.001 }", bridge);
    let count = described.matches("full-1").count();
    assert!(count >= 2, "{described}");
    bench.write("bridge.toml", described);
    let machine = Machine::load(&bench.path("bridge.toml")).unwrap();
    let names: Vec<&str> = machine.channels.iter().map(|c| c.name.as_str()).collect();
    let expected = |place: usize| 0.25 - 0.1 * place as f64;
    bench.write("zero.csv", unloaded(&machine, expected));
    let send = ["send", "bridge.toml", "zero.csv", "--log", "raw.log"];
    done(&bench, &send);
    let zero = |source: &str, output: &str| -> serde_json::Value {
        let date = "2026-11-21";
        let arguments = [
            "zero",
            "bridge.toml",
            "all",
            source,
            "--date",
            date,
            "-o",
            output,
            "--json",
        ];
        serde_json::from_slice(&done(&bench, &arguments)).unwrap()
    };
    let [recorded, sent] = [("zero.csv", "a.toml"), ("raw.log", "b.toml")].map(|(s, o)| zero(s, o));
    assert_eq!(sent["channels"].as_array().unwrap().len(), count);
    // One word: 1200 mV / 64 / 2^23 / 5 V.
    let word = 1200.0 / 64.0 / 8_388_608.0 / 5.0;
    for (said, within) in [(recorded, 1e-9), (sent, word)] {
        for (place, name) in names.iter().enumerate() {
            let channel = &said["channels"][place];
            assert_eq!(channel["channel"], *name);
            let found = channel["calibration"]["zero_mv_per_v"].as_f64().unwrap();
            assert!((found - expected(place)).abs() <= within, "{name}: {found}");
        }
    }
    done(&bench, &["build", "b.toml", "-o", "b.image"]);
    // A second zero of a bridge with a shunt keeps the adjusted gauge factor.
    let text = std::fs::read_to_string(bench.path("b.toml")).unwrap();
    let shunted = text.replace(
        "date = \"2026-11-21\"",
        "date = \"2026-11-20\", gauge_factor = 2.04",
    );
    assert_ne!(shunted, text);
    bench.write("bridge.toml", shunted);
    let again = zero("raw.log", "d.toml");
    assert_eq!(again["channels"][0]["calibration"]["gauge_factor"], 2.04);
    assert_eq!(again["channels"][0]["samples"], 200);
    // Readings of a machine that turns are no zero.
    let turning = std::fs::read_to_string(bench.path("zero.csv")).unwrap();
    let turning: Vec<String> = (turning.lines().enumerate())
        .map(|(i, line)| line.replace(",7,", &format!(",{},", 7 + i / 20)))
        .collect();
    bench.write("turning.csv", turning.join("\n") + "\n");
    done(
        &bench,
        &["send", "bridge.toml", "turning.csv", "--log", "turning.log"],
    );
    for source in ["turning.csv", "turning.log"] {
        let refused = bench.run(&[
            "zero",
            "bridge.toml",
            "all",
            source,
            "--date",
            "2026-11-21",
            "-o",
            "c.toml",
        ]);
        assert_eq!(refused.status.code(), Some(1));
        assert!(String::from_utf8_lossy(&refused.stderr).contains("counts of motion"));
    }
    bench.write("other.log", "(0.000000) can0 101#AC7900000000E002\n");
    let refused = bench.run(&[
        "zero",
        "bridge.toml",
        "all",
        "other.log",
        "--date",
        "2026-11-21",
        "-o",
        "c.toml",
    ]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        String::from_utf8_lossy(&refused.stderr)
            .contains("found 0 raw samples with identifiers from 0x100 on")
    );
    assert!(!bench.path("c.toml").exists());
}

/// 200 rows of each bridge's output (mV/V) by its place, with an encoder that stands still.
fn unloaded(machine: &Machine, mv_per_v: impl Fn(usize) -> f64) -> String {
    let mut text = "t [s]".to_owned();
    for channel in &machine.channels {
        text += &format!(",{} [mV/V]", channel.name);
    }
    text += ",encoder [counts],index [counts]";
    for i in 0..200 {
        text += &format!("\n{:.3}", f64::from(i) / machine.rate_hz);
        for place in 0..machine.channels.len() {
            text += &format!(",{}", mv_per_v(place));
        }
        text += ",7,";
    }
    text + "\n"
}

/// What a command that succeeds prints.
fn done(bench: &Bench, arguments: &[&str]) -> Vec<u8> {
    let output = bench.run(arguments);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
    output.stdout
}
