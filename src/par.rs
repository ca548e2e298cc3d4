//! Work shared between threads so that the result does not depend on how many there are:
//! fixed chunks, answered in order; a random generator for each chunk.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::cell::Cell;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

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
    let chunks = 0..len.div_ceil(chunk);
    let one = |i: usize| work(i * chunk..((i + 1) * chunk).min(len));
    if ALONE.get() {
        return chunks.map(one).collect();
    }
    chunks.into_par_iter().map(one).collect()
}

/// Applies `work` to each item on rayon's threads, the answers in the order of the items; `desk` makes what one thread works
/// with, which must not change an answer.
pub fn map_each<T, D, R>(
    items: Vec<T>,
    desk: impl Fn() -> D + Sync + Send,
    work: impl Fn(&mut D, T) -> R + Sync + Send,
) -> Vec<R>
where
    T: Send,
    R: Send,
{
    if ALONE.get() {
        let mut desk = desk();
        return items.into_iter().map(|i| work(&mut desk, i)).collect();
    }
    items.into_par_iter().map_init(desk, work).collect()
}

/// [`map_chunks`] where `desk` makes what one thread works with. A desk serves one chunk after another: it must not change an
/// answer, but room that is large is made once a thread.
pub fn map_chunks_at<T, D>(
    len: usize,
    chunk: usize,
    desk: impl Fn() -> D + Sync,
    work: impl Fn(&mut D, Range<usize>) -> T + Sync,
) -> Vec<T>
where
    T: Send,
    D: Send,
{
    let free = Mutex::new(Vec::new());
    let of = || free.lock().unwrap_or_else(PoisonError::into_inner);
    map_chunks(len, chunk, |range| {
        let before = of().pop();
        let mut here = before.unwrap_or_else(&desk);
        let answer = work(&mut here, range);
        of().push(here);
        answer
    })
}

thread_local! {
    /// Whether this thread is to do all that it is given by itself.
    static ALONE: Cell<bool> = const { Cell::new(false) };
}

/// Does `work` on this thread alone: chunks and items that are met in it are not shared with others. So its time is its own;
/// a thread that waits for others takes up what has nothing to do with it.
pub fn alone<R>(work: impl FnOnce() -> R) -> R {
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            ALONE.set(self.0);
        }
    }
    let _before = Before(ALONE.replace(true));
    work()
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
    fn desks_serve_many_chunks_and_the_answers_are_in_order() {
        let made = std::sync::atomic::AtomicUsize::new(0);
        let desk = || made.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let answers = map_chunks_at(1000, 3, desk, |_, range| range.start);
        assert_eq!(answers, (0..1000).step_by(3).collect::<Vec<_>>());
        // Threads that work at a time have one each.
        assert!(made.into_inner() <= rayon::current_num_threads() + 1);
    }

    #[test]
    fn chunks_cover_everything_in_order() {
        for (len, chunk) in [(0, 4), (1, 4), (4, 4), (9, 4), (3, 0)] {
            let seen: Vec<usize> = map_chunks(len, chunk, |r| r.collect::<Vec<_>>()).concat();
            assert_eq!(seen, (0..len).collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_is_done_alone_stays_on_its_thread() {
        let here = std::thread::current().id();
        let apart = || -> Vec<bool> {
            let chunks = map_chunks(64, 1, |_| std::thread::current().id() == here);
            let items = vec![(); 64];
            let each = map_each(items, || (), |(), ()| std::thread::current().id() == here);
            [chunks, each].concat()
        };
        assert!(alone(|| alone(apart)).into_iter().all(|on| on));
        // This thread is none of rayon's.
        assert!(apart().into_iter().all(|on| !on));
        let items: Vec<usize> = (0..100).collect();
        let squares = |items: Vec<usize>| map_each(items, || 2, |by, i| i * *by);
        let want: Vec<usize> = (0..100).map(|i| 2 * i).collect();
        assert_eq!(squares(items.clone()), want);
        assert_eq!(alone(|| squares(items)), want);
    }
}
