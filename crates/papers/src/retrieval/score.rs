//! How often a distance is right, on people that it has not learned from.

use super::takes::TakeSet;
use crate::metric::pairs::best_threshold;
use crate::metric::{BodyFramePoses, FrameRef, LabeledPair, PoseDatabase, PoseMetric};
use crate::numeric::parallel;
use crate::numeric::statistics::bootstrap_interval;
use ndarray::Array2;

/// Poses that are asked for and searched, a second.
const RATE: f64 = 10.0;
/// Numbers of poses found at which precision is measured (Chen et al.'s figure 8).
pub const SCOPES: [usize; 4] = [5, 10, 20, 40];

/// A mean over takes, with a 95% interval by bootstrap over them.
#[derive(Debug, Clone, PartialEq)]
pub struct Precision {
    /// The mean.
    pub mean: f64,
    /// The interval.
    pub interval: [f64; 2],
    /// Takes.
    pub takes: usize,
}

impl Precision {
    /// The precision of the values of each take, means in takes of (sum, count); `None` without
    /// values.
    fn new(takes: &[(f64, f64)], seed: u64) -> Option<Precision> {
        let takes: Vec<(f64, f64)> = takes.iter().copied().filter(|t| t.1 > 0.0).collect();
        let mean = |chosen: &mut dyn Iterator<Item = (f64, f64)>| {
            let (sum, count) = chosen.fold((0.0, 0.0), |s, t| (s.0 + t.0, s.1 + t.1));
            sum / count
        };
        if takes.is_empty() {
            return None;
        }
        Some(Precision {
            mean: mean(&mut takes.iter().copied()),
            interval: bootstrap_interval(takes.len(), &mut parallel::rng(seed, 0), |drawn| {
                mean(&mut drawn.map(|k| takes[k]))
            }),
            takes: takes.len(),
        })
    }
}

/// Frames of each take as vectors, [`RATE`] a second.
fn embed(metric: &PoseMetric, set: &TakeSet) -> (Vec<FrameRef>, Array2<f32>) {
    metric.embed_takes(&set.takes, step)
}

/// The frames of a take from one that is asked for, or searched, to the next.
pub(super) fn step(take: &BodyFramePoses) -> usize {
    (take.rate.unwrap_or(RATE) / RATE).round().max(1.0) as usize
}

/// The share of the poses found in `searched`, takes of other people than those of `queries`, that
/// are of the query's class, at each of [`SCOPES`]: each take counts once.
pub(crate) fn retrieval(
    metric: &PoseMetric,
    searched: &TakeSet,
    queries: &TakeSet,
) -> Vec<Option<Precision>> {
    let (rows, vectors) = embed(metric, searched);
    let (query_rows, query_vectors) = embed(metric, queries);
    let most = SCOPES[SCOPES.len() - 1];
    let found =
        PoseDatabase::new(vectors, metric.norm).nearest(query_vectors.view(), most, |_, _| true);
    let precision = |scope: usize| {
        let mut takes = vec![(0.0, 0.0); queries.takes.len()];
        for (query, found) in query_rows.iter().zip(&found) {
            let class = &queries.about[query.take].class;
            let found = &found[..scope.min(found.len())];
            let right = found
                .iter()
                .filter(|n| searched.about[rows[n.row].take].class == *class);
            takes[query.take].0 += right.count() as f64;
            takes[query.take].1 += found.len() as f64;
        }
        let each = takes.iter().filter(|t| t.1 > 0.0).map(|t| (t.0 / t.1, 1.0));
        Precision::new(&each.collect::<Vec<_>>(), scope as u64)
    };
    SCOPES.map(precision).into()
}

/// The share of pairs that the best threshold decides right, (36) and (37).
pub(crate) fn decisions(
    metric: &PoseMetric,
    set: &TakeSet,
    pairs: &[LabeledPair],
) -> Option<Precision> {
    let distance = |pair: &LabeledPair| {
        let [a, b] = pair
            .ends
            .map(|end| metric.embed_frames(&set.takes[end.take], &[end.frame]));
        metric.norm.distance(a.row(0), b.row(0))
    };
    let distances = parallel::map_chunks(pairs.len(), 16, |range| {
        pairs[range].iter().map(distance).collect::<Vec<_>>()
    })
    .concat();
    let is_alike: Vec<bool> = pairs.iter().map(|p| p.is_alike).collect();
    let (_, threshold) = best_threshold(&distances, &is_alike)?;
    let mut takes = vec![(0.0, 0.0); set.takes.len()];
    for (pair, distance) in pairs.iter().zip(&distances) {
        let is_right = (*distance < threshold) == pair.is_alike;
        let take = &mut takes[pair.ends[0].take];
        take.0 += f64::from(u8::from(is_right));
        take.1 += 1.0;
    }
    Precision::new(&takes, 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_holds_the_mean_and_needs_values() {
        let takes: Vec<(f64, f64)> = (0..50).map(|k| (f64::from(k % 2), 1.0)).collect();
        let precision = Precision::new(&takes, 0).unwrap();
        assert_eq!(precision.mean, 0.5);
        let [low, high] = precision.interval;
        assert!(low < 0.45 && high > 0.55 && low > 0.3 && high < 0.7);
        assert_eq!(Precision::new(&[(0.0, 0.0)], 0), None);
    }
}
