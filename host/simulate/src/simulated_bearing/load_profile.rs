//! Gives speed and loads of a wheel over time to the simulated bearing: the trait that scenarios
//! and recorded courses share, and a recorded course, interpolated linearly.

/// Speed and loads over time.
pub(crate) trait Driven: Send {
    /// Speed of the wheel [rad/s].
    fn speed(&self, t: f64) -> f64;

    /// `Fx, Fy, Fz` [N], `Mx, Mz` [N m].
    fn loads(&self, t: f64) -> [f64; 5];
}

/// What a wheel did, in equal steps; between them it changes evenly.
#[derive(Clone, Debug, PartialEq)]
pub struct BearingCourse {
    /// Step (s).
    pub dt_s: f64,
    /// Speed of the wheel [rad/s].
    pub speed: Vec<f64>,
    /// `Fx, Fy, Fz` (N), `Mx, Mz` [N m].
    pub loads: Vec<[f64; 5]>,
}

impl BearingCourse {
    pub(crate) fn duration_s(&self) -> f64 {
        self.dt_s * self.speed.len() as f64
    }

    /// The steps before and after, and how far `t` is from the first to the second.
    fn at(&self, t: f64) -> (usize, usize, f64) {
        let last = self.speed.len().saturating_sub(1);
        let step = t / self.dt_s;
        let i = (step as usize).min(last);
        (i, (i + 1).min(last), (step - i as f64).min(1.0))
    }
}

impl Driven for BearingCourse {
    fn speed(&self, t: f64) -> f64 {
        let (i, j, part) = self.at(t);
        self.speed[i] + part * (self.speed[j] - self.speed[i])
    }

    fn loads(&self, t: f64) -> [f64; 5] {
        let (i, j, part) = self.at(t);
        let (from, to) = (&self.loads[i], &self.loads[j]);
        std::array::from_fn(|k| from[k] + part * (to[k] - from[k]))
    }
}
