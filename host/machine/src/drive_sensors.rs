//! Converts the recorded signals of a drive to channels, encoder and reference column, so that its
//! recordings are read as those of other machines. Computes resolution and noise of signals whose
//! description gives none.

use std::f64::consts::TAU;

use super::{
    Adc, Balance, Channel, Encoder, Estimated, Machine, QUANTISATION, Reference, Senses, Signal,
};
use crate::adc::checked_gain;
use loadtwin_recording::{Quantity, Unit};

/// Part of nominal that one code is of a drive or load of which it is not given: 20 bits.
const FINE: f64 = 1.0 / 1_048_576.0;

/// Change of a position or speed by one count or code where it is not given [SI].
const FINE_MOTION: f64 = 1e-6;

/// Noise of a drive of which it is not given, as part of nominal: that of an industrial torque or
/// current measurement of class 1 (IEC 60688).
const DRIVE_NOISE: f64 = 0.01;

impl Signal {
    /// Factor of the column in SI to the quantity: `quantity = gain_si (column - zero)`.
    pub fn gain_si(&self) -> f64 {
        self.gain / self.unit_si()
    }

    /// Gain that a board sets in its converter, where one is stated.
    ///
    /// # Errors
    /// What is allowed.
    pub(super) fn gain_of_converter(&self) -> Result<Option<u16>, String> {
        self.converter_gain.map(checked_gain).transpose()
    }

    /// One unit of the column in SI.
    fn unit_si(&self) -> f64 {
        self.unit.to_si(1.0) - self.unit.to_si(0.0)
    }
}

impl Balance {
    /// Change of a signal's column by one code or count [its unit]; of a drive or load it needs
    /// `nominal`.
    pub fn lsb(&self, signal: &Signal) -> f64 {
        if let Some(lsb) = signal.lsb {
            return lsb;
        }
        let is_motion = (self.position.iter().chain(&self.speed)).any(|s| s.name == signal.name);
        match (signal.unit.quantity(), is_motion) {
            (Quantity::Counts, _) => 1.0,
            (_, true) => FINE_MOTION / signal.unit_si(),
            (_, false) => self.nominal.unwrap_or(1.0) * FINE / signal.gain.abs(),
        }
    }

    /// Standard deviation of a signal's reading [the quantity it stands for].
    pub fn noise_std(&self, signal: &Signal) -> f64 {
        let rounding = QUANTISATION * self.lsb(signal);
        let is_drive = signal.name == self.drive.name;
        match (signal.noise_std, self.nominal) {
            (Some(noise), _) => noise.max(rounding) * signal.gain.abs(),
            (None, Some(nominal)) if is_drive => DRIVE_NOISE * nominal,
            _ => rounding * signal.gain.abs(),
        }
    }

    /// The signals that are analogue channels, in the order of the words.
    pub fn analogue(&self) -> impl Iterator<Item = &Signal> {
        let drive = (self.estimate == Estimated::Load).then_some(&self.drive);
        drive.into_iter().chain(&self.speed).chain(&self.loads)
    }

    fn channel(&self, signal: &Signal) -> Channel {
        let adc = Adc {
            lsb: self.lsb(signal),
            zero: 0,
            bits: 32,
            stuck_after: Some(0),
            gain: signal.gain_of_converter().ok().flatten(),
            converter: None,
            excitation_v: None,
        };
        Channel {
            noise_std: self.noise_std(signal) / signal.gain.abs(),
            ..Channel::plain(&signal.name, signal.unit, Senses::Drive(String::new()), adc)
        }
    }

    fn encoder(&self, signal: &Signal) -> Encoder {
        let count_si = self.lsb(signal) * signal.unit_si();
        Encoder {
            name: signal.name.clone(),
            inertia: String::new(),
            counts_per_turn: TAU / count_si,
            bits: signal.bits,
            noise_std_counts: None,
            eccentricity: None,
        }
    }
}

impl Machine {
    /// The unit of the column of a drive's position.
    pub fn travel_unit(&self) -> Option<Unit> {
        Some(self.balance.as_ref()?.position.as_ref()?.unit)
    }

    /// Describes the signals of a measured drive as channels, encoder and reference: all that reads
    /// recordings and samples knows those.
    pub(super) fn add_drive_sensors(&mut self) {
        let Some(balance) = &self.balance else {
            return;
        };
        self.channels = balance.analogue().map(|s| balance.channel(s)).collect();
        self.encoders = (balance.position.iter().map(|s| balance.encoder(s))).collect();
        if balance.estimate == Estimated::Drive {
            let drive = &balance.drive;
            self.references = vec![Reference {
                name: drive.name.clone(),
                load: drive.name.clone(),
                unit: drive.unit,
                gain: drive.gain_si(),
                zero: drive.zero,
            }];
        }
    }
}
