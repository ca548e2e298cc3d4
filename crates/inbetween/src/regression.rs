//! The residual of a gap from those of the windows nearest to it: the mean of a Gaussian process
//! and of a locally weighted linear regression, both of which are weighted sums of true residuals.
//!
//! ```text
//! global:  k' (K + .3 I)⁻¹,       k = exp(-d² / 2 η²), η the distance of the 31st of 300
//! linear:  ridge of .03 tr over the nearest 100, weights exp(-d² / h²), h that of the 51st
//! ```

use super::windows::Windows;
use crate::numeric::linalg::cholesky_solve;
use ndarray::{Array1, Array2, ArrayView1, Axis};

/// Windows of the process, and of the linear regression.
const NEAREST: usize = 300;
const LINEAR: usize = 100;
/// The noise of the process, as a share of its variance, and the ridge as one of the trace.
const NOISE: f64 = 0.3;
const RIDGE: f64 = 0.03;

/// Windows of others and of the take itself, which share features.
pub(crate) struct Known<'a> {
    pub others: Option<&'a Windows>,
    pub own: Option<&'a Windows>,
}

/// One of the known windows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Window {
    pub is_own: bool,
    pub index: usize,
}

impl<'a> Known<'a> {
    pub(crate) fn of(&self, window: Window) -> Option<&'a Windows> {
        if window.is_own { self.own } else { self.others }
    }

    /// Each window with its squared distances to a gap's features.
    pub(crate) fn distances(&self, features: ArrayView1<'_, f64>) -> Vec<(f64, Window)> {
        let mut out = Vec::new();
        for (is_own, windows) in [(false, self.others), (true, self.own)] {
            for (index, row) in windows.iter().flat_map(|w| w.features.rows()).enumerate() {
                let squared = row.iter().zip(features).map(|(a, b)| (a - b) * (a - b));
                out.push((squared.sum(), Window { is_own, index }));
            }
        }
        out
    }
}

/// What a residual is a weighted sum of.
#[derive(Debug, Clone)]
pub(crate) struct Blend {
    /// The nearest first.
    pub windows: Vec<Window>,
    /// One for each of them.
    pub weights: Array1<f64>,
    /// The distance of the third nearest.
    pub distance: f64,
}

/// The blend for a gap with some features, of windows with their squared distances to it.
pub(crate) fn blend(
    known: &Known<'_>,
    features: ArrayView1<'_, f64>,
    mut all: Vec<(f64, Window)>,
) -> Option<Blend> {
    let count = NEAREST.min(all.len());
    if count < 3 {
        return None;
    }
    let order = |a: &(f64, Window), b: &(f64, Window)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    all.select_nth_unstable_by(count - 1, order);
    all.truncate(count);
    all.sort_by(order);
    let squared: Vec<f64> = all.iter().map(|(d, _)| *d).collect();
    let mut x = Array2::zeros((count, features.len()));
    for (mut row, (_, window)) in x.rows_mut().into_iter().zip(&all) {
        row.assign(&known.of(*window)?.row(window.index));
    }
    let process = process(&x, &squared)?;
    let mut weights = process * 0.5;
    let linear = linear(&x, features, &squared)?;
    for (w, linear) in weights.iter_mut().zip(linear) {
        *w += 0.5 * linear;
    }
    Some(Blend {
        windows: all.iter().map(|(_, window)| *window).collect(),
        weights,
        distance: squared[2].sqrt(),
    })
}

/// The weights of the process's mean.
fn process(x: &Array2<f64>, squared: &[f64]) -> Option<Array1<f64>> {
    let count = squared.len();
    let reach = squared[(count / 10).max(10).min(count - 1)].max(1e-12);
    let kernel = |d: f64| (-d / (2.0 * reach)).exp();
    let mut k = x.dot(&x.t());
    let lengths = k.diag().to_owned();
    k.indexed_iter_mut().for_each(|((i, j), v)| {
        let apart = (lengths[i] + lengths[j] - 2.0 * *v).max(0.0);
        *v = kernel(apart) + if i == j { NOISE } else { 0.0 };
    });
    cholesky_solve(k, squared.iter().map(|d| kernel(*d)).collect())
}

/// The weights of the linear regression.
fn linear(x: &Array2<f64>, at: ArrayView1<'_, f64>, squared: &[f64]) -> Option<Array1<f64>> {
    let count = LINEAR.min(squared.len());
    let reach = squared[count / 2].max(1e-12);
    let near: Array1<f64> = (squared[..count].iter())
        .map(|d| (-d / reach).exp())
        .collect();
    let near = &near / near.sum();
    let roots = near.mapv(f64::sqrt);
    let x = x.slice(ndarray::s![..count, ..]);
    let mean = near.dot(&x);
    let scaled = (&x - &mean) * &roots.clone().insert_axis(Axis(1));
    let mut gram = scaled.dot(&scaled.t());
    let ridge = RIDGE * gram.diag().sum() + 1e-12;
    gram.diag_mut().mapv_inplace(|v| v + ridge);
    let slopes = cholesky_solve(gram, scaled.dot(&(&at - &mean)))?;
    Some(&near + &(&roots * &slopes) - &near * roots.dot(&slopes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_tree::tests::walk;
    use crate::windows::{Beside, Clip, Origin};

    #[test]
    fn weights_are_those_of_the_regressions() {
        // The linear one is exact for what is linear, but for the ridge, and its weights add up to
        // one.
        let x = Array2::from_shape_fn((60, 2), |(i, c)| ((7 * i + 5 * c + i * i) % 13) as f64);
        let at = Array1::from(vec![6.0, 6.5]);
        let mut rows: Vec<(f64, usize)> = (0..60)
            .map(|i| ((&x.row(i) - &at).mapv(|v| v * v).sum(), i))
            .collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let order: Vec<usize> = rows.iter().map(|r| r.1).collect();
        let (x, squared) = (
            x.select(Axis(0), &order),
            rows.iter().map(|r| r.0).collect::<Vec<_>>(),
        );
        let weights = linear(&x, at.view(), &squared).unwrap();
        assert!((weights.sum() - 1.0).abs() < 1e-9);
        let value = |row: ArrayView1<'_, f64>| 3.0 + 2.0 * row[0] - row[1];
        let found: f64 = (x.rows().into_iter().zip(&weights))
            .map(|(row, w)| w * value(row))
            .sum();
        assert!((found - value(at.view())).abs() < 0.6, "{found}");
        // The process: at a window that lies apart from all others, 1 / 1.3 of its own residual.
        let far = Array2::from_shape_fn((20, 2), |(i, c)| 1e3 * ((i * i) as f64) * (c + 1) as f64);
        let mut squared: Vec<f64> = far.rows().into_iter().map(|r| r.dot(&r)).collect();
        squared[10..].fill(1e-9);
        let own = process(&far, &squared).unwrap();
        assert!((own[0] - 1.0 / 1.3).abs() < 1e-9);
    }

    #[test]
    fn a_window_among_the_known_is_given_back() {
        let (tree, frames) = walk(200, 30.0, 1.0);
        let windows = Windows::cut(
            &tree,
            [Clip::new(&tree, frames, Origin::default())].into(),
            [9, 1],
            Beside::Motion,
            None,
        )
        .unwrap();
        let known = Known {
            others: Some(&windows),
            own: None,
        };
        let at = windows.row(80);
        let found = blend(&known, at, known.distances(at)).unwrap();
        assert_eq!(found.windows[0].index, 80);
        let mut sum = windows.residual(&tree, 80) * -1.0;
        let size = sum.dot(&sum);
        for (window, w) in found.windows.iter().zip(&found.weights) {
            sum.scaled_add(*w, &windows.residual(&tree, window.index));
        }
        assert!(sum.dot(&sum) < 0.05 * size, "{} of {size}", sum.dot(&sum));
    }
}
