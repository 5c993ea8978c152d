//! Rotor filter with sensors that are wrong from the first sample: their loads are not valid or inside their band, and
//! those of rotors that are as described, or roughly so, stay valid.

use loadtwin::machine::Machine;
use loadtwin_common::io::raw::RawSample;

use crate::bound::drawn;
use crate::mismatch::{Score, estimates, recorded, truth, wrong};

/// What is wrong with the readings of two sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Dead,
    Gain(f64),
    Swapped,
}

/// Every fault of the campaign.
const FAULTS: [Fault; 5] = [
    Fault::Dead,
    Fault::Gain(-1.0),
    Fault::Swapped,
    Fault::Gain(0.5),
    Fault::Gain(0.9),
];

/// `raw` with the sensors `i` and `j` wrong in every sample.
fn spoilt(raw: &[RawSample], [i, j]: [usize; 2], fault: Fault) -> Vec<RawSample> {
    let mut raw = raw.to_vec();
    for (k, raw) in raw.iter_mut().enumerate() {
        let before = [raw.words[i], raw.words[j]];
        // Evenly distributed over 0.3 µm.
        let noise = |factor: usize| (k.wrapping_mul(factor) >> 7) as i32 % 300 - 150;
        let [a, b] = match fault {
            Fault::Dead => [noise(2_654_435_761), noise(2_246_822_519)],
            Fault::Gain(by) => before.map(|word| (f64::from(word) * by).round() as i32),
            Fault::Swapped => [before[1], before[0]],
        };
        raw.set_word(i, a);
        raw.set_word(j, b);
    }
    raw
}

/// Samples in a second.
const RATE: usize = 2000;

/// The score from 0.5 s on of a recording of `real`, its samples changed by `change`.
fn scored(
    described: &Machine,
    real: &Machine,
    change: impl Fn(&[RawSample]) -> Vec<RawSample>,
) -> Score {
    scored_after(described, real, [RATE / 2, 3 * RATE], change).0
}

/// As [`scored`], from and to these samples; also the mean standard deviation of the loads in it (N).
fn scored_after(
    described: &Machine,
    real: &Machine,
    [first, end]: [usize; 2],
    change: impl Fn(&[RawSample]) -> Vec<RawSample>,
) -> (Score, f64) {
    let (recorded, scenario) = recorded(described, real, (end / RATE) as f64);
    let (mut score, mut deviations) = (Score::default(), Vec::new());
    estimates(described, &change(&recorded.raw), |k, estimate, _| {
        let (truth, peak) = truth(described, &scenario, k);
        if k >= first {
            score.push(estimate, &truth, peak);
            deviations.extend(estimate.loads.iter().map(|load| f64::from(load.std)));
        }
    });
    let mean = deviations.iter().sum::<f64>() / deviations.len() as f64;
    (score, mean)
}

/// `ROTORS`: how many rotors are drawn, all faults of all pairs in each, as described and roughly so; printed.
#[test]
fn two_sensors_that_are_wrong_from_the_start_do_not_mislead() {
    let count: Option<u64> = std::env::var("ROTORS").ok().and_then(|n| n.parse().ok());
    let pairs = [[0, 1], [0, 3], [1, 3], [0, 2], [1, 2], [2, 3]];
    let (faults, pairs) = match count {
        None => (&FAULTS[..3], &pairs[..2]),
        Some(_) => (&FAULTS[..], &pairs[..]),
    };
    let (mut misleading, mut cases) = (0, 0);
    for seed in 90..90 + count.unwrap_or(1) {
        let described = drawn(seed);
        for real in [described.clone(), wrong(&described, seed)] {
            let sound = scored(&described, &real, <[RawSample]>::to_vec);
            println!("{seed}: sound {sound:?}");
            assert!(sound.misleading <= 0.01 * sound.samples, "{seed}");
            assert!(
                count.is_some() || sound.valid > 0.99 * sound.samples,
                "{seed}: {sound:?}"
            );
            for (fault, pair) in faults
                .iter()
                .flat_map(|f| pairs.iter().map(move |p| (*f, *p)))
            {
                let score = scored(&described, &real, |raw| spoilt(raw, pair, fault));
                println!("{seed}: {fault:?} {pair:?} {score:?}");
                cases += 1;
                // A quarter of a second goes by until no level explains the readings.
                misleading += u64::from(score.misleading > 0.1 * score.samples);
            }
        }
    }
    println!("misleading: {misleading} of {cases}");
    assert!(
        count.is_some() || misleading == 0,
        "{misleading} of {cases}"
    );
}

#[test]
fn loads_are_valid_two_seconds_after_the_sensors_of_a_start_became_right() {
    let (mut narrow, mut cases) = (0, 0);
    for seed in [90, 91] {
        let described = drawn(seed);
        let part = [3 * RATE, 4 * RATE];
        let (sound, std) = scored_after(&described, &described, part, <[RawSample]>::to_vec);
        assert!(sound.valid == sound.samples, "{seed}: {sound:?}");
        for fault in FAULTS {
            let (score, found) = scored_after(&described, &described, part, |raw| {
                [&spoilt(&raw[..RATE], [0, 3], fault), &raw[RATE..]].concat()
            });
            println!("{seed}: {fault:?} {score:?} {found} of {std} N");
            assert!(score.valid >= 0.8 * score.samples && score.misleading == 0.0);
            narrow += u64::from(found < 1.1 * std);
            cases += 1;
        }
    }
    assert!(2 * narrow >= cases, "{narrow} of {cases}");
}

/// `ROTORS`: how many rotors are drawn.
#[test]
fn loads_of_rotors_that_are_not_as_described_are_inside_their_band_at_one_speed() {
    let count = std::env::var("ROTORS").map_or(6, |count| count.parse().unwrap());
    let [mut rough, mut exact] = [Score::default(); 2];
    for seed in 120..120 + count {
        let described = drawn(seed);
        for (real, sum) in [
            (wrong(&described, seed), &mut rough),
            (described.clone(), &mut exact),
        ] {
            let score = scored(&described, &real, <[RawSample]>::to_vec);
            println!("{seed}: {score:?}");
            sum.samples += score.samples;
            sum.valid += score.valid;
            sum.inside += score.inside;
            sum.misleading += score.misleading;
        }
    }
    println!("not as described: {rough:?}\nas described: {exact:?}");
    assert!(rough.misleading <= 0.01 * rough.samples, "{rough:?}");
    assert!(rough.valid >= 0.2 * rough.samples, "{rough:?}");
    assert!(
        exact.misleading == 0.0 && exact.valid == exact.samples,
        "{exact:?}"
    );
}
