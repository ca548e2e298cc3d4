//! Made poses whose classes show in some dimensions only.

use crate::metric::train::TrainingPairs;
use crate::numeric::parallel::rng;
use ndarray::{Array2, ArrayView2};
use rand::Rng;
use rand_distr::StandardNormal;

const CLASSES: usize = 10;
const POSES: usize = 16;

/// Classes about centers in the first dimensions; noise, wider than the classes are apart, in the
/// others.
pub(super) struct Planted {
    /// (CLASSES POSES, signal + noise). The class of row i is i % CLASSES.
    pub x: Array2<f64>,
    /// Chains through the first half of each class.
    pub alike: Vec<[usize; 2]>,
    /// Pairs across classes in the first half.
    pub unlike: Vec<[usize; 2]>,
}

impl Planted {
    /// Poses with so many dimensions that matter and so many that do not.
    pub(crate) fn new(signal: usize, noise: usize) -> Planted {
        let mut random = rng(7, 0);
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        let centers = Array2::from_shape_simple_fn((CLASSES, signal), || 1.5 * normal());
        let n = CLASSES * POSES;
        let x = Array2::from_shape_fn((n, signal + noise), |(i, j)| {
            if j < signal {
                centers[[i % CLASSES, j]] + 0.2 * normal()
            } else {
                2.0 * normal()
            }
        });
        let half = n / 2;
        let alike = (0..half - CLASSES).map(|i| [i, i + CLASSES]).collect();
        let unlike = (0..half).flat_map(|i| [1, 3].map(|step| [i, (i + step) % half]));
        Planted {
            x,
            alike,
            unlike: unlike.collect(),
        }
    }

    pub(crate) fn pairs(&self) -> TrainingPairs<'_> {
        TrainingPairs {
            x: self.x.view(),
            alike: &self.alike,
            unlike: &self.unlike,
        }
    }

    /// The share of the second half, which no pair names, whose nearest other of that half after
    /// the map is of their class.
    pub(crate) fn precision(&self, w: &Array2<f64>) -> f64 {
        let half = self.x.nrows() / 2;
        let z = self.x.slice(ndarray::s![half.., ..]).dot(w);
        let right = (0..z.nrows())
            .filter(|&i| (nearest(z.view(), i) + half) % CLASSES == (i + half) % CLASSES);
        right.count() as f64 / z.nrows() as f64
    }
}

fn nearest(z: ArrayView2<'_, f64>, i: usize) -> usize {
    let apart = |j: usize| (&z.row(i) - &z.row(j)).mapv(|v| v * v).sum();
    let others = (0..z.nrows()).filter(|&j| j != i);
    others
        .min_by(|&a, &b| apart(a).total_cmp(&apart(b)))
        .unwrap()
}
