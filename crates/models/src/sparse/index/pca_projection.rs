//! Projection on the atoms' principal directions, with the norm of the remainder.
//!
//! Poses fill few dimensions. With p(a) the first K PCA coordinates of an atom and t(a) the norm of
//! the rest, Cauchy-Schwarz bounds its product with any vector v:
//!
//! ```text
//! |<a, v>| <= |<p(a), p(v)>| + t(a) t(v)
//! ```

use crate::numeric::parallel;
use crate::numeric::simd;
use ndarray::{Array2, ArrayView2, Axis, s};
use rand::Rng;

/// The number of PCA coordinates of an atom.
pub(crate) const COORDINATES: usize = 32;
/// The number of PCA coordinates of a ball's center. More do not separate balls better, which are
/// wider than that.
pub(crate) const LEADING: usize = 16;
/// Added to norms that serve as upper bounds: more than the rounding of numbers up to 1 to single
/// precision.
pub(crate) const ROUNDING: f64 = 1e-6;
/// The largest number of atoms from which the basis is computed.
const SAMPLE: usize = 4_096;
/// Steps of the orthogonal iteration.
const ITERATIONS: usize = 6;

/// The PCA coordinates of a vector, and upper bounds of its norm beyond them.
#[derive(Clone, Copy)]
pub(crate) struct Projected {
    pub coordinates: [f32; COORDINATES],
    /// Beyond the first [`LEADING`] coordinates, and beyond all of them.
    pub beyond: [f32; 2],
}

impl Projected {
    /// The first [`LEADING`] coordinates.
    pub(crate) fn leading(&self) -> &[f32; LEADING] {
        self.coordinates.first_chunk().expect("LEADING is smaller")
    }
}

/// (D, [`COORDINATES`]): orthonormal principal directions in columns; 0 beyond the atoms' rank.
pub(crate) struct PcaProjection(Vec<[f64; COORDINATES]>);

impl PcaProjection {
    /// The principal directions of atoms (n, D), without centering.
    pub(crate) fn of(atoms: ArrayView2<'_, f32>) -> PcaProjection {
        let (n, d) = atoms.dim();
        let some = atoms.slice_axis(
            Axis(0),
            ndarray::Slice::from(..).step_by(n.div_ceil(SAMPLE) as isize),
        );
        let moments = parallel::map_chunks(some.nrows(), 1024, |rows| {
            let part = some.slice(s![rows, ..]).mapv(f64::from);
            part.t().dot(&part)
        });
        let moment = moments
            .into_iter()
            .fold(Array2::zeros((d, d)), |sum, part| sum + part);
        PcaProjection(orthogonal_iteration(&moment))
    }

    /// Projects atoms (n, D).
    pub(crate) fn project_all(&self, atoms: ArrayView2<'_, f32>) -> Vec<Projected> {
        parallel::map_chunks(atoms.nrows(), 1024, |rows| {
            let mut atom = vec![0.0; atoms.ncols()];
            let mut of = |i| {
                (atom.iter_mut().zip(atoms.row(i))).for_each(|(to, a)| *to = f64::from(*a));
                self.project(&atom)
            };
            rows.map(&mut of).collect::<Vec<_>>()
        })
        .concat()
    }

    /// Projects a vector (D) of norm at most 1.
    pub(crate) fn project(&self, vector: &[f64]) -> Projected {
        simd::dispatch8(
            #[inline(always)]
            || {
                let mut along = [0.0; COORDINATES];
                for (row, value) in self.0.iter().zip(vector) {
                    for k in 0..COORDINATES {
                        along[k] += row[k] * value;
                    }
                }
                let squared: f64 = vector.iter().map(|v| v * v).sum();
                let (leading, others) = along.split_at(LEADING);
                let after_leading = squared - sum_of_squares(leading);
                Projected {
                    coordinates: along.map(|a| a as f32),
                    beyond: [after_leading, after_leading - sum_of_squares(others)].map(upper_norm),
                }
            },
        )
    }
}

#[inline(always)]
fn sum_of_squares(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}

/// Upper bound of a norm, of which the square was found as a difference: 1e-13 is more than its
/// rounding, some D 2^-53.
#[inline(always)]
fn upper_norm(squared: f64) -> f32 {
    ((squared.max(0.0) + 1e-13).sqrt() * (1.0 + ROUNDING)) as f32
}

/// [`COORDINATES`] orthonormal vectors near the leading eigenvectors of a symmetric matrix, in
/// columns; 0 beyond its rank. Their accuracy affects only the speed. (LAPACK would be exact, but
/// loading it takes 4 ms.)
fn orthogonal_iteration(matrix: &Array2<f64>) -> Vec<[f64; COORDINATES]> {
    let d = matrix.nrows();
    // Random, because a start along a coordinate that is 0 in all atoms, or equal to another, would
    // be lost.
    let mut random = parallel::rng(0, 0);
    let start = |_| random.random::<f64>() - 0.5;
    let mut vectors = Array2::from_shape_fn((COORDINATES.min(d), d), start);
    for _ in 0..ITERATIONS {
        vectors = vectors.dot(matrix);
        orthonormalize(&mut vectors);
    }
    let mut columns = vec![[0.0; COORDINATES]; d];
    for (k, vector) in vectors.outer_iter().enumerate() {
        (columns.iter_mut().zip(vector)).for_each(|(column, v)| column[k] = *v);
    }
    columns
}

/// Gram-Schmidt, twice for each vector: the second pass removes the rounding errors of the first.
fn orthonormalize(vectors: &mut Array2<f64>) {
    for i in 0..vectors.nrows() {
        let (before, mut rest) = vectors.view_mut().split_at(Axis(0), i);
        let mut vector = rest.row_mut(0);
        let whole = vector.dot(&vector).sqrt();
        for other in before.outer_iter().chain(before.outer_iter()) {
            let along = other.dot(&vector);
            vector.scaled_add(-along, &other);
        }
        let left = vector.dot(&vector).sqrt();
        if left > whole * 1e-9 {
            vector.mapv_inplace(|v| v / left)
        } else {
            vector.fill(0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::testdata::random;

    #[test]
    fn coordinates_hold_all_of_few_dimensions_whatever_the_basis_of_the_poses() {
        // Poses like those of a skeleton: three coordinates that are always 0, and others that are
        // the same point's twice.
        let (few, mix) = (random(400, COORDINATES, 1), random(COORDINATES, 60, 2));
        let mut atoms = few.dot(&mix);
        atoms.slice_mut(s![.., ..3]).fill(0.0);
        for k in 3..23 {
            let same = atoms.column(k).to_owned();
            atoms.column_mut(k + 20).assign(&same);
        }
        for mut atom in atoms.rows_mut() {
            let norm = atom.dot(&atom).sqrt();
            atom /= norm;
        }
        let basis = PcaProjection::of(atoms.mapv(|v| v as f32).view());
        for atom in atoms.rows() {
            let beyond = basis.project(&atom.to_vec()).beyond[1];
            assert!(beyond <= 1e-3, "{beyond}");
        }
    }
}
