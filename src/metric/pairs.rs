//! Pairs of poses that a person, or a rule, has called alike or not.

/// A frame of a take: indices from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FrameRef {
    /// The take.
    pub take: usize,
    /// The frame within the take.
    pub frame: usize,
}

/// A labelled pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LabelledPair {
    /// The two frames.
    pub ends: [FrameRef; 2],
    /// Whether the poses are alike.
    pub is_alike: bool,
}

/// The position of a pair that is labelled both ways, in any order of its ends; `None` where labels agree.
pub fn contradiction(pairs: &[LabelledPair]) -> Option<usize> {
    let mut seen = std::collections::HashMap::new();
    pairs.iter().position(|pair| {
        let [a, b] = pair.ends;
        let before = seen.insert((a.min(b), a.max(b)), pair.is_alike);
        before.is_some_and(|label| label != pair.is_alike)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_labelled_both_ways_is_found_in_either_order() {
        let frame = |take, frame| FrameRef { take, frame };
        let pair = |a, b, is_alike| LabelledPair {
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
