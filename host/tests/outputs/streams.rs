//! Outputs to pipes, standard output and devices, and input from standard input.

use std::fs::File;
use std::io::{Read, Write};
use std::process::Stdio;

use super::bench::Bench;

#[test]
fn a_closed_pipe_ends_quietly_and_a_full_disk_is_an_error() {
    let bench = Bench::new();
    for line in [
        "dbc",
        "dbc machine.toml",
        "schema",
        "completions bash",
        "version",
        "--help",
        "simulate --help",
        "replay machine.toml good.csv",
        "replay machine.toml good.csv --json",
        "replay machine.toml good.csv --estimates -",
        "simulate machine.toml --duration-s 30 -o -",
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = (bench.command(line).stdout(writer).stderr(Stdio::piped()))
            .output()
            .unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{line} | true: {message}");
        assert!(!message.contains("panicked"), "{line} | true: {message}");

        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = bench.command(line).stdout(full).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(
            output.status.code(),
            Some(1),
            "{line} > /dev/full: {message}"
        );
        assert_eq!(message.lines().count(), 1, "{line} > /dev/full: {message}");
    }
    // Standard error may be full as well.
    let full = File::options().write(true).open("/dev/full").unwrap();
    let status = (bench
        .command("replay absent.toml good.csv")
        .stderr(full)
        .status())
    .unwrap();
    assert_eq!(status.code(), Some(1));
    bench.refused(
        "replay machine.toml good.csv --estimates /dev/full",
        &["/dev/full"],
    );
}

#[test]
fn estimates_go_through_pipes_as_into_files() {
    let bench = Bench::new();
    bench.succeeds("replay machine.toml good.csv --estimates e.csv");
    let expected = bench.read("e.csv");
    assert!(expected.starts_with(b"t [s],"), "a header comes first");
    for name in ["-", "/dev/stdout"] {
        let output = bench.run(&format!("replay machine.toml good.csv --estimates {name}"));
        assert!(output.status.success());
        assert!(output.stdout == expected, "{name}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("NMAE"));
    }
    // Into a file by the shell: the same file, not one that takes its place.
    let file = File::create(bench.path("shell.csv")).unwrap();
    let line = "replay machine.toml good.csv --estimates /dev/stdout";
    let status = (bench
        .command(line)
        .stdout(file)
        .stderr(Stdio::null())
        .status())
    .unwrap();
    assert!(status.success());
    assert!(bench.read("shell.csv") == expected);
    for name in ["-", "/dev/stdin"] {
        let line = format!("replay machine.toml {name} --estimates -");
        let mut child = (bench.command(&line))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let good = bench.read("good.csv");
        let mut stdin = child.stdin.take().unwrap();
        let mut stdout = child.stdout.take().unwrap();
        let mut found = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(move || stdin.write_all(&good));
            stdout.read_to_end(&mut found).unwrap();
        });
        assert!(child.wait().unwrap().success(), "{name}");
        assert!(found == expected, "{name}");
    }
}

#[test]
fn standard_output_that_leads_into_an_input_is_refused() {
    let bench = Bench::new();
    let good = bench.read("good.csv");
    let open = || {
        let mut options = File::options();
        options.append(true).read(true);
        options.open(bench.path("good.csv")).unwrap()
    };
    for line in [
        "replay machine.toml good.csv --estimates -",
        "replay machine.toml good.csv --estimates /dev/stdout",
        "replay machine.toml good.csv",
        "replay machine.toml good.csv --json",
    ] {
        let output = bench.command(line).stdout(open()).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line}: {message}");
        assert!(message.contains("input good.csv"), "{line}: {message}");
        assert!(bench.read("good.csv") == good, "{line}");
    }
    for name in ["/dev/stdin", "/dev/fd/0", "/proc/self/fd/0"] {
        let line = format!("replay machine.toml - --estimates {name} --force");
        let output = bench.command(&line).stdin(open()).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line}: {message}");
        assert!(message.contains("is the input"), "{line}: {message}");
        assert!(bench.read("good.csv") == good, "{line}");
    }
}
