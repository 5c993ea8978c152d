//! Faults put into raw samples, each on every channel and encoder in turn: missing, saturated and
//! stuck words, early wraps and jumps of counters, wrong index pulses, lost and repeated samples.

use loadtwin::image_build::Sensors;
use loadtwin_common::io::raw::{MAX_CHANNELS, RawSample};

/// `samples` with everything that a converter, an encoder, an index and a bus do wrong now and
/// then, on every channel in turn.
pub fn with_faults(samples: Vec<RawSample>, sensors: &Sensors) -> Vec<RawSample> {
    let mut spoilt: Vec<RawSample> = Vec::with_capacity(samples.len());
    for sample in samples {
        let raw = spoil(sample, spoilt.last(), sensors);
        match () {
            // Dropped.
            () if due(&sample, 977) => {}
            // Sent twice.
            () if due(&sample, 1301) => spoilt.extend([raw, raw]),
            // Sent before the one that it follows.
            () if due(&sample, 1303) => spoilt.insert(spoilt.len().saturating_sub(1), raw),
            () => spoilt.push(raw),
        }
    }
    spoilt
}

fn spoil(sample: RawSample, before: Option<&RawSample>, sensors: &Sensors) -> RawSample {
    let (channels, encoders) = (sensors.channels.len(), sensors.encoders.len());
    let turn = |every: u32, of: usize| (sample.tick / every) as usize % of;
    let mut raw = sample;
    if channels > 0 {
        if due(&sample, 311) {
            // Not delivered, or not a number.
            raw.valid &= !(1 << turn(311, channels));
        }
        if due(&sample, 401) {
            raw.words[turn(401, channels)] = [i32::MAX, i32::MIN][turn(401, 2)];
        }
        if sample.tick % 1499 > 1450 {
            let stuck = turn(1499, channels);
            raw.words[stuck] = before.map_or(0, |before| before.words[stuck]);
        }
    }
    for (k, encoder) in sensors.encoders.iter().enumerate() {
        // Every counter wraps soon after the start.
        let mask = u32::MAX >> (32 - encoder.bits);
        let mut count = sample.encoders[k].wrapping_sub(100);
        if due(&sample, 701) && k == turn(701, encoders) {
            count = count.wrapping_add(turn(701, 64) as u32);
        }
        raw.encoders[k] = count & mask;
        if due(&sample, 1201) && k == turn(1201, encoders) {
            raw.valid &= !(1 << (MAX_CHANNELS + k));
        }
        if k == 0 {
            raw.index = raw.index.map(|count| count.wrapping_sub(100) & mask);
            if due(&sample, 1709) {
                // A pulse where none belongs.
                raw.index = Some(raw.encoders[0]);
            } else if sample.tick % 2000 > 1500 {
                // Pulses that do not come.
                raw.index = None;
            }
        }
    }
    raw
}

fn due(sample: &RawSample, every: u32) -> bool {
    sample.tick % every == every - 1
}
