//! Simulates the temperature of the gearbox's housing (K): a first-order lag of 20 min, heated by
//! the transmitted power.

/// First order, heated by the power that is transmitted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Housing {
    start: f64,
    /// Temperature [K].
    pub temperature: f64,
}

/// Temperature of the surroundings [K]: 20 degrees Celsius.
const AMBIENT: f64 = 293.15;

/// Final rise above the surroundings at nominal power [K].
const RISE: f64 = 30.0;

/// Time constant of the housing [s]: 20 min.
const TIME_CONSTANT: f64 = 1200.0;

impl Housing {
    /// `above`: how much warmer than the surroundings it is at first [K].
    pub(crate) fn new(above: f64) -> Self {
        Self {
            start: AMBIENT + above,
            temperature: AMBIENT + above,
        }
    }

    /// `power` is the magnitude of the transmitted power as part of nominal.
    pub(crate) fn step(&mut self, dt: f64, power: f64) {
        let target = AMBIENT + RISE * power;
        self.temperature += dt / TIME_CONSTANT * (target - self.temperature);
    }

    /// Since the start [K].
    pub(crate) fn warming(&self) -> f64 {
        self.temperature - self.start
    }
}
