//! What the body's mirror image says of names: distances on one side of a body are those on the
//! other, so that the names are right on the side of a long exchange where they fit them.

use super::chirality::Sides;
use super::marker_distances::{Distance, Distances};
use super::tuning::chirality::{self, RIGID, RIGID_SHARE, STILL_NEAR};
use super::tuning::mirror::*;
use super::tuning::person_template::STANDING;
use super::tuning::whole_take::{CLEAR, NEAR};
use super::unlabeled::own_name;
use super::whole_take::exchanged;
use crate::numeric::statistics::median;
use crate::pose::sides::mirrored;
use ndarray::ArrayView2;
use std::ops::Range;

/// The labels of a take and their mirror images.
pub(crate) struct Mirror<'a> {
    /// (frames, 3 L), cm, as they are named.
    positions: ArrayView2<'a, f64>,
    /// The mirror image of each label, itself in the middle of the body; `None` of one whose image
    /// is not there.
    images: Vec<Option<usize>>,
    /// Whether each is one of several whose names differ by a number at their end.
    are_numbered: Vec<bool>,
}

impl<'a> Mirror<'a> {
    pub(crate) fn new(names: &[String], positions: ArrayView2<'a, f64>) -> Mirror<'a> {
        Mirror {
            images: (0..names.len()).map(|l| image(names, l)).collect(),
            are_numbered: are_numbered(names),
            positions,
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
            let known = others.filter_map(|other| {
                Some((other, Distance::measure(self.positions, [image, other])?))
            });
            let mut known: Vec<(usize, Distance)> = known.collect();
            known.retain(|(_, distance)| distance.spread <= LOOSEST);
            known.sort_by(|a, b| a.1.looseness().total_cmp(&b.1.looseness()));
            known.truncate(NEIGHBORS);
            let terms = known.iter().filter_map(|(other, distance)| {
                let here = [*label, self.images[*other]?];
                let own = Distance::within(self.positions, here, frames)?;
                Some(cost_of(&own, distance, UNEVEN))
            });
            terms.collect::<Vec<f64>>()
        };
        let terms: Vec<f64> = exchanged.iter().flat_map(of_label).collect();
        (!terms.is_empty()).then(|| terms.iter().sum())
    }

    /// Pairs of labels that are exchanged in every frame, or whose mirror images are, the clearest
    /// first; `distances` are those between the labels.
    pub(crate) fn exchanged(&self, distances: &Distances) -> Vec<[usize; 2]> {
        let whole = WholeMirror::new(self, distances);
        exchanged(self.images.len(), |tracks, pair| whole.gain(tracks, pair))
    }

    /// Whether two labels, or their mirror images, are exchanged in every frame; `None` where the
    /// sides do not say it.
    pub(crate) fn says(&self, distances: &Distances, pair: [usize; 2]) -> Option<bool> {
        let whole = WholeMirror::new(self, distances);
        let tracks: Vec<usize> = (0..self.images.len()).collect();
        match whole.turned(&tracks, pair) {
            votes if votes < 0 => Some(false),
            _ => (whole.gain(&tracks, pair) > CLEAR).then_some(true),
        }
    }

    /// The mirror image of each label, itself where it has none.
    pub(crate) fn images(&self) -> Vec<usize> {
        let all = self.images.iter().enumerate();
        all.map(|(label, image)| image.unwrap_or(label)).collect()
    }
}

/// The body's mirror image in a whole take.
struct WholeMirror<'m, 'a> {
    mirror: &'m Mirror<'a>,
    distances: &'m Distances,
    /// The most rigid neighbors of each track.
    rigid: Vec<Vec<(usize, Distance)>>,
    /// Whether the body stands still, so that all its distances are rigid.
    is_still: bool,
}

impl<'m, 'a> WholeMirror<'m, 'a> {
    fn new(mirror: &'m Mirror<'a>, distances: &'m Distances) -> WholeMirror<'m, 'a> {
        let tracks = 0..mirror.images.len();
        let rigid: Vec<Vec<(usize, Distance)>> =
            tracks.map(|track| distances.most_rigid(track)).collect();
        let spreads = rigid.iter().flatten().map(|(_, d)| d.spread).collect();
        WholeMirror {
            is_still: median(spreads).is_none_or(|spread| spread < STANDING),
            rigid,
            mirror,
            distances,
        }
    }

    /// What the exchange of two labels gains, where the label `l` is at the positions of the track
    /// `tracks[l]`, χ²: by which way round they lie, and where that is not known by distances.
    fn gain(&self, tracks: &[usize], pair: [usize; 2]) -> f64 {
        let apart = self.distances.between(tracks[pair[0]], tracks[pair[1]]);
        if !apart.is_some_and(|d| (NEAR[0]..=NEAR[1]).contains(&d.median)) {
            return 0.0;
        }
        match self.turned(tracks, pair) {
            votes @ 1.. => self.nearer(tracks, pair).max(CLEAR) + f64::from(votes) / 10.0,
            0 => self.nearer(tracks, pair),
            _ => 0.0,
        }
    }

    /// How many volumes say that two labels lie the wrong way round; nothing of labels without
    /// mirror images, or that no body holds together.
    fn turned(&self, tracks: &[usize], [a, b]: [usize; 2]) -> i32 {
        let with_image = |label: usize| self.with_image(label);
        let Some((a, b)) = with_image(a).zip(with_image(b)) else {
            return 0;
        };
        let is_other = |both: &[usize; 2]| !both.iter().any(|l| a.contains(l) || b.contains(l));
        if a.iter().any(|l| b.contains(l)) || a[0] == a[1] || b[0] == b[1] {
            return 0;
        }
        let between = |one: [usize; 2], other: [usize; 2]| {
            let both = [0, 1].map(|k| self.distances.between(tracks[one[k]], tracks[other[k]]));
            let [Some(own), Some(image)] = both else {
                return None;
            };
            let is_rigid = |d: &Distance| d.spread <= RIGID + RIGID_SHARE * d.median;
            (is_rigid(&own) && is_rigid(&image)).then_some([own, image])
        };
        let longest = |both: &[Distance]| both.iter().map(|d| d.median).fold(0.0, f64::max);
        let Some(apart) = between(a, b) else { return 0 };
        let near = if self.is_still {
            STILL_NEAR * longest(&apart)
        } else {
            f64::INFINITY
        };
        let others = (0..self.mirror.images.len())
            .filter_map(with_image)
            .filter(is_other);
        let known = others.filter_map(|both| {
            let to_both = [between(a, both)?, between(b, both)?].concat();
            let loosest = to_both.iter().map(Distance::looseness).fold(0.0, f64::max);
            (longest(&to_both) <= near).then_some((loosest, both))
        });
        let mut known: Vec<(f64, [usize; 2])> = known.collect();
        known.sort_by(|a, b| a.0.total_cmp(&b.0));
        let nearest = known.into_iter().take(chirality::NEIGHBORS);
        let neighbors: Vec<[usize; 2]> = nearest.map(|(_, both)| both.map(|l| tracks[l])).collect();
        let sides = Sides {
            positions: self.mirror.positions,
            neighbors: &neighbors,
        };
        sides.turned([a, b].map(|both| both.map(|l| tracks[l])))
    }

    /// A label and its mirror image, if it has one: those of a cluster are numbered on both sides
    /// as it comes.
    fn with_image(&self, label: usize) -> Option<[usize; 2]> {
        let image = self.mirror.images[label]?;
        (!self.mirror.are_numbered[label]).then_some([label, image])
    }

    /// How much nearer the distances of two labels come to those of their mirror images, χ².
    fn nearer(&self, tracks: &[usize], pair: [usize; 2]) -> f64 {
        let images = &self.mirror.images;
        let mut label_of = vec![0; images.len()];
        (0..images.len()).for_each(|l| label_of[tracks[l]] = l);
        let of_label = |label: usize, other: usize| {
            let is_usable = |l: &usize| !pair.contains(l);
            let [_, image] = self
                .with_image(label)
                .filter(|[_, image]| is_usable(image))?;
            let term = |(track, distance): &(usize, Distance)| {
                let near = Some(label_of[*track]).filter(is_usable)?;
                let across = images[near].filter(|l| is_usable(l) && *l != image)?;
                let [own, other] = [label, other]
                    .map(|l| self.distances.between(tracks[l], tracks[across]))
                    .map(|d| d.map(|d| cost_of(&d, distance, WHOLE_UNEVEN)));
                Some(own? - other?)
            };
            let terms = self.rigid[tracks[image]].iter().filter_map(term);
            Some(terms.take(WHOLE_NEIGHBORS).sum::<f64>())
        };
        let [a, b] = pair;
        let all = [a, b].map(|label| self.with_image(label));
        // Each fits better: else one of them is set elsewhere on the other side, or is not there.
        let better = [of_label(a, b), of_label(b, a)].into_iter().flatten();
        let better: Vec<f64> = better.collect();
        if all.contains(&None) || better.iter().any(|gain| *gain <= 0.0) {
            0.0
        } else {
            better.iter().sum()
        }
    }
}

/// z of a distance and that of the mirror images, which differ by so many cm anyway.
fn cost_of(own: &Distance, image: &Distance, uneven: f64) -> f64 {
    let variance = image.spread.powi(2) + uneven.powi(2) + (UNEVEN_SHARE * image.median).powi(2);
    ((own.median - image.median).powi(2) / variance).min(HIGHEST)
}

/// Whether each of some names is one of several that differ by a number at their end.
fn are_numbered(names: &[String]) -> Vec<bool> {
    let stem = |name: &String| {
        name.trim_end_matches(|c: char| c.is_ascii_digit())
            .to_string()
    };
    let stems: Vec<String> = names.iter().map(stem).collect();
    let is_numbered = |k: usize| {
        let has_number = |k: usize| stems[k].len() < names[k].len();
        has_number(k) && (0..names.len()).any(|o| o != k && has_number(o) && stems[o] == stems[k])
    };
    (0..names.len()).map(is_numbered).collect()
}

/// The mirror image of a point by its name, which may have a subject's prefix.
pub(super) fn image(names: &[String], point: usize) -> Option<usize> {
    let name = &names[point];
    let (prefix, own) = name.split_at(name.len() - own_name(name).len());
    let of_person: Vec<String> = names
        .iter()
        .map(|n| n.strip_prefix(prefix).unwrap_or_default().to_string())
        .collect();
    if let Some(other) = mirrored(&of_person, point) {
        return Some(other);
    }
    (!own.starts_with(['L', 'R'])).then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_a_cluster_have_no_mirror_images() {
        let names = "LTHI1 LTHI2 RTHI1 RTHI2 LMT5 RMT5 LTOE T10";
        let names: Vec<String> = names.split(' ').map(String::from).collect();
        let xyz = ndarray::Array2::zeros((30, 24));
        let mirror = Mirror::new(&names, xyz.view());
        let distances = Distances::measure(xyz.view());
        let whole = WholeMirror::new(&mirror, &distances);
        let all: Vec<_> = (0..8).map(|label| whole.with_image(label)).collect();
        let none = [None; 4];
        assert_eq!(all[..4], none);
        assert_eq!(all[4..], [Some([4, 5]), Some([5, 4]), None, Some([7, 7])]);
    }
}
