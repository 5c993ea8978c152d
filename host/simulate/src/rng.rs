//! Gives the random number streams of a simulation, two for each purpose: one that is the same in
//! every recording of an individual machine, and one for the recording.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Two sources of random numbers for one purpose.
///
/// Each purpose has streams of its own, so that no effect changes what another
/// one draws.
pub(crate) struct Draw {
    /// The same in every recording of one machine.
    pub individual: ChaCha8Rng,
    /// Different in each recording.
    pub recording: ChaCha8Rng,
}

impl Draw {
    /// The streams of `purpose`, for individual number `individual` in the
    /// recording with number `seed`.
    pub(crate) fn new(purpose: &str, individual: u64, seed: u64) -> Self {
        let mut draw = Self {
            individual: ChaCha8Rng::seed_from_u64(individual),
            recording: ChaCha8Rng::seed_from_u64(seed),
        };
        // FNV-1a; the lowest bit keeps the two apart where the seeds are equal.
        let stream = purpose
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            });
        draw.individual.set_stream(stream | 1);
        draw.recording.set_stream(stream & !1);
        draw
    }
}
