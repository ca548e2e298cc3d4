//! From when to when a take lasts, and how many frames a second it has.

use crate::pose::poses::round_rate;
use crate::skeletons::Skeleton;
use crate::{Error, Result};
use ufbx::{AnimStack, SceneRoot};

/// The most frames of a take, and the most bytes of its motion.
const MOST_FRAMES: usize = 2_000_000;
const MOST_BYTES: usize = 500_000_000;
/// Frames a second that a file can mean.
const RATES: std::ops::RangeInclusive<f64> = 1.0..=1000.0;
/// Seconds by which a frame's time may miss a key's: they are meant to be one.
const SAME: f64 = 1e-6;
/// How much the steps between keys may differ from their median to be a rate, of which all but a
/// tenth keep to it.
const EVEN: f64 = 0.02;

/// The times at which a take is sampled, in seconds of the file.
pub(crate) struct Times {
    /// One a frame.
    pub frames: Vec<f64>,
    /// Frames a second.
    pub rate: f64,
    /// What was odd.
    pub notes: Vec<String>,
}

/// The times of the frames of a take: from its first key to its last within the stack's own range,
/// at `fps`, else at the rate of the keys where these stand closer than the file says, else at the
/// file's. A joint takes `bytes_of_joint` in a frame.
///
/// # Errors
/// [`Error::Unfit`]: no rate is to be had, or there are too many frames.
pub(crate) fn of_take(
    scene: &SceneRoot,
    tree: &Skeleton,
    stack: &AnimStack,
    fps: Option<f64>,
    bytes_of_joint: usize,
) -> Result<Times> {
    let keys = key_times(tree, stack);
    let (Some(first), Some(last)) = (keys.first(), keys.last()) else {
        return Err("has no key at a time that is a number".into());
    };
    let (begin, end) = match (stack.time_begin.max(*first), stack.time_end.min(*last)) {
        (begin, end) if stack.time_begin < stack.time_end && begin <= end => (begin, end),
        _ => (*first, *last),
    };
    let within = |t: &&f64| **t >= begin - SAME && **t <= end + SAME;
    let inside: Vec<f64> = keys.iter().filter(within).copied().collect();
    let (rate, note) = match fps {
        Some(fps) => (fps, None),
        None => rate(scene.settings.frames_per_second, &inside)?,
    };
    let count = ((end - begin) * rate + 1e-6).floor() + 1.0;
    let bytes = count * (tree.joint_count() * bytes_of_joint) as f64;
    if count > MOST_FRAMES as f64 || bytes > MOST_BYTES as f64 {
        return Err(too_long(end - begin, rate));
    }
    // The file's own time, where a frame is a key: what is held changes there and not before.
    let time = |frame: usize| {
        let t = begin + frame as f64 / rate;
        let at = inside.partition_point(|key| *key < t - SAME);
        let key = inside.get(at).filter(|key| (**key - t).abs() <= SAME);
        key.copied().unwrap_or(t)
    };
    Ok(Times {
        frames: (0..count as usize).map(time).collect(),
        rate,
        notes: note.into_iter().collect(),
    })
}

fn too_long(seconds: f64, rate: f64) -> Error {
    format!(
        "lasts {seconds:.1} s at {rate:.4} frames a second, which is too long (at most \
         {MOST_FRAMES} frames and {} MB); choose fewer a second with the option `fps F`",
        MOST_BYTES / 1_000_000
    )
    .into()
}

/// The times of all keys that move a skeleton, each once, in their order.
fn key_times(tree: &Skeleton, stack: &AnimStack) -> Vec<f64> {
    let once = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times.dedup_by(|later, before| *later - *before <= SAME);
    };
    // Most curves have the same times: they are not kept a hundred times over.
    let (mut times, mut known) = (Vec::new(), 0);
    for curve in tree.curves(stack) {
        let own = curve.keyframes.iter().map(|key| key.time);
        times.extend(own.filter(|t| t.is_finite()));
        if times.len() > 2 * known {
            once(&mut times);
            known = times.len();
        }
    }
    once(&mut times);
    times
}

/// Frames a second, and a note where the file's own word is not taken.
fn rate(said: f64, keys: &[f64]) -> Result<(f64, Option<String>)> {
    let of_keys = key_rate(keys).filter(|rate| RATES.contains(rate));
    match (RATES.contains(&said), of_keys) {
        (true, Some(own)) if own > said * (1.0 + EVEN) => {
            let note = format!(
                "says {said:.3} frames a second and has keys at {own:.3}, which are all taken; the \
                 option `fps {said:.0}` takes fewer"
            );
            Ok((own, Some(note)))
        }
        (true, _) => Ok((round_rate(said), None)),
        (false, Some(own)) => {
            let note = format!("says {said} frames a second; its keys are taken, {own:.3}");
            Ok((own, Some(note)))
        }
        (false, None) => Err(format!(
            "says a rate of {said} frames a second, and its keys tell no other; give it with the \
             option `fps F`"
        )
        .into()),
    }
}

/// The rate of keys that stand at even steps.
fn key_rate(keys: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = keys.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let median = *steps.get(steps.len() / 2)?;
    let is_even = |step: &&f64| (**step - median).abs() <= EVEN * median;
    let even = steps.iter().filter(is_even).count();
    (median > 0.0 && 10 * even >= 9 * steps.len()).then(|| round_rate(1.0 / median))
}
