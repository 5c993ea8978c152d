//! For every machine, set of sensors and filter the emulated board sends what the
//! host sends, to the last bit, through everything that can go wrong with a sample.

use std::thread;
use std::time::Duration;

use loadtwin::image_build::Filter;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_tests::descriptions::{Variant, variants};

use crate::line;

/// Of each variant; `LOADTWIN_SECONDS` sets another.
const SECONDS: f64 = 2.5;

/// Runs a variant on both sides and compares.
fn compare(variant: &Variant, seconds: f64) {
    let name = &variant.name;
    let samples = variant.samples(seconds);
    let frames = line::compare(name, &variant.image, &samples, Duration::from_secs(20));
    // Loads come every few samples, sensors less often.
    assert!(
        2 * frames.len() >= samples.len(),
        "{name}: {}",
        frames.len()
    );

    let mut host = Estimator::try_build(Image::from_bytes(&variant.image).unwrap()).unwrap();
    let steady = samples.iter().filter(|raw| host.step(raw).steady).count();
    assert!(steady > 0 || variant.filter != Filter::Steady, "{name}");
    println!(
        "{name}: {} samples, {steady} by steady gains, {} frames equal",
        samples.len(),
        frames.len()
    );
}

#[test]
fn every_machine_with_every_set_and_filter_gives_the_bits_of_the_host() {
    let seconds = loadtwin_tests::seconds(SECONDS);
    let variants = variants();
    assert!(variants.len() >= 43, "{} variants", variants.len());
    // One emulator for each of two cores.
    for pair in variants.chunks(2) {
        thread::scope(|scope| {
            for variant in pair {
                scope.spawn(move || compare(variant, seconds));
            }
        });
    }
}
