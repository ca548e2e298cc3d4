//! Pairs of poses that a person, or a rule, has called alike or not.

use std::collections::HashMap;

/// A frame of a take: indices from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FrameRef {
    /// The take.
    pub take: usize,
    /// The frame within the take.
    pub frame: usize,
}

/// A labeled pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LabeledPair {
    /// The two frames.
    pub ends: [FrameRef; 2],
    /// Whether the poses are alike.
    pub is_alike: bool,
}

/// The labels that are left when those that contradict each other are weighed, in order, and the
/// number of pairs that were labeled both ways. Of the labels of one pair, in any order of its
/// ends, each of the fewer takes one of the more away: a pair that one of three people calls
/// unlike counts once, and a draw not at all.
pub(crate) fn weighed(pairs: &[LabeledPair]) -> (Vec<LabeledPair>, usize) {
    let key = |pair: &LabeledPair| {
        let [a, b] = pair.ends;
        (a.min(b), a.max(b))
    };
    let mut labels: HashMap<_, [usize; 2]> = HashMap::new();
    for pair in pairs {
        labels.entry(key(pair)).or_default()[usize::from(pair.is_alike)] += 1;
    }
    let contradicted = labels.values().filter(|n| n[0] > 0 && n[1] > 0).count();
    let mut left: HashMap<_, usize> = labels
        .iter()
        .map(|(key, n)| (*key, n[0].abs_diff(n[1])))
        .collect();
    let mut is_left = |pair: &&LabeledPair| {
        let key = key(pair);
        let [unlike, alike] = labels[&key];
        let Some(left) = left.get_mut(&key).filter(|left| **left > 0) else {
            return false;
        };
        let counts = (alike > unlike) == pair.is_alike;
        *left -= usize::from(counts);
        counts
    };
    let kept = pairs.iter().filter(|pair| is_left(pair)).copied().collect();
    (kept, contradicted)
}

/// The largest share of pairs that one threshold on the distance decides right, (36) and (37), and
/// the threshold: a pair is called alike when its distance is below it. Pairs whose distance is NaN
/// count as unlike. `None` without pairs.
///
/// ```
/// use posing_likeness::pairs::best_threshold;
///
/// let (share, threshold) = best_threshold(&[0.1, 0.2, 0.3, 0.9], &[true, true, false, false])
///     .ok_or("no pairs")?;
/// assert_eq!(share, 1.0); // all pairs are told right
/// assert!(threshold > 0.2 && threshold <= 0.3);
/// # Ok::<(), &str>(())
/// ```
pub fn best_threshold(distances: &[f32], is_alike: &[bool]) -> Option<(f64, f32)> {
    let mut order: Vec<usize> = (0..distances.len()).collect();
    order.sort_by(|a, b| distances[*a].total_cmp(&distances[*b]));
    // All are called unlike until the threshold has passed them.
    let mut right = is_alike.iter().filter(|a| !**a).count();
    let mut best = (right, order.first().map(|k| distances[*k])?);
    for (at, k) in order.iter().enumerate() {
        if distances[*k].is_nan() {
            break;
        }
        if is_alike[*k] {
            right += 1;
        } else {
            right -= 1;
        }
        let next = order.get(at + 1).map_or(f32::INFINITY, |k| distances[*k]);
        // A NaN is no threshold: nothing is below it.
        let next = if next.is_nan() { f32::INFINITY } else { next };
        if right > best.0 && next > distances[*k] {
            best = (right, next);
        }
    }
    Some((best.0 as f64 / distances.len() as f64, best.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_threshold_is_that_of_trying_all() {
        let distances = [0.1, 0.4, 0.2, 0.9, 0.4, f32::NAN];
        let is_alike = [true, true, false, false, false, true];
        let (share, threshold) = best_threshold(&distances, &is_alike).unwrap();
        let right = |threshold: f32| {
            let calls = distances.iter().zip(is_alike);
            calls.filter(|(d, a)| (**d < threshold) == *a).count()
        };
        let tried = distances.iter().filter(|d| !d.is_nan()).map(|d| right(*d));
        assert_eq!(tried.max(), Some(right(threshold)));
        assert_eq!((share * 6.0).round() as usize, right(threshold));
        assert_eq!(best_threshold(&[], &[]), None);
    }

    #[test]
    fn labels_that_contradict_each_other_are_weighed_in_either_order_of_the_ends() {
        let frame = |take, frame| FrameRef { take, frame };
        let pair = |a, b, is_alike| LabeledPair {
            ends: [a, b],
            is_alike,
        };
        let (a, b, c) = (frame(0, 3), frame(1, 4), frame(1, 5));
        let one = [pair(a, b, true), pair(b, a, true), pair(a, c, false)];
        assert_eq!(weighed(&one), (one.to_vec(), 0));
        let draw = [pair(a, b, true), pair(a, c, true), pair(b, a, false)];
        assert_eq!(weighed(&draw), (vec![draw[1]], 1));
        let most = [pair(a, b, true), pair(b, a, false), pair(a, b, false)];
        assert_eq!(weighed(&most), (vec![most[1]], 1));
    }
}
