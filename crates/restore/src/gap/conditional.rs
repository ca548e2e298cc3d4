//! The Gaussian conditional of targets on predictors.

use super::local_poses::LocalPoses;
use crate::numeric::linalg::{Cholesky, gram};
use ndarray::{Array1, Array2, ArrayView1, Axis, s};

/// Means and covariance of predictors and targets together.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    mean: Array1<f64>,
    covariance: Array2<f64>,
}

/// The moments of all rows, and of the kept ones alone.
pub(crate) fn moments_without(
    poses: &LocalPoses,
    kept: &[usize],
    held: &[usize],
) -> (Moments, Moments) {
    let mut all = rows(poses, &[kept, held].concat());
    let mean = all.sum_axis(Axis(0)) / all.nrows().max(1) as f64;
    all -= &mean;
    let held = all.slice(s![kept.len().., ..]);
    let (sum, squares) = (gram(all.view()), gram(held));
    // About the mean of all, that of the kept ones is off by so much.
    let shift = held.sum_axis(Axis(0)) / -(kept.len().max(1) as f64);
    let column = shift.view().insert_axis(Axis(1));
    let of_shift = column.dot(&column.t()) * kept.len() as f64;
    let over = |n: usize| (n as f64 - 1.0).max(1.0);
    let without = Moments {
        covariance: (&sum - &squares - of_shift) / over(kept.len()),
        mean: &mean + &shift,
    };
    let with = Moments {
        covariance: sum / over(all.nrows()),
        mean,
    };
    (with, without)
}

/// Predictors and targets beside each other.
fn rows(poses: &LocalPoses, rows: &[usize]) -> Array2<f64> {
    let x = poses.predictors.select(Axis(0), rows);
    let y = poses.targets.select(Axis(0), rows);
    let Ok(all) = ndarray::concatenate(Axis(1), &[x.view(), y.view()]) else {
        unreachable!("predictors and targets have the same rows");
    };
    all
}

impl Moments {
    /// The moments of some rows.
    pub(crate) fn new(poses: &LocalPoses, rows: &[usize]) -> Moments {
        moments_without(poses, rows, &[]).0
    }

    /// The mean of both, this one with the weight `w`.
    pub(crate) fn pooled(&self, w: f64, other: &Moments) -> Moments {
        Moments {
            mean: &self.mean * w + &other.mean * (1.0 - w),
            covariance: &self.covariance * w + &other.covariance * (1.0 - w),
        }
    }
}

/// y ≈ m_y + K (x − m_x).
pub(crate) struct Conditional {
    mean_x: Array1<f64>,
    mean_y: Array1<f64>,
    /// Kᵀ (3 P, 3 T).
    coefficients: Array2<f64>,
}

impl Conditional {
    /// The conditional of moments with `p` coordinates of predictors, to whose variances `ridge`
    /// is added.
    pub(crate) fn new(moments: &Moments, p: usize, ridge: f64) -> Option<Conditional> {
        let mut xx = moments.covariance.slice(s![..p, ..p]).to_owned();
        xx.diag_mut().mapv_inplace(|v| v + ridge);
        let xy = moments.covariance.slice(s![..p, p..]).to_owned();
        Some(Conditional {
            mean_x: moments.mean.slice(s![..p]).to_owned(),
            mean_y: moments.mean.slice(s![p..]).to_owned(),
            coefficients: Cholesky::new(xx)?.solve(&xy)?,
        })
    }

    /// What it expects (n, 3 T) of predictors (n, 3 P).
    pub(crate) fn expects(&self, x: &Array2<f64>) -> Array2<f64> {
        (x - &self.mean_x).dot(&self.coefficients) + &self.mean_y
    }

    /// Predictors (n, 3 P) about their mean.
    pub(crate) fn centered(&self, x: &Array2<f64>) -> Array2<f64> {
        x - &self.mean_x
    }

    /// s: .1 and each predictor's share in the targets' coefficients, of 1 for the largest of each
    /// target.
    pub(crate) fn scales(&self) -> Array1<f64> {
        let coefficients = &self.coefficients;
        let mut sum = Array1::<f64>::zeros(coefficients.nrows());
        for target in 0..coefficients.ncols() / 3 {
            let of_target = coefficients.slice(s![.., 3 * target..3 * target + 3]);
            let squares = of_target.map_axis(Axis(1), |row: ArrayView1<'_, f64>| row.dot(&row));
            let largest = squares.iter().copied().fold(1e-300, f64::max);
            sum += &(squares / largest);
        }
        let largest = sum.iter().copied().fold(1e-300, f64::max);
        sum.mapv(|v| 0.1 + (v / largest).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::ArrayView2;

    #[test]
    fn moments_without_some_rows_are_those_of_the_others() {
        let xyz = Array2::from_shape_fn((40, 12), |(t, c)| {
            50.0 + ((t * t + 3 * c) as f64 * 0.37).sin() * (c + 1) as f64
        });
        let poses = LocalPoses::in_reference_frame(ArrayView2::from(&xyz), &[0, 1, 3], &[2]);
        let (kept, held): (Vec<usize>, Vec<usize>) = (0..40).partition(|t| t % 3 > 0);
        let (with, without) = moments_without(&poses, &kept, &held);
        for (got, rows) in [(with, [&kept[..], &held].concat()), (without, kept)] {
            let all = super::rows(&poses, &rows);
            let mean = all.mean_axis(Axis(0)).expect("rows");
            let about = &all - &mean;
            let covariance = about.t().dot(&about) / (rows.len() - 1) as f64;
            assert!((got.mean - mean).iter().all(|v| v.abs() < 1e-10));
            assert!(
                (got.covariance - covariance)
                    .iter()
                    .all(|v| v.abs() < 1e-10)
            );
        }
    }
}
