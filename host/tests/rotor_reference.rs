//! Compares the rotor model with ROSS 2.3.0: eigenvalues, Campbell diagram and unbalance response
//! to 1e-8, the paper's case over time to 0.01 µm, also an imported rotor with steps, bores and
//! cross-coupled bearings. The stiffness of acceleration is that of Euler's equations.

use std::path::{Path, PathBuf};

use faer::c64;
use loadtwin::machine::read_ross;
use loadtwin::machine::{Machine, Rotor};
use loadtwin::rotor::{
    Reduced, RotorModel, TimeResponse, Unbalance, campbell, modes, unbalance_response,
};

/// 7 g at 68 mm.
const MOMENT: f64 = 0.007 * 0.068;
const SPEED: f64 = 87.96;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/rotor")
}

/// Rows of a table, split into cells, without comments and header.
fn table(name: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(folder().join(name)).unwrap();
    let rows: Vec<Vec<String>> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .skip(1)
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    assert!(rows.len() > 4, "{name}");
    rows
}

fn number(cell: &str) -> f64 {
    cell.parse().unwrap()
}

/// The paper's rotor; case A is without damping of the shaft.
fn rotor(case: &str) -> Rotor {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml");
    let mut rotor = Machine::load(&path).unwrap().rotor.unwrap();
    if case == "A" {
        for section in &mut rotor.sections {
            (section.alpha_per_s, section.beta_s) = (0.0, 0.0);
        }
    }
    rotor
}

fn imported(file: &str) -> Rotor {
    let mut rotor = rotor("B");
    rotor.sections.clear();
    rotor.materials.clear();
    rotor.discs.clear();
    rotor.bearings.clear();
    read_ross(&folder().join(file), &mut rotor).unwrap();
    rotor
}

fn size(z: c64) -> f64 {
    z.re.hypot(z.im)
}

#[test]
fn eigenvalues_are_those_of_ross() {
    for case in ["A", "B"] {
        let model = RotorModel::new(&rotor(case));
        for speed in [0.0, SPEED] {
            let mut expected: Vec<c64> = (table("modes.csv").iter())
                .filter(|row| row[0] == case && number(&row[1]) == speed)
                .map(|row| c64::new(number(&row[2]), number(&row[3])))
                .filter(|s| s.im > 0.0)
                .collect();
            expected.sort_by(|a, b| size(*a).total_cmp(&size(*b)));
            let found = modes(&model, speed, expected.len()).unwrap();
            assert!(found.len() >= 12, "{}", found.len());
            let mut worst: f64 = 0.0;
            for (mode, s) in found.iter().zip(&expected) {
                worst = worst.max(size(mode.eigenvalue - *s) / size(*s));
            }
            println!(
                "case {case}, {speed} rad/s: {} modes, {worst:.1e}",
                found.len()
            );
            assert!(worst < 1e-8, "case {case}, {speed} rad/s: {worst:e}");
        }
    }
}

#[test]
fn the_campbell_diagram_is_that_of_ross() {
    let model = RotorModel::new(&rotor("B"));
    let rows = table("campbell_B.csv");
    let mut speeds: Vec<f64> = rows.iter().map(|row| number(&row[0])).collect();
    speeds.dedup();
    let found = campbell(&model, &speeds, 12).unwrap();
    for (row, mode) in rows.iter().zip(found.iter().flatten()) {
        let (wn, zeta, whirl) = (number(&row[2]), number(&row[4]), number(&row[5]));
        assert!(
            (mode.natural_rad_s() / wn - 1.0).abs() < 1e-8,
            "{row:?} {mode:?}"
        );
        assert!(
            (mode.damping_ratio() - zeta).abs() < 1e-8,
            "{row:?} {mode:?}"
        );
        if whirl.abs() > 0.5 {
            assert!(mode.whirl * whirl > 0.0, "{row:?} {mode:?}");
        }
    }
}

#[test]
fn the_unbalance_response_is_that_of_ross() {
    let unbalances = [(12, 70.0_f64), (23, 30.0)].map(|(node, degrees)| Unbalance {
        node,
        moment_kg_m: MOMENT,
        phase_rad: degrees.to_radians(),
    });
    for case in ["A", "B"] {
        let found = unbalance_response(&RotorModel::new(&rotor(case)), SPEED, &unbalances).unwrap();
        let rows = table(&format!("unbalance_{case}.csv"));
        let expected: Vec<c64> = (rows.iter())
            .map(|row| c64::new(number(&row[2]), number(&row[3])))
            .collect();
        compare(&found, &expected, case);
    }
}

fn compare(found: &[c64], expected: &[c64], what: &str) {
    assert_eq!(found.len(), expected.len());
    let peak = expected.iter().copied().map(size).fold(0.0, f64::max);
    let worst = (found.iter().zip(expected))
        .map(|(a, b)| size(*a - *b))
        .fold(0.0, f64::max);
    println!("{what}: {:.1e} of the peak", worst / peak);
    assert!(worst < 1e-8 * peak, "{what}: {:e}", worst / peak);
}

/// Forces of the unbalances from rest, as ROSS took them: straight lines
/// between samples of 0.1 ms.
#[test]
fn the_response_over_time_is_that_of_ross() {
    let dt = 1e-4;
    let forces = |t: f64| {
        let size = MOMENT * SPEED * SPEED;
        let (a, b) = (
            SPEED * t + 70_f64.to_radians(),
            SPEED * t + 30_f64.to_radians(),
        );
        [a.cos(), a.sin(), b.cos(), b.sin()].map(|f| size * f)
    };
    for case in ["A", "B"] {
        let model = RotorModel::new(&rotor(case));
        let rows: Vec<Vec<f64>> = [12, 23]
            .into_iter()
            .flat_map(|node| [0.0, std::f64::consts::FRAC_PI_2].map(|a| model.direction(node, a)))
            .collect();
        let reduced = Reduced::with_statics(&model, SPEED, 40, &rows).unwrap();
        let mut response = TimeResponse::new(&model, &reduced, SPEED, &rows, dt);
        response.set_force(&forces(0.0));
        let (mut step, mut worst, mut peak) = (0, 0.0_f64, 0.0_f64);
        for row in table(&format!("time_{case}.csv")) {
            let row: Vec<f64> = row.iter().map(|cell| number(cell)).collect();
            while f64::from(step) * dt < row[0] - 0.5 * dt {
                step += 1;
                response.step(&forces(f64::from(step) * dt));
            }
            let q = response.displacements();
            for (k, expected) in row[1..].iter().enumerate() {
                worst = worst.max((q[4 * (k / 2) + k % 2] - expected).abs());
                peak = peak.max(expected.abs());
            }
        }
        println!("case {case}: {:.4} of {:.0} µm", worst * 1e6, peak * 1e6);
        assert!(worst < 0.01e-6, "case {case}: {worst:e} m");
    }
}

/// Steps, bores, cross-coupled bearings that change with speed: nothing that
/// the paper's rotor has.
#[test]
fn an_imported_rotor_is_that_of_ross() {
    for file in ["ross_model.toml", "ross_model.json"] {
        let model = RotorModel::new(&imported(file));
        assert_eq!(model.nodes, 7);
        let lateral = table("ross_model_modes.csv");
        for speed in [0.0, 150.0, 450.0] {
            let expected: Vec<c64> = (lateral.iter())
                .filter(|row| number(&row[0]) == speed)
                .map(|row| c64::new(number(&row[1]), number(&row[2])))
                .collect();
            for mode in modes(&model, speed, 6).unwrap() {
                let nearest = (expected.iter())
                    .map(|s| size(mode.eigenvalue - *s) / size(*s))
                    .fold(f64::INFINITY, f64::min);
                assert!(
                    nearest < 1e-8,
                    "{file}, {speed} rad/s: {mode:?}, {nearest:e}"
                );
            }
        }
        let unbalances =
            [(2, 1e-3, 0.3), (4, 5e-4, -1.1)].map(|(node, moment_kg_m, phase_rad)| Unbalance {
                node,
                moment_kg_m,
                phase_rad,
            });
        let rows = table("ross_model_unbalance.csv");
        for speed in [150.0, 450.0] {
            // x, y, alpha, beta of the six degrees of freedom of a node there.
            let expected: Vec<c64> = (rows.iter())
                .filter(|row| number(&row[0]) == speed)
                .enumerate()
                .filter(|(i, _)| ![2, 5].contains(&(i % 6)))
                .map(|(_, row)| c64::new(number(&row[2]), number(&row[3])))
                .collect();
            let found = unbalance_response(&model, speed, &unbalances).unwrap();
            compare(&found, &expected, &format!("{file}, {speed} rad/s"));
        }
    }
}

/// Of rigid motions: nothing of a shift, and of tilts the whole polar inertia. ROSS has all of it
/// in one plane, and against its own `G`.
#[test]
fn the_stiffness_of_acceleration_is_half_of_g_where_ross_has_one_plane_of_it() {
    let rotor = rotor("B");
    let model = RotorModel::new(&rotor);
    let n = model.len();
    let mut ross = faer::Mat::<f64>::zeros(n, n);
    for row in table("accelerating.csv") {
        let at = |cell: &str| cell.parse::<usize>().unwrap();
        ross[(at(&row[0]), at(&row[1]))] = number(&row[2]);
    }
    let length = rotor.sections[0].length_m / rotor.sections[0].elements as f64;
    let motion = |of: fn(f64) -> [f64; 4]| {
        faer::Mat::from_fn(n, 1, |i, _| of(length * (i / 4) as f64)[i % 4])
    };
    let (alpha, beta) = (
        motion(|s| [0.0, -s, 1.0, 0.0]),
        motion(|s| [s, 0.0, 0.0, 1.0]),
    );
    let over = |m: &faer::Mat<f64>, a: &faer::Mat<f64>, b: &faer::Mat<f64>| {
        (a.transpose() * (m * b))[(0, 0)]
    };
    let own = model.accelerating_stiffness();
    let section = &rotor.sections[0];
    let shaft = rotor.materials[0].density_kg_per_m3 * std::f64::consts::PI / 32.0
        * section.outer_m.powi(4)
        * section.length_m;
    let polar = shaft + rotor.discs.iter().map(|d| d.polar_kg_m2).sum::<f64>();
    let same = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * polar, "{a} {b}");
    same(over(&ross, &beta, &alpha), polar);
    same(over(&ross, &alpha, &beta), 0.0);
    same(over(&own, &alpha, &beta), 0.5 * polar);
    same(over(&own, &beta, &alpha), -0.5 * polar);
    let shift = motion(|_| [1.0, 1.0, 0.0, 0.0]);
    for m in [&own, &ross] {
        same((m * &shift).norm_max(), 0.0);
    }
}

/// A disc that is sped up, by the equations of Euler: by a torque along its own axis, along
/// that of the bearings, or half of each.
#[test]
fn a_disc_that_is_sped_up_tilts_as_by_the_equations_of_euler() {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (spring, acceleration, start, dt) = (20.0, 200.0, 50.0, 1e-5);
    let mut ends = Vec::new();
    for part in [0.0, 0.5, 1.0] {
        let mut rotor = rotor("B");
        rotor.acceleration_stiffness = part;
        let with = RotorModel::new(&rotor);
        let tilt = 4 * rotor.discs[0].node + 2;
        rotor.discs.clear();
        let without = RotorModel::new(&rotor);
        let block = |of: &dyn Fn(&RotorModel) -> faer::Mat<f64>| {
            (of(&with) - of(&without))
                .submatrix(tilt, tilt, 2, 2)
                .to_owned()
        };
        let (m, g) = (block(&|r| r.mass.clone()), block(&|r| r.gyroscopic.clone()));
        let kst = block(&|r| r.accelerating_stiffness());
        let (diametral, polar) = (m[(0, 0)], g[(0, 1)]);
        // (alpha, beta, alpha', beta') at a time.
        let linear = |t: f64, x: &[f64; 9]| {
            let speed = start + acceleration * t;
            let of = |i: usize| {
                let turned: f64 = (0..2)
                    .map(|j| speed * g[(i, j)] * x[2 + j] + acceleration * kst[(i, j)] * x[j])
                    .sum();
                -(spring * x[i] + turned) / diametral
            };
            [x[2], x[3], of(0), of(1), 0.0, 0.0, 0.0, 0.0, 0.0]
        };
        // Axis, its derivative, and the spin.
        let euler = |_: f64, x: &[f64; 9]| {
            let (e, v, spin) = ([x[0], x[1], x[2]], [x[3], x[4], x[5]], x[6]);
            let along =
                |i: usize| polar * acceleration * ((1.0 - part) * e[i] + part * [0.0, 0.0, 1.0][i]);
            let tilted = [spring * e[1], -spring * e[0], 0.0];
            let moment = [0, 1, 2].map(|i| along(i) + tilted[i]);
            let (turned, carried) = (cross(e, moment), cross(e, v));
            let a = [0, 1, 2]
                .map(|i| -dot(v, v) * e[i] - (turned[i] - polar * spin * carried[i]) / diametral);
            [
                v[0],
                v[1],
                v[2],
                a[0],
                a[1],
                a[2],
                dot(moment, e) / polar,
                0.0,
                0.0,
            ]
        };
        let run = |of: &dyn Fn(f64, &[f64; 9]) -> [f64; 9], mut x: [f64; 9]| {
            for step in 0..100_000 {
                let t = f64::from(step) * dt;
                let moved =
                    |k: &[f64; 9], h: f64| -> [f64; 9] { std::array::from_fn(|i| x[i] + h * k[i]) };
                let a = of(t, &x);
                let b = of(t + 0.5 * dt, &moved(&a, 0.5 * dt));
                let c = of(t + 0.5 * dt, &moved(&b, 0.5 * dt));
                let d = of(t + dt, &moved(&c, dt));
                x = std::array::from_fn(|i| {
                    x[i] + dt / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i])
                });
            }
            x
        };
        let small = 1e-4;
        let predicted = run(&linear, [small, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        // alpha = -e_y.
        let mut first = [0.0; 9];
        (first[1], first[2], first[6]) = (-small, f64::sqrt(1.0 - small * small), start);
        let right = run(&euler, first);
        let right = [-right[1], right[0]];
        let off = (predicted[0] - right[0]).hypot(predicted[1] - right[1]);
        println!("{part}: {predicted:?} {right:?}");
        assert!(off < 1e-6 * small, "{part}: {off:e}");
        ends.push(right);
    }
    let apart = (ends[0][0] - ends[2][0]).hypot(ends[0][1] - ends[2][1]);
    assert!(apart > 0.1 * 1e-4, "{apart:e}");
}

/// 200 nodes, 60 speeds, from the description on.
#[test]
fn a_campbell_diagram_of_200_nodes_takes_two_seconds() {
    let mut rotor = rotor("B");
    rotor.sections[0].elements = 199;
    rotor.discs[0].node = 64;
    rotor.discs[1].node = 124;
    rotor.bearings[0].node = 22;
    rotor.bearings[1].node = 178;
    let started = std::time::Instant::now();
    let model = RotorModel::new(&rotor);
    let speeds: Vec<f64> = (0..60).map(|k| f64::from(k) * 5.0).collect();
    let diagram = campbell(&model, &speeds, 12).unwrap();
    let seconds = started.elapsed().as_secs_f64();
    println!(
        "{} nodes, {} speeds: {seconds:.2} s",
        model.nodes,
        diagram.len()
    );
    // Five times what it takes, for a machine that is busy with other things.
    assert!(seconds < 10.0, "{seconds}");
    // The same shaft as with 37 elements.
    let coarse = modes(&RotorModel::new(&self::rotor("B")), 0.0, 1).unwrap();
    let ratio = diagram[0][0].natural_rad_s() / coarse[0].natural_rad_s();
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}
