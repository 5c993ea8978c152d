//! Collects raw samples of a machine from a log, or from a bus where its board is asked for a burst of
//! them (`raw_samples`), for what is computed from the converter's words themselves.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::io::frame::{RawAssembler, RawCounts};
use loadtwin_common::io::raw::RawSample;

use super::bus::{BusError, Link};
use super::frame_source::Source;
use super::twin_and_prove::burst_request;
use super::{CanError, standard, to_bus};

/// Share of the bus that the burst may take (%).
const SHARE: u8 = 50;

/// How long a bus may carry no raw sample before the collection ends.
const SILENCE: Duration = Duration::from_secs(3);

/// How long one wait for a frame takes at most.
const POLL: Duration = Duration::from_millis(100);

/// The whole raw samples that `source` carries for the machine whose frames begin at `base`: all of
/// a log, or up to `burst` of a bus, whose board is asked for them. Its estimator starts anew. With
/// the counts of what was whole, lost and damaged.
///
/// # Errors
/// When the source cannot be opened, or the bus fails for good.
pub fn raw_samples(
    source: Source<'_>,
    base: u16,
    burst: u16,
    stop: &AtomicBool,
) -> Result<(Vec<RawSample>, RawCounts), CanError> {
    let mut link = Link::new(source.open(Some(base), None)?, POLL);
    if source.log().is_none()
        && let Some(request) = burst_request(burst, SHARE, false)
    {
        link.send(&to_bus(&request), stop)?;
    }
    let mut assembler = RawAssembler::new(base);
    let mut samples = Vec::new();
    let most = source.log().map_or(usize::from(burst), |_| usize::MAX);
    let mut last = link.bus().now();
    while samples.len() < most && !stop.load(Ordering::Relaxed) {
        let received = match link.receive(POLL) {
            Ok(received) => received,
            Err(BusError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let frame = received
            .as_ref()
            .and_then(|received| standard(&received.frame));
        let now = link.bus().now();
        if let Some(sample) = frame.and_then(|(id, data)| assembler.push(id, data)) {
            samples.push(sample);
            last = now;
        }
        if source.log().is_none() && now.saturating_sub(last) > SILENCE {
            break;
        }
    }
    Ok((samples, assembler.counts()))
}
