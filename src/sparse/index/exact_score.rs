//! Scores of a leaf's atoms, summed in the order of a dense scan, so that both find the same atom.

use super::ball_tree::{LEAF, Lanes, NO_ATOM};
use super::micro_gemm::{Products, vectors, vectors_mut};
use super::panel_kernel::{FLOOR, add_product};
use super::single_search::{Kept, Sweep};
use pulp::Simd;

/// Leaves whose scores are summed side by side: their chains of additions do not wait for each other.
const AT_ONCE: usize = 2;

/// The best of the atoms met so far.
struct Best {
    key: f32,
    atom: u32,
}

/// The best atom of the leaves that a search kept, the first of equals.
#[inline(always)]
pub fn best<S: Simd, const N: usize, const V: usize>(
    sweep: &mut Sweep<'_, S, N, V>,
) -> Option<u32> {
    let key = sweep.key;
    sweep.kept.retain(|k| k.most >= key);
    let mut best = Best {
        key: 0.0,
        atom: NO_ATOM,
    };
    for few in sweep.kept.chunks(AT_ONCE) {
        match few.len() {
            1 => meet::<S, N, V, 1>(sweep, few, &mut best),
            _ => meet::<S, N, V, AT_ONCE>(sweep, few, &mut best),
        }
    }
    (best.atom != NO_ATOM).then_some(best.atom)
}

/// The largest key of a leaf's atoms.
#[inline(always)]
pub fn key<S: Simd, const N: usize, const V: usize>(
    sweep: &Sweep<'_, S, N, V>,
    leaf: usize,
) -> f32 {
    let kept = Kept {
        leaf: leaf as u32,
        most: f32::INFINITY,
    };
    let mut best = Best {
        key: 0.0,
        atom: NO_ATOM,
    };
    meet::<S, N, V, 1>(sweep, &[kept], &mut best);
    best.key
}

/// Meets up to L leaves.
#[inline(always)]
fn meet<S: Simd, const N: usize, const V: usize, const L: usize>(
    sweep: &Sweep<'_, S, N, V>,
    few: &[Kept],
    best: &mut Best,
) {
    let (simd, path) = (sweep.simd, sweep.sought.path);
    let d = path.width();
    let whole = &sweep.leaves.whole;
    let mut leaves = [&whole[few[0].leaf as usize * d..][..d]; L];
    for l in 1..L.min(few.len()) {
        leaves[l] = &whole[few[l].leaf as usize * d..][..d];
    }
    let mut vectors_of = [&path.vectors[..d]; N];
    for n in 1..N {
        vectors_of[n] = &path.vectors[n * d..][..d];
    }
    let mut sums: [Products<S, N, V>; L] = [[[simd.splat_f32s(0.0); V]; N]; L];
    for k in 0..d {
        for n in 0..N {
            let q = simd.splat_f32s(vectors_of[n][k]);
            for l in 0..L {
                let row = vectors::<S>(&leaves[l][k]);
                for v in 0..V {
                    sums[l][n][v] = add_product(simd, row[v], q, sums[l][n][v]);
                }
            }
        }
    }
    for (kept, sums) in few.iter().zip(&sums) {
        let keys = keys(simd, sums, &path.parts, sweep.optimised);
        choose(sweep, kept.leaf as usize, &keys, best);
    }
}

/// The keys of atoms side by side, as a scan finds them: by their products with the signal, then with the directions, of which
/// the residual had −`parts`.
#[inline(always)]
pub fn keys<S: Simd, const V: usize>(
    simd: S,
    sums: &[[S::f32s; V]],
    parts: &[f32],
    is_optimised: bool,
) -> Lanes {
    let mut keys = Lanes::ZERO;
    for v in 0..V {
        let (mut c, mut e) = (sums[0][v], simd.splat_f32s(1.0));
        for (p, part) in sums[1..].iter().zip(parts) {
            c = add_product(simd, simd.splat_f32s(*part), p[v], c);
            e = add_product(simd, simd.neg_f32s(p[v]), p[v], e);
        }
        let under = match is_optimised {
            true => simd.max_f32s(e, simd.splat_f32s(FLOOR)),
            false => simd.splat_f32s(1.0),
        };
        vectors_mut::<S>(&mut keys)[v] = simd.div_f32s(simd.mul_f32s(c, c), under);
    }
    keys
}

/// Takes the best of a leaf's atoms if it is better than the best so far: the first of equals.
#[inline(always)]
fn choose<S: Simd, const N: usize, const V: usize>(
    sweep: &Sweep<'_, S, N, V>,
    leaf: usize,
    keys: &Lanes,
    best: &mut Best,
) {
    let atoms = &sweep.leaf(leaf).atoms;
    for lane in 0..LEAF {
        let (key, atom) = (keys.0[lane], atoms[lane]);
        let better = key > best.key || (key == best.key && key > 0.0 && atom < best.atom);
        if better && !sweep.sought.taken.contains(&atom) {
            *best = Best { key, atom };
        }
    }
}
