//! Work shared between threads so that the result does not depend on how many there are:
//! fixed chunks, combined in order; a random generator for each chunk.

use crate::Result;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::cell::Cell;
use std::collections::VecDeque;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::channel;
use std::sync::{Mutex, PoisonError};

/// Applies `work` to fixed chunks of `0..len` (the last may be shorter) on rayon's threads.
///
/// The results come back in the order of the chunks, whatever the number of threads,
/// so that folding them one after another gives the same floating-point result every time.
/// (Never use rayon's `sum` or `reduce` on floats: their order varies.)
///
/// ```
/// use posing_core::numeric::parallel::map_chunks;
///
/// let sums = map_chunks(10, 4, |range| range.sum::<usize>());
/// assert_eq!(sums, [6, 22, 17]); // 0 to 3, 4 to 7, 8 and 9
/// ```
pub fn map_chunks<T, F>(len: usize, chunk: usize, work: F) -> Vec<T>
where
    T: Send,
    F: Fn(Range<usize>) -> T + Sync,
{
    let chunk = chunk.max(1);
    let chunks = len.div_ceil(chunk);
    let one = |i: usize| work(i * chunk..((i + 1) * chunk).min(len));
    if SINGLE_THREADED.get() {
        return (0..chunks).map(one).collect();
    }
    let results: Vec<Mutex<Option<T>>> = (0..chunks).map(|_| Mutex::new(None)).collect();
    for_each(chunks, &|i| *unpoisoned(results[i].lock()) = Some(one(i)));
    let results = results.into_iter();
    results.filter_map(|r| unpoisoned(r.into_inner())).collect()
}

/// Calls `work` with each number below `count` on rayon's threads. Not generic: each of the many
/// callers would have rayon's machinery compiled for it, 8% of the library's code.
fn for_each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

/// What a lock holds, also after a panic, which rayon passes on.
fn unpoisoned<T>(lock: std::sync::LockResult<T>) -> T {
    lock.unwrap_or_else(PoisonError::into_inner)
}

/// Applies `work` to each item on rayon's threads, the results in the order of the items; `scratch`
/// makes what one thread works with, which must not change a result.
#[doc(hidden)]
pub fn map_each<T, D, R>(
    items: Vec<T>,
    scratch: impl Fn() -> D + Sync,
    work: impl Fn(&mut D, T) -> R + Sync,
) -> Vec<R>
where
    T: Send,
    D: Send,
    R: Send,
{
    let items: Vec<Mutex<Option<T>>> = items.into_iter().map(|i| Mutex::new(Some(i))).collect();
    let done = map_chunks_with(items.len(), 1, scratch, |scratch, range| {
        let item = unpoisoned(items[range.start].lock()).take();
        item.map(|item| work(scratch, item))
    });
    done.into_iter().flatten().collect()
}

/// [`map_chunks`] where `scratch` makes what one thread works with. One serves one chunk after
/// another: it must not change a result, but room that is large is made once a thread.
#[doc(hidden)]
pub fn map_chunks_with<T, D>(
    len: usize,
    chunk: usize,
    scratch: impl Fn() -> D + Sync,
    work: impl Fn(&mut D, Range<usize>) -> T + Sync,
) -> Vec<T>
where
    T: Send,
    D: Send,
{
    let scratches = ScratchPool::default();
    map_chunks(len, chunk, |range| {
        scratches.with(&scratch, |scratch| work(scratch, range))
    })
}

/// What threads work with, one each at a time, kept for those that come after.
#[doc(hidden)]
pub struct ScratchPool<D>(Mutex<Vec<D>>);

impl<D> Default for ScratchPool<D> {
    fn default() -> Self {
        ScratchPool(Mutex::new(Vec::new()))
    }
}

impl<D> ScratchPool<D> {
    /// Works with what is free, or with something new.
    pub fn with<R>(&self, new: impl FnOnce() -> D, work: impl FnOnce(&mut D) -> R) -> R {
        let free = || unpoisoned(self.0.lock());
        let before = free().pop();
        let mut scratch = before.unwrap_or_else(new);
        let result = work(&mut scratch);
        free().push(scratch);
        result
    }
}

thread_local! {
    /// Whether this thread is to do all that it is given by itself.
    static SINGLE_THREADED: Cell<bool> = const { Cell::new(false) };
}

/// Does `work` on this thread alone: chunks and items that are met in it are not shared with
/// others. So its time is its own; a thread that waits for others takes up what has nothing to do
/// with it.
#[doc(hidden)]
pub fn single_threaded<R>(work: impl FnOnce() -> R) -> R {
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            SINGLE_THREADED.set(self.0);
        }
    }
    let _before = Before(SINGLE_THREADED.replace(true));
    work()
}

/// Works on the items of a stream on all of rayon's threads while `next` reads more of them, here;
/// `put` is given what became of them, here too, in their order.
///
/// Up to `ahead` items are on their way at a time: a few a thread where each is worked on by one,
/// two where work is shared among them itself. Not for rayon's own threads, as this one waits.
///
/// # Errors
/// The first, in the order of the items; all before it are put.
pub fn ordered_pipeline<T: Send, R: Send>(
    ahead: usize,
    mut next: impl FnMut() -> Result<Option<T>>,
    work: impl Fn(T) -> Result<R> + Sync,
    mut put: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    debug_assert!(rayon::current_thread_index().is_none());
    let (done, results) = channel();
    let work = &work;
    rayon::in_place_scope(|scope| {
        let mut end = None;
        let mut given = 0;
        // The results of the jobs that are under way, in the order of the jobs.
        let mut finished = VecDeque::new();
        loop {
            while end.is_none() && finished.len() < ahead.max(1) {
                match next() {
                    Ok(Some(item)) => {
                        let (done, number) = (done.clone(), given);
                        scope.spawn(move |_| {
                            let result = catch_unwind(AssertUnwindSafe(|| work(item)));
                            // Nobody listens any more after an error.
                            let _ = done.send((number, result));
                        });
                        given += 1;
                        finished.push_back(None);
                    }
                    Ok(None) => end = Some(Ok(())),
                    Err(error) => end = Some(Err(error)),
                }
            }
            let Some(wait) = finished.front() else {
                return end.unwrap_or(Ok(()));
            };
            if wait.is_none() {
                let (number, result): (usize, _) = match results.recv() {
                    Ok(result) => result,
                    Err(_) => unreachable!("`done` is here"),
                };
                let first = given - finished.len();
                finished[number - first] = Some(result);
            }
            while let Some(result) = finished.pop_front_if(|a| a.is_some()).flatten() {
                put(result.unwrap_or_else(|panic| resume_unwind(panic))?)?;
            }
        }
    })
}

/// A random generator for one stream of one seed: the same on every machine and for any number of
/// threads.
pub fn rng(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream);
    generator
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    #[test]
    fn scratches_serve_many_chunks_and_the_answers_are_in_order() {
        let made = std::sync::atomic::AtomicUsize::new(0);
        let scratch = || made.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let results = map_chunks_with(1000, 3, scratch, |_, range| range.start);
        assert_eq!(results, (0..1000).step_by(3).collect::<Vec<_>>());
        // Threads that work at a time have one each.
        assert!(made.into_inner() <= rayon::current_num_threads() + 1);
    }

    #[test]
    fn a_stream_is_worked_on_ahead_and_put_in_order() {
        for len in [0, 1, 3, 500] {
            let (mut read, mut all) = (0, Vec::new());
            let next = || {
                read += 1;
                Ok((read <= len).then_some(read))
            };
            let work = |i: usize| {
                // Some are done before those read before them.
                std::thread::sleep(std::time::Duration::from_micros(37 * (i as u64 % 5)));
                Ok(2 * i)
            };
            ordered_pipeline(5, next, work, |i| {
                all.push(i);
                Ok(())
            })
            .unwrap();
            assert_eq!(all, (1..=len).map(|i| 2 * i).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_stream_ends_with_the_first_error() {
        let wrong = |i: usize| Error::usage(format!("{i}"));
        for (reading, working, putting) in [(7, 99, 99), (99, 7, 9), (99, 99, 7), (7, 5, 6)] {
            let (mut read, mut all) = (0, Vec::new());
            let next = || {
                read += 1;
                if read == reading {
                    Err(wrong(read))
                } else {
                    Ok(Some(read))
                }
            };
            let work = |i| if i == working { Err(wrong(i)) } else { Ok(i) };
            let put = |i| {
                if i == putting {
                    return Err(wrong(i));
                }
                all.push(i);
                Ok(())
            };
            let first = reading.min(working).min(putting);
            let error = ordered_pipeline(5, next, work, put).unwrap_err();
            assert!(error.to_string().contains(&first.to_string()), "{error}");
            assert_eq!(all, (1..first).collect::<Vec<_>>());
        }
        let panic = std::panic::catch_unwind(|| {
            let _ = ordered_pipeline(
                5,
                || Ok(Some(())),
                |()| -> Result<()> { panic!("at work") },
                Ok,
            );
        });
        assert!(panic.is_err());
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
        assert!(
            single_threaded(|| single_threaded(apart))
                .into_iter()
                .all(|on| on)
        );
        // This thread is none of rayon's.
        assert!(apart().into_iter().all(|on| !on));
        let items: Vec<usize> = (0..100).collect();
        let squares = |items: Vec<usize>| map_each(items, || 2, |by, i| i * *by);
        let want: Vec<usize> = (0..100).map(|i| 2 * i).collect();
        assert_eq!(squares(items.clone()), want);
        assert_eq!(single_threaded(|| squares(items)), want);
    }
}
