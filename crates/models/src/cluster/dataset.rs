//! Poses to cluster, checked, and the exact distance that every label rests on.

use crate::numeric::parallel;
use crate::{Error, Place, Result};
use ndarray::{CowArray, Ix2};

/// Lanes of the unrolled sums: fixed, so that a distance is the same everywhere.
const LANES: usize = 8;
/// Beyond this, squares summed over a pose could overflow f32.
pub(super) const LARGEST: f32 = 1e15;
/// A checked table: finite numbers, row after row.
#[derive(Clone, Copy)]
pub(super) struct Dataset<'a> {
    /// Coordinates, (n, d) in row order.
    values: &'a [f32],
    /// Number of poses.
    pub n: usize,
    /// Coordinates of a pose, at least 1.
    pub d: usize,
}

impl<'a> Dataset<'a> {
    /// Checks a table whose rows lie one after another in memory.
    ///
    /// # Errors
    /// Usage: no columns, or more rows than a u32 counts. Data: the first row holding NaN, infinity
    /// or a value beyond 1e15; its place has the file `poses` and the row, counted from 1, as line.
    pub(crate) fn check(table: &'a CowArray<'_, f32, Ix2>) -> Result<Self> {
        let (n, d) = table.dim();
        if d == 0 {
            return Err(Error::usage("poses to cluster need at least 1 column"));
        }
        if n > u32::MAX as usize {
            return Err(Error::usage(format!(
                "{n} poses: at most {} can be clustered",
                u32::MAX
            )));
        }
        let values = table
            .as_slice()
            .expect("the caller puts rows one after another");
        let poses = Dataset { values, n, d };
        let bad = parallel::map_chunks(n, 4096, |mut rows| {
            rows.find(|&i| poses.row(i).iter().any(|x| x.is_nan() || x.abs() > LARGEST))
        });
        match bad.into_iter().flatten().next() {
            None => Ok(poses),
            Some(i) => {
                let x = poses
                    .row(i)
                    .iter()
                    .find(|x| x.is_nan() || x.abs() > LARGEST);
                Err(Error::data(
                    Place::line("poses", i as u64 + 1),
                    format!(
                        "cannot cluster the value {}; fill the pose or leave it out",
                        x.unwrap_or(&f32::NAN)
                    ),
                ))
            }
        }
    }

    /// The poses of `table`, which are rows of a checked table.
    pub(crate) fn trusted(values: &'a [f32], d: usize) -> Self {
        Dataset {
            values,
            n: values.len() / d,
            d,
        }
    }

    /// Some of the poses, by their ascending numbers; copied into `room` unless they are all.
    pub(crate) fn subset<'b>(self, members: &[u32], room: &'b mut Vec<f32>) -> Dataset<'b>
    where
        'a: 'b,
    {
        if members.len() == self.n {
            return self;
        }
        let rows = members.iter().flat_map(|&i| self.row(i as usize));
        room.extend(rows);
        Dataset::trusted(room, self.d)
    }

    /// Pose `i`.
    pub(crate) fn row(&self, i: usize) -> &'a [f32] {
        &self.values[i * self.d..(i + 1) * self.d]
    }

    /// Mean of the poses (d), and the mean over coordinates of their variance.
    pub(crate) fn moments(&self) -> (Vec<f64>, f64) {
        let sums = parallel::map_chunks(self.n, 4096, |rows| {
            let mut sum = vec![0.0; self.d];
            rows.for_each(|i| add(&mut sum, self.row(i)));
            sum
        });
        let mut mean = vec![0.0; self.d];
        for sum in sums {
            mean.iter_mut().zip(sum).for_each(|(m, s)| *m += s);
        }
        mean.iter_mut().for_each(|m| *m /= self.n.max(1) as f64);
        let squares = parallel::map_chunks(self.n, 4096, |rows| {
            rows.map(|i| squared_distance(self.row(i), &mean))
                .sum::<f64>()
        });
        let variance = squares.into_iter().sum::<f64>() / (self.n.max(1) * self.d) as f64;
        (mean, variance)
    }
}

/// Adds a pose to a sum in f64.
pub(super) fn add(sum: &mut [f64], pose: &[f32]) {
    sum.iter_mut()
        .zip(pose)
        .for_each(|(s, &x)| *s += f64::from(x));
}

/// |x - c|² in f64. Every label in this module is decided by this function: the order of its sum is
/// part of the result.
pub(super) fn squared_distance(pose: &[f32], centroid: &[f64]) -> f64 {
    let mut lanes = [0.0f64; LANES];
    let (x, c) = (pose.chunks_exact(LANES), centroid.chunks_exact(LANES));
    let rest = x.remainder().iter().zip(c.remainder());
    let tail: f64 = rest.map(|(&x, c)| (f64::from(x) - c).powi(2)).sum();
    for (x, c) in x.zip(c) {
        for i in 0..LANES {
            let gap = f64::from(x[i]) - c[i];
            lanes[i] += gap * gap;
        }
    }
    lanes.iter().sum::<f64>() + tail
}

/// The centroid nearest to a pose by the exact rule, its squared distance, and the second least one
/// (infinite for a single centroid).
pub(super) fn exact_nearest<'c>(
    pose: &[f32],
    centroids: impl Iterator<Item = (u32, &'c [f64])>,
) -> NearestCentroid {
    let mut near = NearestCentroid {
        label: 0,
        squared: f64::INFINITY,
        second: f64::INFINITY,
    };
    for (label, centroid) in centroids {
        let squared = squared_distance(pose, centroid);
        if squared < near.squared {
            near = NearestCentroid {
                label,
                squared,
                second: near.squared,
            };
        } else if squared < near.second {
            near.second = squared;
        }
    }
    near
}

/// The answer for one pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct NearestCentroid {
    /// The nearest centroid.
    pub label: u32,
    /// Its squared distance, exact.
    pub squared: f64,
    /// No other centroid that was looked at has a smaller squared distance than this.
    pub second: f64,
}
