//! Damaged machine descriptions: an error or a machine, never a panic.

use std::io::Write;

use loadtwin::build::{self, Sensors};
use loadtwin::machine::Machine;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const MACHINE: &str = include_str!("data/two_inertias.toml");
const MAP: &str = include_str!("data/two_inertias_map.csv");

/// Words that a person, or a program, may put in the wrong place.
const WORDS: [&str; 16] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "-1e-308",
    "\"\"",
    "[]",
    "{}",
    "true",
    "[[channel]]",
    "[",
    "= =",
    "\u{0}",
    "9223372036854775807",
    "\"rotor\"",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]
    #[test]
    fn a_damaged_description_is_refused_or_built(
        cuts in proptest::collection::vec((0..MACHINE.len(), 0usize..12, 0..WORDS.len()), 1..5),
        numbers_only in any::<bool>(),
    ) {
        let mut text = MACHINE.as_bytes().to_vec();
        for (at, length, word) in cuts {
            // Half of the cases replace a value, so that the damage gets past the parser.
            let (from, to) = if numbers_only {
                let Some(equals) = text.iter().skip(at).position(|b| *b == b'=') else { continue };
                let from = at.min(text.len()) + equals + 1;
                (from, text[from..].iter().position(|b| *b == b'\n').map_or(text.len(), |n| from + n))
            } else {
                let from = at.min(text.len());
                (from, (from + length).min(text.len()))
            };
            text.splice(from..to, WORDS[word].bytes());
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("two_inertias_map.csv"), MAP).unwrap();
        let path = folder.path().join("machine.toml");
        std::fs::File::create(&path).unwrap().write_all(&text).unwrap();
        if let Ok(machine) = Machine::load(&path)
            && let Ok(sensors) = Sensors::choose(&machine, None)
            && let Ok(payload) = build::image(&machine, &sensors)
        {
            // What was built must be a whole image.
            loadtwin_common::image::Image::from_bytes(&payload).unwrap();
        }
    }
}
