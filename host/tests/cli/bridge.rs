//! Strain bridges on the command line: recordings in mV/V, zero and shunt calibration.

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
