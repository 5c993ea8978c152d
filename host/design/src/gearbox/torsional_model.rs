//! Assembles the torsional model of a drivetrain in SI units (`dx/dt = A x + B d`) and discretises
//! it exactly. Gives the rows by which encoders and channels observe the state, and the shaft
//! twists in rigid-body motion under given loads.

use faer::Mat;

use loadtwin_machine::{Drivetrain, Inertia, Senses};
use loadtwin_math::exponential::exponential;

/// `dx/dt = A x + B d`, states `theta`, twists, speeds, all referred to the main
/// shaft (speed ratio 1); loads `d` in their own sign and at their own shaft.
///
/// `theta`: angle of the carrier (rad); twist i: angle of inertia i minus that of
/// i + 1 (rad); speeds [rad/s].
///
/// Source: Bosmans et al. 2023, section 4.1.
#[derive(Clone, Debug)]
pub struct Torsion {
    n: usize,
    carrier: usize,
    a: Mat<f64>,
    b: Mat<f64>,
    /// Stiffness, damping and speed ratio of each shaft, referred to the main shaft.
    shafts: Vec<(f64, f64, f64)>,
    ratios: Vec<f64>,
    inertia_names: Vec<String>,
    shaft_names: Vec<String>,
    load_names: Vec<String>,
    referred_moments: Vec<f64>,
}

impl Torsion {
    /// Assembles the model of `drivetrain`, which has been checked.
    pub fn new(drivetrain: &Drivetrain) -> Self {
        let n = drivetrain.inertias.len();
        let ratios: Vec<f64> = drivetrain.inertias.iter().map(|j| j.speed_ratio).collect();
        let shafts: Vec<(f64, f64, f64)> = drivetrain
            .shafts
            .iter()
            .map(|s| {
                let square = s.speed_ratio * s.speed_ratio;
                (
                    s.stiffness_nm_per_rad * square,
                    s.damping_nm_s_per_rad * square,
                    s.speed_ratio,
                )
            })
            .collect();
        let inertia_names: Vec<String> =
            drivetrain.inertias.iter().map(|j| j.name.clone()).collect();
        let position = |name: &str| {
            inertia_names
                .iter()
                .position(|other| other == name)
                .unwrap_or(0)
        };
        let carrier = drivetrain.carrier.as_deref().map_or(0, position);
        let moments: Vec<f64> = drivetrain
            .inertias
            .iter()
            .map(Inertia::referred_moment)
            .collect();

        let states = 2 * n;
        let (twist, speed) = (|i: usize| 1 + i, |i: usize| n + i);
        let mut a = Mat::<f64>::zeros(states, states);
        a[(0, speed(carrier))] = 1.0;
        for (i, &(k, c, _)) in shafts.iter().enumerate() {
            a[(twist(i), speed(i))] = 1.0;
            a[(twist(i), speed(i + 1))] = -1.0;
            for (inertia, sign) in [(i, -1.0), (i + 1, 1.0)] {
                let scale = sign / moments[inertia];
                a[(speed(inertia), twist(i))] += scale * k;
                a[(speed(inertia), speed(i))] += scale * c;
                a[(speed(inertia), speed(i + 1))] -= scale * c;
            }
        }
        for (i, inertia) in drivetrain.inertias.iter().enumerate() {
            a[(speed(i), speed(i))] -= inertia.referred_drag() / moments[i];
        }
        let mut b = Mat::<f64>::zeros(states, drivetrain.loads.len());
        for (j, load) in drivetrain.loads.iter().enumerate() {
            let i = position(&load.inertia);
            b[(speed(i), j)] = load.direction.sign() * ratios[i] / moments[i];
        }
        Self {
            n,
            carrier,
            a,
            b,
            shafts,
            ratios,
            shaft_names: drivetrain.shafts.iter().map(|s| s.name.clone()).collect(),
            load_names: drivetrain.loads.iter().map(|l| l.name.clone()).collect(),
            inertia_names,
            referred_moments: moments,
        }
    }

    /// Number of mechanical states, `2 n`.
    pub fn states(&self) -> usize {
        2 * self.n
    }

    /// Stiffness of each shaft referred to the main shaft [N m/rad].
    pub fn referred_stiffness(&self) -> impl Iterator<Item = f64> {
        self.shafts.iter().map(|s| s.0)
    }

    /// `A`.
    pub fn a(&self) -> &Mat<f64> {
        &self.a
    }

    /// `B`.
    pub fn b(&self) -> &Mat<f64> {
        &self.b
    }

    /// `[F G]` over `dt_s`, exact for loads held over the step: the upper rows
    /// of `exp([A B; 0 0] dt)`, loads and then each inertia's drive torque.
    pub fn discretised(&self, dt_s: f64) -> Mat<f64> {
        let (states, loads) = (self.states(), self.b.ncols());
        let total = states + loads + self.n;
        let mut m = Mat::<f64>::zeros(total, total);
        for i in 0..states {
            for j in 0..states {
                m[(i, j)] = self.a[(i, j)] * dt_s;
            }
            for j in 0..loads {
                m[(i, states + j)] = self.b[(i, j)] * dt_s;
            }
        }
        for i in 0..self.n {
            m[(self.n + i, states + loads + i)] = self.ratios[i] / self.referred_moments[i] * dt_s;
        }
        let e = exponential(&m);
        Mat::from_fn(states, total, |i, j| e[(i, j)])
    }

    /// Angle of inertia `name`, referred to the main shaft, as a row over the states.
    pub fn angle_row(&self, name: &str) -> Vec<f64> {
        let k = self.inertia(name);
        let mut row = vec![0.0; self.states()];
        row[0] = 1.0;
        for i in self.carrier..k {
            row[1 + i] = -1.0;
        }
        for i in k..self.carrier {
            row[1 + i] = 1.0;
        }
        row
    }

    /// What a channel senses, as a row over the states and then the loads, in
    /// the unit and at the shaft that the machine description names.
    pub fn sensed_row(&self, senses: &Senses) -> Vec<f64> {
        let states = self.states();
        let mut row = vec![0.0; states + self.b.ncols()];
        match senses {
            Senses::Shaft(name) => {
                let i = self
                    .shaft_names
                    .iter()
                    .position(|other| other == name)
                    .unwrap_or(0);
                let (k, c, ratio) = self.shafts[i];
                row[1 + i] = k / ratio;
                row[self.n + i] = c / ratio;
                row[self.n + i + 1] = -c / ratio;
            }
            Senses::Load(name) => {
                let j = self
                    .load_names
                    .iter()
                    .position(|other| other == name)
                    .unwrap_or(0);
                row[states + j] = 1.0;
            }
            Senses::Speed(name) => {
                let i = self.inertia(name);
                row[self.n + i] = self.ratios[i];
            }
            Senses::Drive(_)
            | Senses::Displacement(_)
            | Senses::OuterRing(_)
            | Senses::Temperature => {}
        }
        row
    }

    /// Number of the inertia called `name`.
    pub fn inertia(&self, name: &str) -> usize {
        self.inertia_names
            .iter()
            .position(|other| other == name)
            .unwrap_or(0)
    }

    /// Turns of inertia `name` per turn of the main shaft.
    pub fn ratio(&self, name: &str) -> f64 {
        self.ratios[self.inertia(name)]
    }

    /// Twist of each shaft when `loads` accelerate the whole train as one body
    /// without drag (rad).
    pub fn rigid_twists(&self, loads: &[f64]) -> Vec<f64> {
        // B holds torque over moment at the main shaft.
        let torque: Vec<f64> = (0..self.n)
            .map(|i| {
                let referred = |j| self.b[(self.n + i, j)] * self.referred_moments[i];
                loads
                    .iter()
                    .enumerate()
                    .map(|(j, load)| referred(j) * load)
                    .sum()
            })
            .collect();
        let acceleration = torque.iter().sum::<f64>() / self.referred_moments.iter().sum::<f64>();
        let mut carried = 0.0;
        (0..self.shafts.len())
            .map(|i| {
                carried += torque[i] - self.referred_moments[i] * acceleration;
                carried / self.shafts[i].0
            })
            .collect()
    }
}
