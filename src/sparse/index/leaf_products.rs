//! The products of a leaf's atoms as they are, with nothing left out and in sums that need not wait for one another: quicker than
//! a scan's, and rounded otherwise.

use super::ball_tree::Lanes;
use super::micro_gemm::{Products, vectors};
use super::panel_kernel::add_product;
use super::single_search::Sweep;
use pulp::Simd;

/// Sums side by side.
pub const CHAINS: usize = 4;

/// The products of a leaf's full atoms with the residual and the directions.
#[inline(always)]
pub fn products<S: Simd, const N: usize, const V: usize>(
    sweep: &Sweep<'_, S, N, V>,
    leaf: usize,
) -> Products<S, N, V> {
    let (simd, path) = (sweep.simd, sweep.sought.path);
    let d = path.width();
    let rows = &sweep.leaves.whole[leaf * d..][..d];
    let mut sums: [Products<S, N, V>; CHAINS] = [[[simd.splat_f32s(0.0); V]; N]; CHAINS];
    let (fours, rest) = rows.as_chunks::<CHAINS>();
    for (i, four) in fours.iter().enumerate() {
        for c in 0..CHAINS {
            add(sweep, &mut sums[c], &four[c], i * CHAINS + c);
        }
    }
    for (c, row) in rest.iter().enumerate() {
        add(sweep, &mut sums[c], row, fours.len() * CHAINS + c);
    }
    let mut all = sums[0];
    for sums in &sums[1..] {
        for n in 0..N {
            for v in 0..V {
                all[n][v] = simd.add_f32s(all[n][v], sums[n][v]);
            }
        }
    }
    // <a, r> is <a, signal> minus the parts along the directions.
    for v in 0..V {
        for n in 1..N {
            let part = simd.splat_f32s(path.parts[n - 1]);
            all[0][v] = add_product(simd, part, all[n][v], all[0][v]);
        }
    }
    all
}

/// Adds the products of row `k`.
#[inline(always)]
fn add<S: Simd, const N: usize, const V: usize>(
    sweep: &Sweep<'_, S, N, V>,
    sums: &mut Products<S, N, V>,
    row: &Lanes,
    k: usize,
) {
    let path = sweep.sought.path;
    for n in 0..N {
        let q = sweep.simd.splat_f32s(path.vectors[n * path.width() + k]);
        for v in 0..V {
            sums[n][v] = add_product(sweep.simd, vectors::<S>(row)[v], q, sums[n][v]);
        }
    }
}
