//! What the body's mirror image says of names: distances on one side of a body are those on the
//! other, so that the names are right on the side of a long exchange where they fit them.

use super::distances::Distance;
use super::tuning::mirror::*;
use crate::pose::joints::mirrored;
use crate::pose::point_at;
use ndarray::ArrayView2;
use std::ops::Range;

/// The labels of a take and their mirror images.
pub(crate) struct Mirror<'a> {
    /// (frames, 3 L), cm, as they are named.
    places: ArrayView2<'a, f64>,
    /// The mirror image of each label, itself in the middle of the body; `None` of one whose image
    /// is not there.
    images: Vec<Option<usize>>,
}

impl<'a> Mirror<'a> {
    pub(crate) fn new(names: &[String], places: ArrayView2<'a, f64>) -> Mirror<'a> {
        Mirror {
            images: (0..names.len()).map(|l| image(names, l)).collect(),
            places,
        }
    }

    /// How badly the distances of some labels, which were exchanged with each other, fit those of
    /// their mirror images in some frames, χ²; `None` where these say nothing.
    pub(crate) fn cost(&self, exchanged: &[usize], frames: &[Range<usize>]) -> Option<f64> {
        let of_label = |label: &usize| {
            let is_other = |image: &usize| image != label && !exchanged.contains(image);
            let Some(image) = self.images[*label].filter(is_other) else {
                return Vec::new();
            };
            let is_usable = |other: &usize| !exchanged.contains(other) && *other != image;
            let others = (0..self.images.len()).filter(|other| {
                let of_other = self.images[*other];
                is_usable(other) && of_other.is_some_and(|o| is_usable(&o) && o != *label)
            });
            let known = others
                .filter_map(|other| Some((other, Distance::measure(self.places, [image, other])?)));
            let mut known: Vec<(usize, Distance)> = known.collect();
            known.sort_by(|a, b| a.1.looseness().total_cmp(&b.1.looseness()));
            known.truncate(NEIGHBORS);
            let terms = known.iter().filter_map(|(other, distance)| {
                let own = self.median(*label, self.images[*other]?, frames)?;
                let off = own - distance.median;
                let variance = distance.spread.powi(2)
                    + UNEVEN.powi(2)
                    + (UNEVEN_SHARE * distance.median).powi(2);
                Some((off * off / variance).min(HIGHEST))
            });
            terms.collect::<Vec<f64>>()
        };
        let terms: Vec<f64> = exchanged.iter().flat_map(of_label).collect();
        (!terms.is_empty()).then(|| terms.iter().sum())
    }

    /// The median distance of two labels in some frames, cm.
    fn median(&self, a: usize, b: usize, frames: &[Range<usize>]) -> Option<f64> {
        let count: usize = frames.iter().map(ExactSizeIterator::len).sum();
        let step = count.div_ceil(MOST_FRAMES).max(1);
        let all = frames.iter().cloned().flatten().step_by(step);
        let lengths =
            all.map(|t| point_at(self.places, t, a).distance(point_at(self.places, t, b)));
        Distance::of(lengths.filter(|l| l.is_finite()).collect()).map(|d| d.median)
    }
}

/// The mirror image of a point by its name, which may have a subject's prefix.
pub(super) fn image(names: &[String], point: usize) -> Option<usize> {
    if let Some(other) = mirrored(names, point) {
        return Some(other);
    }
    let name = &names[point];
    let own = name.rfind(':').map_or(0, |colon| colon + 1);
    let (prefix, own) = name.split_at(own);
    let other = match own.chars().next()? {
        'L' => 'R',
        'R' => 'L',
        _ => return Some(point),
    };
    let other = format!("{prefix}{other}{}", &own[1..]);
    names.iter().position(|n| *n == other)
}
