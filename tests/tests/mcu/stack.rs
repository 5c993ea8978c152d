//! Worst-case stack depth of each board's program against the stack that it has.

use std::process::Command;

use loadtwin_tests::firmware::root;

#[test]
fn the_worst_case_fits_the_stack_of_each_board() {
    for board in ["emulated", "nucleo-g474re"] {
        let run = Command::new(root().join("tests/rig/stack"))
            .current_dir(root())
            .arg(board)
            .output()
            .expect("tests/rig/stack starts");
        let said = String::from_utf8_lossy(&run.stdout);
        let verdict = said
            .lines()
            .last()
            .and_then(|line| line.strip_prefix(&format!("{board}: worst-case stack ")))
            .and_then(|line| line.strip_suffix(" bytes")?.split_once(" of "))
            .unwrap_or_else(|| panic!("{said}{}", String::from_utf8_lossy(&run.stderr)));
        println!("{board}: {} of {}", verdict.0, verdict.1);
        // The estimator alone takes thousands: less would be a graph with holes.
        let deepest: u32 = verdict.0.parse().expect("a number");
        assert!(run.status.success() && deepest > 20_000, "{said}");
    }
}
