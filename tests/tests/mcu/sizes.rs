//! Flash of the real board's program against its bound, and that nothing in it formats text.

use std::process::Command;

use loadtwin_tests::firmware::{root, target};

/// Bytes of bank 1 that the program may take: 1.2 kB below its end.
const MOST_FLASH: u32 = 260_900;

#[test]
fn the_real_boards_program_leaves_room_in_flash_and_formats_nothing() {
    let run = Command::new(root().join("tests/rig/sizes"))
        .current_dir(root())
        .output()
        .expect("tests/rig/sizes starts");
    let said = String::from_utf8_lossy(&run.stdout);
    let flash = said
        .strip_prefix("flash ")
        .and_then(|rest| rest.split(' ').next()?.parse::<u32>().ok());
    let flash = flash.unwrap_or_else(|| panic!("{said}{}", String::from_utf8_lossy(&run.stderr)));
    println!("{said}");
    // The estimators alone take more than 150 kB: less would be another program.
    assert!((150_000..=MOST_FLASH).contains(&flash), "{said}");

    let elf = target().join("thumbv7em-none-eabihf/nucleo/nucleo_g474re");
    let listed = Command::new("arm-none-eabi-nm")
        .arg(elf)
        .output()
        .expect("arm-none-eabi-nm starts; tests/run installs it");
    let symbols = String::from_utf8_lossy(&listed.stdout);
    assert!(symbols.contains("DrivetrainEstimator"), "no symbols");
    // `Formatter` as it stands in a mangled name, with its length.
    let formatting: Vec<&str> = symbols
        .lines()
        .filter(|symbol| symbol.contains("9Formatter"))
        .collect();
    assert!(formatting.is_empty(), "{}", formatting.join("\n"));
}
