//! What is known of a take while its gaps are filled. The frames in which each point is known are a
//! bit each: to count those that some points have in common takes a word for 64.

use super::Gap;
use super::path::PathVariances;
use super::tuning::filler::BREAK;
use crate::take::Take;
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// Frames of one word.
const WORD: usize = u64::BITS as usize;

/// What is known of a take while its gaps are filled.
pub(crate) struct Known {
    /// (frames, 3 J), cm: captured or filled; NaN missing.
    pub xyz: Array2<f64>,
    /// The frames in which each point is captured or filled.
    pub frames: KnownFrames,
    /// Those in which it is captured.
    pub captured: KnownFrames,
    /// Seconds of each frame.
    pub seconds: Vec<f64>,
    /// How well points are interpolated.
    pub paths: PathVariances,
}

impl Known {
    /// What the captured frames show.
    pub(crate) fn new(take: &Take<'_>) -> Known {
        let mut seconds = vec![0.0; take.xyz.nrows()];
        for (k, run) in take.runs.iter().enumerate() {
            (run.clone()).for_each(|t| seconds[t] = k as f64 * BREAK + t as f64 / take.rate);
        }
        Known {
            xyz: take.xyz.to_owned(),
            frames: KnownFrames::of(take.xyz),
            captured: KnownFrames::of(take.xyz),
            seconds,
            paths: PathVariances::default(),
        }
    }

    /// Adds a filled gap.
    pub(crate) fn put(&mut self, gap: &Gap, xyz: &Array2<f64>) {
        let columns = 3 * gap.point..3 * gap.point + 3;
        (self.xyz.slice_mut(s![gap.frames.clone(), columns])).assign(xyz);
        self.frames.add(gap.point, gap.frames.clone());
    }
}

/// The frames in which each point of a take is known.
pub(crate) struct KnownFrames(Vec<FrameSet>);

/// Some frames of a take.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FrameSet(Vec<u64>);

impl KnownFrames {
    /// The frames of `xyz` (frames, 3 J; NaN missing) in which all three coordinates of a point are
    /// finite.
    pub(crate) fn of(xyz: ArrayView2<'_, f64>) -> KnownFrames {
        let words = xyz.nrows().div_ceil(WORD);
        let mut points = vec![FrameSet(vec![0; words]); xyz.ncols() / 3];
        for (t, row) in xyz.rows().into_iter().enumerate() {
            for (p, set) in points.iter_mut().enumerate() {
                let is_known = (3 * p..3 * p + 3).all(|i| row[i].is_finite());
                set.0[t / WORD] |= u64::from(is_known) << (t % WORD);
            }
        }
        KnownFrames(points)
    }

    /// The number of points, J.
    pub(crate) fn points(&self) -> usize {
        self.0.len()
    }

    /// Marks frames in which a point has become known.
    pub(crate) fn add(&mut self, point: usize, frames: Range<usize>) {
        frames.for_each(|t| self.0[point].0[t / WORD] |= 1 << (t % WORD));
    }

    /// Whether a point is known in all of some frames.
    pub(crate) fn has_all(&self, point: usize, frames: Range<usize>) -> bool {
        let set = &self.0[point].0;
        let mut frames = frames;
        frames.all(|t| set[t / WORD] >> (t % WORD) & 1 == 1)
    }

    /// The frames of `range` in which all `points` are known.
    pub(crate) fn all_known(&self, points: &[usize], range: &Range<usize>) -> FrameSet {
        let words = self.0.first().map_or(0, |set| set.0.len());
        let mut out = FrameSet(vec![0; words]);
        for word in range.start / WORD..range.end.div_ceil(WORD) {
            out.0[word] = bits_within(word, range);
        }
        for point in points {
            (out.0.iter_mut().zip(&self.0[*point].0)).for_each(|(out, own)| *out &= own);
        }
        out
    }

    /// In how many of `frames` a point is known.
    pub fn count(&self, point: usize, frames: &FrameSet) -> usize {
        let both = frames.0.iter().zip(&self.0[point].0);
        both.map(|(a, b)| (a & b).count_ones() as usize).sum()
    }

    /// Those of `frames` in which a point is known.
    pub(crate) fn intersection(&self, point: usize, frames: &FrameSet) -> FrameSet {
        let both = frames.0.iter().zip(&self.0[point].0);
        FrameSet(both.map(|(a, b)| a & b).collect())
    }
}

/// The bits of a word that are frames of a range.
fn bits_within(word: usize, range: &Range<usize>) -> u64 {
    let first = word * WORD;
    let from = range.start.saturating_sub(first).min(WORD);
    let to = range.end.saturating_sub(first).min(WORD);
    let below = |n: usize| if n == WORD { u64::MAX } else { (1 << n) - 1 };
    below(to) & !below(from)
}

impl FrameSet {
    /// The number of frames.
    pub(crate) fn len(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// The frames, in order.
    pub(crate) fn frames(&self) -> impl Iterator<Item = usize> + '_ {
        let of_word = |(k, word): (usize, &u64)| {
            let mut left = *word;
            std::iter::from_fn(move || {
                let bit = left.trailing_zeros() as usize;
                left &= left.wrapping_sub(1);
                (bit < WORD).then_some(k * WORD + bit)
            })
        };
        self.0.iter().enumerate().flat_map(of_word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_counted_as_one_by_one() {
        let xyz = Array2::from_shape_fn((300, 9), |(t, c)| match (t * 7 + c / 3 * 5) % 3 {
            0 if c % 3 == 1 => f64::NAN,
            _ => 1.0,
        });
        let mut known = KnownFrames::of(xyz.view());
        let is_known = |t: usize, p: usize| xyz[[t, 3 * p + 1]].is_finite();
        for range in [
            0..300,
            0..64,
            63..65,
            64..128,
            5..6,
            100..291,
            7..7,
            300..300,
        ] {
            let both = known.all_known(&[0, 1], &range);
            let want: Vec<usize> = (range.clone())
                .filter(|&t| is_known(t, 0) && is_known(t, 1))
                .collect();
            assert_eq!(both.frames().collect::<Vec<_>>(), want, "{range:?}");
            assert_eq!(both.len(), want.len());
            let with: Vec<usize> = want.into_iter().filter(|&t| is_known(t, 2)).collect();
            assert_eq!(known.count(2, &both), with.len());
            assert_eq!(
                known.intersection(2, &both).frames().collect::<Vec<_>>(),
                with
            );
        }
        assert!(!known.has_all(0, 60..70));
        known.add(0, 60..70);
        assert!(known.has_all(0, 60..70) && known.has_all(0, 9..9));
        assert_eq!(KnownFrames::of(Array2::zeros((0, 9)).view()).points(), 3);
    }
}
