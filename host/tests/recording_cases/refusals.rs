//! Text that could be read in two ways, or not at all: the refusal names the setting that helps.
use super::table::{ENCODER, INDEX, Table, machine, replay};

/// Rows of 29 to 31 s.
fn base() -> Table {
    Table::shipped(14_500..15_500)
}

/// Error of the recording whose text `change` has changed, read by `layout` (%).
fn outcome(layout: &str, change: impl Fn(&str) -> String) -> Result<f64, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rec.csv");
    base().write(&path);
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, change(&text)).unwrap();
    replay(&path, &machine(layout)).map(|found| found.full())
}

fn refused(layout: &str, says: &[&str], change: impl Fn(&str) -> String) {
    let line = outcome(layout, change).unwrap_err();
    assert!(!line.contains('\n'), "{line}");
    for part in says {
        assert!(line.contains(part), "found: {line}\nexpected: {part}");
    }
}

/// Whole numbers, but the torque in kNm with three decimals.
fn whole(text: &str) -> String {
    let mut lines = text.lines();
    let head = lines.next().unwrap().replace("t [s]", "t [ms]");
    let mut whole = head.replace("[m/m]", "[µm/m]").replace(',', ";") + "\n";
    for (row, line) in lines.enumerate() {
        let cells = line.split(',').enumerate();
        let cells = cells.map(|(k, cell)| match (k, cell.parse::<f64>()) {
            (0, _) => (2 * row).to_string(),
            (6, Ok(torque)) => format!("{:.3}", torque / 1e3).replace('.', ","),
            (1..=3, Ok(strain)) => format!("{:.0}", strain * 1e6),
            _ => cell.to_owned(),
        });
        whole += &(cells.collect::<Vec<_>>().join(";") + "\n");
    }
    whole
}

#[test]
fn commas_of_two_meanings() {
    let says = [
        "`decimal_comma`",
        "part the thousands",
        "allowed: true or false",
    ];
    refused("", &says, whole);
    let in_knm = |text: &str| whole(text).replace("torque_main [Nm]", "torque_main [kNm]");
    refused("", &says, in_knm);
    let error = outcome("decimal_comma = true", in_knm).unwrap();
    assert!(error < 3.0, "{error}");
    refused(
        "decimal_comma = false",
        &["column `torque_main`: found `"],
        whole,
    );
}

#[test]
fn times_that_are_absent_or_there_twice() {
    let bare = |text: &str| {
        let rows = text.lines().map(|line| line.split_once(',').unwrap().1);
        rows.collect::<Vec<_>>().join("\n") + "\n"
    };
    let says = ["column `t` is missing", "`row_period_ms` under [recording]"];
    refused("", &says, bare);
    outcome("row_period_ms = 2", bare).unwrap();
    let says = ["row_period_ms = 2 beside the column `t`; allowed: where no column is the time"];
    refused("row_period_ms = 2", &says, str::to_owned);
    let named = |text: &str| text.replacen("t [s]", "Uhr [s]", 1);
    let layout = "row_period_ms = 2\nchannels.t.column = 'Uhr'";
    refused(layout, &["beside the column `Uhr`"], named);
}

#[test]
fn a_title_above_the_header() {
    let titled = |text: &str| format!("Bench 3\n{text}");
    let says = ["column `t` is missing; found: Bench 3", "`skip_lines`"];
    refused("", &says, titled);
    outcome("skip_lines = 1", titled).unwrap();
}

/// From 2^53 on, f64 does not hold each count.
#[test]
fn counts_that_are_not_exact() {
    let plain = base().replay(&machine("")).unwrap();
    let moved = |by: f64| {
        let mut table = base();
        for row in &mut table.rows {
            row[ENCODER] += by;
            row[INDEX] += by;
        }
        table.replay(&machine(""))
    };
    assert!(moved(2_f64.powi(52)).unwrap().loads == plain.loads);
    for power in [53, 60] {
        let line = moved(2_f64.powi(power)).unwrap_err();
        let place = "row 1 (line 2), column `encoder_main`: found `";
        assert!(line.starts_with(place), "{line}");
        assert!(line.contains("counts below 2^53"), "{line}");
    }
}
