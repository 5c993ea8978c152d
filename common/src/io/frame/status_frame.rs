//! Encodes the status of a board as CAN frames (heartbeat), decodes a frame, and merges received
//! pages (`Status`). Each frame has the state of the estimator and one of six pages: hash of the
//! image, sample counters, bus counters, frame format, tick, sample rate.

use crate::io::frame::WIRE_VERSION;
use crate::io::frame::signal_layout::status as field;

/// What the estimator is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// There is no image that it could run.
    #[default]
    NoImage = 0,
    /// There is an image, but no samples.
    Waiting = 1,
    /// It runs, and waits for the index pulse.
    Homing = 2,
    /// It runs.
    Running = 3,
}

impl State {
    /// Every state.
    pub const ALL: [Self; 4] = [Self::NoImage, Self::Waiting, Self::Homing, Self::Running];

    /// The name in tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoImage => "no image",
            Self::Waiting => "waiting for samples",
            Self::Homing => "homing",
            Self::Running => "running",
        }
    }
}

/// Status of a board. The counts wrap in the board and saturate at 65535 on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// What the estimator is doing.
    pub state: State,
    /// Tick of the last sample.
    pub tick: u32,
    /// Samples that came before the step for the one before had ended.
    pub overruns: u32,
    /// Samples that were due and did not come.
    pub missed: u32,
    /// Times the controller went bus-off.
    pub bus_off: u32,
    /// Frames dropped because the queue to the bus was full.
    pub queue_overflow: u32,
    /// Why the last offered image was refused, the code of the upload
    /// protocol; 0: none was.
    pub refused: u8,
    /// Sensors of the machine.
    pub sensors: u8,
}

impl Status {
    /// Status of a board before its first sample; the default, as a constant.
    pub const fn new() -> Self {
        Self {
            state: State::NoImage,
            tick: 0,
            overruns: 0,
            missed: 0,
            bus_off: 0,
            queue_overflow: 0,
            refused: 0,
            sensors: 0,
        }
    }
}

/// What one status frame reports, besides the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatusPage {
    /// Name of the model: the first four bytes of its SHA-256.
    Image(u32),
    /// `overruns` and `missed`.
    Samples,
    /// `bus_off` and `queue_overflow`.
    Bus,
    /// `refused`, `sensors` and the shape of the frames.
    Format {
        /// Version of the bytes.
        wire_version: u8,
        /// Loads of the machine.
        loads: u8,
        /// Load frames come every `2^load_every` samples.
        load_every: u8,
        /// Sensor frames come every `2^sensor_every` samples.
        sensor_every: u8,
    },
    /// `tick`.
    Tick,
    /// Sample rate (mHz).
    Rate(u32),
}

/// The fixed numbers of the pages, and the page that is sent next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pages {
    pub(crate) counter: u8,
    pub(crate) page: u32,
    pub(crate) image_hash: u32,
    pub(crate) loads: u32,
    pub(crate) load_every: u32,
    pub(crate) sensor_every: u32,
    pub(crate) rate_mhz: u32,
}

impl Pages {
    /// Number of pages.
    const COUNT: u32 = 6;

    /// Those of a board without image.
    pub(crate) const fn new() -> Self {
        Self {
            counter: 0,
            page: 0,
            image_hash: 0,
            loads: 0,
            load_every: 0,
            sensor_every: 0,
            rate_mhz: 0,
        }
    }

    /// Counter and payload of the next page.
    pub(crate) fn next(&mut self, status: &Status) -> (u8, u64) {
        let (counter, page) = (self.counter, self.page);
        self.counter = counter.wrapping_add(1);
        self.page = if page + 1 < Self::COUNT { page + 1 } else { 0 };
        let content = match page {
            0 => field::IMAGE_HASH.put(self.image_hash),
            1 => {
                field::OVERRUNS.put(saturated(status.overruns))
                    | field::MISSED.put(saturated(status.missed))
            }
            2 => {
                field::BUS_OFF.put(saturated(status.bus_off))
                    | field::QUEUE_OVERFLOW.put(saturated(status.queue_overflow))
            }
            3 => {
                field::REFUSED.put(status.refused.into())
                    | field::WIRE_VERSION.put(WIRE_VERSION.into())
                    | field::LOADS.put(self.loads)
                    | field::SENSORS.put(status.sensors.into())
                    | field::LOAD_EVERY.put(self.load_every)
                    | field::SENSOR_EVERY.put(self.sensor_every)
            }
            4 => field::TICK.put(status.tick),
            _ => field::RATE.put(self.rate_mhz),
        };
        (
            counter,
            field::PAGE.put(page) | field::STATE.put(status.state as u32) | content,
        )
    }
}

fn saturated(count: u32) -> u32 {
    count.min(u16::MAX.into())
}

impl Status {
    /// A status with the content of this page, and the page.
    pub(crate) fn decode(payload: u64) -> Option<(Self, StatusPage)> {
        let code = field::STATE.get(payload);
        let state = State::ALL.into_iter().find(|state| *state as u32 == code)?;
        let mut status = Self {
            state,
            ..Self::new()
        };
        let page = match field::PAGE.get(payload) {
            0 => StatusPage::Image(field::IMAGE_HASH.get(payload)),
            1 => {
                status.overruns = field::OVERRUNS.get(payload);
                status.missed = field::MISSED.get(payload);
                StatusPage::Samples
            }
            2 => {
                status.bus_off = field::BUS_OFF.get(payload);
                status.queue_overflow = field::QUEUE_OVERFLOW.get(payload);
                StatusPage::Bus
            }
            3 => {
                status.refused = field::REFUSED.get(payload) as u8;
                status.sensors = field::SENSORS.get(payload) as u8;
                StatusPage::Format {
                    wire_version: field::WIRE_VERSION.get(payload) as u8,
                    loads: field::LOADS.get(payload) as u8,
                    load_every: field::LOAD_EVERY.get(payload) as u8,
                    sensor_every: field::SENSOR_EVERY.get(payload) as u8,
                }
            }
            4 => {
                status.tick = field::TICK.get(payload);
                StatusPage::Tick
            }
            5 => StatusPage::Rate(field::RATE.get(payload)),
            _ => return None,
        };
        Some((status, page))
    }

    /// Takes over `page` of `newer`.
    pub fn merge(&mut self, newer: &Self, page: StatusPage) {
        self.state = newer.state;
        match page {
            StatusPage::Samples => {
                self.overruns = newer.overruns;
                self.missed = newer.missed;
            }
            StatusPage::Bus => {
                self.bus_off = newer.bus_off;
                self.queue_overflow = newer.queue_overflow;
            }
            StatusPage::Format { .. } => {
                self.refused = newer.refused;
                self.sensors = newer.sensors;
            }
            StatusPage::Tick => self.tick = newer.tick,
            StatusPage::Image(_) | StatusPage::Rate(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_pages_tell_everything() {
        let status = Status {
            state: State::Homing,
            tick: 0xDEAD_BEEF,
            overruns: 3,
            missed: 40_000,
            bus_off: 5,
            queue_overflow: 6,
            refused: 0xF8,
            sensors: 5,
        };
        let mut pages = Pages {
            image_hash: 0x0123_4567,
            loads: 2,
            load_every: 1,
            sensor_every: 3,
            rate_mhz: 1_000_000,
            ..Pages::new()
        };
        let mut result = Status::new();
        let mut seen = [None; 6];
        for (i, seen) in seen.iter_mut().enumerate() {
            let (counter, payload) = pages.next(&status);
            assert_eq!(usize::from(counter), i);
            let (part, page) = Status::decode(payload).expect("a page");
            result.merge(&part, page);
            *seen = Some(page);
        }
        assert_eq!(result, status);
        assert_eq!(seen[0], Some(StatusPage::Image(0x0123_4567)));
        assert_eq!(
            seen[3],
            Some(StatusPage::Format {
                wire_version: 1,
                loads: 2,
                load_every: 1,
                sensor_every: 3
            })
        );
        assert_eq!(seen[5], Some(StatusPage::Rate(1_000_000)));
        assert_eq!(pages.next(&status).0, 6);
    }

    #[test]
    fn counts_saturate() {
        let mut pages = Pages {
            page: 1,
            ..Pages::new()
        };
        let (_, payload) = pages.next(&Status {
            missed: 65_536,
            ..Status::new()
        });
        assert_eq!(Status::decode(payload).expect("a page").0.missed, 65_535);
    }
}
