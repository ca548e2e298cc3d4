//! Work shared between threads so that the result does not depend on how many there are:
//! fixed chunks, answered in order; a random generator for each chunk.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::ops::Range;

/// Applies `work` to fixed chunks of `0..len` (the last may be shorter) on rayon's threads.
///
/// The answers come back in the order of the chunks, whatever the number of threads,
/// so that folding them one after another gives the same floating-point result every time.
/// (Never use rayon's `sum` or `reduce` on floats: their order varies.)
pub fn map_chunks<T, F>(len: usize, chunk: usize, work: F) -> Vec<T>
where
    T: Send,
    F: Fn(Range<usize>) -> T + Sync,
{
    let chunk = chunk.max(1);
    (0..len.div_ceil(chunk))
        .into_par_iter()
        .map(|i| work(i * chunk..((i + 1) * chunk).min(len)))
        .collect()
}

/// A random generator for one stream of one seed: the same on every machine and for any number of threads.
pub fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream);
    generator
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_cover_everything_in_order() {
        for (len, chunk) in [(0, 4), (1, 4), (4, 4), (9, 4), (3, 0)] {
            let seen: Vec<usize> = map_chunks(len, chunk, |r| r.collect::<Vec<_>>()).concat();
            assert_eq!(seen, (0..len).collect::<Vec<_>>());
        }
    }
}
