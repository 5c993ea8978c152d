//! Computes the zero (tare) of a bridge from its outputs without load, and from its output with a
//! shunt resistor an adjusted gauge factor. Refuses readings that no intact bridge gives.

use super::bridge::{Calibration, StrainBridge, is_iso_date};
use super::{MICROSTRAIN, MV_PER_V};

/// Strain at which metal foil gauges break [m/m].
///
/// Source: HBK, data sheets of the foil strain gauges of series Y: maximum elongation 50 000 µm/m.
const BREAKING_STRAIN: f64 = 0.05;

/// What a shunt resistor across one arm looks like to the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Simulates {
    /// The arm beside the gauge that is under tension (R3): the reading is that of tension.
    Tension,
    /// The gauge that is under tension itself (R4): the reading is that of compression.
    Compression,
}

/// Output with a shunt resistor across one arm, the structure still unloaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShuntReading {
    /// Mean output ratio [V/V].
    pub ratio: f64,
    /// Resistance of the shunt (ohm), > 0.
    pub shunt_ohm: f64,
    /// Which arm it is across.
    pub simulates: Simulates,
}

/// Why readings make no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No readings, or one that is not a number.
    #[error("zero reading: found {0}, allowed are one or more finite ratios")]
    Zero(String),
    /// The zero is beyond the strain at which gauges break: another unit, or a broken arm.
    #[error(
        "zero reading: found {found:.6} mV/V, allowed is -{largest:.3} to {largest:.3} mV/V (a strain of 5 %); \
         check the column's unit and the wiring"
    )]
    Unbalanced {
        /// Mean output [mV/V].
        found: f64,
        /// Largest output of a gauge that holds [mV/V].
        largest: f64,
    },
    /// The shunt resistor is not a resistance.
    #[error("shunt resistor: found {0} ohm, allowed is a number > 0")]
    Shunt(f64),
    /// The reading is far from what the shunt must give: not connected, other arm, other bridge.
    #[error(
        "shunt reading: found {found_um:.1} um/m, expected {expected_um:.1} um/m, \
         allowed is half to twice that"
    )]
    Reading {
        /// Strain by the raw gauge factor [um/m].
        found_um: f64,
        /// Strain that the shunt simulates [um/m].
        expected_um: f64,
    },
    /// The date is not a day written as ISO 8601 says.
    #[error("date: found {0:?}, allowed is a date as \"2026-03-31\"")]
    Date(String),
}

/// Zero and, with a shunt reading, adjusted gauge factor of `bridge`.
///
/// `zero = mean(zero_ratios)`
///
/// A shunt `rs` across one arm of nominal resistance `rg` gives the ratio
/// `u = -rg / (4 rs + 2 rg)` (tension; opposite sign for compression), which by the formula of the
/// bridge's type, without leads, is the strain `e(u)`. The reading is the strain `e(vr)` with the
/// raw gauge factor and the lead correction. Then
///
/// `gf_adjusted = gf e(vr) / e(u)`
///
/// so that the adjusted bridge reads `e(u)`. The bridge's own fields stay; put the result into
/// [`StrainBridge::calibration`]. Without a shunt reading the adjusted gauge factor of an earlier
/// calibration of `bridge` stays, else none of it takes part.
///
/// `zero_ratios`: outputs of the unloaded bridge [V/V]; `date`: `YYYY-MM-DD`.
///
/// # Errors
/// [`CalibrationError`] names the reading, what was found and what is allowed.
///
/// Source: National Instruments, Strain Gauge Configuration Types (shunt calibration).
pub fn calibrate(
    bridge: &StrainBridge,
    zero_ratios: &[f64],
    shunt: Option<ShuntReading>,
    date: &str,
) -> Result<Calibration, CalibrationError> {
    if !is_iso_date(date) {
        return Err(CalibrationError::Date(date.to_owned()));
    }
    if zero_ratios.is_empty() {
        return Err(CalibrationError::Zero("none".to_owned()));
    }
    if let Some(bad) = zero_ratios.iter().find(|ratio| !ratio.is_finite()) {
        return Err(CalibrationError::Zero(bad.to_string()));
    }
    let zero = zero_ratios.iter().sum::<f64>() / zero_ratios.len() as f64;
    let largest = bridge.output_change(BREAKING_STRAIN);
    if zero.abs() > largest {
        return Err(CalibrationError::Unbalanced {
            found: zero / MV_PER_V,
            largest: largest / MV_PER_V,
        });
    }
    let (gauge_factor, shunt_ohm) = match (shunt, &bridge.calibration) {
        (Some(reading), _) => {
            let adjusted = adjusted_gauge_factor(bridge, zero, reading)?;
            (Some(adjusted), Some(reading.shunt_ohm))
        }
        (None, Some(before)) => (before.gauge_factor, before.shunt_ohm),
        (None, None) => (None, None),
    };
    Ok(Calibration {
        date: date.to_owned(),
        zero_mv_per_v: zero / MV_PER_V,
        gauge_factor,
        shunt_ohm,
    })
}

fn adjusted_gauge_factor(
    bridge: &StrainBridge,
    zero: f64,
    reading: ShuntReading,
) -> Result<f64, CalibrationError> {
    let rs = reading.shunt_ohm;
    if !(rs.is_finite() && rs > 0.0) {
        return Err(CalibrationError::Shunt(rs));
    }
    let rg = bridge.gauge_resistance_ohm;
    let tension = -rg / (4.0 * rs + 2.0 * rg);
    let u = match reading.simulates {
        Simulates::Tension => tension,
        Simulates::Compression => -tension,
    };
    let expected = bridge.relative_change(u);
    let vr = bridge.sign() * (reading.ratio - zero);
    let found = bridge.relative_change(vr) * bridge.lead_factor();
    let adjustment = found / expected;
    if !(0.5..=2.0).contains(&adjustment) {
        let to_microstrain = 1.0 / (bridge.gauge_factor * MICROSTRAIN);
        return Err(CalibrationError::Reading {
            // + 0 so that no reading prints as 0.0, not -0.0.
            found_um: found * to_microstrain + 0.0,
            expected_um: expected * to_microstrain,
        });
    }
    Ok(bridge.gauge_factor * adjustment)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strain::{BridgeKind, TensionReads};

    fn quarter() -> StrainBridge {
        StrainBridge {
            bridge: BridgeKind::Quarter1,
            gauge_factor: 2.0,
            gauge_resistance_ohm: 120.0,
            lead_resistance_ohm: 0.0,
            poisson_ratio: 0.3,
            initial_mv_per_v: 0.5,
            tension_reads: TensionReads::Negative,
            calibration: None,
        }
    }

    /// 100 kohm across a 120 ohm gauge: the arm becomes 119.85617 ohm, -0.11986 % of resistance,
    /// with gauge factor 2 that is -599.28 um/m (the figure in the trade's tables: 599).
    #[test]
    fn shunt_across_the_gauge_is_the_published_compression() {
        let rs = 100_000.0;
        let arm = 120.0 * rs / (120.0 + rs);
        let ratio = 120.0 / (120.0 + arm) - 0.5;
        let reading = ShuntReading {
            ratio: ratio + 0.2e-3,
            shunt_ohm: rs,
            simulates: Simulates::Compression,
        };
        let c = calibrate(&quarter(), &[0.1e-3, 0.3e-3], Some(reading), "2026-03-31").unwrap();
        assert!((c.zero_mv_per_v - 0.2).abs() < 1e-12);
        assert!((c.gauge_factor.unwrap() - 2.0).abs() < 1e-9);
        let bridge = StrainBridge {
            calibration: Some(c),
            ..quarter()
        };
        assert!((bridge.strain(reading.ratio) / MICROSTRAIN + 599.281).abs() < 1e-3);
    }

    /// Long leads and a weak amplifier lower the output by 3 %: afterwards the bridge reads what
    /// the shunt simulates, the raw gauge factor is still there.
    #[test]
    fn adjusted_gauge_factor_takes_up_lost_sensitivity() {
        for (kind, sense) in [
            (BridgeKind::Half1, TensionReads::Positive),
            (BridgeKind::Full2, TensionReads::Negative),
        ] {
            let mut bridge = StrainBridge {
                bridge: kind,
                tension_reads: sense,
                ..quarter()
            };
            let ideal = -120.0 / (4.0 * 59_880.0 + 240.0);
            let reading = ShuntReading {
                ratio: bridge.sign() * 0.97 * ideal,
                shunt_ohm: 59_880.0,
                simulates: Simulates::Tension,
            };
            let c = calibrate(&bridge, &[0.0], Some(reading), "2026-03-31").unwrap();
            assert!((c.gauge_factor.unwrap() - 1.94).abs() < 1e-3);
            let simulated = bridge.relative_change(ideal) / 2.0;
            bridge.calibration = Some(c);
            assert!((bridge.strain(reading.ratio) - simulated).abs() < 1e-12);
            assert_eq!(bridge.gauge_factor, 2.0);
        }
    }

    #[test]
    fn zero_alone_keeps_the_gauge_factor() {
        let c = calibrate(&quarter(), &[-0.04e-3], None, "2026-03-31").unwrap();
        let bridge = StrainBridge {
            calibration: Some(c),
            ..quarter()
        };
        assert!(bridge.strain(-0.04e-3).abs() < 1e-15);
        assert_eq!(bridge.initial_mv_per_v, 0.5);
    }

    #[test]
    fn useless_readings_are_refused() {
        let reading = ShuntReading {
            ratio: 0.0,
            shunt_ohm: 100_000.0,
            simulates: Simulates::Tension,
        };
        let refused = |zero: &[f64], reading, date: &str| {
            calibrate(&quarter(), zero, Some(reading), date)
                .unwrap_err()
                .to_string()
        };
        let open = refused(&[0.0], reading, "2026-03-31");
        assert_eq!(
            open,
            "shunt reading: found 0.0 um/m, expected 600.0 um/m, allowed is half to twice that"
        );
        let zero_ohm = ShuntReading {
            shunt_ohm: 0.0,
            ..reading
        };
        assert!(refused(&[0.0], zero_ohm, "2026-03-31").contains("found 0 ohm"));
        assert!(refused(&[f64::NAN], reading, "2026-03-31").contains("found NaN"));
        assert!(refused(&[], reading, "2026-03-31").contains("found none"));
        assert!(refused(&[0.0], reading, "31.3.2026").contains("found \"31.3.2026\""));
    }
}
