//! Numbers in sixteen bits, two of them in a lane: their products are summed twice as fast as those of single precision, and
//! exactly. What is lost when numbers are rounded to sixteen bits is bounded.
//!
//! Of a vector a of length 1 at most and any vector d, K numbers each, let A be a times U and R be d times T = U / |d|, both
//! rounded to whole numbers, each by 1/2 at most. Then
//!
//! ```text
//! |<A, R> / (U T) - <a, d>| <= sum |A / U - a| |R / T| + sum |a| |R / T - d|
//!                           <= 2 sqrt(K) / (2 U) |d|, and a little
//! ```
//!
//! and no sum of some of the products is beyond U², and a little, by Cauchy and Schwarz: it fits 32 bits.

use super::packed_atoms::WIDTH;
use super::quantized_table::SHORT;
use pulp::Simd;
use pulp::bytemuck::{cast, cast_slice, cast_slice_mut};
use std::any::Any;
use std::slice;

/// Pairs that hold what all atoms are told by.
pub const PAIRS: usize = SHORT / 2;
/// U, less than 2^15.
const UNIT: f32 = 32_000.0;
/// Vectors that are no longer count as nothing.
const NOTHING: f32 = 1e-20;

/// A pair of numbers of each atom of a panel.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct PairRow(pub [i32; WIDTH]);

impl PairRow {
    pub const ZERO: PairRow = PairRow([0; WIDTH]);
}

/// Numbers of a vector, rounded.
#[derive(Debug, Clone, Copy)]
pub struct Rounded {
    pub pairs: [i32; PAIRS],
    /// What 1 counts in a sum of products with atoms; not 0.
    pub unit: f32,
}

/// What a product of an atom with a vector of length 1 errs at most.
pub fn rounding() -> f32 {
    // Two hundredths for what is a little: numbers round when they are scaled, and |A| and |R| are not quite U.
    1.02 * (SHORT as f32).sqrt() / UNIT
}

/// The numbers of an atom, of length 1 at most.
pub fn of_atom(numbers: &[f32]) -> [i32; PAIRS] {
    scaled(numbers, UNIT)
}

/// The numbers of a vector.
pub fn of_vector(numbers: &[f32]) -> Rounded {
    let length = numbers.iter().map(|v| v * v).sum::<f32>().sqrt();
    if length <= NOTHING {
        return Rounded {
            pairs: [0; PAIRS],
            unit: 1.0,
        };
    }
    Rounded {
        pairs: scaled(numbers, UNIT / length),
        unit: length / (UNIT * UNIT),
    }
}

fn scaled(numbers: &[f32], scale: f32) -> [i32; PAIRS] {
    let (pairs, _) = numbers.as_chunks::<2>();
    std::array::from_fn(|k| {
        // To the nearest, ties away from 0: `round` is a call where the machine is not known.
        let [low, high] = pairs[k].map(|v| (v * scale + 0.5f32.copysign(v)) as i16);
        i32::from(high) << 16 | i32::from(low) & 0xffff
    })
}

/// Adds the products of pairs, lane by lane.
#[inline(always)]
pub fn add_products<S: Simd>(simd: S, row: S::i32s, by: S::i32s, sum: S::i32s) -> S::i32s {
    // pulp has it for each machine, not for all.
    #[cfg(target_arch = "x86_64")]
    {
        let machine: &dyn Any = &simd;
        if let Some(v4) = machine.downcast_ref::<pulp::x86::V4>() {
            let products = v4.multiply_wrapping_add_adjacent_i16x32(cast(row), cast(by));
            return simd.add_i32s(cast(products), sum);
        }
        if let Some(v3) = machine.downcast_ref::<pulp::x86::V3>() {
            let products = v3.multiply_wrapping_add_adjacent_i16x16(cast(row), cast(by));
            return simd.add_i32s(cast(products), sum);
        }
    }
    let mut sum = sum;
    let sums: &mut [i32] = cast_slice_mut(slice::from_mut(&mut sum));
    let (row, by): (&[i32], &[i32]) = (lanes(&row), lanes(&by));
    for ((sum, a), b) in sums.iter_mut().zip(row).zip(by) {
        *sum += i32::from(*a as i16) * i32::from(*b as i16) + (a >> 16) * (b >> 16);
    }
    sum
}

/// Sums as numbers in single precision.
#[inline(always)]
pub fn in_single<S: Simd>(simd: S, sums: S::i32s) -> S::f32s {
    #[cfg(target_arch = "x86_64")]
    {
        let machine: &dyn Any = &simd;
        if let Some(v4) = machine.downcast_ref::<pulp::x86::V4>() {
            return cast(v4.convert_i32x16_to_f32x16(cast(sums)));
        }
        if let Some(v3) = machine.downcast_ref::<pulp::x86::V3>() {
            return cast(v3.convert_i32x8_to_f32x8(cast(sums)));
        }
    }
    let mut all = simd.splat_f32s(0.0);
    let singles: &mut [f32] = cast_slice_mut(slice::from_mut(&mut all));
    (singles.iter_mut().zip(lanes(&sums))).for_each(|(to, sum)| *to = *sum as f32);
    all
}

#[inline(always)]
fn lanes<V: pulp::bytemuck::Pod>(vector: &V) -> &[i32] {
    cast_slice(slice::from_ref(vector))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::testdata::random;
    use pulp::{Scalar, Scalar128b, Scalar256b, Scalar512b, WithSimd};

    /// Some numbers of length `length`.
    fn vector(seed: u64, length: f64) -> Vec<f32> {
        let row = random(1, SHORT, seed);
        let scale = length / row.dot(&row.t())[[0, 0]].sqrt();
        row.iter().map(|v| (v * scale) as f32).collect()
    }

    /// The product of one vector with a panel's atoms.
    struct Sum<'a>(&'a [PairRow], Rounded);

    impl WithSimd for Sum<'_> {
        type Output = Vec<f32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
            let Sum(rows, rounded) = self;
            let mut all = Vec::new();
            for at in 0..WIDTH / S::F32_LANES {
                let mut sum = simd.splat_i32s(0);
                for (row, pair) in rows.iter().zip(rounded.pairs) {
                    let row = S::as_simd_i32s(&row.0).0[at];
                    sum = add_products(simd, row, simd.splat_i32s(pair), sum);
                }
                let product = simd.mul_f32s(in_single(simd, sum), simd.splat_f32s(rounded.unit));
                all.extend_from_slice(cast_slice(slice::from_ref(&product)));
            }
            all
        }
    }

    #[test]
    fn products_err_no_more_than_they_say_and_are_the_same_on_vectors_of_any_width() {
        let mut rows = [PairRow::ZERO; PAIRS];
        // Of length 1, and nearly 0, and along one axis: the largest numbers there are.
        let mut atoms: Vec<Vec<f32>> = (0..WIDTH as u64).map(|i| vector(i, 1.0)).collect();
        atoms[1] = vector(1, 1e-3);
        atoms[2] = vec![0.0; SHORT];
        atoms[2][5] = -1.0;
        for (lane, atom) in atoms.iter().enumerate() {
            let pairs = of_atom(atom);
            (rows.iter_mut().zip(pairs)).for_each(|(row, pair)| row.0[lane] = pair);
        }
        for length in [0.0, 1e-30, 1e-12, 0.01, 1.0, 3.0] {
            let mut along = vec![0.0; SHORT];
            along[5] = length as f32;
            for vector in [vector(100, length), atoms[9].clone(), along] {
                let sum = || Sum(&rows, of_vector(&vector));
                let products = crate::numeric::simd::dispatch_widest(sum());
                let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
                let vector = wide(&vector);
                let length = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
                let off = (f64::from(rounding()) * length).max(f64::from(NOTHING));
                for (atom, product) in atoms.iter().zip(&products) {
                    let exact: f64 = wide(atom).iter().zip(&vector).map(|(a, v)| a * v).sum();
                    assert!(
                        (f64::from(*product) - exact).abs() <= off,
                        "{product} {exact}"
                    );
                }
                assert_eq!(crate::numeric::simd::dispatch8_job(sum()), products);
                assert_eq!(sum().with_simd(Scalar), products);
                assert_eq!(sum().with_simd(Scalar128b), products);
                assert_eq!(sum().with_simd(Scalar256b), products);
                assert_eq!(sum().with_simd(Scalar512b), products);
            }
        }
    }
}
