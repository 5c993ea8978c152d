//! Checks the references and the counting direction of the encoder by the torque balance of the whole
//! drivetrain, for notes of `calibrate` (`TorqueBalance`): whether all loads, inertia and drag balance,
//! better with the other direction, or with another gain and zero of a reference.

use loadtwin_machine::Machine;

use crate::calibrate::recorded_motion::{BalanceSample, Motion};

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
    /// Sums of the torque of the last load [N m], of its square and of its product with the
    /// residual [N² m²].
    load: f64,
    load_squared: f64,
    load_residual: f64,
}

impl TorqueBalance {
    /// Adds the samples of a recording in which every load has a reference.
    pub fn add(&mut self, machine: &Machine, motion: &Motion) {
        for sample in motion.balance(machine).into_iter().flatten() {
            let BalanceSample {
                driven,
                of_last_load,
                lost,
            } = sample;
            let residual = driven - lost;
            self.samples += 1.0;
            self.sum += residual;
            self.as_described += residual.powi(2);
            self.reversed += (driven + lost).powi(2);
            self.load += of_last_load;
            self.load_squared += of_last_load.powi(2);
            self.load_residual += of_last_load * residual;
        }
    }

    /// Root mean square of what the sum of squares `sum` holds [N m].
    fn rms(&self, sum: f64) -> f64 {
        (sum / self.samples).max(0.0).sqrt()
    }

    /// What to check where the other direction of the encoder explains the references better; none
    /// where the described one does, or where the references may be off by as much. A zero error of
    /// the references that explains them as well is named beside it.
    pub fn direction_note(&self, machine: &Machine) -> Option<String> {
        let encoder = machine.homed_encoder().or(machine.encoders.first())?;
        let nominal = machine.drivetrain.as_ref()?.nominal_torque();
        let rms = |sum| self.rms(sum);
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

    /// What to check where the references contradict each other and the encoder's direction does not
    /// explain it: the residual of the balance, and what another gain and zero of the last load's
    /// reference would leave, by least squares. None below 1 % of the nominal torque.
    pub fn reference_note(&self, machine: &Machine) -> Option<String> {
        let drivetrain = machine.drivetrain.as_ref()?;
        let nominal = drivetrain.nominal_torque();
        let described = self.rms(self.as_described);
        if self.direction_note(machine).is_some() || described <= REFERENCE_ERROR * nominal {
            return None;
        }
        let percent = 100.0 * described / nominal;
        let balance = format!(
            "loads, inertia and drag leave {described:.1} Nm ({percent:.1} % of nominal): the references contradict \
             each other, or a loss is missing in the description"
        );
        let n = self.samples;
        let spread = self.load_squared - self.load.powi(2) / n;
        let common = self.load_residual - self.load * self.sum / n;
        let left = self.as_described - self.sum.powi(2) / n - common.powi(2) / spread;
        let last = drivetrain.loads.last()?;
        // A gain is known where the load moves by more than the references may be off.
        let moves = self.rms(spread) > 10.0 * REFERENCE_ERROR * nominal;
        Some(if moves && FACTOR * self.rms(left) <= described {
            format!(
                "{balance}; the reference of {} times {:.3} would leave {:.1} Nm beside a constant",
                last.name,
                1.0 - common / spread,
                self.rms(left)
            )
        } else {
            balance
        })
    }
}
