//! `loadtwin replay --archive` on the real binary and simulated gearboxes: results have the bits of
//! one replay, whatever the threads, and whatever is damaged, late, killed, without description or
//! on a full disk. The remaining life by a design spectrum is that by hand.

mod bench;

use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use arrow_array::Array;
use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;

use bench::{Bench, DAYS, Files, RECORDING, date, rows};

/// What belongs to one machine.
fn of_machine(files: &Files, machine: usize) -> Files {
    let name = format!("machine=g{machine}/");
    let of = files.iter().filter(|(path, _)| path.contains(&name));
    of.map(|(path, bytes)| (path.clone(), bytes.clone()))
        .collect()
}

/// Without the table that has the days of the last run.
fn without_run(mut files: Files) -> Files {
    files.remove("machines.parquet").expect("a table");
    files
}

fn assert_same(found: &Files, expected: &Files) {
    assert!(
        found.keys().eq(expected.keys()),
        "{:?}",
        found.keys().collect::<Vec<_>>()
    );
    let other = found
        .iter()
        .filter(|(path, bytes)| expected[*path] != **bytes);
    let other: Vec<&String> = other.map(|(path, _)| path).collect();
    assert!(other.is_empty(), "other bytes: {other:?}");
}

#[test]
fn one_two_and_seven_threads_give_the_bits_of_one_recording() {
    let bench = Bench::new(7);
    let mut first = None;
    for threads in ["1", "2", "7"] {
        let figures = bench.run(&["--processes", threads]);
        assert_eq!(
            (&figures["machines"], &figures["faults"]),
            (&7.into(), &0.into())
        );
        assert_eq!(figures["replayed_days"], 7 * DAYS);
        let made = bench.made();
        assert_same(&made, first.get_or_insert_with(|| made.clone()));
        for machine in [1, 7] {
            bench.has_the_bits_of_one_replay(machine);
        }
        fs::remove_dir_all(bench.results()).unwrap();
    }
    let refused = bench.command(&["--processes", "0"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1), "{refused:?}");
}

#[test]
fn a_damaged_recording_is_in_the_table_of_faults_and_all_others_go_on() {
    let bench = Bench::new(3);
    bench.run(&[]);
    let good = bench.made();
    let path = bench.recording(2, 1);
    let whole = fs::read(&path).unwrap();
    let written = fs::metadata(&path).unwrap().modified().unwrap();
    for damaged in [&[][..], &whole[..whole.len() / 2], &[0x5a; 5000]] {
        fs::write(&path, damaged).unwrap();
        let figures = bench.run(&[]);
        // The days after it follow from another state.
        assert_eq!(
            (&figures["faults"], &figures["replayed_days"]),
            (&1.into(), &(DAYS - 1).into())
        );
        let faults = bench.faults();
        let [machine, day, recording, fault] = &faults[0];
        assert_eq!([machine, day, recording], ["g2", &date(1), RECORDING]);
        assert!(fault.contains(RECORDING) && faults.len() == 1, "{faults:?}");
        let made = bench.made();
        let estimates = format!("estimates/machine=g2/day={}/{RECORDING}", date(1));
        assert!(!made.contains_key(&estimates));
        for other in [1, 3] {
            assert_same(&of_machine(&made, other), &of_machine(&good, other));
        }
        fs::write(&path, &whole).unwrap();
        let file = fs::File::options().write(true).open(&path).unwrap();
        file.set_modified(written).unwrap();
        drop(file);
        assert_eq!(bench.run(&[])["faults"], 0);
        assert_same(&of_machine(&bench.made(), 2), &of_machine(&good, 2));
    }
}

#[test]
fn a_late_day_is_replayed_with_those_after_it() {
    let bench = Bench::new(2);
    let (path, late) = (bench.recording(1, 1), bench.archive().join("late.parquet"));
    fs::rename(&path, &late).unwrap();
    assert_eq!(bench.run(&[])["replayed_days"], 2 * DAYS - 1);
    let before = bench.made();
    fs::rename(&late, &path).unwrap();
    assert_eq!(bench.run(&[])["replayed_days"], DAYS - 1);
    bench.has_the_bits_of_one_replay(1);
    assert_same(&of_machine(&bench.made(), 2), &of_machine(&before, 2));
    assert_eq!(bench.run(&[])["replayed_days"], 0);
}

#[test]
fn a_machine_without_description_has_a_fault_each_day() {
    let bench = Bench::new(3);
    let table = fs::read_to_string(bench.archive().join("descriptions.csv")).unwrap();
    let others: Vec<&str> = table
        .lines()
        .filter(|row| !row.starts_with("g2,"))
        .collect();
    bench.describe(&others.join("\n"));
    let figures = bench.run(&[]);
    assert_eq!(
        (&figures["machines"], &figures["faults"]),
        (&3.into(), &DAYS.into())
    );
    assert_eq!(figures["verdicts"]["no data"], 1);
    for (day, fault) in bench.faults().iter().enumerate() {
        assert_eq!(fault[..3], ["g2".to_owned(), date(day), String::new()]);
        assert!(
            fault[3].contains("descriptions.csv: it has none"),
            "{fault:?}"
        );
    }
    bench.has_the_bits_of_one_replay(3);
    // Once it has one, it is replayed, and no other machine.
    bench.describe(&table);
    let figures = bench.run(&[]);
    assert_eq!(
        (&figures["faults"], &figures["replayed_days"]),
        (&0.into(), &DAYS.into())
    );
}

#[test]
fn remaining_life_by_a_design_spectrum() {
    let bench = Bench::new(2);
    let write = |name: &str, text: &str| fs::write(bench.archive().join(name), text).unwrap();
    let table = fs::read_to_string(bench.archive().join("descriptions.csv")).unwrap();
    let described = |design: &str| {
        let curve = "main_shaft,\"1e4:5e5,2e6:1e5\",-3e6:3e6";
        let described = table.lines().skip(1).enumerate().map(|(k, row)| {
            let design = if k == 0 { design } else { "" };
            format!("{row},{curve},{design}\n")
        });
        let header = "machine,from,description,load,sn,range,design\n";
        bench.describe(&(header.to_owned() + &described.collect::<String>()));
    };
    described("design.csv");
    // At the points of the curve: 2 / 1e4 + 100 / 2e6 an hour.
    write("design.csv", "range,cycles_per_hour\n5e5,2\n1e5,100\n");
    bench.run(&[]);
    let machines = rows(&bench.results().join("machines.parquet"));
    let column = |name: &str| {
        machines
            .column_by_name(name)
            .unwrap()
            .as_primitive::<Float64Type>()
    };
    let damage = column("damage").value(0);
    let hours = column("remaining_by_design_s").value(0) / 3600.0;
    assert!(
        damage > 0.0 && (hours * 2.5e-4 / (1.0 - damage) - 1.0).abs() < 1e-9,
        "{hours}"
    );
    assert!(column("remaining_by_design_s").is_null(1) && column("damage").is_valid(1));
    // Another spectrum replays nothing.
    write("design.csv", "range,cycles_per_hour\n5e5,4\n");
    assert_eq!(bench.run(&[])["replayed_days"], 0);
    for (text, reason) in [
        ("range,cycles\n5e5,4\n", "range,cycles_per_hour"),
        ("range,cycles_per_hour\n-5e5,4\n", "a range above 0"),
        ("range,cycles_per_hour\n5e5,many\n", "line: 2"),
    ] {
        write("design.csv", text);
        let refused = bench.command(&[]).output().unwrap();
        let said = String::from_utf8_lossy(&refused.stderr);
        assert!(
            refused.status.code() == Some(1) && said.contains(reason),
            "{said}"
        );
        assert!(
            said.contains("descriptions.csv:2") && said.contains("design.csv"),
            "{said}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_killed_run_leaves_complete_files_and_the_next_one_does_the_others() {
    let bench = Bench::new(6);
    bench.run(&[]);
    let whole = without_run(bench.made());
    let states = || {
        let of = |machine| format!("estimates/machine=g{machine}");
        let days = (1..=6).flat_map(|machine| fs::read_dir(bench.results().join(of(machine))));
        days.flatten()
            .filter(|day| day.as_ref().unwrap().path().join("_state").exists())
            .count()
    };
    for kill in [1, 4, 7, 10] {
        fs::remove_dir_all(bench.results()).unwrap();
        let mut running = bench
            .command(&["--processes", "2"])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let end = Instant::now() + Duration::from_mins(1);
        while states() < kill {
            assert!(running.try_wait().unwrap().is_none() && Instant::now() < end);
            thread::sleep(Duration::from_millis(1));
        }
        running.kill().unwrap();
        running.wait().unwrap();
        assert!(states() < 6 * DAYS, "it was done before it was killed");
        let left = bench.made();
        let is_other = |path: &String| left[path] != whole[path];
        let complete = left
            .keys()
            .filter(|path| path.starts_with("estimates") && !path.contains("/."));
        assert_eq!(complete.filter(|path| is_other(path)).count(), 0);
        bench.run(&[]);
        assert_same(&without_run(bench.made()), &whole);
    }
}

/// On a file system of its own, in a namespace, which is full and then made larger.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_run_and_the_next_one_goes_on() {
    const SCRIPT: &str = r#"
        results=$1; mount -t tmpfs -o size=600k none "$results" || exit 77
        "$0" replay --archive "$2" -o "$results"; code=$?
        find "$results" -name '*.parquet' -path '*/estimates/*' | wc -l
        mount -o remount,size=100m "$results"
        "$0" replay --archive "$2" -o "$results" >&2 && cp -a "$results/." "$3" && exit $code
    "#;
    let bench = Bench::new(2);
    bench.run(&[]);
    let whole = bench.made();
    fs::remove_dir_all(bench.results()).unwrap();
    let small = bench.archive().join("small");
    fs::create_dir_all(&small).unwrap();
    fs::create_dir_all(bench.results()).unwrap();
    let full = Command::new("unshare")
        .args(["--map-root-user", "--mount", "sh", "-c", SCRIPT])
        .arg(env!("CARGO_BIN_EXE_loadtwin"))
        .args([small, bench.archive(), bench.results()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&full.stderr);
    if full.status.code() == Some(77) || said.contains("unshare: ") {
        skip("a full disk: no name spaces");
        return;
    }
    assert_eq!(full.status.code(), Some(1), "{said}");
    let error = said.lines().next().unwrap();
    assert!(error.contains("No space left on device"), "{said}");
    let complete: usize = String::from_utf8_lossy(&full.stdout)
        .trim()
        .parse()
        .unwrap();
    assert!((1..2 * DAYS).contains(&complete), "{complete} files");
    assert_same(&without_run(bench.made()), &without_run(whole));
}

#[cfg(target_os = "linux")]
fn skip(what: &str) {
    use std::io::Write;
    if let Some(list) = std::env::var_os("LOADTWIN_SKIPPED") {
        let file = fs::File::options().append(true).create(true).open(list);
        writeln!(file.unwrap(), "{what}").unwrap();
    }
}
