//! Detects encoder counters that wrap around earlier than the number of bits in the description
//! implies, from jumps of the counts against the motion, and names the right number of bits.

use loadtwin_machine::Encoder;

use super::Cause;
use crate::Sample;

/// Steps of a counter that are no motion, over the step before.
const JUMP: i64 = 8;

/// Least of them [counts]: counters of 7 bits and more.
const LEAST: i64 = 100;

/// The counts of one encoder, gathered sample by sample.
#[derive(Clone, Debug)]
pub(super) struct Counter {
    name: String,
    bits: u32,
    last: Option<i64>,
    step: Option<i64>,
    /// Least and largest count.
    range: Option<[i64; 2]>,
    /// Jumps against the motion: how many, and the least distance of counts that each can mean.
    jumps: u64,
    distance: i64,
}

impl Counter {
    /// Nothing gathered yet.
    pub fn new(encoder: &Encoder) -> Self {
        Self {
            name: encoder.name.clone(),
            bits: encoder.bits,
            last: None,
            step: None,
            range: None,
            jumps: 0,
            distance: i64::MAX,
        }
    }

    /// Adds the count of encoder `k` in one sample.
    pub fn push(&mut self, sample: &Sample<'_>, k: usize) {
        let raw = &sample.raw;
        let count = raw.encoders.get(k).filter(|_| raw.has_encoder(k));
        let Some(&count) = count else {
            (self.last, self.step) = (None, None);
            return;
        };
        let count = signed(count, self.bits);
        let [least, most] = self.range.get_or_insert([count; 2]);
        (*least, *most) = (count.min(*least), count.max(*most));
        if let Some(last) = self.last.replace(count) {
            let step = count - last;
            match self.step {
                Some(before) if step.abs() > JUMP * (before.abs() + 1) && step.abs() >= LEAST => {
                    if before.signum() * step.signum() < 0 {
                        self.jumps += 1;
                        let distance = step.abs() + 2 * (before.abs() + 1);
                        self.distance = self.distance.min(distance);
                    }
                }
                _ => self.step = Some(step),
            }
        }
    }

    /// Whether all jumps are from one end of the counts to the other.
    pub fn cause(&self) -> Option<Cause> {
        let [least, most] = self.range?;
        let span = most - least + 1;
        if self.jumps == 0 || self.distance < span || span > 1 << (self.bits - 1) {
            return None;
        }
        let modulus = u64::try_from(span).ok()?.next_power_of_two();
        let is_binary = modulus <= u64::try_from(self.distance).ok()?;
        let remedy = if is_binary {
            format!("set bits = {} of {}", modulus.ilog2(), self.name)
        } else {
            format!(
                "give the column as an angle (`unit` of the channel under [recording.channels]), or \
                 counts of {} that run on",
                self.name
            )
        };
        let after = if is_binary { modulus } else { span as u64 };
        Some(Cause {
            kind: "counts",
            what: format!(
                "{} begins anew after {after} counts ({} times), bits {}",
                self.name, self.jumps, self.bits
            ),
            corrected_percent: None,
            remedy,
        })
    }
}

/// A count of so many bits as a number with a sign.
fn signed(count: u32, bits: u32) -> i64 {
    let count = i64::from(count);
    let half = 1_i64 << (bits - 1);
    if count >= half {
        count - 2 * half
    } else {
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_common::io::raw::RawSample;

    fn cause(bits: u32, counts: impl IntoIterator<Item = i64>) -> Option<Cause> {
        let mut counter = Counter {
            bits,
            name: "main".into(),
            last: None,
            step: None,
            range: None,
            jumps: 0,
            distance: i64::MAX,
        };
        for count in counts {
            let mut raw = RawSample::default();
            raw.set_encoder(0, count.rem_euclid(1 << bits) as u32);
            let sample = Sample {
                t: 0.0,
                segment_t: 0.0,
                raw,
                references: &[],
                displacements: &[],
            };
            counter.push(&sample, 0);
        }
        counter.cause()
    }

    #[test]
    fn a_counter_of_fewer_bits_is_named() {
        let up = |k: i64| 17 * k;
        let unsigned = cause(32, (0..9000).map(|k| up(k) % 65536)).unwrap();
        assert!(unsigned.what.contains("65536"), "{}", unsigned.what);
        assert_eq!(unsigned.remedy, "set bits = 16 of main");
        let down = cause(32, (0..9000).map(|k| (-up(k)).rem_euclid(65536))).unwrap();
        assert_eq!(down.remedy, "set bits = 16 of main");
        let signed = cause(24, (0..9000).map(|k| i64::from(up(k) as i16))).unwrap();
        assert_eq!(signed.remedy, "set bits = 16 of main");
        let turns = cause(32, (0..9000).map(|k| up(k) % 5000)).unwrap();
        assert!(turns.remedy.contains("angle"), "{}", turns.remedy);
    }

    #[test]
    fn what_is_described_and_what_jumps_otherwise_is_not() {
        assert_eq!(cause(16, (0..9000).map(|k| 17 * k)), None);
        assert_eq!(cause(32, (0..9000).map(|k| 17 * k)), None);
        // One count with a wrong bit, and a counter that was set anew.
        assert_eq!(
            cause(
                32,
                (0..9000).map(|k| 17 * k + if k == 700 { 65536 } else { 0 })
            ),
            None
        );
        assert_eq!(
            cause(
                32,
                (0..9000).map(|k| 17 * k - if k > 700 { 8000 } else { 0 })
            ),
            None
        );
        // A shaft that turns back and forth.
        let swing = (0..9000).map(|k| (3000.0 * (0.01 * f64::from(k)).sin()) as i64);
        assert_eq!(cause(32, swing), None);
    }
}
