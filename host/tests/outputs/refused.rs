//! Outputs that a command refuses before any work: inputs, files of others, folders, clashes.

use std::os::unix::fs::{PermissionsExt, symlink};

use super::bench::Bench;

/// Commands with what they read, OUT where an output is given.
const COMMANDS: [(&str, &[&str]); 17] = [
    (
        "replay machine.toml good.csv --estimates OUT",
        &["machine.toml", "good.csv", "two_inertias_map.csv"],
    ),
    (
        "replay machine.toml good.csv --report OUT",
        &["machine.toml", "good.csv", "two_inertias_map.csv"],
    ),
    (
        "simulate machine.toml --duration-s 1 -o OUT",
        &["machine.toml", "two_inertias_map.csv"],
    ),
    (
        "calibrate machine.toml good.csv other.csv -o OUT",
        &["machine.toml", "other.csv", "two_inertias_map.csv"],
    ),
    (
        "calibrate machine.toml good.csv other.csv --report OUT",
        &["machine.toml", "good.csv", "other.csv"],
    ),
    (
        "tune machine.toml good.csv other.csv -o OUT",
        &["machine.toml", "other.csv", "two_inertias_map.csv"],
    ),
    (
        "tune machine.toml good.csv --report OUT",
        &["machine.toml", "good.csv", "two_inertias_map.csv"],
    ),
    (
        "tune machine.toml good.csv --response OUT",
        &["machine.toml", "good.csv", "two_inertias_map.csv"],
    ),
    (
        "diagnose machine.toml good.csv --validate other.csv --output OUT",
        &["machine.toml", "good.csv", "other.csv"],
    ),
    (
        "diagnose machine.toml good.csv --validate other.csv --out OUT",
        &["machine.toml", "two_inertias_map.csv"],
    ),
    (
        "diagnose machine.toml good.csv --validate other.csv --report OUT",
        &["machine.toml", "good.csv", "other.csv"],
    ),
    (
        "zero bridge.toml constant zero.csv --date 2026-11-21 -o OUT",
        &["bridge.toml", "zero.csv"],
    ),
    (
        "build machine.toml -o OUT",
        &["machine.toml", "two_inertias_map.csv"],
    ),
    (
        "build machine.toml --key bench.pem -o OUT",
        &["bench.pem", "machine.toml"],
    ),
    (
        "reduce machine.toml loads.csv strains.csv -o OUT",
        &["loads.csv", "strains.csv", "machine.toml"],
    ),
    (
        "reduce machine.toml loads.csv strains.csv -o x.csv --patches OUT",
        &["loads.csv", "strains.csv"],
    ),
    (
        "tables machine.toml --report OUT",
        &["machine.toml", "two_inertias_map.csv"],
    ),
];

#[test]
fn no_input_is_an_output_under_any_name_even_by_force() {
    let bench = Bench::new();
    bench.succeeds("key --machine bench -o bench.pem");
    bench.write("loads.csv", "place,angle [deg],axis\n");
    bench.write("strains.csv", "step,node\n");
    std::fs::create_dir(bench.path("folder")).unwrap();
    for (line, inputs) in COMMANDS {
        for input in inputs {
            let _ = std::fs::remove_file(bench.path("soft"));
            let _ = std::fs::remove_file(bench.path("hard"));
            symlink(input, bench.path("soft")).unwrap();
            std::fs::hard_link(bench.path(input), bench.path("hard")).unwrap();
            for name in [*input, "soft", "hard", &format!("folder/../{input}")] {
                let line = format!("{} --force", line.replace("OUT", name));
                bench.refused(&line, &["is the input", input]);
            }
        }
    }
}

#[test]
fn a_file_beside_an_output_is_no_input_either() {
    let bench = Bench::new();
    let described = String::from_utf8(bench.read("machine.toml")).unwrap();
    bench.write(
        "mine.toml",
        described.replace("two_inertias_map.csv", "out-maps.csv"),
    );
    bench.write("out-maps.csv", bench.read("two_inertias_map.csv"));
    for command in ["calibrate", "tune", "diagnose"] {
        let line = format!("{command} mine.toml good.csv --output out.toml --force");
        bench.refused(&line, &["is the input", "out-maps.csv"]);
    }
}

#[test]
fn only_what_loadtwin_wrote_as_such_is_replaced() {
    let bench = Bench::new();
    let mine = [
        ("mine.csv", "t [s],torque [Nm]\n0,1\n"),
        ("mine.html", "<!DOCTYPE html><html></html>"),
        ("mine.toml", "name = \"mine\"\n"),
        ("mine.image", "a photograph"),
        ("mine.parquet", "PAR1 of another program PAR1"),
    ];
    for (name, text) in mine {
        bench.write(name, text);
    }
    for (line, found) in [
        (
            "replay machine.toml good.csv --estimates mine.csv",
            "a table of text",
        ),
        (
            "replay machine.toml good.csv --estimates mine.parquet",
            "a Parquet file",
        ),
        (
            "replay machine.toml good.csv --report mine.html",
            "an HTML page",
        ),
        (
            "simulate machine.toml --duration-s 1 -o mine.csv",
            "a table of text",
        ),
        (
            "zero bridge.toml constant zero.csv --date 2026-11-21 -o mine.toml",
            "a TOML file",
        ),
        ("build machine.toml -o mine.image", "another file"),
    ] {
        bench.refused(line, &["is there already", found, "--force"]);
        bench.succeeds(&format!("{line} --force"));
        // Now it is one of ours.
        bench.succeeds(line);
    }
    // Once edited it is the user's again.
    let edited = String::from_utf8(bench.read("mine.toml")).unwrap() + "# mine\n";
    bench.write("mine.toml", edited);
    let line = "zero bridge.toml constant zero.csv --date 2026-11-21 -o mine.toml";
    bench.refused(line, &["is there already"]);
    // So is what was added to a table, a page or an image.
    bench.succeeds("replay machine.toml good.csv --estimates e.csv --report e.html");
    bench.succeeds("build machine.toml -o e.image");
    let table = String::from_utf8(bench.read("e.csv")).unwrap();
    let with_column = table.lines().map(|line| format!("{line},my remark\n"));
    bench.write("e.csv", with_column.collect::<String>());
    for name in ["e.html", "e.image"] {
        let mut bytes = bench.read(name);
        bytes.extend(b"<p>mine</p>");
        bench.write(name, bytes);
    }
    for line in [
        "replay machine.toml good.csv --estimates e.csv",
        "replay machine.toml good.csv --report e.html",
        "build machine.toml -o e.image",
    ] {
        bench.refused(line, &["is there already", "--force"]);
    }
}

#[test]
fn every_format_of_a_table_is_known_again() {
    let bench = Bench::new();
    for suffix in ["csv", "parquet", "mf4"] {
        for _ in 0..2 {
            bench.succeeds(&format!(
                "replay machine.toml good.csv --estimates e.{suffix}"
            ));
            bench.succeeds(&format!(
                "simulate machine.toml --duration-s 1 -o s.{suffix}"
            ));
        }
        bench.refused(
            &format!("replay machine.toml good.csv --estimates s.{suffix}"),
            &["is there already", "no estimates"],
        );
        bench.refused(
            &format!("simulate machine.toml --duration-s 1 -o e.{suffix}"),
            &["is there already", "no simulated recording"],
        );
    }
}

#[test]
fn names_folders_and_permissions_are_checked_first() {
    let bench = Bench::new();
    for (line, expected) in [
        ("replay machine.toml good.csv --report r.pdf", ".html"),
        (
            "replay machine.toml good.csv --estimates e.xlsx",
            ".parquet",
        ),
        ("calibrate machine.toml good.csv -o out.csv", ".toml"),
        ("build machine.toml -o machine.html", ".image"),
        ("simulate machine.toml -o absent/s.csv", "mkdir -p absent"),
        (
            "replay machine.toml good.csv --estimates X.csv --report X.csv",
            "a file of its own",
        ),
        (
            "reduce machine.toml l.csv s.csv -o maps.csv --patches ./maps.csv",
            "a file of its own",
        ),
        (
            "calibrate machine.toml good.csv -o c.toml --report c.toml",
            ".html",
        ),
        (
            "calibrate machine.toml good.csv -o -",
            "give the name of a file",
        ),
        (
            "replay machine.toml good.csv --json --estimates -",
            "--json",
        ),
        ("build - -o x.image", "give the name of a file"),
        ("calibrate machine.toml - -o x.toml", "standard input"),
        ("replay good.csv machine.toml", "it comes first"),
        (
            "diagnose machine.toml good.csv --validate ./good.csv",
            "it is fitted as well",
        ),
        ("build /dev/zero -o x.image", "allowed: up to 16 MiB"),
    ] {
        bench.refused(line, &[expected]);
    }
    bench.succeeds("key --machine bench -o bench.pem");
    bench.refused("key --machine bench -o bench.pem", &["never overwritten"]);
    // A replaced file keeps its permissions, and links stay links.
    bench.write("private.csv", "");
    let private = std::fs::Permissions::from_mode(0o600);
    std::fs::set_permissions(bench.path("private.csv"), private).unwrap();
    symlink("target.csv", bench.path("dangling.csv")).unwrap();
    bench.succeeds("replay machine.toml good.csv --estimates private.csv");
    bench.succeeds("replay machine.toml good.csv --estimates dangling.csv");
    let mode = bench
        .path("private.csv")
        .metadata()
        .unwrap()
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o600);
    assert!(bench.path("dangling.csv").is_symlink());
    assert_eq!(bench.read("target.csv"), bench.read("private.csv"));
}
