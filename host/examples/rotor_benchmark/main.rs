//! Blind benchmark: `diagnose` on rotors with effects that it does not know.
//!
//! `cargo run --release -p loadtwin --example rotor_benchmark -- [ROTORS] [SEED]`
//!
//! Shafts, discs, bearings, noise, encoders, speeds, strengths (0.3 to 2) and places are drawn;
//! a line for each recording, then the rates with 95 % intervals.

mod cases;
#[path = "../diagnose_benchmark/rate.rs"]
mod rate;

use std::error::Error;
use std::path::Path;

use cases::Asked;
use loadtwin::machine::Machine;
use rate::Rate;

fn main() -> Result<(), Box<dyn Error>> {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse::<u64>());
    let rotors = numbers.next().transpose()?.unwrap_or(4) as usize;
    let seed = numbers.next().transpose()?.unwrap_or(7);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml");
    let (rotors, cases) = cases::drawn(&Machine::load(&path)?, rotors, seed);
    let all = [
        (Asked::Named, "one effect in a run-up, named alone"),
        (
            Asked::BothNamed,
            "two effects in a run-up, both and no other",
        ),
        (Asked::Nothing, "clean ones of which nothing is said"),
        (
            Asked::Unobservable,
            "what an unbalance does as well, said so",
        ),
    ];
    let mut rates = [Rate::default(); 4];
    for case in &cases {
        let (right, said) = case.evaluate(&rotors[case.rotor])?;
        let mark = if right { "  " } else { "NO" };
        println!("{mark} {}: {said}", case.truth());
        for (rate, _) in rates
            .iter_mut()
            .zip(all)
            .filter(|(_, (asked, _))| *asked == case.asked)
        {
            rate.count(right);
        }
    }
    for (rate, (_, what)) in rates.into_iter().zip(all) {
        println!("{what:<46}{rate}");
    }
    Ok(())
}
