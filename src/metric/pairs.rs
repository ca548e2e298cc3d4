//! Pairs of poses that a person, or a rule, has called alike or not.

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

/// The position of a pair that is labeled both ways, in any order of its ends; `None` where labels
/// agree.
pub(crate) fn contradiction(pairs: &[LabeledPair]) -> Option<usize> {
    let mut seen = std::collections::HashMap::new();
    pairs.iter().position(|pair| {
        let [a, b] = pair.ends;
        let before = seen.insert((a.min(b), a.max(b)), pair.is_alike);
        before.is_some_and(|label| label != pair.is_alike)
    })
}

/// The largest share of pairs that one threshold on the distance decides right, (36) and (37), and
/// the threshold: a pair is called alike when its distance is below it. Pairs whose distance is NaN
/// count as unlike. `None` without pairs.
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
    fn a_pair_labeled_both_ways_is_found_in_either_order() {
        let frame = |take, frame| FrameRef { take, frame };
        let pair = |a, b, is_alike| LabeledPair {
            ends: [a, b],
            is_alike,
        };
        let (a, b) = (frame(0, 3), frame(1, 4));
        assert_eq!(contradiction(&[pair(a, b, true), pair(b, a, true)]), None);
        assert_eq!(
            contradiction(&[pair(a, b, true), pair(b, a, false)]),
            Some(1)
        );
    }
}
