//! Steady filter beside the full filter on the shipped recording of the gearbox: every NMAE within
//! 0.1 points, an image of at most 32 KiB, the full recursion while gauges are missing, after lost
//! samples and before homing; damaged tables are refused.

use std::path::{Path, PathBuf};

use loadtwin::image_build::{self, Filter, Sensors};
use loadtwin::machine::Machine;
use loadtwin::replay::{self, Figures, Samples};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::RawSample;

fn example(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/gearbox")
        .join(file)
}

fn machine() -> Machine {
    Machine::load(&example("calibrated.toml")).unwrap()
}

fn sensors(machine: &Machine, set: &str, filter: Filter) -> Sensors {
    Sensors::choose(machine, Some(set))
        .unwrap()
        .filtered_by(filter)
}

#[test]
fn each_set_loses_less_than_a_tenth_of_a_point() {
    let machine = machine();
    let figures = |sensors: &Sensors| {
        let mut figures = Figures::new(&machine);
        let recording = example("start-stop.parquet");
        replay::run(&machine, sensors, &recording, |sample, estimate, _| {
            figures.push(sample, estimate);
        })
        .unwrap();
        figures
    };
    for set in &machine.sensor_sets {
        let full = figures(&sensors(&machine, &set.name, Filter::Aekf));
        let steady = figures(&sensors(&machine, &set.name, Filter::Steady));
        assert_eq!(full.steady_samples(), 0);
        // From the first index pulse after the start until shortly before the stop.
        let share = steady.steady_samples() as f64 / steady.samples() as f64;
        println!("{}: {share:.2} by steady gains", set.name);
        // Less where a gauge is left out for a while: the gains are those of the whole set.
        assert!(share > 0.55, "{}: {share}", set.name);
        for ((name, full), (_, steady)) in full.loads().zip(steady.loads()) {
            for (segment, full) in &full.nmae_percent {
                let (full, steady) = (full.unwrap(), steady.nmae_percent[segment].unwrap());
                assert!(
                    (steady - full).abs() <= 0.1,
                    "{} {name} {segment}: {steady} against {full}",
                    set.name
                );
            }
        }
    }
}

#[test]
fn an_image_for_five_gauges_fits_into_32_kib() {
    let machine = machine();
    for set in ["torque-arm-5", "ring-gear-5"] {
        let image = image_build::image(&machine, &sensors(&machine, set, Filter::Steady)).unwrap();
        assert!(image.len() <= 32 * 1024, "{set}: {} bytes", image.len());
    }
}

/// Raw samples of the shipped recording.
fn samples(machine: &Machine, sensors: &Sensors) -> Vec<RawSample> {
    let mut samples = Samples::open(machine, sensors, &example("start-stop.parquet")).unwrap();
    let mut raw = Vec::new();
    while samples.next_block(|sample| raw.push(sample.raw)).unwrap() {}
    raw
}

fn estimates(payload: &[u8], raw: &[RawSample]) -> Vec<Estimate> {
    let mut line = Estimator::try_build(Image::from_bytes(payload).unwrap()).unwrap();
    raw.iter().map(|raw| line.step(raw)).collect()
}

/// Where the torque dwells at nominal, and the gains are steady.
const DWELL: usize = 20_000;

#[test]
fn while_a_gauge_is_missing_the_full_recursion_goes_on() {
    let machine = machine();
    let sensors = sensors(&machine, "torque-arm-3", Filter::Steady);
    let payload = image_build::image(&machine, &sensors).unwrap();
    let mut raw = samples(&machine, &sensors);
    let sound = estimates(&payload, &raw);
    assert!(sound[DWELL - 1].steady && sound[DWELL].steady);
    for raw in &mut raw[DWELL..DWELL + 1000] {
        // The words of all three gauges, one after the other.
        raw.valid &= !0b111;
    }
    let found = estimates(&payload, &raw);
    let at = |k: usize| &found[DWELL + k];
    assert_eq!(at(0).sensors[0].fault, Fault::Missing);
    // The sample of the fault knows nothing of it before; the next one does.
    assert!((1..1001).all(|k| !at(k).steady));
    // Without gauges the load becomes less and less certain, and is so from the start.
    let std = |k: usize| at(k).loads[0].std;
    assert!(
        std(1) >= 0.9 * sound[DWELL].loads[0].std,
        "{} {}",
        std(1),
        sound[DWELL].loads[0].std
    );
    assert!(std(100) > 1.2 * std(1) && std(999) > 2.0 * std(1));
    // With them it comes back, to the steady gains as well.
    assert!(at(2000).steady);
    let difference = (at(3000).loads[0].value - sound[DWELL + 3000].loads[0].value).abs();
    assert!(difference < 100.0, "{difference}");
    assert!((std(3000) / sound[DWELL + 3000].loads[0].std - 1.0).abs() < 1e-3);
}

#[test]
fn lost_samples_and_a_false_pulse_lead_to_the_full_recursion() {
    let machine = machine();
    let sensors = sensors(&machine, "torque-arm-1", Filter::Steady);
    let payload = image_build::image(&machine, &sensors).unwrap();
    let raw = samples(&machine, &sensors);
    let mut lost = raw.clone();
    lost.drain(DWELL..DWELL + 10);
    let found = estimates(&payload, &lost);
    assert!(found[DWELL].lost == 10 && !found[DWELL + 1].steady);
    let mut slipped = raw;
    slipped[DWELL].index = slipped[DWELL - 1]
        .index
        .or(Some(slipped[DWELL].encoders[0] + 3000));
    let found = estimates(&payload, &slipped);
    assert!(found[DWELL].steady && !found[DWELL + 1].steady);
    assert_eq!(found[DWELL].loads[0].fault, Fault::Slipped);
}

#[test]
fn before_the_angle_is_homed_every_sample_takes_the_full_recursion() {
    let machine = machine();
    let sensors = sensors(&machine, "ring-gear-3", Filter::Steady);
    let payload = image_build::image(&machine, &sensors).unwrap();
    let found = estimates(&payload, &samples(&machine, &sensors));
    assert!(found.iter().all(|e| e.homed || !e.steady));
    // A ring gear's gauges are blind between the planets: at standstill their
    // gains are not those of the turning carrier.
    assert!(!found.last().unwrap().steady);
}

#[test]
fn a_damaged_table_is_refused() {
    let machine = machine();
    let full =
        image_build::image(&machine, &sensors(&machine, "torque-arm-1", Filter::Aekf)).unwrap();
    let steady =
        image_build::image(&machine, &sensors(&machine, "torque-arm-1", Filter::Steady)).unwrap();
    // The table stands at the end, behind its length; the last entries are variances.
    let table = full.len() + 100;
    let mut damaged = steady.clone();
    damaged[table..table + 64].fill(0xff);
    let refused = Estimator::try_build(Image::from_bytes(&damaged).unwrap()).unwrap_err();
    assert!(refused.to_string().contains("steady gains"), "{refused}");
}
