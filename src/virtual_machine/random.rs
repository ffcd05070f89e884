//! Random number generators with a seed, so that runs can be repeated.

use rand::SeedableRng;
use rand_pcg::Pcg32;

/// Returns a random number generator for one purpose. Each purpose has a separate generator, so that an
/// additional sensor does not change the noise of the other sensors.
pub(super) fn stream(seed: u64, purpose: &str) -> Pcg32 {
    let hash = purpose.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    Pcg32::seed_from_u64(hash ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}
