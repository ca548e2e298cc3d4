//! The similarity that carries one set of points onto another (Horn 1987, by unit quaternions).

use glam::{DMat3, DMat4, DQuat, DVec3};

/// `y = scale · rotation · x + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// A proper rotation.
    pub rotation: DMat3,
    /// Centimeters.
    pub shift: DVec3,
    /// Above zero.
    pub scale: f64,
}

impl Default for Similarity {
    fn default() -> Self {
        Similarity::IDENTITY
    }
}

impl Similarity {
    /// Moves nothing.
    pub const IDENTITY: Similarity = Similarity {
        rotation: DMat3::IDENTITY,
        shift: DVec3::ZERO,
        scale: 1.0,
    };

    /// Where `x` is carried.
    #[doc(hidden)]
    #[inline]
    pub fn apply(&self, x: DVec3) -> DVec3 {
        self.rotation * x * self.scale + self.shift
    }
    /// Where `y` came from.
    #[doc(hidden)]
    #[inline]
    pub fn undo(&self, y: DVec3) -> DVec3 {
        self.rotation.transpose() * (y - self.shift) / self.scale
    }
    /// Applies the similarity to a pose of 3 J numbers (missing values stay missing).
    ///
    /// ```
    /// use posing_core::pose::similarity::Similarity;
    ///
    /// let lift = Similarity { shift: glam::DVec3::new(0.0, 5.0, 0.0), ..Similarity::IDENTITY };
    /// let (pose, mut lifted) = ([1.0, 2.0, 3.0, f64::NAN, 0.0, 0.0], [0.0; 6]);
    /// lift.apply_pose(&pose, &mut lifted);
    /// assert_eq!(lifted[..3], [1.0, 7.0, 3.0]);
    /// assert!(lifted[3].is_nan());
    /// ```
    pub fn apply_pose(&self, from: &[f64], to: &mut [f64]) {
        for (x, y) in from.chunks_exact(3).zip(to.chunks_exact_mut(3)) {
            y.copy_from_slice(&self.apply(DVec3::from_slice(x)).to_array());
        }
    }
    /// Turns [`Similarity::apply_pose`] back.
    pub fn undo_pose(&self, from: &[f64], to: &mut [f64]) {
        for (y, x) in from.chunks_exact(3).zip(to.chunks_exact_mut(3)) {
            x.copy_from_slice(&self.undo(DVec3::from_slice(y)).to_array());
        }
    }
}

/// The parameters of a fit besides the rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransformKind {
    /// Nothing: both sets share their origin and scale.
    Rotation,
    /// The shift.
    Rigid,
    /// The shift and the scale.
    Similarity,
}

/// The fit of [`fit_similarity`].
#[derive(Debug, Clone, Copy)]
pub struct SimilarityFit {
    /// The transform of `from` onto `to`.
    pub similarity: Similarity,
    /// Sum of weighted squared distances left, cm².
    pub error: f64,
    /// Whether the points determine the rotation (they do not when they lie on a line or there are
    /// too few).
    pub determined: bool,
}

/// Minimizes `Σ wᵢ |s R fromᵢ + t − toᵢ|²` over the rotation R, and over t and s as `free` says.
///
/// Closed form: R is the eigenvector of a symmetric 4 x 4 matrix (B. K. P. Horn, JOSA A 4, 1987),
/// so a reflection is never returned. `None` when no weight is positive.
///
/// ```
/// use glam::DVec3;
/// use posing_core::pose::similarity::{TransformKind, fit_similarity};
///
/// // Each point is twice as far out, and then one up: y = 2 x + (0, 1, 0).
/// let from = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X];
/// let pairs = from.map(|x| (x, 2.0 * x + DVec3::Y, 1.0));
/// let fit = fit_similarity(pairs.into_iter(), TransformKind::Similarity).ok_or("no weight")?;
/// assert!((fit.similarity.scale - 2.0).abs() < 1e-9);
/// assert!((fit.similarity.shift - DVec3::Y).length() < 1e-9);
/// # Ok::<(), &str>(())
/// ```
pub fn fit_similarity(
    pairs: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone,
    free: TransformKind,
) -> Option<SimilarityFit> {
    let (mut weight, mut from, mut to) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for (a, b, w) in pairs.clone() {
        weight += w;
        from += a * w;
        to += b * w;
    }
    if !(weight > 0.0) {
        return None;
    }
    let (from, to) = if free == TransformKind::Rotation {
        (DVec3::ZERO, DVec3::ZERO)
    } else {
        (from / weight, to / weight)
    };
    // M = Σ w a bᵀ, and the spreads of both sets.
    let (mut m, mut spread_from, mut spread_to) = (DMat3::ZERO, 0.0, 0.0);
    for (a, b, w) in pairs {
        let (a, b) = (a - from, b - to);
        m += DMat3::from_cols(a * (b.x * w), a * (b.y * w), a * (b.z * w));
        spread_from += w * a.length_squared();
        spread_to += w * b.length_squared();
    }
    let (rotation, gain, determined) = nearest_rotation(&m);
    let scale = match free {
        TransformKind::Similarity if spread_from > 0.0 && gain > 0.0 => gain / spread_from,
        _ => 1.0,
    };
    let error = spread_to - 2.0 * scale * gain + scale * scale * spread_from;
    let shift = to - rotation * from * scale;
    let similarity = Similarity {
        rotation,
        shift,
        scale,
    };
    Some(SimilarityFit {
        similarity,
        error: error.max(0.0),
        determined,
    })
}

/// The rotation R that maximizes `trace(R M)` for `M = Σ w a bᵀ`, that maximum, and whether R is
/// unique.
#[doc(hidden)]
pub fn nearest_rotation(m: &DMat3) -> (DMat3, f64, bool) {
    // S_ab = Σ w a b in Horn's notation; glam is column-major, so col(b)[a] = S_ab.
    let s = |a: usize, b: usize| m.col(b)[a];
    let (xx, yy, zz) = (s(0, 0), s(1, 1), s(2, 2));
    let n = [
        [
            xx + yy + zz,
            s(1, 2) - s(2, 1),
            s(2, 0) - s(0, 2),
            s(0, 1) - s(1, 0),
        ],
        [
            s(1, 2) - s(2, 1),
            xx - yy - zz,
            s(0, 1) + s(1, 0),
            s(2, 0) + s(0, 2),
        ],
        [
            s(2, 0) - s(0, 2),
            s(0, 1) + s(1, 0),
            yy - xx - zz,
            s(1, 2) + s(2, 1),
        ],
        [
            s(0, 1) - s(1, 0),
            s(2, 0) + s(0, 2),
            s(1, 2) + s(2, 1),
            zz - xx - yy,
        ],
    ];
    if let Some((value, v)) = largest_eigenpair(m, n) {
        return (rotation_of(v), value, true);
    }
    let (values, vectors) = eigen_symmetric(n);
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let gap = values[order[0]] - values[order[1]];
    let size = values.iter().fold(0.0, |z: f64, v| z.max(v.abs()));
    let rotation = rotation_of(vectors[order[0]]);
    (rotation, values[order[0]], gap > 1e-9 * size)
}

/// The rotation of a quaternion, its real part first.
fn rotation_of(v: [f64; 4]) -> DMat3 {
    DMat3::from_quat(DQuat::from_xyzw(v[1], v[2], v[3], v[0]).normalize())
}

/// The largest eigenvalue of Horn's matrix `n` of `m`, and an eigenvector: by Newton's steps on the
/// characteristic polynomial from above (D. L. Theobald, Acta Crystallographica A 61, 2005), and as
/// a column of the adjugate. `None` where another eigenvalue is so near that digits would be lost.
fn largest_eigenpair(m: &DMat3, n: [[f64; 4]; 4]) -> Option<(f64, [f64; 4])> {
    // Of size 1, lest its powers leave the range of numbers.
    let size = (m.to_cols_array().iter()).fold(0.0, |most: f64, v| most.max(v.abs()));
    let (m, n) = (*m * size.recip(), n.map(|row| row.map(|v| v / size)));
    let square: f64 = m.to_cols_array().iter().map(|v| v * v).sum();
    if !square.is_finite() {
        return None;
    }
    let [c2, c1, c0] = [
        -2.0 * square,
        -8.0 * m.determinant(),
        DMat4::from_cols_array_2d(&n).determinant(),
    ];
    let slope = |x: f64| (4.0 * x * x + 2.0 * c2) * x + c1;
    // Three singular values whose squares add up to `square` add up to no more.
    let mut value = (3.0 * square).sqrt();
    for _ in 0..30 {
        let step = (((value * value + c2) * value + c1) * value + c0) / slope(value);
        value -= step;
        if !(step.abs() > 1e-15) {
            break;
        }
    }
    if !(slope(value) > 1e-2 * square.powf(1.5)) {
        return None;
    }
    let mut left = n;
    (0..4).for_each(|i| left[i][i] -= value);
    let cofactor = |i: usize, j: usize| {
        let others = |k: usize| [0, 1, 2, 3].into_iter().filter(move |o| *o != k);
        let mut minor = [[0.0; 3]; 3];
        for (row, a) in minor.iter_mut().zip(others(i)) {
            row.iter_mut()
                .zip(others(j))
                .for_each(|(v, b)| *v = left[a][b]);
        }
        let sign = if (i + j).is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * DMat3::from_cols_array_2d(&minor).determinant()
    };
    let diagonal = [0, 1, 2, 3].map(|k| cofactor(k, k).abs());
    let column = (0..4).max_by(|a, b| diagonal[*a].total_cmp(&diagonal[*b]))?;
    Some((value * size, [0, 1, 2, 3].map(|k| cofactor(k, column))))
}

/// Eigenvalues and unit eigenvectors of a small symmetric matrix, by Jacobi's rotations.
#[doc(hidden)]
pub fn eigen_symmetric<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    for (i, row) in v.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    // Six sweeps suffice at these sizes (convergence is quadratic); thirty is a bound for odd
    // input.
    for _ in 0..30 {
        let off: f64 = (0..N)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| a[i][j] * a[i][j])
            .sum();
        let diagonal: f64 = (0..N).map(|i| a[i][i] * a[i][i]).sum();
        if !(off > 1e-30 * diagonal) {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..N {
                    let (kp, kq) = (a[k][p], a[k][q]);
                    a[k][p] = c * kp - s * kq;
                    a[k][q] = s * kp + c * kq;
                }
                for k in 0..N {
                    let (pk, qk) = (a[p][k], a[q][k]);
                    a[p][k] = c * pk - s * qk;
                    a[q][k] = s * pk + c * qk;
                }
                for row in &mut v {
                    let (rp, rq) = (row[p], row[q]);
                    row[p] = c * rp - s * rq;
                    row[q] = s * rp + c * rq;
                }
            }
        }
    }
    let values = std::array::from_fn(|i| a[i][i]);
    let vectors = std::array::from_fn(|i| std::array::from_fn(|k| v[k][i]));
    (values, vectors)
}

#[cfg(test)]
mod tests {
    use super::super::rotation::{angle_between, from_rotation_vector};
    use super::*;

    fn cloud() -> Vec<DVec3> {
        (0..7)
            .map(|i| DVec3::new((i as f64).sin(), (i as f64 * 2.0).cos(), 0.3 * i as f64))
            .collect()
    }

    #[test]
    fn a_known_similarity_is_recovered() {
        for v in [
            DVec3::new(0.3, 2.0, -1.0),
            DVec3::ZERO,
            DVec3::new(0.0, std::f64::consts::PI, 0.0),
        ] {
            let want = Similarity {
                rotation: from_rotation_vector(v),
                shift: DVec3::new(3.0, -2.0, 9.0),
                scale: 1.7,
            };
            let pairs = cloud().into_iter().map(|a| (a, want.apply(a), 2.0));
            let fit = fit_similarity(pairs, TransformKind::Similarity).unwrap();
            assert!(fit.determined);
            assert!(fit.error <= 1e-12);
            assert!(angle_between(&fit.similarity.rotation, &want.rotation) <= 1e-7);
            assert!((fit.similarity.shift - want.shift).length() <= 1e-9);
            assert!((fit.similarity.scale - 1.7).abs() <= 1e-12);
            let x = DVec3::new(1.0, 2.0, 3.0);
            assert!((want.undo(want.apply(x)) - x).length() <= 1e-12);
        }
    }

    #[test]
    fn a_mirror_image_is_answered_by_a_rotation() {
        let pairs = cloud()
            .into_iter()
            .map(|a| (a, DVec3::new(-a.x, a.y, a.z), 1.0));
        let fit = fit_similarity(pairs, TransformKind::Rigid).unwrap();
        assert!((fit.similarity.rotation.determinant() - 1.0).abs() <= 1e-12);
        assert!(fit.error > 0.1);
    }

    #[test]
    fn the_nearest_rotation_is_that_of_the_eigenvectors() {
        for seed in 0..400i32 {
            let part =
                |k: usize| (((9 * seed + k as i32) as f64 * 12.9898).sin() * 43758.5453).fract();
            let mut m = DMat3::from_cols_array(&std::array::from_fn(part))
                * 10f64.powi(20 * (seed % 13) - 120);
            if seed % 3 == 0 {
                // Points in a plane, and nearly on a line.
                m *= DMat3::from_diagonal(DVec3::new(1.0, 0.1f64.powi(seed % 5), 0.0));
            }
            let (rotation, gain, determined) = nearest_rotation(&m);
            assert!((rotation * m).to_cols_array().iter().all(|v| v.is_finite()) && determined);
            let of = |r: DMat3| (r * m).x_axis.x + (r * m).y_axis.y + (r * m).z_axis.z;
            let size = gain.abs();
            assert!((of(rotation) - gain).abs() <= 1e-12 * size, "{seed}");
            // No turn gains.
            for axis in DVec3::AXES {
                for by in [1e-3, -1e-3, 0.4, 2.0, -2.0] {
                    let turned = from_rotation_vector(axis * by) * rotation;
                    assert!(of(turned) <= gain + 1e-12 * size, "{seed}");
                }
            }
        }
    }

    #[test]
    fn points_on_a_line_do_not_determine_a_rotation() {
        let line = (0..5).map(|i| (DVec3::X * i as f64, DVec3::Y * i as f64, 1.0));
        let fit = fit_similarity(line, TransformKind::Rigid).unwrap();
        assert!(!fit.determined);
        assert!(fit.error <= 1e-9);
        assert!(fit_similarity(std::iter::empty(), TransformKind::Rigid).is_none());
    }

    #[test]
    fn eigenvectors_are_right() {
        let a = [[4.0, 1.0, 0.5], [1.0, -2.0, 0.25], [0.5, 0.25, 1.0]];
        let (values, vectors) = eigen_symmetric(a);
        for (value, v) in values.iter().zip(vectors) {
            for (i, row) in a.iter().enumerate() {
                let av: f64 = row.iter().zip(v).map(|(x, y)| x * y).sum();
                assert!((av - value * v[i]).abs() <= 1e-12);
            }
        }
    }
}
