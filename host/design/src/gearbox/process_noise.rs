//! Computes the process noise covariance of a drivetrain's mechanical states from the uncertainty
//! of its parameters: the change of one step when each parameter moves by its standard deviation,
//! averaged over operating points with all loads nominal and with each load alone.

use faer::Mat;

use crate::gearbox::torsional_model::Torsion;
use loadtwin_machine::Drivetrain;

/// Standard deviation of each state's step with all parameters known, relative
/// to the state's nominal size: rounding and the like.
const FLOOR: f64 = 1e-6;

/// Q over one step of `dt_s`, for the mechanical states in SI units.
///
/// `Q = 1/n sum_points sum_p w_p w_p'`, `w_p = (F(p + s_p) - F(p)) x`: each
/// parameter is moved by one standard deviation `s_p = relative_std p`, and
/// the change of one step is the process error that it causes, to
/// first order, at operating points with the loads in balance and with each
/// load alone.
///
/// Source: Bosmans et al. 2023, section 5.3.2, with the sample covariance
/// replaced by its first-order value.
pub fn process_noise(
    drivetrain: &Drivetrain,
    dt_s: f64,
    relative_std: f64,
    nominal: &[f64],
) -> Mat<f64> {
    let torsion = Torsion::new(drivetrain);
    let states = torsion.states();
    let points = operating_points(drivetrain, &torsion);
    let step = |torsion: &Torsion, point: &[f64]| -> Vec<f64> {
        let f = torsion.discretised(dt_s);
        (0..states)
            .map(|i| point.iter().enumerate().map(|(j, x)| f[(i, j)] * x).sum())
            .collect()
    };
    let mut q = Mat::<f64>::zeros(states, states);
    for point in &points {
        let expected = step(&torsion, point);
        for moved in moved_parameters(drivetrain, 1.0 + relative_std) {
            let found = step(&Torsion::new(&moved), point);
            for i in 0..states {
                for j in 0..states {
                    q[(i, j)] +=
                        (found[i] - expected[i]) * (found[j] - expected[j]) / points.len() as f64;
                }
            }
        }
    }
    for i in 0..states {
        q[(i, i)] += (FLOOR * nominal[i]).powi(2);
    }
    q
}

/// States and loads, in SI units: all loads nominal, then each one alone; nominal speed,
/// twists as in rigid-body motion under those loads.
pub fn operating_points(drivetrain: &Drivetrain, torsion: &Torsion) -> Vec<Vec<f64>> {
    let nominal: Vec<f64> = drivetrain.loads.iter().map(|l| l.nominal_nm).collect();
    let mut cases = vec![nominal.clone()];
    for (j, load) in nominal.iter().enumerate() {
        let mut alone = vec![0.0; nominal.len()];
        alone[j] = *load;
        cases.push(alone);
    }
    cases
        .into_iter()
        .map(|loads| {
            let n = torsion.states() / 2;
            let mut point = vec![0.0; torsion.states()];
            for (i, twist) in torsion.rigid_twists(&loads).into_iter().enumerate() {
                point[1 + i] = twist;
            }
            point[n..].fill(drivetrain.nominal_speed_rad_s);
            point.extend(loads);
            point
        })
        .collect()
}

/// The drivetrain with one parameter at a time multiplied by `factor`.
fn moved_parameters(drivetrain: &Drivetrain, factor: f64) -> Vec<Drivetrain> {
    let mut moved = Vec::new();
    let mut push = |change: &dyn Fn(&mut Drivetrain)| {
        let mut copy = drivetrain.clone();
        change(&mut copy);
        moved.push(copy);
    };
    for i in 0..drivetrain.inertias.len() {
        push(&|d| d.inertias[i].moment_kg_m2 *= factor);
        push(&|d| d.inertias[i].drag_nm_s_per_rad *= factor);
    }
    for i in 0..drivetrain.shafts.len() {
        push(&|d| d.shafts[i].stiffness_nm_per_rad *= factor);
        push(&|d| d.shafts[i].damping_nm_s_per_rad *= factor);
    }
    moved
}
