//! Simulates a CAN controller and its wire as a `Bus` in simulated time, for tests: during given
//! periods every transmission fails, and the controller goes bus-off and comes back.
//!
//! Fault confinement of ISO 11898-1: a failed transmission adds 8 to the
//! transmit error counter, a good one takes 1 away; above 255 the controller
//! is bus-off; it comes back after 128 times 11 recessive bits.

use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

use super::bus::{Bus, BusError, Received};
use super::bus_frame::{BUS_OFF, BusFrame, FrameKind, RESTARTED};

/// Bits of a standard frame without its data and stuff bits: start to interframe space (ISO
/// 11898-1).
const OVERHEAD_BITS: u32 = 47;
/// Bits of an FD frame before and after its data phase, and in it beside the data: CRC of 21 bits
/// with its stuff bits, stuff count, length (ISO 11898-1).
const FD_NOMINAL_BITS: u32 = 30;
const FD_DATA_BITS: u32 = 37;
/// Bits of an error: flag of 6 to 12, delimiter of 8, interframe space of 3 (ISO 11898-1).
const ERROR_BITS: u32 = 23;
/// Recessive bits after which a controller that is bus-off comes back (ISO 11898-1).
const RECOVERY_BITS: u32 = 128 * 11;

/// The controller and its wire.
#[derive(Debug)]
pub struct SimulatedController {
    bit: Duration,
    data_bit: Duration,
    now: Duration,
    disturbed: Vec<Range<Duration>>,
    transmit_errors: u32,
    off: bool,
    /// Frames that reached the wire.
    pub wire: Vec<BusFrame>,
    /// Frames that it will receive.
    pub incoming: VecDeque<BusFrame>,
}

impl SimulatedController {
    /// At `bitrate` (bit/s), on a wire on which nothing passes during `disturbed`.
    pub fn new(bitrate: u32, disturbed: Vec<Range<Duration>>) -> Self {
        Self {
            bit: Duration::from_secs(1) / bitrate,
            data_bit: Duration::from_secs(1) / bitrate,
            now: Duration::ZERO,
            disturbed,
            transmit_errors: 0,
            off: false,
            wire: Vec::new(),
            incoming: VecDeque::new(),
        }
    }

    /// The same with another bit rate in the data phase of FD frames (bit/s).
    #[must_use]
    pub fn with_data_rate(self, bitrate: u32) -> Self {
        let data_bit = Duration::from_secs(1) / bitrate;
        Self { data_bit, ..self }
    }

    fn is_disturbed(&self) -> bool {
        self.disturbed.iter().any(|range| range.contains(&self.now))
    }

    fn report(&mut self, cause: u32) {
        let frame = BusFrame::new(FrameKind::Error, cause, false, &[0; 8]);
        self.incoming.extend(frame);
    }
}

impl Bus for SimulatedController {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        let frame = self.incoming.pop_front();
        if frame.is_none() {
            self.now += timeout;
        }
        let t_us = self.now.as_micros() as u64;
        Ok(frame.map(|frame| Received { t_us, frame }))
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        if self.off {
            return Err(BusError::Off);
        }
        // The controller repeats a failed frame by itself, without end.
        while self.is_disturbed() {
            self.now += self.bit * ERROR_BITS;
            self.transmit_errors += 8;
            if self.transmit_errors > 255 {
                self.off = true;
                self.report(BUS_OFF);
                return Err(BusError::Off);
            }
        }
        let data_bits = 8 * frame.data().len() as u32;
        self.now += if matches!(frame.kind(), FrameKind::Fd { .. }) {
            self.bit * FD_NOMINAL_BITS + self.data_bit * (FD_DATA_BITS + data_bits)
        } else {
            self.bit * (OVERHEAD_BITS + data_bits)
        };
        self.transmit_errors = self.transmit_errors.saturating_sub(1);
        self.wire.push(*frame);
        Ok(())
    }

    fn restart(&mut self) -> Result<(), BusError> {
        if self.off {
            // A disturbed wire is dominant: no recessive bits to count.
            if self.is_disturbed() {
                return Err(BusError::Off);
            }
            self.now += self.bit * RECOVERY_BITS;
            self.off = false;
            self.transmit_errors = 0;
            self.report(RESTARTED);
        }
        Ok(())
    }

    fn now(&self) -> Duration {
        self.now
    }

    fn wait(&mut self, time: Duration) {
        self.now += time;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use loadtwin_common::io::frame::Frame;

    use super::*;
    use crate::bus::{Link, LinkCounts};
    use crate::to_bus;

    const MS: Duration = Duration::from_millis(1);

    fn link(disturbed: Vec<Range<Duration>>, patience: Duration) -> Link<SimulatedController> {
        Link::new(SimulatedController::new(500_000, disturbed), patience)
    }

    fn send(link: &mut Link<SimulatedController>, n: u8) -> bool {
        let frame = to_bus(&Frame {
            id: 0x501,
            data: [n; 8],
        });
        link.send(&frame, &AtomicBool::new(false))
            .expect("passes by itself")
    }

    #[test]
    fn a_short_disturbance_costs_only_repetitions() {
        let mut link = link(vec![Duration::ZERO..MS], 100 * MS);
        assert!(send(&mut link, 1));
        assert_eq!(
            link.counts(),
            LinkCounts {
                sent: 1,
                ..LinkCounts::default()
            }
        );
        assert_eq!(link.bus().transmit_errors, 8 * 22 - 1);
    }

    #[test]
    fn bus_off_is_left_once_the_wire_is_free_and_no_frame_is_lost_within_the_patience() {
        let mut link = link(vec![5 * MS..500 * MS], 2000 * MS);
        let sent: Vec<bool> = (0..200).map(|n| send(&mut link, n)).collect();
        assert!(sent.iter().all(|sent| *sent));
        let counts = link.counts();
        assert_eq!(
            (
                counts.sent,
                counts.bus_off,
                counts.recovered,
                counts.dropped
            ),
            (200, 1, 1, 0)
        );
        let order: Vec<u8> = link
            .bus()
            .wire
            .iter()
            .map(|frame| frame.data()[0])
            .collect();
        assert_eq!(order, (0..200).collect::<Vec<u8>>());
        let first = link
            .receive(MS)
            .expect("bus")
            .expect("an error frame")
            .frame;
        assert!(first.is_error() && first.id() == BUS_OFF);
    }

    #[test]
    fn the_wait_between_attempts_is_bounded() {
        // 60 s disturbed: the last attempts come once a second, so it is left
        // at most a second, and the recovery, after the wire is free.
        let mut link = link(vec![MS..60_000 * MS], 120_000 * MS);
        while link.bus().now() < 60_000 * MS {
            assert!(send(&mut link, 0));
        }
        assert!(link.bus().now() < 61_010 * MS, "{:?}", link.bus().now());
    }

    #[test]
    fn a_frame_is_given_up_after_the_patience_and_counted() {
        let mut link = link(vec![Duration::ZERO..10_000 * MS], 100 * MS);
        for n in 0..5 {
            assert!(!send(&mut link, n));
        }
        assert_eq!((link.counts().dropped, link.counts().bus_off), (5, 1));
        assert!(link.bus().now() < 5_500 * MS);
    }
}
