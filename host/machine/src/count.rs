//! Describes a load whose cycles a board is to count (`Count`): range of the levels, smallest cycle,
//! ratio of its shaft. Checks its fields.

use loadtwin_common::counting::{CountedLoad, GATE_LEVELS, LEVELS, LevelScale, MAX_COUNTED};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::Violation;
use super::field_checks::{Checked, at_most, finite, one_of, positive, refuse, within};
use super::{Machine, NamedLoad};

/// A load whose cycles a board is to count.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Count {
    /// Name of the load.
    pub load: String,
    /// Range that the 128 levels cover, from and to [unit of the load]; loads beyond it count at
    /// its nearer end.
    pub range: [f64; 2],
    /// Smallest range of a cycle [unit of the load], > 0; 1/64 of `range` where absent.
    pub gate: Option<f64>,
    /// Turns of the load's own shaft for one of the angle that the machine estimates, > 0.
    #[serde(default = "one")]
    pub ratio: f64,
}

fn one() -> f64 {
    1.0
}

impl Count {
    /// The levels.
    ///
    /// # Errors
    /// When the range has no 128 levels in single precision.
    fn scale(&self) -> Result<LevelScale, loadtwin_common::Error> {
        let [from, to] = self.range;
        LevelScale::covering(from as f32, to as f32)
    }

    /// The gate (levels), 1 to 127 in a description that was checked.
    fn gate_levels(&self, scale: LevelScale) -> f64 {
        let levels = |gate: f64| (gate / f64::from(scale.width())).ceil();
        self.gate.map_or(GATE_LEVELS.into(), levels)
    }

    fn check(&self, field: &impl Fn(&str) -> String, loads: &[NamedLoad<'_>]) -> Checked {
        let names: Vec<&str> = loads.iter().map(|load| load.name).collect();
        one_of(&field("load"), &self.load, &names)?;
        let [from, to] = self.range;
        finite(&field("range[1]"), from)?;
        finite(&field("range[2]"), to)?;
        let found = format!("[{from}, {to}]");
        let allowed = "from below to, by more than rounding";
        let Ok(scale) = self.scale() else {
            return refuse(&field("range"), found, allowed);
        };
        let gate = self.gate_levels(scale);
        let is = (1.0..=(LEVELS - 1) as f64).contains(&gate);
        let found = self.gate.unwrap_or_default();
        within(&field("gate"), found, is, "> 0, below the range")?;
        positive(&field("ratio"), self.ratio)
    }
}

impl Machine {
    /// Checks the loads that are counted.
    pub(super) fn check_counts(&self) -> Result<(), Violation> {
        at_most("count", self.counts.len(), MAX_COUNTED)?;
        let loads = self.loads();
        for (i, count) in self.counts.iter().enumerate() {
            let field = |name: &str| format!("count[{}].{name}", i + 1);
            count.check(&field, &loads)?;
            let first = self.counts[..i].iter().all(|c| c.load != count.load);
            let allowed = "a load that no other one counts";
            within(&field("load"), &count.load, first, allowed)?;
        }
        Ok(())
    }

    /// The loads that are counted, as an image states them.
    ///
    /// # Errors
    /// In a description that [`Machine::check`] refuses.
    pub fn counted_loads(&self) -> Result<Vec<CountedLoad>, loadtwin_common::Error> {
        let loads = self.loads();
        let place = |name: &str| loads.iter().position(|load| load.name == name);
        let counted = self.counts.iter().filter_map(|count| {
            let load = u8::try_from(place(&count.load)?).ok()?;
            Some((count, load))
        });
        counted
            .map(|(count, load)| {
                let scale = count.scale()?;
                Ok(CountedLoad {
                    load,
                    scale,
                    gate: count.gate_levels(scale) as u8,
                    ratio: count.ratio as f32,
                })
            })
            .collect()
    }
}
