//! A limit of the address space, as `ulimit -v` sets it.
//!
//! OpenBLAS takes 128 MB of addresses for each thread that calls it, and tries again for ever where
//! it gets none; the C library takes 64 MB for the heap of each thread. So under a limit OpenBLAS's
//! own threads are switched off and all threads have one heap, which only the environment that a
//! program starts in can say; there are as many threads of ours as the limit has room for; and
//! their memory is taken before anything else. A build without OpenBLAS needs less, but keeps to
//! the same numbers.

use crate::numeric::linalg::cholesky_solve;
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2};
use std::fs;
use std::sync::OnceLock;

/// What OpenBLAS takes for a thread that calls it, with the thread's stack; what else a command
/// needs at least: bytes.
const THREAD: u64 = 140 << 20;
const BESIDE: u64 = 48 << 20;
/// The size of a matrix that makes OpenBLAS take it.
const LARGE: usize = 300;
/// The number of threads of OpenBLAS, and of heaps.
const FRUGAL: [(&str, &str); 2] = [("OPENBLAS_NUM_THREADS", "1"), ("MALLOC_ARENA_MAX", "1")];

/// The number of threads that a limit has room for; unset without one.
static MOST_THREADS: OnceLock<usize> = OnceLock::new();

/// Prepares for a limit of the address space, if there is one: to be called first. Known on Linux
/// only.
///
/// # Errors
/// The limit has no room for one thread.
pub(crate) fn prepare() -> Result<()> {
    let Some(limit) = address_limit() else {
        return Ok(());
    };
    let is_frugal =
        |(name, value): &(&str, &str)| std::env::var_os(name).is_some_and(|v| v == *value);
    if !FRUGAL.iter().all(is_frugal) {
        start_frugally();
    }
    let room = limit.saturating_sub(used_addresses());
    let threads = room.saturating_sub(BESIDE) / THREAD;
    if threads == 0 {
        let what = format!(
            "{} MB of address space are too few: {} MB are needed (ulimit -v)",
            limit >> 20,
            (limit - room + BESIDE + THREAD) >> 20
        );
        return Err(Error::data(Place::file("memory"), what));
    }
    // Half is for what threads have in common.
    let threads = (threads / 2).max(1) as usize;
    MOST_THREADS.get_or_init(|| threads);
    Ok(())
}

/// Starts the program again, with `FRUGAL` in its environment. Returns only where that fails.
#[cfg(target_os = "linux")]
fn start_frugally() {
    use std::os::unix::process::CommandExt;
    let Ok(program) = std::env::current_exe() else {
        return;
    };
    let mut words = std::env::args_os();
    let mut again = std::process::Command::new(program);
    again.arg0(words.next().unwrap_or_default());
    super::closed_stdout::pass_on();
    let _ = again.args(words).envs(FRUGAL).exec();
}

/// No limit is known here, so it is never called.
#[cfg(not(target_os = "linux"))]
fn start_frugally() {}

/// Makes the pool of `threads`, or as many as there are processors; under a limit, no more than it
/// has room for, whose memory is then taken.
pub(crate) fn make_pool(threads: Option<usize>) {
    let builder = rayon::ThreadPoolBuilder::new();
    let Some(&most) = MOST_THREADS.get() else {
        if let Some(threads) = threads {
            // Fails only if there is a pool already, which costs nothing but speed.
            let _ = builder.num_threads(threads).build_global();
        }
        return;
    };
    let processors = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = threads.unwrap_or(processors).min(most);
    if builder.num_threads(threads).build_global().is_ok() {
        rayon::broadcast(|_| cholesky_solve(Array2::eye(LARGE), Array1::ones(LARGE)));
    }
}

/// The limit, bytes.
fn address_limit() -> Option<u64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits
        .lines()
        .find_map(|l| l.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// The addresses in use, bytes.
fn used_addresses() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let size = status.lines().find_map(|l| l.strip_prefix("VmSize:"));
    let kilobytes = size.and_then(|s| s.split_whitespace().next()?.parse::<u64>().ok());
    1024 * kilobytes.unwrap_or_default()
}
