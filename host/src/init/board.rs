//! Generates the draft of a machine description from the sensors of a board, for `loadtwin init
//! --board` (`draft_for_board`): its rate, channels and encoders, on a drivetrain whose numbers are
//! marked to be filled in.

use loadtwin_common::hardware::Hardware;

use super::drivetrain::{ENDS, chain};
use super::toml_text::{Text, number, quoted};
use super::{InitError, MARK, checked};

/// Sample rate until it is filled in (Hz); each board has it.
const RATE_HZ: f64 = 1000.0;

/// A description begun for a board, and its places to fill in.
///
/// # Errors
/// Where the text that was written is no description.
pub fn draft_for_board(board: &str, hardware: &Hardware) -> Result<(String, usize), InitError> {
    let mut text = Text::default();
    text.comment(format_args!("Begun for the channels of the board {board}."));
    text.comment(format_args!(
        "Lines that begin with \"{}\" stand above what a board does not show; the value below holds the place.",
        MARK.trim_end()
    ));
    text.line("format = 1");
    text.fill_in(
        "name",
        quoted("machine"),
        "the machine, as in `loadtwin key --machine`",
    );
    let meaning = match hardware.rates_hz {
        [] => "the sample rate (Hz)".to_owned(),
        rates => format!("the sample rate (Hz), one of {rates:?}"),
    };
    text.fill_in("rate_hz", number(RATE_HZ), meaning);
    chain(&mut text, &[], &[]);
    for (k, inertia) in ENDS.iter().enumerate().take(hardware.encoders) {
        text.table("[[encoder]]");
        text.set("name", quoted(&format!("encoder{k}")));
        text.fill_in("inertia", quoted(inertia), "the inertia that it turns with");
        text.fill_in(
            "counts_per_turn",
            "4096",
            "lines per turn times four; negative where it counts down in forward turning",
        );
        if let Some(bits) = hardware.counter_bits {
            text.comment(format_args!(
                "The board's counter wraps at as many bits as stand here, 8 to {bits}."
            ));
            text.set("bits", bits);
        } else {
            text.comment("`bits` is the width of a counter that wraps, 32 without.");
        }
    }
    text.line("");
    text.comment("Where an index pulse is wired, which homes the angle of the first encoder:");
    for line in [
        "[index]",
        "name = \"index\"",
        "encoder = \"encoder0\"",
        "angle_rad = 0",
    ] {
        text.comment(line);
    }
    for i in 0..hardware.channels {
        gauge(&mut text, i);
    }
    let (text, marks) = text.finish();
    checked(&text)?;
    Ok((text, marks))
}

/// A strain-gauge bridge at an input of the converter.
fn gauge(text: &mut Text, input: usize) {
    text.table("[[channel]]");
    text.comment(format_args!(
        "Input {input} of the converter. Delete the table where nothing is wired to it."
    ));
    text.set("name", quoted(&format!("gauge{input}")));
    text.set("unit", quoted("µm/m"));
    text.fill_in(
        "senses",
        "{ shaft = \"shaft\" }",
        "the shaft or load whose torque strains the gauge",
    );
    text.fill_in("sensitivity", "1", "µm/m per Nm, with its sign");
    text.fill_in(
        "noise_std",
        "1",
        "the standard deviation of the reading (µm/m)",
    );
    text.fill_in(
        "adc",
        "{ converter = \"ads131m04\", gain = 32, excitation_v = 2.5 }",
        "gain of the converter (1, 2, 4, ... 128), which the board sets, and excitation of the bridge (V)",
    );
    text.fill_in(
        "bridge",
        "{ bridge = \"full-1\", gauge_factor = 2, gauge_resistance_ohm = 350, tension_reads = \"positive\" }",
        "type and gauge factor of the bridge",
    );
}
