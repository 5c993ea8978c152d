//! Prints the text output of `loadtwin life` for one load: time seen, extremes, cycle counts,
//! damage-equivalent loads, damage, gear torque and bearing life.

use super::count::Counted;
use super::figures::Figures;
use crate::cli::printing::say;
use crate::life::Interval;

/// The table of equivalent loads.
fn print_equivalent(counted: &Counted, figures: &Figures) {
    let unit = counted.unit;
    if counted.noise_removed.is_some() {
        say!(
            "    exponent  as estimated [{unit}]  noise removed [{unit}]   90 % interval [{unit}]"
        );
    } else {
        say!("    exponent      range [{unit}]");
    }
    for of in &figures.equivalent {
        let (exponent, load) = (of.exponent, of.load);
        match of.noise_removed {
            None => say!("    {exponent:>8}{load:>15.4}"),
            Some(Interval {
                value,
                lower,
                upper,
            }) => say!("    {exponent:>8}{load:>19.4}{value:>20.4}{lower:>16.4} to {upper:.4}"),
        }
    }
}

pub(super) fn print(counted: &Counted, figures: &Figures, period_s: f64) {
    print_counts(counted, period_s);
    print_figures(counted, figures);
}

/// Range, observed time, extremes and cycles of each machine.
fn print_counts(counted: &Counted, period_s: f64) {
    let unit = counted.unit;
    for (number, machine) in (1..).zip(&counted.machines) {
        let counts = &machine.counts;
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
}

/// Equivalent loads, damage, torque of gears and life of a bearing.
fn print_figures(counted: &Counted, figures: &Figures) {
    let unit = counted.unit;
    say!(
        "  equal cycles of the same damage, {:.0} of them:",
        figures.equivalent_cycles
    );
    print_equivalent(counted, figures);
    if let Some(damage) = figures.damage {
        let removed = figures.damage_noise_removed.map_or(String::new(), |found| {
            let Interval {
                value,
                lower,
                upper,
            } = found;
            format!("; noise removed {value:.4e} (90 % interval {lower:.4e} to {upper:.4e})")
        });
        say!("  damage by the S-N curve: {damage:.4e}{removed}");
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
