//! A model of labels learned from labeled takes alone: whatever the labels are, of bodies, parts of
//! them, hands, or clusters on plates, it knows nothing of bones.
//!
//! A few postures of the takes stand for all. They bend: each label is where the labels near it,
//! those whose distances to it change least, carry it together without bending.

use super::marker_distances::{Distance, Distances};
use super::tuning::posture_model::*;
use super::unlabeled::{is_unlabeled, marker_labels, own_name};
use crate::numeric::statistics::median;
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::zeros::Zeros;
use crate::pose::{Poses, point_at};
use crate::{Error, Result};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

/// The labels of some takes, in postures of these.
#[derive(Debug, Clone, PartialEq)]
pub struct PostureModel {
    pub(super) labels: Vec<String>,
    /// Where each label is, cm about the middle (y up); NaN where it is not seen.
    pub(super) postures: Vec<Vec<DVec3>>,
    /// How much a distance of two labels changes: variance, cm².
    pub(super) looseness: Array2<f64>,
    /// How differently each label lies on the people of the takes, cm.
    pub(super) spreads: Vec<f64>,
}

/// The middle of some points that are seen: the median.
pub(super) fn middle(points: &[DVec3]) -> DVec3 {
    let of = |c: usize| {
        let seen = points.iter().filter(|p| p.is_finite()).map(|p| p[c]);
        median(seen.collect()).unwrap_or(0.0)
    };
    DVec3::new(of(0), of(1), of(2))
}

impl PostureModel {
    /// Learns from labeled takes of one or several people.
    ///
    /// # Errors
    /// [`Error::Usage`]: fewer than four labels are ever seen together.
    pub fn learn(takes: &[&Poses]) -> Result<PostureModel> {
        let mut labels: Vec<String> = Vec::new();
        for take in takes {
            for p in marker_labels(&take.points) {
                let own = own_name(&take.points[p]);
                if !labels.iter().any(|l| l == own) {
                    labels.push(own.to_string());
                }
            }
        }
        let positions: Vec<Array2<f64>> = takes.iter().map(|t| positions(t, &labels)).collect();
        let is_seen = |l: &usize| {
            let share = |xyz: &Array2<f64>| {
                let seen = xyz.column(3 * l).iter().filter(|v| v.is_finite()).count();
                seen as f64 >= RARE * xyz.nrows() as f64 && seen > 0
            };
            positions.iter().any(share)
        };
        let seen: Vec<usize> = (0..labels.len()).filter(is_seen).collect();
        if seen.len() < FEWEST_LABELS {
            let what = format!(
                "{} labels are seen in the labeled takes, and {FEWEST_LABELS} are needed",
                seen.len()
            );
            return Err(Error::usage(what));
        }
        let columns: Vec<usize> = seen.iter().flat_map(|l| 3 * l..3 * l + 3).collect();
        let positions = positions
            .iter()
            .map(|xyz| xyz.select(ndarray::Axis(1), &columns));
        let positions: Vec<Array2<f64>> = positions.collect();
        let labels: Vec<String> = seen.iter().map(|l| labels[*l].clone()).collect();
        let each = MOST_POSTURES.div_ceil(positions.len()).max(FEWEST_POSTURES);
        let of_takes: Vec<Vec<Vec<DVec3>>> = positions
            .iter()
            .map(|xyz| unlike_postures(xyz.view(), each))
            .collect();
        let spreads = (0..labels.len()).map(|l| spread(&of_takes, l)).collect();
        let postures = of_takes.concat();
        Ok(PostureModel {
            looseness: looseness(&positions, &postures),
            labels,
            postures,
            spreads,
        })
    }

    /// The distances of two labels in the postures, cm.
    fn median_distance(postures: &[Vec<DVec3>], a: usize, b: usize) -> Option<f64> {
        let all = postures.iter().map(|p| p[a].distance(p[b]));
        median(all.filter(|d| d.is_finite()).collect())
    }
}

/// Where the labels are in a take (frames, 3 L); NaN is missing.
fn positions(take: &Poses, labels: &[String]) -> Array2<f64> {
    let emptied = Zeros::emptied(take);
    let mut xyz = Array2::from_elem((take.frames(), 3 * labels.len()), f64::NAN);
    for (l, label) in labels.iter().enumerate() {
        let is_it = |name: &String| own_name(name) == label && !is_unlabeled(name);
        if let Some(point) = take.points.iter().position(is_it) {
            for c in 0..3 {
                xyz.column_mut(3 * l + c)
                    .assign(&emptied.xyz.column(3 * point + c));
            }
        }
    }
    xyz
}

/// So many postures of a take at most, as unlike each other as can be, in which most labels are
/// seen; what is not seen there is where it is in another frame beside its neighbors.
fn unlike_postures(xyz: ArrayView2<'_, f64>, most: usize) -> Vec<Vec<DVec3>> {
    let labels = xyz.ncols() / 3;
    let frame = |t: usize| -> Vec<DVec3> { (0..labels).map(|l| point_at(xyz, t, l)).collect() };
    let seen = |p: &[DVec3]| p.iter().filter(|p| p.is_finite()).count();
    let step = xyz.nrows().div_ceil(LOOKED_AT).max(1);
    let all: Vec<Vec<DVec3>> = (0..xyz.nrows()).step_by(step).map(frame).collect();
    let fullest = all.iter().map(|p| seen(p)).max().unwrap_or(0);
    let full: Vec<&Vec<DVec3>> = all
        .iter()
        .filter(|p| seen(p) as f64 >= FULL * fullest as f64 && seen(p) >= FEWEST_LABELS)
        .collect();
    let Some(first) = full.iter().max_by_key(|p| seen(p)) else {
        return Vec::new();
    };
    let mut chosen: Vec<&Vec<DVec3>> = vec![first];
    let mut nearest: Vec<f64> = full.iter().map(|p| unlikeness(p, first)).collect();
    while chosen.len() < most {
        let far = nearest.iter().enumerate();
        let Some((n, _)) = far
            .max_by(|a, b| a.1.total_cmp(b.1))
            .filter(|f| *f.1 > ALIKE)
        else {
            break;
        };
        chosen.push(full[n]);
        for (to, p) in nearest.iter_mut().zip(&full) {
            *to = to.min(unlikeness(p, full[n]));
        }
    }
    let filled = |posture: &Vec<DVec3>| {
        let is_missing = |l: &usize| !posture[*l].is_finite();
        let missing: Vec<usize> = (0..labels).filter(is_missing).collect();
        let mut out = posture.clone();
        for l in missing {
            let others = all.iter().filter(|other| other[l].is_finite());
            let placed = others.filter_map(|other| carried(other, posture, l));
            let best = placed.min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, at)) = best {
                out[l] = at;
            }
        }
        let middle = middle(&out);
        out.iter().map(|p| *p - middle).collect()
    };
    chosen.into_iter().map(filled).collect()
}

/// Where a label of one posture is in another, as its neighbors carry it, and how badly these fit.
fn carried(from: &[DVec3], to: &[DVec3], label: usize) -> Option<(f64, DVec3)> {
    let pairs = from.iter().zip(to).enumerate().filter_map(|(n, (a, b))| {
        let far = a.distance_squared(from[label]);
        let is_known = n != label && far.is_finite() && b.is_finite();
        is_known.then(|| (*a, *b, (1.0 + far).powi(-2)))
    });
    let pairs: Vec<(DVec3, DVec3, f64)> = pairs.collect();
    let fit = fit_similarity(pairs.iter().copied(), TransformKind::Rigid)?;
    let weights: f64 = pairs.iter().map(|p| p.2).sum();
    let at = fit.similarity.apply(from[label]);
    (pairs.len() >= 3 && fit.determined).then_some((fit.error / weights, at))
}

/// How differently a label lies on the people of some takes, cm: where the first posture of one has
/// it in that of another, the median.
fn spread(takes: &[Vec<Vec<DVec3>>], label: usize) -> f64 {
    let firsts: Vec<&Vec<DVec3>> = takes.iter().filter_map(|t| t.first()).collect();
    let firsts = &firsts[..firsts.len().min(MOST_PEOPLE)];
    let pairs = firsts
        .iter()
        .enumerate()
        .flat_map(|(n, a)| firsts[..n].iter().map(move |b| (*a, *b)));
    let offs = pairs.filter_map(|(a, b)| Some(carried(a, b, label)?.1.distance(b[label])));
    median(offs.filter(|d| d.is_finite()).collect()).unwrap_or(0.0)
}

/// How unlike two postures are, however they stand: the root mean squared distance, cm.
fn unlikeness(a: &[DVec3], b: &[DVec3]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| (**a - **b).is_finite());
    let pairs = both.map(|(a, b)| (*a, *b, 1.0));
    let count = pairs.clone().count() as f64;
    let fit = fit_similarity(pairs, TransformKind::Rigid);
    fit.map_or(0.0, |fit| (fit.error / count).sqrt())
}

/// How much the distances of all pairs change, cm²: in the takes that move; else far labels move
/// against each other.
fn looseness(takes: &[Array2<f64>], postures: &[Vec<DVec3>]) -> Array2<f64> {
    let measured: Vec<Distances> = takes
        .iter()
        .map(|xyz| Distances::measure(xyz.view()))
        .filter(|d| !stands(d))
        .collect();
    let labels = postures.first().map_or(0, Vec::len);
    let of = |(a, b): (usize, usize)| {
        let Some(long) = PostureModel::median_distance(postures, a, b) else {
            return FAR_APART * FAR_APART;
        };
        let known: Vec<Distance> = measured.iter().filter_map(|d| d.between(a, b)).collect();
        let all = known.iter().map(|d| looseness_of(d.spread, d.median));
        match known.len() {
            0 => looseness_of(BENDS * long, long),
            n => all.sum::<f64>() / n as f64,
        }
    };
    Array2::from_shape_fn((labels, labels), of)
}

/// How loose a label is by how its distance to another changes, cm²: a far one may also go round
/// it.
pub(super) fn looseness_of(spread: f64, long: f64) -> f64 {
    spread * spread + (TURNS * long).powi(2) + STIFF * STIFF
}

/// Whether the labels stand still: half of their distances hardly change.
pub(super) fn stands(distances: &Distances) -> bool {
    let points = distances.points();
    let pairs = (0..points).flat_map(|a| (a + 1..points).map(move |b| (a, b)));
    let spreads = pairs.filter_map(|(a, b)| Some(distances.between(a, b)?.spread));
    median(spreads.collect()).is_none_or(|spread| spread < STANDING)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Templates;
    use crate::label_model::LabelModel;
    use crate::nameless::name_tracks;
    use crate::{PosturesInFile, numeric};
    use glam::DMat3;

    /// Plates of four on the pelvis, the thighs and the shanks of somebody who stands, or walks;
    /// those of the right side are copies of those of the left.
    fn plates(frames: usize, swing: f64) -> Poses {
        let plate = [
            [0.0, 0.0, 0.0],
            [7.0, 1.0, 0.5],
            [1.0, -9.0, 1.0],
            [6.0, -8.0, 2.5],
        ];
        let plate = plate.map(DVec3::from_array);
        let parts = ["P", "LT", "LS", "RT", "RS"];
        let names = parts
            .iter()
            .flat_map(|part| (1..5).map(move |n| format!("{part}{n}")));
        let mut xyz = Array2::zeros((frames, 60));
        for t in 0..frames {
            let time = t as f64 / 60.0;
            let trunk = DVec3::new(0.0, 95.0, 80.0 * time * swing);
            let mut points: Vec<DVec3> = plate.map(|p| trunk + p - 10.0 * DVec3::Z).to_vec();
            for side in [1.0, -1.0] {
                let upper = DMat3::from_rotation_x(0.5 * swing * (6.0 * time + side).sin());
                let lower =
                    upper * DMat3::from_rotation_x(0.5 * swing * (1.0 - (6.0 * time).cos()));
                let hip = trunk + DVec3::new(10.0 * side, -5.0, 0.0);
                let knee = hip + upper * DVec3::new(0.0, -42.0, 0.0);
                let at = DVec3::new(6.0 * side, -15.0, 4.0);
                points.extend(plate.map(|p| hip + upper * (at + p)));
                points.extend(plate.map(|p| knee + lower * (at + 0.8 * p)));
            }
            for (k, p) in points.into_iter().enumerate() {
                let skin = 0.05 * DVec3::new((t + k) as f64, (t + 2 * k) as f64, k as f64);
                let p = p + 0.1 * DVec3::new(skin.x.sin(), skin.y.sin(), skin.z.cos());
                (0..3).for_each(|c| xyz[[t, 3 * k + c]] = p[c]);
            }
        }
        Poses {
            points: names.collect(),
            xyz,
            ..Poses::default()
        }
    }

    /// The tracks of a take without names, in another order, every third of them in two pieces.
    /// The point of each track.
    fn nameless(poses: &Poses) -> (Poses, Vec<usize>) {
        let (count, frames) = (poses.points.len(), poses.frames());
        let mut of: Vec<usize> = (0..count).map(|k| (k * 7) % count).collect();
        of.extend((0..count).step_by(3));
        let xyz = Array2::from_shape_fn((frames, 3 * of.len()), |(t, c)| {
            let (track, point) = (c / 3, of[c / 3]);
            let has = match (track >= count, point % 3 == 0) {
                (true, _) => t > frames / 2 + 5,
                (_, true) => t < frames / 2,
                _ => true,
            };
            if has {
                poses.xyz[[t, 3 * point + c % 3]]
            } else {
                f64::NAN
            }
        });
        let poses = Poses {
            points: (0..of.len()).map(|n| format!("*{n}")).collect(),
            xyz,
            ..poses.clone()
        };
        (poses, of)
    }

    #[test]
    fn plates_that_walk_are_named_as_those_that_stand() {
        let model = PostureModel::learn(&[&plates(30, 0.0)]).unwrap();
        let walking = plates(180, 1.0);
        let (tracks, of) = nameless(&walking);
        let found = name_tracks(&tracks, 60.0, &model, 0.9, &Templates::default()).unwrap();
        assert_eq!(found.missing, [""; 0]);
        for (track, name) in &found.names {
            assert_eq!(*name, walking.points[of[*track]]);
        }
        // Every second piece goes to the column of the first, or the other way round.
        assert_eq!(found.moved.len(), 7);
        assert!(found.unsure.is_empty(), "{:?}", found.unsure);
    }

    #[test]
    fn what_is_another_set_gets_no_names() {
        let model = PostureModel::learn(&[&plates(30, 0.0)]).unwrap();
        let mut other = nameless(&plates(120, 1.0)).0;
        other
            .xyz
            .mapv_inplace(|v| 0.4 * v + (v * 71.3).rem_euclid(60.0));
        let said = name_tracks(&other, 60.0, &model, 0.9, &Templates::default());
        assert!(said.is_err_and(|e| e.to_string().contains("no body")));
    }

    #[test]
    fn a_model_is_the_same_from_its_file() {
        let mut poses = plates(30, 0.3);
        poses.points[3] = "*8".to_string();
        let model = PostureModel::learn(&[&poses, &plates(40, 0.0)]).unwrap();
        assert_eq!(model.labels().len(), 20);
        let again = PosturesInFile::from(&model).model().unwrap();
        assert_eq!(again.labels(), model.labels());
        let off = (&again.looseness - &model.looseness).mapv(f64::abs);
        assert!(numeric::statistics::range(off).1 < 1e-3);
        // Three labels say nothing of each other.
        poses
            .points
            .iter_mut()
            .skip(3)
            .for_each(|p| *p = "*1".to_string());
        assert!(PostureModel::learn(&[&poses]).is_err());
    }
}
