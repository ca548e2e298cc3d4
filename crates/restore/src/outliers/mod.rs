//! Outliers of a take: points that cannot be where they were measured.
//!
//! 1. [`crate::label::out_and_back`] finds stretches of a track that stand away from their point,
//!    `trajectory` spikes: points that leave their path for some frames. No model is needed.
//! 2. The model is adapted to the body that the other points show. Rigid distances then say which
//!    frames hold outliers (`rigid::noise_floor`), each frame together with its neighbors.
//! 3. In those frames distances say which points are outliers, and where they leave a point open,
//!    the prior too (`frame_posterior`).

mod assignment;
pub(crate) mod frame_posterior;
mod frame_state;
mod leave_one_out;
pub(crate) mod rigid_likelihood;
mod trajectory;
mod tuning;

use crate::adapted_prior::AdaptedPrior;
use crate::label::out_and_back::stretches;
use crate::noise_estimation::{rounded, variances};
use crate::numeric::parallel;
use crate::take::{FRAMES_PER_TASK, PointMapping, Take, without};
use ndarray::{ArrayView2, Axis};
use std::borrow::Cow;
use std::ops::Range;
pub(crate) use trajectory::spikes_by_time;
use trajectory::spikes_in_rounds;
#[doc(hidden)]
pub use trajectory::spikes_of_take;
pub(crate) use tuning::search::LIKELY;
use tuning::search::*;

/// The outliers of a take.
pub(crate) struct Outliers {
    /// Outliers of each frame, spikes included.
    pub points: Vec<Vec<usize>>,
    /// Spikes of each frame, found by `trajectory`: the path says where the point should have
    /// been.
    pub spikes: Vec<Vec<usize>>,
}

/// The outliers of a take in the table's order of points, and the model adapted to the take's body;
/// `noise` is the standard deviation of a coordinate in cm if known. Without a model, and for
/// points that it does not know, only spikes are found.
pub(crate) fn find_outliers<'m>(
    mapping: Option<&'m PointMapping<'m>>,
    take: &Take<'_>,
    noise: Option<f64>,
) -> (Outliers, Option<AdaptedPrior<'m>>) {
    let away = stretches(take.xyz, take.runs, take.rate);
    let mut spikes = vec![Vec::new(); take.xyz.nrows()];
    for stretch in &away {
        (stretch.frames.clone()).for_each(|t| spikes[t].push(stretch.point));
    }
    let back = without(take.xyz, &spikes);
    let take = &take.with_xyz(back.view());
    let is_foreign = |p: &usize| mapping.is_none_or(|m| m.in_model(*p).is_none());
    let foreign: Vec<usize> = (0..take.names.len()).filter(is_foreign).collect();
    let columns: Vec<usize> = foreign.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
    let xyz = take.xyz.select(Axis(1), &columns);
    let by_time = spikes_by_time(&take.with_xyz(xyz.view()), noise);
    for (spikes, found) in spikes.iter_mut().zip(by_time) {
        spikes.extend(found.into_iter().map(|p| foreign[p]));
    }
    let Some(mapping) = mapping else {
        let points = spikes.clone();
        return (Outliers { points, spikes }, None);
    };
    let (found, adapted) = find_by_model(mapping, take, noise);
    let both = |of_model: &[Vec<usize>]| {
        let mut all = mapping.points_of_table(of_model);
        all.iter_mut().zip(&spikes).for_each(|(a, s)| a.extend(s));
        all
    };
    let outliers = Outliers {
        points: both(&found.points),
        spikes: both(&found.spikes),
    };
    (outliers, Some(adapted))
}

/// The outliers of a take among the model's points, in the model's order, and the model adapted to
/// the take's body.
fn find_by_model<'m>(
    mapping: &'m PointMapping<'m>,
    take: &Take<'_>,
    noise: Option<f64>,
) -> (Outliers, AdaptedPrior<'m>) {
    let xyz = mapping.gather(take.xyz);
    let take = &take.with_xyz(xyz.view());
    let (spikes, clean, typical) = spikes_in_rounds(mapping.model, take, noise);
    let adapted = AdaptedPrior::measured(mapping, clean.view(), typical);
    let with_spikes = spikes.iter().filter(|points| !points.is_empty());
    let has_many = with_spikes.count() as f64 > MANY * spikes.len() as f64;
    let mut points = by_distances(&adapted, &take.with_xyz(clean.view()), typical, has_many);
    release_most(&mut points, clean.view());
    for (points, spikes) in points.iter_mut().zip(&spikes) {
        points.extend(spikes);
    }
    (Outliers { points, spikes }, adapted)
}

/// A point that is an outlier in most of the frames that show it is where it is on this body, and
/// the model is wrong about it: it is none.
fn release_most(points: &mut [Vec<usize>], xyz: ArrayView2<'_, f64>) {
    for p in 0..xyz.ncols() / 3 {
        let is_seen = |t: &usize| (3 * p..3 * p + 3).all(|i| xyz[[*t, i]].is_finite());
        let seen = (0..points.len()).filter(is_seen).count();
        let off = points.iter().filter(|points| points.contains(&p)).count();
        if 2 * off > seen {
            points
                .iter_mut()
                .for_each(|points| points.retain(|q| *q != p));
        }
    }
}

/// The outliers of each frame by rigid distances and the prior; `noise` is that of most
/// coordinates, cm, `has_many` whether the take had many outliers already.
fn by_distances(
    adapted: &AdaptedPrior<'_>,
    take: &Take<'_>,
    noise: f64,
    has_many: bool,
) -> Vec<Vec<usize>> {
    let xyz = take.xyz;
    let rigid = if has_many {
        Cow::Borrowed(&*adapted.rigid)
    } else {
        Cow::Owned(adapted.rigid.loosened(LENGTHS_VARY))
    };
    let evidence = parallel::map_chunks(xyz.nrows(), FLOORS_PER_TASK, |range| {
        let floor = |t: usize| rigid.noise_floor(&xyz.row(t).to_vec());
        let evidence = |t: usize| floor(t).map_or(0.0, |f| f.outlier_evidence.max(0.0));
        range.map(evidence).collect::<Vec<_>>()
    });
    let is_searched = pooled_over_time(&evidence.concat(), take.runs);
    let searched: Vec<usize> = (0..xyz.nrows()).filter(|t| is_searched[*t]).collect();
    let estimator = adapted.rigid_estimator();
    let found = parallel::map_chunks(searched.len(), FRAMES_PER_TASK, |range| {
        let outliers = |t: &usize| {
            let y = xyz.row(*t).to_vec();
            let Some(floor) = adapted.rigid.noise_floor(&y) else {
                return Vec::new();
            };
            let sd = rounded(floor.sd.min(noise.max(LEAST_NOISE)));
            let by_lengths = (adapted.rigid).outlier_probabilities(&y, &variances(&y, sd, &[]));
            let is_decided = |q: &f64| *q <= DECIDED || *q >= 1.0 - DECIDED;
            // The prior is of another skeleton where the table has other points.
            let by_lengths_alone = adapted.mapping.has_others();
            let probability = if by_lengths_alone || by_lengths.iter().all(is_decided) {
                by_lengths
            } else {
                (estimator.estimate_with_outliers(&y, sd * sd)).map_or(Vec::new(), |f| f.1)
            };
            (0..probability.len())
                .filter(|&p| probability[p] > LIKELY)
                .collect()
        };
        searched[range]
            .iter()
            .map(outliers)
            .collect::<Vec<Vec<usize>>>()
    });
    let mut points = vec![Vec::new(); xyz.nrows()];
    for (t, found) in searched.iter().zip(found.into_iter().flatten()) {
        points[*t] = found;
    }
    points
}

/// Which frames are searched for outliers, by the evidence for them in each frame (nats, not
/// negative).
///
/// Under heavy noise one clean frame in eight shows some evidence, and its neighbors do not. An
/// outlier that is no spike lasts for several frames, some of which may show no evidence.
fn pooled_over_time(evidence: &[f64], runs: &[Range<usize>]) -> Vec<bool> {
    let mut searched = vec![false; evidence.len()];
    for run in runs {
        for t in run.clone() {
            let sum = |frames: Range<usize>| evidence[frames].iter().sum::<f64>();
            let before = sum(t.saturating_sub(NEIGHBORS).max(run.start)..t);
            let after = sum(t + 1..run.end.min(t + NEIGHBORS + 1));
            searched[t] = if evidence[t] > 0.0 {
                evidence[t] >= ALONE || before + evidence[t] + after >= TOGETHER
            } else {
                let before = sum(t.saturating_sub(BESIDE).max(run.start)..t);
                let after = sum(t + 1..run.end.min(t + BESIDE + 1));
                before.min(after) >= EITHER_SIDE
            };
        }
    }
    searched
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_of_neighbors_is_pooled() {
        let mut evidence = vec![0.0; 200];
        // Some by noise now and then; once enough by itself.
        (0..60).step_by(7).for_each(|t| evidence[t] = 0.8);
        evidence[40] = 4.0;
        // For some frames, with gaps; up to the end of a run.
        (90..110).for_each(|t| evidence[t] = 2.0 * f64::from(u8::from(t % 3 != 0)));
        (145..150).for_each(|t| evidence[t] = 2.5);
        let searched = pooled_over_time(&evidence, &[0..150, 150..200]);
        let searched: Vec<usize> = (0..200).filter(|t| searched[*t]).collect();
        // At an end of these a frame without evidence has too little on one side.
        let some = (91..108).chain([109]);
        let want: Vec<usize> = [40].into_iter().chain(some).chain(145..150).collect();
        assert_eq!(searched, want);
    }
}
