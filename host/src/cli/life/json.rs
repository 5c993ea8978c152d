//! Makes the JSON object that `loadtwin life --json` prints of one load: counts of each machine,
//! cycles, damage-equivalent loads, damage, equivalent torque and bearing life.

use loadtwin_common::counting::LoadCounts;
use serde_json::{Map, Value, json};

use super::count::Counted;
use super::figures::Figures;
use crate::life::Interval;

pub(super) fn report(counted: &Counted, figures: &Figures, period_s: f64) -> Value {
    let machines: Vec<Value> = (counted.machines.iter())
        .map(|machine| machine_report(&machine.counts, period_s))
        .collect();
    let equivalent: Map<String, Value> = (figures.equivalent.iter())
        .map(|of| (of.exponent.to_string(), json!(of.load)))
        .collect();
    let noise_removed = (counted.noise_removed.as_ref()).map(|removed| {
        let equivalent: Map<String, Value> = (figures.equivalent.iter())
            .map(|of| (of.exponent.to_string(), interval(of.noise_removed)))
            .collect();
        json!({
            "range_std": removed.range_std(),
            "damage_equivalent_load": equivalent,
            "damage": interval(figures.damage_noise_removed),
        })
    });
    let cycles: Vec<[f64; 2]> = counted
        .spectrum
        .cycles()
        .map(|cycle| [cycle.range, cycle.count])
        .collect();
    json!({
        "unit": counted.unit.symbol(),
        "machines": machines,
        "seen_s": figures.seen_s,
        "cycles": cycles,
        "equivalent_cycles": figures.equivalent_cycles,
        "damage_equivalent_load": equivalent,
        "damage": figures.damage,
        "noise_removed": noise_removed,
        "equivalent_torque": figures.torque,
        "bearing": figures.bearing.map(|life| json!({
            "equivalent_load": life.equivalent,
            "l10_turns": life.l10_turns,
            "used": life.used,
        })),
    })
}

fn interval(interval: Option<Interval>) -> Value {
    json!(interval.map(|found| json!({
        "value": found.value, "lower": found.lower, "upper": found.upper,
    })))
}

fn machine_report(counts: &LoadCounts, period_s: f64) -> Value {
    let seen = counts.observation();
    let extremes = counts.extremes().map(|extremes| {
        extremes
            .map(|extreme| json!({ "load": extreme.load, "t": extreme.sample as f64 * period_s }))
    });
    let (closed, residue) = counts.ended();
    let middle = |level: &u8| counts.scale().middle(*level);
    json!({
        "range": counts.scale().ends(),
        "gate": f32::from(counts.gate()) * counts.scale().width(),
        "samples": {
            "seen": seen.seen, "not_valid": seen.not_valid, "missing": seen.missing,
            "gaps": seen.gaps, "restarts": seen.restarts, "seen_share": seen.share(),
        },
        "extremes": extremes,
        "closed_cycles": closed.cycles(),
        "residue": residue.points().iter().map(middle).collect::<Vec<_>>(),
    })
}
