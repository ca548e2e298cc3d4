//! Products of a few poses' vectors with the PCA coordinates of eight atoms or balls. The coordinates are read once for all
//! poses, and the products are summed in registers.

use super::ball_tree::Lanes;
use super::panel_kernel::add_product;
use super::pca_projection::{PART, Projected};
use pulp::Simd;

/// The number of poses that share a read.
pub const AT_ONCE: usize = 4;

/// Products of N vectors with eight atoms or balls.
pub type Products<S, const N: usize, const V: usize> = [[<S as Simd>::f32s; V]; N];

/// A few of the poses of a search.
pub struct Few {
    /// The first `count` are valid; the others repeat the first.
    pub poses: [usize; AT_ONCE],
    pub count: usize,
}

impl Few {
    /// Removes the first few poses from `mask`; `None` if it is empty.
    #[inline(always)]
    pub fn of(mask: &mut u16) -> Option<Few> {
        let first = mask.trailing_zeros() as usize;
        let count = (mask.count_ones() as usize).min(AT_ONCE);
        // Without a branch, which could not be predicted.
        let mut poses = [first; AT_ONCE];
        for pose in &mut poses {
            *pose = match *mask {
                0 => first,
                some => some.trailing_zeros() as usize,
            };
            *mask &= mask.wrapping_sub(1);
        }
        (count > 0).then_some(Few { poses, count })
    }
}

/// The products of the vectors of `count` poses with `parts`; entries from `count` on are undefined.
#[inline(always)]
pub fn products<S: Simd, const N: usize, const V: usize>(
    simd: S,
    parts: &[[Lanes; PART]],
    heads: &[&[Projected; N]; AT_ONCE],
    count: usize,
) -> [Products<S, N, V>; AT_ONCE] {
    let mut all = [[[simd.splat_f32s(0.0); V]; N]; AT_ONCE];
    match count {
        1 => sum::<S, N, V, 1, 4>(simd, (parts, 0), heads, &mut all),
        2 => sum::<S, N, V, 2, 2>(simd, (parts, 0), heads, &mut all),
        _ => sum::<S, N, V, AT_ONCE, 1>(simd, (parts, 0), heads, &mut all),
    }
    all
}

/// The products for P poses, each as C independent sums. `parts` starts at part `from` of the coordinates.
#[inline(always)]
fn sum<S: Simd, const N: usize, const V: usize, const P: usize, const C: usize>(
    simd: S,
    (parts, from): (&[[Lanes; PART]], usize),
    heads: &[&[Projected; N]; AT_ONCE],
    all: &mut [Products<S, N, V>; AT_ONCE],
) {
    let mut sums = [[[[simd.splat_f32s(0.0); V]; N]; P]; C];
    for (p, rows) in (from..).zip(parts) {
        for first in (0..PART).step_by(C) {
            for c in 0..C {
                let row = vectors::<S>(&rows[first + c]);
                for pose in 0..P {
                    for n in 0..N {
                        let by = simd.splat_f32s(heads[pose][n].along[p][first + c]);
                        for v in 0..V {
                            let sum = &mut sums[c][pose][n][v];
                            *sum = add_product(simd, row[v], by, *sum);
                        }
                    }
                }
            }
        }
    }
    for pose in 0..P {
        for n in 0..N {
            for v in 0..V {
                let mut sum = sums[0][pose][n][v];
                for c in 1..C {
                    sum = simd.add_f32s(sum, sums[c][pose][n][v]);
                }
                all[pose][n][v] = sum;
            }
        }
    }
}

/// The products of one pose's vectors with the parts from `from` on.
#[inline(always)]
pub fn more<S: Simd, const N: usize, const V: usize>(
    simd: S,
    parts: &[[Lanes; PART]],
    heads: &[Projected; N],
    from: usize,
) -> Products<S, N, V> {
    let mut all = [[[simd.splat_f32s(0.0); V]; N]; AT_ONCE];
    sum::<S, N, V, 1, 4>(simd, (&parts[from..], from), &[heads; AT_ONCE], &mut all);
    all[0]
}

/// The SIMD vectors of a row of lanes.
#[inline(always)]
pub fn vectors<S: Simd>(lanes: &Lanes) -> &[S::f32s] {
    S::as_simd_f32s(&lanes.0).0
}

/// The SIMD vectors of a row of lanes, mutable.
#[inline(always)]
pub fn vectors_mut<S: Simd>(lanes: &mut Lanes) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(&mut lanes.0).0
}
