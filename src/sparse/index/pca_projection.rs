//! Projection on the atoms' principal directions, with the norm of the remainder.
//!
//! Poses fill few dimensions. With p(a) the first K PCA coordinates of an atom and t(a) the norm of the rest, Cauchy-Schwarz
//! bounds its product with any direction q:
//!
//! ```text
//! |<a, q>| <= |<p(a), p(q)>| + t(a) t(q)
//! ```

use crate::numeric::parallel;
use crate::numeric::simd;
use ndarray::{Array2, ArrayView2, Axis, s};
use pulp::{Simd, WithSimd};
use rand::Rng;

/// The number of coordinates in a part; bounds are tested after whole parts.
pub const PART: usize = 8;
/// The number of parts of an atom, and of a ball's center.
pub const PARTS: usize = HEAD / PART;
pub const CENTRE_PARTS: usize = CENTRE / PART;
/// The number of coordinates of an atom, and of a ball's center: more do not separate balls better, which are wider than
/// that.
pub const HEAD: usize = 32;
pub const CENTRE: usize = 16;
/// The numbers of parts after which bounds are tested.
pub const LEVELS: [usize; 3] = [CENTRE_PARTS, 3, PARTS];
/// Added to norms that serve as upper bounds: more than the rounding of numbers up to 1 to single precision.
pub const ROUNDING: f64 = 1e-6;
/// The largest number of atoms from which the basis is computed.
const SAMPLE: usize = 4_096;
/// Steps of the orthogonal iteration.
const ITERATIONS: usize = 6;

/// A vector's PCA coordinates, and upper bounds of its norm beyond each of [`LEVELS`].
#[derive(Clone, Copy)]
pub struct Projected {
    pub along: [[f32; PART]; PARTS],
    pub beyond: [f32; LEVELS.len()],
}

impl Projected {
    /// The coordinates that a ball's center has.
    pub fn centre(&self) -> &[f32] {
        &self.along.as_flattened()[..CENTRE]
    }

    /// Upper bound of the norm beyond them.
    pub fn beyond_centre(&self) -> f32 {
        self.beyond[0]
    }
}

/// A vector's PCA coordinates and squared norm, in double precision.
#[derive(Clone, Copy)]
pub struct Turned {
    along: [f64; HEAD],
    squared: f64,
}

impl Turned {
    /// The zero vector.
    pub const NONE: Turned = Turned {
        along: [0.0; HEAD],
        squared: 0.0,
    };

    /// Subtracts `times` another vector; `squared` is the squared norm of the result.
    pub fn less(&mut self, times: f64, other: &Turned, squared: f64) {
        (self.along.iter_mut().zip(&other.along)).for_each(|(a, b)| *a -= times * b);
        self.squared = squared;
    }

    /// The coordinates in single precision, and the bounds of the rest.
    pub fn head(&self) -> Projected {
        let mut left = self.squared;
        let mut beyond = [0.0; LEVELS.len()];
        let mut from = 0;
        for (beyond, to) in beyond.iter_mut().zip(LEVELS) {
            let to = to * PART;
            left -= self.along[from..to].iter().map(|a| a * a).sum::<f64>();
            // 1e-13 is more than the rounding of the difference, some D 2^-53.
            *beyond = ((left.max(0.0) + 1e-13).sqrt() * (1.0 + ROUNDING)) as f32;
            from = to;
        }
        let part = |p: usize| std::array::from_fn(|k| self.along[p * PART + k] as f32);
        Projected {
            along: std::array::from_fn(part),
            beyond,
        }
    }
}

/// Multiplies a vector by the basis.
struct Turn<'a> {
    basis: &'a [[f64; HEAD]],
    vector: &'a [f64],
    turned: &'a mut Turned,
}

impl WithSimd for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F64_LANES {
            8 => self.go::<S, 4>(simd),
            4 => self.go::<S, 8>(simd),
            2 => self.go::<S, 16>(simd),
            _ => self.go::<S, HEAD>(simd),
        }
    }
}

impl Turn<'_> {
    /// V SIMD vectors hold [`HEAD`] numbers.
    #[inline(always)]
    fn go<S: Simd, const V: usize>(self, simd: S) {
        // Two sums of each coordinate, because one would wait for its own latency.
        let mut sums = [[simd.splat_f64s(0.0); V]; 2];
        let (rows, last) = self.basis.as_chunks::<2>();
        let (values, rest) = self.vector.as_chunks::<2>();
        for (rows, values) in rows.iter().zip(values) {
            for i in 0..2 {
                add(simd, &rows[i], values[i], &mut sums[i]);
            }
        }
        for (row, value) in last.iter().zip(rest) {
            add(simd, row, *value, &mut sums[0]);
        }
        let along = S::as_mut_simd_f64s(&mut self.turned.along).0;
        for v in 0..V {
            along[v] = simd.add_f64s(sums[0][v], sums[1][v]);
        }
        let (eights, rest) = self.vector.as_chunks::<8>();
        let mut squares = [0.0; 8];
        for eight in eights {
            for l in 0..8 {
                squares[l] += eight[l] * eight[l];
            }
        }
        let rest: f64 = rest.iter().map(|v| v * v).sum();
        self.turned.squared = squares.iter().sum::<f64>() + rest;
    }
}

/// Adds a row times a value.
#[inline(always)]
fn add<S: Simd, const V: usize>(simd: S, row: &[f64; HEAD], value: f64, sums: &mut [S::f64s; V]) {
    let (row, by) = (S::as_simd_f64s(row).0, simd.splat_f64s(value));
    for v in 0..V {
        sums[v] = simd.mul_add_e_f64s(row[v], by, sums[v]);
    }
}

/// (D, [`HEAD`]): orthonormal principal directions in columns; 0 beyond the atoms' rank.
pub struct PcaProjection(Vec<[f64; HEAD]>);

impl PcaProjection {
    /// The principal directions of atoms (n, D), without centering.
    pub fn of(atoms: ArrayView2<'_, f32>) -> PcaProjection {
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

    /// The PCA coordinates of atoms (n, D).
    pub fn heads(&self, atoms: ArrayView2<'_, f32>) -> Vec<Projected> {
        parallel::map_chunks(atoms.nrows(), 1024, |rows| {
            let mut atom = vec![0.0; atoms.ncols()];
            let mut of = |i| {
                (atom.iter_mut().zip(atoms.row(i))).for_each(|(to, a)| *to = f64::from(*a));
                self.turned(&atom).head()
            };
            rows.map(&mut of).collect::<Vec<_>>()
        })
        .concat()
    }

    /// The PCA coordinates of a vector (D).
    pub fn turned(&self, vector: &[f64]) -> Turned {
        let mut turned = Turned::NONE;
        simd::dispatch_widest(Turn {
            basis: &self.0,
            vector,
            turned: &mut turned,
        });
        turned
    }
}

/// [`HEAD`] orthonormal vectors near the leading eigenvectors of a symmetric matrix, in columns; 0 beyond its rank. Their
/// accuracy affects only the speed. (LAPACK would be exact, but loading it takes 4 ms.)
fn orthogonal_iteration(matrix: &Array2<f64>) -> Vec<[f64; HEAD]> {
    let d = matrix.nrows();
    // Random, because a start along a coordinate that is 0 in all atoms, or equal to another, would be lost.
    let mut random = parallel::rng(0, 0);
    let start = |_| random.random::<f64>() - 0.5;
    let mut vectors = Array2::from_shape_fn((HEAD.min(d), d), start);
    for _ in 0..ITERATIONS {
        vectors = vectors.dot(matrix);
        orthonormalise(&mut vectors);
    }
    let mut columns = vec![[0.0; HEAD]; d];
    for (k, vector) in vectors.outer_iter().enumerate() {
        (columns.iter_mut().zip(vector)).for_each(|(column, v)| column[k] = *v);
    }
    columns
}

/// Gram-Schmidt, twice for each vector: the second pass removes the rounding errors of the first.
fn orthonormalise(vectors: &mut Array2<f64>) {
    for i in 0..vectors.nrows() {
        let (before, mut rest) = vectors.view_mut().split_at(Axis(0), i);
        let mut vector = rest.row_mut(0);
        let whole = vector.dot(&vector).sqrt();
        for other in before.outer_iter().chain(before.outer_iter()) {
            let along = other.dot(&vector);
            vector.scaled_add(-along, &other);
        }
        let left = vector.dot(&vector).sqrt();
        match left > whole * 1e-9 {
            true => vector.mapv_inplace(|v| v / left),
            false => vector.fill(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::testdata::random;

    #[test]
    fn heads_hold_all_of_few_dimensions_whatever_the_coordinates_are() {
        // Poses like those of a skeleton: three coordinates that are always 0, and others that are the same point's twice.
        let (few, mix) = (random(400, HEAD, 1), random(HEAD, 60, 2));
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
            let head = basis.turned(&atom.to_vec()).head();
            assert!(head.beyond[LEVELS.len() - 1] <= 1e-3, "{:?}", head.beyond);
        }
    }
}
