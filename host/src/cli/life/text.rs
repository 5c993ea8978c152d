//! Counts and figures as text.

use super::count::Counted;
use super::figures::Figures;
use crate::cli::output::say;

pub(super) fn print(counted: &Counted, figures: &Figures, period_s: f64) {
    let unit = counted.unit;
    for (number, counts) in (1..).zip(&counted.machines) {
        let of_machine = match counted.machines.len() {
            1 => String::new(),
            _ => format!(", machine {number}"),
        };
        let [from, to] = counts.scale().ends();
        let seen = counts.observation();
        say!(
            "{} [{unit}]{of_machine}: counted from {from:.4} to {to:.4}, gate {:.4}",
            counted.name,
            f32::from(counts.gate()) * counts.scale().width()
        );
        say!(
            "  seen {:.2} % of {:.1} s: {} samples not valid, {} missing in {} gaps, {} restarts",
            100.0 * seen.share().unwrap_or(0.0),
            seen.elapsed() as f64 * period_s,
            seen.not_valid,
            seen.missing,
            seen.gaps,
            seen.restarts
        );
        if let Some([low, high]) = counts.extremes() {
            let at = |sample: u64| sample as f64 * period_s;
            say!(
                "  lowest {:.4} at {:.2} s, highest {:.4} at {:.2} s",
                low.load,
                at(low.sample),
                high.load,
                at(high.sample)
            );
        }
        let (closed, residue) = counts.ended();
        say!(
            "  {} closed cycles, {} half cycles",
            closed.cycles(),
            residue.ranges().count()
        );
    }
    say!(
        "  equal cycles of the same damage, {:.0} of them:",
        figures.equivalent_cycles
    );
    say!("    exponent      range [{unit}]");
    for (exponent, load) in &figures.equivalent {
        say!("    {exponent:>8}{load:>15.4}");
    }
    if let Some(damage) = figures.damage {
        say!("  damage by the S-N curve: {damage:.4e}");
    }
    for (shaft, torque) in (1..).zip(&figures.torque) {
        if let Some(torque) = torque {
            say!("  equivalent torque of a gear on shaft {shaft}: {torque:.4} {unit}");
        }
    }
    if let Some(life) = &figures.bearing {
        let l10 = life
            .l10_turns
            .map_or("without end".into(), |turns| format!("{turns:.4e} turns"));
        say!(
            "  bearing: equivalent load {:.4}, L10 {l10}, used {:.4e}",
            life.equivalent,
            life.used
        );
    }
}
