//! Compares both counting directions of the encoder by the torque balance of the whole drivetrain.

use loadtwin_machine::Machine;

use crate::calibrate::recorded_motion::Motion;

/// By how much the references of a balance may be off together, as part of the nominal
/// torque: twice the 0.5 % of a simple torque flange.
const REFERENCE_ERROR: f64 = 0.01;

/// Residual as described over that of the other direction from which the other one is reported.
const FACTOR: f64 = 2.0;

/// Residual torque of a drivetrain under both counting directions of its encoder, about the main
/// shaft.
///
/// `r = sum_j s_j i_j T_j -+ (J dw/dt + c w + friction)`, with the sign `s_j` and speed ratio `i_j`
/// of load `T_j`, and the acceleration and speed of the encoder: `-` as described, `+` where it
/// counts the other way.
#[derive(Clone, Copy, Debug, Default)]
pub struct TorqueBalance {
    samples: f64,
    /// Sum as described [N m].
    sum: f64,
    /// Sum of squares as described [N² m²].
    as_described: f64,
    /// The same with the other direction.
    reversed: f64,
}

impl TorqueBalance {
    /// Adds the samples of a recording in which every load has a reference.
    pub fn add(&mut self, machine: &Machine, motion: &Motion) {
        for (driven, lost) in motion.driven_and_lost(machine).into_iter().flatten() {
            self.samples += 1.0;
            self.sum += driven - lost;
            self.as_described += (driven - lost).powi(2);
            self.reversed += (driven + lost).powi(2);
        }
    }

    /// What to check where the other direction of the encoder explains the references better; none
    /// where the described one does, or where the references may be off by as much. A zero error of
    /// the references that explains them as well is named beside it.
    pub fn note(&self, machine: &Machine) -> Option<String> {
        let encoder = machine.homed_encoder().or(machine.encoders.first())?;
        let nominal = machine.drivetrain.as_ref()?.nominal_torque();
        let rms = |sum: f64| (sum / self.samples).max(0.0).sqrt();
        let (described, reversed) = (rms(self.as_described), rms(self.reversed));
        if described <= FACTOR * reversed.max(REFERENCE_ERROR * nominal) {
            return None;
        }
        let zero = self.sum / self.samples;
        let beside_zero = rms(self.as_described - self.sum * zero);
        let balance = format!(
            "loads, inertia and drag balance within {described:.1} Nm as described, within {reversed:.1} Nm if {} \
             counts the other way",
            encoder.name
        );
        let exchange = "exchange its two channels, or negate counts_per_turn";
        Some(
            if beside_zero <= FACTOR * reversed.max(REFERENCE_ERROR * nominal) {
                format!(
                    "{balance}, within {beside_zero:.1} Nm with zeros of the references that are {zero:.1} Nm off together: \
                 check the zeros and signs of the references; else {exchange}"
                )
            } else {
                format!("{balance}: {exchange}, or check the signs of the references")
            },
        )
    }
}
