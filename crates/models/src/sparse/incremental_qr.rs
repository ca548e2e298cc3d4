//! One Gram-Schmidt step of an incremental QR factorization: an atom is made orthogonal to those
//! before it, and the residual to the atom.
//!
//! Sums are taken in eight lanes in a fixed order, without fused operations, so that the result has
//! the same bits for any width of the vectors. (Explicit vectors, because the compiler uses only
//! two lanes for these loops.)

use crate::numeric::simd::{LANES, dispatch_widest};
use pulp::{Simd, WithSimd};

/// An atom counts as dependent on those chosen when at most this share of its squared (weighted)
/// norm is left outside their span: an angle of 1e-5. Atoms are f32: two copies of one direction
/// differ by some 1e-7.
const DEPENDENT: f64 = 1e-10;

/// The number of columns subtracted at once: their products are independent.
const FEW: usize = 3;

/// After at most [`FEW`] columns, one pass of Gram-Schmidt is enough for an atom with a larger
/// share of its squared norm left: its products with the others are then at most 1e-13, measured.
/// Other atoms get a second pass.
const NEARLY_DEPENDENT: f64 = 1e-2;

/// The operands of a step; rows are padded to eight. Returns the product of the residual with the
/// new column, and |residual|² after it; `None`, with the residual unchanged, if the atom depends
/// on those before.
pub(crate) struct QrColumn<'a> {
    /// The columns q of the atoms before, (k, D).
    pub done: &'a [f64],
    /// The atom (D), not padded.
    pub atom: &'a [f32],
    pub root: Option<&'a [f64]>,
    /// Output: the new column q.
    pub v: &'a mut [f64],
    /// Zeros on input; then <q, a> for the columns before, and the norm of the remainder: a column
    /// of R.
    pub column: &'a mut [f64],
    pub residual: &'a mut [f64],
}

impl WithSimd for QrColumn<'_> {
    type Output = Option<(f64, f64)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        // The number of vectors that hold eight lanes.
        match S::F64_LANES {
            8 => self.make::<S, 1>(simd),
            4 => self.make::<S, 2>(simd),
            2 => self.make::<S, 4>(simd),
            _ => self.make::<S, LANES>(simd),
        }
    }
}

impl QrColumn<'_> {
    #[inline(always)]
    fn make<S: Simd, const V: usize>(self, simd: S) -> Option<(f64, f64)> {
        let QrColumn {
            done,
            atom,
            root,
            v,
            column,
            residual,
        } = self;
        let whole = match root {
            None => load::<S, V>(simd, v, atom, |a, _| f64::from(a)),
            Some(root) => load::<S, V>(simd, v, atom, |a, i| f64::from(a) * root[i]),
        };
        let (norm, before) = column.split_last_mut()?;
        let stride = v.len();
        let (mut left, mut along) = without::<S, V, 0>(simd, done, v, residual, &mut []);
        for _ in 0..2 {
            let few = done.chunks(FEW * stride).zip(before.chunks_mut(FEW));
            for (done, r) in few {
                (left, along) = match r.len() {
                    1 => without::<S, V, 1>(simd, done, v, residual, r),
                    2 => without::<S, V, 2>(simd, done, v, residual, r),
                    _ => without::<S, V, FEW>(simd, done, v, residual, r),
                };
            }
            // A second pass removes the rounding errors of the first for nearly dependent atoms.
            if before.len() <= FEW && left > NEARLY_DEPENDENT * whole {
                break;
            }
        }
        if left <= DEPENDENT * whole {
            return None;
        }
        *norm = left.sqrt();
        let z = along / *norm;
        Some((z, finish::<S, V>(simd, 1.0 / *norm, v, z, residual)))
    }
}

/// Subtracts from v its projection on K columns in `done`, and adds the products to r. Returns <v,
/// v> and <v, residual>.
#[inline(always)]
fn without<S: Simd, const V: usize, const K: usize>(
    simd: S,
    done: &[f64],
    v: &mut [f64],
    residual: &[f64],
    r: &mut [f64],
) -> (f64, f64) {
    let (v, residual) = (blocks_mut::<S, V>(v), blocks::<S, V>(residual));
    let done = blocks::<S, V>(done);
    let columns: [&[[S::f64s; V]]; K] =
        std::array::from_fn(|k| &done[k * v.len()..(k + 1) * v.len()]);
    let zeros = [simd.splat_f64s(0.0); V];
    let mut sums = [zeros; K];
    for (b, v) in v.iter().enumerate() {
        for k in 0..K {
            add_products::<S, V>(simd, &mut sums[k], &columns[k][b], v);
        }
    }
    let mut parts = [simd.splat_f64s(0.0); K];
    for k in 0..K {
        let part = total::<S, V>(simd, sums[k]);
        r[k] += part;
        parts[k] = simd.splat_f64s(part);
    }
    let (mut left, mut along) = (zeros, zeros);
    for (b, (v, residual)) in v.iter_mut().zip(residual).enumerate() {
        for k in 0..K {
            for l in 0..V {
                v[l] = simd.sub_f64s(v[l], simd.mul_f64s(parts[k], columns[k][b][l]));
            }
        }
        add_products::<S, V>(simd, &mut left, v, v);
        add_products::<S, V>(simd, &mut along, v, residual);
    }
    (total::<S, V>(simd, left), total::<S, V>(simd, along))
}

/// Scales v and subtracts z v from the residual. Returns <residual, residual>.
#[inline(always)]
fn finish<S: Simd, const V: usize>(
    simd: S,
    scale: f64,
    v: &mut [f64],
    z: f64,
    residual: &mut [f64],
) -> f64 {
    let (scale, z) = (simd.splat_f64s(scale), simd.splat_f64s(z));
    let mut sums = [simd.splat_f64s(0.0); V];
    let residual = blocks_mut::<S, V>(residual).iter_mut();
    for (v, residual) in blocks_mut::<S, V>(v).iter_mut().zip(residual) {
        for l in 0..V {
            v[l] = simd.mul_f64s(v[l], scale);
            residual[l] = simd.sub_f64s(residual[l], simd.mul_f64s(z, v[l]));
        }
        add_products::<S, V>(simd, &mut sums, residual, residual);
    }
    total::<S, V>(simd, sums)
}

/// <a, b> of padded rows.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    struct Dot<'a>(&'a [f64], &'a [f64]);
    impl WithSimd for Dot<'_> {
        type Output = f64;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f64 {
            match S::F64_LANES {
                8 => product::<S, 1>(simd, self.0, self.1),
                4 => product::<S, 2>(simd, self.0, self.1),
                2 => product::<S, 4>(simd, self.0, self.1),
                _ => product::<S, LANES>(simd, self.0, self.1),
            }
        }
    }
    dispatch_widest(Dot(a, b))
}

#[inline(always)]
fn product<S: Simd, const V: usize>(simd: S, a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [simd.splat_f64s(0.0); V];
    for (a, b) in blocks::<S, V>(a).iter().zip(blocks::<S, V>(b)) {
        add_products::<S, V>(simd, &mut sums, a, b);
    }
    total::<S, V>(simd, sums)
}

/// A row as blocks of eight numbers.
#[inline(always)]
fn blocks<S: Simd, const V: usize>(row: &[f64]) -> &[[S::f64s; V]] {
    S::as_simd_f64s(row).0.as_chunks().0
}

#[inline(always)]
fn blocks_mut<S: Simd, const V: usize>(row: &mut [f64]) -> &mut [[S::f64s; V]] {
    S::as_mut_simd_f64s(row).0.as_chunks_mut().0
}

#[inline(always)]
fn add_products<S: Simd, const V: usize>(
    simd: S,
    sums: &mut [S::f64s; V],
    a: &[S::f64s; V],
    b: &[S::f64s; V],
) {
    for l in 0..V {
        sums[l] = simd.add_f64s(sums[l], simd.mul_f64s(a[l], b[l]));
    }
}

/// Writes `of(number, index)` to v, padded with 0. Returns <v, v>.
#[inline(always)]
pub(crate) fn load<S: Simd, const V: usize>(
    simd: S,
    v: &mut [f64],
    numbers: &[f32],
    of: impl Fn(f32, usize) -> f64,
) -> f64 {
    let mut sums = [simd.splat_f64s(0.0); V];
    let mut at = 0;
    // Eight at a time, as they are read next: a wide read after narrow writes stalls.
    for v in v.as_chunks_mut::<LANES>().0 {
        let mut lanes = [0.0; LANES];
        match numbers.get(at..at + LANES) {
            Some(numbers) => {
                for l in 0..LANES {
                    lanes[l] = of(numbers[l], at + l);
                }
            }
            None => {
                for (l, number) in numbers.iter().skip(at).enumerate() {
                    lanes[l] = of(*number, at + l);
                }
            }
        }
        at += LANES;
        *v = lanes;
        let lanes = S::as_simd_f64s(&lanes).0;
        for l in 0..V {
            sums[l] = simd.add_f64s(sums[l], simd.mul_f64s(lanes[l], lanes[l]));
        }
    }
    total::<S, V>(simd, sums)
}

/// The sum of the lanes.
#[inline(always)]
fn total<S: Simd, const V: usize>(_: S, sums: [S::f64s; V]) -> f64 {
    let mut lanes = [0.0; LANES];
    S::as_mut_simd_f64s(&mut lanes).0.copy_from_slice(&sums);
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_is_orthogonal_to_those_before_and_one_that_depends_is_refused() {
        let atom =
            |k: usize| -> Vec<f32> { (0..13).map(|i| ((i * (k + 3) + k) as f32).sin()).collect() };
        let padded = |atom: Vec<f32>| -> Vec<f64> {
            let numbers = atom.into_iter().map(f64::from);
            numbers.chain(std::iter::repeat(0.0)).take(16).collect()
        };
        let mut done: Vec<f64> = Vec::new();
        let mut residual = padded(atom(9));
        // Behind more than are taken out at once too.
        for k in 0..7 {
            let (mut v, mut column) = (vec![0.0; 16], vec![0.0; k + 1]);
            let before = dot(&residual, &residual);
            let made = QrColumn {
                done: &done,
                atom: &atom(k),
                root: None,
                v: &mut v,
                column: &mut column,
                residual: &mut residual,
            };
            let (z, left) = dispatch_widest(made).unwrap();
            assert!((dot(&v, &v) - 1.0).abs() <= 1e-14);
            assert!(done.chunks(16).all(|q| dot(q, &v).abs() <= 1e-14));
            assert!(dot(&v, &residual).abs() <= 1e-14);
            assert!((before - z * z - left).abs() <= 1e-13);
            // The atom is what its column says.
            let mut again: Vec<f64> = v.iter().map(|v| column[k] * v).collect();
            for (q, r) in done.chunks(16).zip(&column) {
                again.iter_mut().zip(q).for_each(|(a, q)| *a += r * q);
            }
            assert!(
                again
                    .iter()
                    .zip(padded(atom(k)))
                    .all(|(a, b)| (a - b).abs() <= 1e-14)
            );
            done.extend(v);
        }
        // On vectors of any width the same bits.
        fn on<S: Simd>(simd: S, done: &[f64], atom: &[f32]) -> Vec<u64> {
            let (mut v, mut column) = (vec![0.0; 16], vec![0.0; done.len() / 16 + 1]);
            let mut residual: Vec<f64> = (0..16).map(|i| 1.0 / (i as f64 + 0.3)).collect();
            let made = QrColumn {
                done,
                atom,
                root: None,
                v: &mut v,
                column: &mut column,
                residual: &mut residual,
            };
            let (z, left) = made.with_simd(simd).unwrap();
            let all = [z, left].into_iter().chain(v).chain(column).chain(residual);
            all.map(f64::to_bits).collect()
        }
        for count in 0..=7 {
            let (done, next) = (&done[..16 * count], atom(10));
            let want = on(pulp::Scalar, done, &next);
            assert_eq!(on(pulp::Scalar128b, done, &next), want);
            assert_eq!(on(pulp::Scalar256b, done, &next), want);
            assert_eq!(on(pulp::Scalar512b, done, &next), want);
        }
        let both = atom(1).into_iter().zip(atom(3));
        let sum: Vec<f32> = both.map(|(a, b)| a - 2.0 * b).collect();
        let before = residual.clone();
        let made = QrColumn {
            done: &done,
            atom: &sum,
            root: None,
            v: &mut [0.0; 16],
            column: &mut [0.0; 8],
            residual: &mut residual,
        };
        assert_eq!(dispatch_widest(made), None);
        assert_eq!(residual, before);
    }
}
