//! What the body says of labels: how well they fit it as they are, and exchanged.
//!
//! ```text
//! cost = Σ min(deviation², 25) + min(distance² / 1.5², 25)
//! ```
//!
//! over the labels, with how far each is from where such labels are mostly, in standard deviations,
//! and its mean squared distance from the body that is fitted to all, cm².

use super::label_model::LabelModel;
use super::marker_distances::Distance;
use super::tuning::body_evidence::*;
use super::tuning::whole_take::NEAR;
use super::unlabeled::own_name;
use crate::pose::point_at;
use ndarray::{Array2, ArrayView2, s};
use std::cell::OnceCell;

/// The labels of a person and the body that they are compared with.
pub(crate) struct BodyEvidence<'a> {
    model: &'a dyn LabelModel,
    /// (frames, 3 P), cm.
    xyz: ArrayView2<'a, f64>,
    /// The point that is each label.
    points: Vec<Option<usize>>,
    /// How badly each fits as it is named, once that is asked for.
    as_named: OnceCell<Option<Vec<f64>>>,
}

impl<'a> BodyEvidence<'a> {
    /// Takes the `points` of a person, by their names among all, whose labels the body has; `None`
    /// where these are few.
    pub(crate) fn new(
        model: &'a dyn LabelModel,
        names: &[String],
        points: &[usize],
        xyz: ArrayView2<'a, f64>,
    ) -> Option<BodyEvidence<'a>> {
        let is = |p: &usize, label: &String| own_name(&names[*p]) == label;
        let of = |label: &String| points.iter().copied().find(|p| is(p, label));
        let points: Vec<Option<usize>> = model.labels().iter().map(of).collect();
        let known = points.iter().flatten().count();
        (known >= FEWEST_LABELS).then_some(BodyEvidence {
            model,
            xyz,
            points,
            as_named: OnceCell::new(),
        })
    }

    /// How badly each label fits, where `from` says which point's positions each point has in a
    /// frame; `None` where the body cannot be fitted.
    fn costs(&self, from: &dyn Fn(usize, usize) -> usize) -> Option<Vec<f64>> {
        let step = self.xyz.nrows().div_ceil(FRAMES).max(1);
        let rows: Vec<usize> = (0..self.xyz.nrows()).step_by(step).collect();
        let mut known = Array2::from_elem((rows.len(), 3 * self.points.len()), f64::NAN);
        for (n, t) in rows.iter().enumerate() {
            for (label, point) in self.points.iter().enumerate() {
                let Some(own) = point.map(|point| from(*t, point)) else {
                    continue;
                };
                let at = self.xyz.slice(s![*t, 3 * own..3 * own + 3]);
                known.slice_mut(s![n, 3 * label..3 * label + 3]).assign(&at);
            }
        }
        let fit = self.model.fit(known.view()).ok()?;
        let of = |label: usize| {
            let far = |n: usize| {
                let at = point_at(known.view(), n, label);
                point_at(fit.places.view(), n, label).distance_squared(at)
            };
            let all = (0..rows.len()).map(far).filter(|far| far.is_finite());
            let (sum, count) = all.fold((0.0, 0.0), |(sum, count), far| (sum + far, count + 1.0));
            if count == 0.0 {
                return 0.0;
            }
            let off = sum / count / (SD * SD);
            fit.deviations[label].powi(2).min(HIGHEST) + off.min(HIGHEST)
        };
        Some((0..self.points.len()).map(of).collect())
    }

    /// How badly each label fits as it is named.
    fn as_named(&self) -> Option<&Vec<f64>> {
        self.as_named.get_or_init(|| self.costs(&|_, p| p)).as_ref()
    }

    /// How badly the labels fit, where `from` says which point's positions each point has in a
    /// frame.
    pub(crate) fn cost(&self, from: &dyn Fn(usize, usize) -> usize) -> Option<f64> {
        self.costs(from).map(|costs| costs.iter().sum())
    }

    /// By how much better the labels fit with pairs of points exchanged in every frame; `None`
    /// where the body has not all of them.
    pub(crate) fn gain(&self, pairs: &[usize]) -> Option<f64> {
        let has = |p: &usize| self.points.contains(&Some(*p));
        let other = |_: usize, p: usize| match pairs.iter().position(|q| *q == p) {
            Some(k) => pairs[k ^ 1],
            None => p,
        };
        let all = pairs.iter().all(has);
        all.then(|| Some(self.as_named()?.iter().sum::<f64>() - self.cost(&other)?))?
    }

    /// Pairs of near points that both fit badly, one of them very, and fit exchanged; the clearest
    /// first, with its gain.
    pub(crate) fn exchanged(&self) -> Vec<(f64, [usize; 2])> {
        let odd: Vec<(f64, usize)> = (self.as_named().into_iter().flatten().zip(&self.points))
            .filter_map(|(cost, point)| Some((*cost, (*point)?)))
            .filter(|(cost, _)| *cost >= ODD)
            .collect();
        let is_near = |pair: [usize; 2]| {
            let apart = Distance::measure(self.xyz, pair);
            apart.is_some_and(|d| (NEAR[0]..=NEAR[1]).contains(&d.median))
        };
        let pairs = odd.iter().enumerate().flat_map(|(k, a)| {
            let both = odd[k + 1..].iter().map(move |b| (a.0.max(b.0), [a.1, b.1]));
            both.filter(|(worst, pair)| *worst >= VERY_ODD && is_near(*pair))
        });
        let mut pairs: Vec<(f64, [usize; 2])> = pairs.collect();
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        pairs.truncate(MOST_PAIRS);
        let gains = pairs
            .into_iter()
            .filter_map(|(_, pair)| Some((self.gain(&pair)?, pair)));
        let mut gains: Vec<_> = gains.filter(|(gain, _)| *gain >= TOLD).collect();
        gains.sort_by(|a, b| b.0.total_cmp(&a.0));
        gains
    }
}
