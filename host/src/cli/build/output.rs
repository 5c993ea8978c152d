//! Prints the result of `loadtwin build` as text or JSON: sizes, signature, lag, and for a rotor
//! the error of the model reduction and whether the rotor as described is unstable.

use serde_json::json;

use super::Build;
use crate::cli::printing::{say, shown};
use crate::image_build::Sensors;
use crate::machine::{Kind, Machine, Rotor};
use crate::rotor::RotorFilterDesign;

/// Part of a start's motion that a reduction may lose without a word.
const MUCH_LOST: f64 = 0.1;

/// What was built.
pub(super) struct Built {
    pub(super) machine: Machine,
    pub(super) sensors: Sensors,
    pub(super) issue: u32,
    pub(super) image: Vec<u8>,
    pub(super) is_signed: bool,
    /// Size of the FMU (bytes).
    pub(super) fmu: Option<usize>,
    /// Speeds between which gains computed beforehand are used (rad/s).
    pub(super) steady: Option<[f64; 2]>,
    pub(super) seconds: f64,
}

impl Built {
    pub(super) fn report(&self, asked: &Build, as_json: bool) -> anyhow::Result<()> {
        let machine = &self.machine;
        let plan = match machine.kind() {
            Some(Kind::Rotor(rotor)) => Some(RotorFilterDesign::new(
                machine,
                rotor,
                &self.sensors.channels,
            )?),
            _ => None,
        };
        let reduction = plan.as_ref().map(RotorFilterDesign::reduction_error);
        let instability = plan.as_ref().and_then(RotorFilterDesign::instability);
        let stability_note = instability.map(|found| found.note());
        let reduction_note = (reduction.as_ref())
            .filter(|r| r.error_m > MUCH_LOST * r.peak_m)
            .map(|r| {
                format!(
                    "the reduction loses {:.0} % of a start's motion at {:.1} rad/s, more than {:.0} %: \
                     estimates err by that until it has died out",
                    100.0 * r.error_m / r.peak_m,
                    r.speed_rad_s,
                    100.0 * MUCH_LOST
                )
            });
        if as_json {
            let mut report = self.figures(asked);
            let more = json!({
                "reduction": reduction.map(|r| json!({
                    "error_um": 1e6 * r.error_m,
                    "peak_um": 1e6 * r.peak_m,
                    "speed_rad_s": r.speed_rad_s,
                })),
                "reduction_note": reduction_note,
                "instability": instability,
                "stability_note": stability_note,
                "seconds": self.seconds,
            });
            if let (Some(report), serde_json::Value::Object(more)) = (report.as_object_mut(), more)
            {
                report.extend(more);
            }
            say!("{report}");
        } else {
            self.print(asked);
            if let Some(r) = reduction {
                say!(
                    "reduction: error up to {:.3} µm of {:.1} µm, at {:.1} rad/s",
                    1e6 * r.error_m,
                    1e6 * r.peak_m,
                    r.speed_rad_s
                );
            }
            for note in reduction_note.into_iter().chain(stability_note) {
                say!("{note}");
            }
        }
        Ok(())
    }

    /// What `--json` prints of every machine.
    fn figures(&self, asked: &Build) -> serde_json::Value {
        let Built {
            machine, sensors, ..
        } = self;
        let names = |names: Vec<&String>| json!(names);
        json!({
            "machine": machine.name,
            "machine_id": machine.id(),
            "image": asked.output.as_ref().map(shown),
            "bytes": self.image.len(),
            "issue": self.issue,
            "signed": self.is_signed,
            "fmu": asked.fmu.as_ref().map(|path| json!({
                "file": shown(path),
                "bytes": self.fmu,
                "fmi": asked.fmi.version().name(),
            })),
            "filter": asked.filter.name(),
            "steady_from_to_rad_s": self.steady,
            "lag_samples": lag(machine),
            "channels": names(sensors.channels.iter().map(|c| &c.name).collect()),
            "encoders": names(sensors.encoders.iter().map(|e| &e.name).collect()),
        })
    }

    fn print(&self, asked: &Build) {
        let Built { machine, issue, .. } = self;
        if let Some(path) = &asked.output {
            let signed = if self.is_signed {
                format!("signed for machine {:?}", machine.id())
            } else {
                "not signed: for the host only".into()
            };
            say!(
                "{}: {} bytes, issue {issue}, {signed}",
                path.display(),
                self.image.len()
            );
        }
        if let (Some(path), Some(bytes)) = (&asked.fmu, self.fmu) {
            say!(
                "{}: {bytes} bytes, FMI {}, co-simulation in steps of {} s",
                path.display(),
                asked.fmi.version().name(),
                1.0 / machine.rate_hz
            );
        }
        if lag(machine) > 0 {
            let lag = lag(machine);
            say!(
                "estimates lag {lag} samples, {} ms",
                1e3 * f64::from(lag) / machine.rate_hz
            );
        }
    }
}

/// Samples by which the estimates lag.
fn lag(machine: &Machine) -> u8 {
    machine.rotor.as_ref().map_or(0, Rotor::lag)
}
