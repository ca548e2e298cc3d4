//! The smoothest way to move all of space so that some points go where they should: a thin plate.
//!
//! ```text
//! s(x) = Σ_k c_k |x − x_k| + b + B x,   with Σ c_k = 0 and Σ c_k x_kᵀ = 0
//! ```
//!
//! bends least of all functions with these values at the x_k (J. Duchon 1977: in space the
//! biharmonic spline is |r|). It is also the best estimate of a random field whose differences have
//! a variance that grows with the distance; the noise of the values over that growth smooths it. A
//! noise that is told holds, and near points tell the growth; else the plate is as smooth as it
//! predicts each value best from the others.

use crate::numeric::linalg::{Cholesky, symmetric_eigen};
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2, Axis, s};

/// Pairs up to this distance tell how the field grows, cm.
const NEAR: f64 = 10.0;
/// And the nearest, this many times the points.
const PAIRS: usize = 3;
/// The least smoothing, cm: points that coincide leave the equations solvable.
const LEAST_SMOOTHING: f64 = 1e-3;
/// Points that tell how smooth the plate is where the noise is not told, at most about.
const JUDGED: usize = 250;
/// Smoothing that is tried there, cm.
const TRIED: [f64; 11] = [
    LEAST_SMOOTHING,
    0.3,
    1.0,
    2.0,
    4.0,
    8.0,
    16.0,
    32.0,
    64.0,
    200.0,
    1000.0,
];
/// By how much the polynomials count more than the largest distance: the equations are positive
/// definite then, and their solution is the same.
const LIFT: f64 = 10.0;
/// What a point's own value counts against the stiffest motion of all, at least, if others tell it.
const ALONE: f64 = 1e-9;

/// A warp of space.
#[derive(Debug, Clone)]
pub(crate) struct Warp {
    /// The points and c.
    centers: Vec<(DVec3, DVec3)>,
    /// b and B; of points about `middle`.
    shift: DVec3,
    linear: DMat3,
    middle: DVec3,
}

impl Warp {
    /// The warp that moves each point by its own way, but for the noise: standard deviation of a
    /// coordinate, cm, if known. `None`: fewer than four points, or all in a plane.
    pub(crate) fn new(moves: &[(DVec3, DVec3)], noise: Option<f64>) -> Option<Warp> {
        let count = moves.len();
        if count < 4 {
            return None;
        }
        let middle = moves.iter().map(|(at, _)| *at).sum::<DVec3>() / count as f64;
        let square = |(at, _): &(DVec3, DVec3)| (*at - middle) * (*at - middle);
        let spread = (moves.iter().map(square).sum::<DVec3>() / count as f64).map(f64::sqrt);
        if !(spread.min_element() > 0.0) || is_flat(moves, middle) {
            return None;
        }
        let base = |at: DVec3| {
            let own = (at - middle) / spread;
            [1.0, own.x, own.y, own.z]
        };
        let polynomials = Array2::from_shape_fn((count, 4), |(i, c)| base(moves[i].0)[c]);
        let values = Array2::from_shape_fn((count, 3), |(i, a)| moves[i].1[a]);
        let smoothing = match noise {
            Some(noise) => smoothing(moves, noise * noise).max(LEAST_SMOOTHING),
            None => {
                let some: Vec<usize> = (0..count).step_by(count.div_ceil(JUDGED)).collect();
                let [polynomials, values] =
                    [&polynomials, &values].map(|m| m.select(Axis(0), &some));
                let moves: Vec<(DVec3, DVec3)> = some.iter().map(|i| moves[*i]).collect();
                Plate::new(&moves, &polynomials)?.best_smoothing(&values)
            }
        };
        let apart = distances(moves);
        let largest = apart.iter().copied().fold(0.0, f64::max);
        let mut matrix = polynomials.dot(&polynomials.t()) * (LIFT * largest) - apart;
        matrix.diag_mut().mapv_inplace(|v| v + smoothing);
        let factor = Cholesky::new(matrix)?;
        let (own, theirs) = (factor.solve(&polynomials)?, factor.solve(&values)?);
        let normal = Cholesky::new(polynomials.t().dot(&own))?;
        let shared = normal.solve(&polynomials.t().dot(&theirs))?;
        let pulls = theirs - own.dot(&shared);
        // The polynomials are what the values are less the rest.
        let left = polynomials.t().dot(&polynomials);
        let rest = Array2::from_shape_fn((count, 3), |(i, a)| {
            let plate = |j: usize| pulls[[j, a]] * moves[i].0.distance(moves[j].0);
            values[[i, a]] - smoothing * pulls[[i, a]] + (0..count).map(plate).sum::<f64>()
        });
        let factors = Cholesky::new(left)?.solve(&polynomials.t().dot(&rest))?;
        let row = |i: usize| DVec3::from_slice(&factors.slice(s![i, ..]).to_vec());
        let pull = |j: usize| DVec3::from_slice(&pulls.slice(s![j, ..]).to_vec());
        Some(Warp {
            centers: (moves.iter().enumerate())
                .map(|(j, (at, _))| (*at, -pull(j)))
                .collect(),
            shift: row(0),
            linear: DMat3::from_cols(row(1) / spread.x, row(2) / spread.y, row(3) / spread.z),
            middle,
        })
    }

    /// What a point is moved by.
    pub(crate) fn at(&self, point: DVec3) -> DVec3 {
        let plate = self.centers.iter().map(|(at, c)| *c * point.distance(*at));
        plate.sum::<DVec3>() + self.shift + self.linear * (point - self.middle)
    }
}

/// What gives −c of the values at some points for any smoothing: `V (Λ + smoothing)⁻¹ Vᵀ`, by the
/// eigenvectors of the negative distances across the polynomials.
struct Plate {
    /// V (points, points − 4).
    vectors: Array2<f64>,
    /// Λ.
    values: Array1<f64>,
}

impl Plate {
    fn new(moves: &[(DVec3, DVec3)], polynomials: &Array2<f64>) -> Option<Plate> {
        let count = moves.len();
        let apart = distances(moves);
        let largest = apart.iter().copied().fold(0.0, f64::max);
        let normal = Cholesky::new(polynomials.t().dot(polynomials))?;
        let along = polynomials.dot(&normal.solve(&polynomials.t().to_owned())?);
        let across = Array2::eye(count) - &along;
        // Lifted, the polynomials are last.
        let lifted = along * (LIFT * largest * count as f64) - across.dot(&apart).dot(&across);
        let (values, vectors) = symmetric_eigen(&lifted)?;
        let own = count.checked_sub(4)?;
        Some(Plate {
            vectors: vectors.slice(s![.., ..own]).to_owned(),
            values: values.iter().take(own).map(|v| v.max(0.0)).collect(),
        })
    }

    /// −c (points, 3).
    fn pulls(&self, values: &Array2<f64>, smoothing: f64) -> Array2<f64> {
        let weights = self.values.mapv(|v| 1.0 / (v + smoothing));
        let along = self.vectors.t().dot(values) * weights.insert_axis(Axis(1));
        self.vectors.dot(&along)
    }

    /// The smoothing by which the others tell each value best; the least where they tell none.
    fn best_smoothing(&self, values: &Array2<f64>) -> f64 {
        let stiffest = self.values.iter().copied().fold(0.0, f64::max);
        let squares = self.vectors.mapv(|v| v * v);
        // What a value is off without its own pull is that over the diagonal of the inverse.
        let off = |smoothing: f64| -> f64 {
            let own = squares.dot(&self.values.mapv(|v| 1.0 / (v + smoothing)));
            let pulls = self.pulls(values, smoothing);
            let rows = pulls.rows().into_iter().zip(&own);
            // A point that the polynomials alone go through is told by no other.
            let told = rows.filter(|(_, own)| **own * (stiffest + smoothing) > ALONE);
            told.map(|(pull, own)| pull.dot(&pull) / (own * own)).sum()
        };
        let tried = TRIED.iter().map(|smoothing| (off(*smoothing), *smoothing));
        let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(LEAST_SMOOTHING, |(_, smoothing)| smoothing)
    }
}

/// The distances of some points (points, points), cm.
fn distances(moves: &[(DVec3, DVec3)]) -> Array2<f64> {
    let count = moves.len();
    Array2::from_shape_fn((count, count), |(i, j)| moves[i].0.distance(moves[j].0))
}

/// Whether all points are in a plane.
fn is_flat(moves: &[(DVec3, DVec3)], middle: DVec3) -> bool {
    const FLAT: f64 = 1e-9;
    let mut moments = Array2::zeros((3, 3));
    for (at, _) in moves {
        let own = *at - middle;
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            moments[[i, j]] += own[i] * own[j];
        }
    }
    let values = symmetric_eigen(&moments).map(|(values, _)| values);
    values.is_none_or(|values| values[0] <= FLAT * values[2])
}

/// The variance of the noise over the growth of half the variance of a coordinate's
/// difference with the distance, cm: by a line through what near pairs show, which starts no higher
/// than at the noise that was told, cm².
fn smoothing(moves: &[(DVec3, DVec3)], told: f64) -> f64 {
    let mut pairs = Vec::new();
    for (i, (a, moved)) in moves.iter().enumerate() {
        for (b, other) in &moves[..i] {
            let apart = a.distance(*b);
            if apart < NEAR {
                pairs.push((apart, moved.distance_squared(*other) / 6.0));
            }
        }
    }
    pairs.sort_by(|a: &(f64, f64), b| a.0.total_cmp(&b.0));
    pairs.truncate(PAIRS * moves.len());
    let sum = |of: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|(d, v)| of(*d, *v)).sum::<f64>();
    let count = pairs.len().max(1) as f64;
    let (middle, mean) = (sum(&|d, _| d) / count, sum(&|_, v| v) / count);
    let slope = sum(&|d, v| (d - middle) * (v - mean)) / sum(&|d, _| (d - middle).powi(2));
    let start = (mean - slope * middle).max(0.0);
    // Near pairs may show less noise than was told, but not more.
    let (noise, growth) = if start < told && slope > 0.0 {
        (start, slope)
    } else {
        let along = sum(&|d, v| d * (v - told));
        (told, along / sum(&|d, _| d * d))
    };
    // Where nothing but noise is seen, the warp is all but stiff.
    noise / growth.max(noise / (100.0 * NEAR)).max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use rand::Rng;

    #[test]
    fn points_go_where_they_should_and_affine_maps_are_exact() {
        let mut chance = parallel::rng(0, 0);
        let mut random =
            || DVec3::from_array(std::array::from_fn(|_| chance.random_range(-30.0..30.0)));
        let points: Vec<DVec3> = (0..30).map(|_| random()).collect();
        let bent = |x: DVec3| DVec3::new(0.01 * x.y * x.y, (x.z / 9.0).sin(), 0.0);
        let moves: Vec<_> = points.iter().map(|x| (*x, bent(*x))).collect();
        let warp = Warp::new(&moves, Some(0.0)).unwrap();
        assert!(moves.iter().all(|(x, y)| warp.at(*x).distance(*y) < 0.01));
        let affine = |x: DVec3| DVec3::new(1.0 + 0.1 * x.y, -0.2 * x.x, 0.05 * x.z - 2.0);
        let moves: Vec<_> = points.iter().map(|x| (*x, affine(*x))).collect();
        let warp = Warp::new(&moves, Some(0.0)).unwrap();
        let at = DVec3::new(50.0, -4.0, 7.0);
        assert!(warp.at(at).distance(affine(at)) < 1e-6);
        // Four points tell an affine map, whether or not the noise is told.
        for noise in [Some(0.0), None] {
            let warp = Warp::new(&moves[..4], noise).unwrap();
            assert!(warp.at(at).distance(affine(at)) < 1e-6);
        }
        let flat = points.iter().map(|x| (x.with_z(x.x - 0.5 * x.y), DVec3::X));
        let flat: Vec<_> = flat.collect();
        assert!(Warp::new(&flat, None).is_none() && Warp::new(&moves[..3], None).is_none());
    }

    #[test]
    fn noise_that_is_not_told_is_told_from_a_field() {
        let mut chance = parallel::rng(1, 0);
        let mut draw = |by: f64| -> DVec3 {
            DVec3::from_array(std::array::from_fn(|_| chance.random_range(-by..by)))
        };
        let field = |x: DVec3| DVec3::new((x.y / 25.0).sin(), 0.0, (x.x / 25.0).cos());
        let points: Vec<DVec3> = (0..300).map(|_| draw(30.0)).collect();
        let noisy: Vec<_> = points.iter().map(|x| (*x, field(*x) + draw(0.5))).collect();
        let rms = |far: &dyn Fn(usize) -> f64| {
            let sum: f64 = (0..points.len()).map(|k| far(k).powi(2)).sum();
            (sum / points.len() as f64).sqrt()
        };
        let before = rms(&|k| noisy[k].1.distance(field(points[k])));
        // Told that there is none, it goes through the points; told how much, or by itself, not.
        for (noise, most) in [
            (Some(0.0), 1.0),
            (Some(0.5 / 3f64.sqrt()), 0.7),
            (None, 0.7),
        ] {
            let warp = Warp::new(&noisy, noise).unwrap();
            let after = rms(&|k| warp.at(points[k]).distance(field(points[k])));
            assert!(
                after < (most + 0.01) * before,
                "{noise:?}: {after} {before}"
            );
            let off = rms(&|k| warp.at(points[k]).distance(noisy[k].1));
            assert_eq!(off < 0.01, noise == Some(0.0), "{noise:?}: {off}");
        }
    }
}
