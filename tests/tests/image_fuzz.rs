//! Fuzz tests of damaged model images: each of a million is refused whole, or runs and sends frames
//! that decode; the estimates of those accepted stay finite, on several kinds of machine.

use loadtwin::image_build::Filter;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::frame::{IDS_PER_MACHINE, decode};
use loadtwin_firmware::app::App;
use loadtwin_tests::descriptions::variants;
use loadtwin_tests::gearbox::{run, samples};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const CASES: u32 = 1_000_000;
/// Damaged images that one application is offered.
const BATCH: u32 = 1000;

/// Numbers that a check may have forgotten.
const WORDS: [f32; 8] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN_POSITIVE,
    -1.0,
    0.0,
    1e-45,
];

/// Damages an image in one to three places: bits, bytes, lengths, numbers, pieces.
fn damage(image: &mut Vec<u8>, random: &mut impl Rng) {
    for _ in 0..random.random_range(1..4) {
        let len = image.len();
        let at = random.random_range(0..len);
        match random.random_range(0..8) {
            0 => image[at] ^= 1 << random.random_range(0..8),
            1 => image[at] = [0, 1, 0x7F, 0x80, 0xFF][random.random_range(0..5)],
            2 => image.truncate(at.max(1)),
            3 => image.extend((0..random.random_range(1..20)).map(|_| random.random::<u8>())),
            4 => drop(image.remove(at)),
            5 => image.insert(at, random.random()),
            6 => {
                let from = random.random_range(0..len);
                let piece = image[from..len.min(from + 24)].to_vec();
                let end = len.min(at + piece.len());
                image.splice(at..end, piece);
            }
            _ => {
                let word = WORDS[random.random_range(0..WORDS.len())].to_le_bytes();
                let end = len.min(at + 4);
                image[at..end].copy_from_slice(&word[..end - at]);
            }
        }
        if image.len() < 2 {
            return;
        }
    }
}

#[test]
fn a_damaged_model_is_refused_whole_or_runs() {
    let mut images: Vec<(Filter, Vec<u8>)> = variants()
        .into_iter()
        .map(|variant| (variant.filter, variant.image))
        .collect();
    // The shortest of each filter: more of the damage meets what is parsed.
    images.sort_by_key(|(_, image)| image.len());
    let of = |filter| images.iter().find(|(f, _)| *f == filter);
    let images = [Filter::Aekf, Filter::Steady].map(|filter| &of(filter).expect("one").1);

    let mut random = ChaCha8Rng::seed_from_u64(3);
    let world = samples(200);
    let (mut refused, mut taken) = (0_u32, 0_u32);
    for batch in 0..CASES / BATCH {
        let image = images[batch as usize % images.len()];
        let damaged: Vec<Vec<u8>> = (0..BATCH)
            .map(|_| {
                let mut damaged = image.clone();
                damage(&mut damaged, &mut random);
                damaged
            })
            .collect();
        let mut app = App::try_new(image, 0).expect("the image is valid");
        for damaged in &damaged {
            let mut other = App::without_image();
            if other.load(damaged, 1).is_ok() {
                taken += 1;
                for frame in run(&mut other, &world[..20]) {
                    let base = frame.id / IDS_PER_MACHINE * IDS_PER_MACHINE;
                    assert!(decode(base, frame.id, &frame.data).is_ok(), "{frame:?}");
                }
            } else {
                refused += 1;
                assert!(app.load(damaged, 1).is_err());
            }
        }
        let mut untouched = App::try_new(image, 0).expect("the image is valid");
        assert_eq!(run(&mut app, &world), run(&mut untouched, &world));
    }
    println!("{refused} refused, {taken} taken and run");
    assert!(refused > CASES / 10 && taken > CASES / 100);
}

/// What every estimate keeps, whatever the image: finite numbers, no negative variance, an angle in
/// [-pi, pi), a reason where a load is unknown.
fn assert_invariants(estimate: &Estimate) {
    use std::f32::consts::PI;
    let not_negative = |x: f32| x >= 0.0 && x.is_finite();
    assert!((-PI..PI).contains(&estimate.angle_rad), "{estimate:?}");
    for load in &estimate.loads {
        assert!(load.value.is_finite() && not_negative(load.std), "{load:?}");
        assert!(load.std < f32::MAX || !load.fault.is_none(), "{load:?}");
    }
    for sensor in &estimate.sensors {
        assert!(
            sensor.measured.is_finite() && sensor.innovation.is_finite(),
            "{sensor:?}"
        );
        assert!(
            not_negative(sensor.innovation_variance) && not_negative(sensor.nis),
            "{sensor:?}"
        );
    }
}

/// Of every kind of machine: image -> estimator -> 100 steps.
#[test]
fn a_damaged_model_that_is_taken_keeps_the_invariants_of_an_estimate() {
    const EACH: u32 = 10_000;
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let world = samples(100);
    let mut kinds: Vec<Vec<u8>> = Vec::new();
    for variant in variants() {
        // Machines and filters differ in length.
        let len = variant.image.len();
        if len < 20_000 && kinds.iter().all(|image| image.len() != len) {
            kinds.push(variant.image);
        }
    }
    assert!(kinds.len() > 4);
    let mut taken = 0_u32;
    for image in kinds {
        for _ in 0..EACH {
            let mut damaged = image.clone();
            damage(&mut damaged, &mut random);
            let Ok(mut estimator) = Image::from_bytes(&damaged).and_then(Estimator::try_build)
            else {
                continue;
            };
            taken += 1;
            for raw in &world {
                assert_invariants(&estimator.step(raw));
            }
        }
    }
    assert!(taken > EACH, "{taken} taken");
}
