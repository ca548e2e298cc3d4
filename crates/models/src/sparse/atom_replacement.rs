//! Replaces useless atoms by poses.

use super::atom_update::AtomUsage;
use super::rank_one_svd::dot;
use super::{Dictionary, coherence};
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::cmp::Reverse;

/// Puts the poses coded worst (each once) in the place of atoms that are not used, and of those
/// closer than `coherence` to a better used one. Gives the number of each.
pub(super) fn replace(
    dictionary: &mut Dictionary,
    support: &Array2<u32>,
    uses: &AtomUsage,
    poses: ArrayView2<f32>,
    residual: &[f32],
    coherence: Option<f64>,
) -> (usize, usize) {
    let n = dictionary.len();
    let (mut used, unused): (Vec<usize>, Vec<usize>) =
        (0..n).partition(|&j| !uses.of_atom(j).is_empty());
    let mut coherent = Vec::new();
    if let Some(limit) = coherence {
        used.sort_by_key(|&j| (Reverse(uses.of_atom(j).len()), j));
        let kept = coherence::spread(dictionary.atoms(), &used, limit);
        coherent = used.into_iter().filter(|&j| !kept[j]).collect();
    }
    if unused.is_empty() && coherent.is_empty() {
        return (0, 0);
    }
    let mut worst = worst_coded(support, n, poses, residual).into_iter();
    let mut fill = |atoms: &[usize]| {
        let pairs = atoms.iter().zip(&mut worst);
        pairs
            .map(|(&j, i)| set_atom(dictionary, j, poses.row(i)))
            .count()
    };
    (fill(&unused), fill(&coherent))
}

/// Poses from the one coded worst to the one coded best; those that are zero are left out.
///
/// Neighbors in time are nearly equal, and coded equally badly: of the poses whose first atom is
/// the same, one goes first, then one more of each, and so on, so that the atoms they make are not
/// copies of each other.
fn worst_coded(
    support: &Array2<u32>,
    n: usize,
    poses: ArrayView2<f32>,
    residual: &[f32],
) -> Vec<usize> {
    let d = poses.ncols();
    let errors: Vec<f32> = residual.chunks_exact(d).map(|r| dot(r, r)).collect();
    let mut order: Vec<usize> = (0..errors.len()).filter(|&i| errors[i] > 0.0).collect();
    order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
    let mut turns = vec![0u32; n + 1];
    let mut keyed: Vec<(u32, usize)> = order
        .into_iter()
        .map(|i| {
            let first = support[[i, 0]] as usize;
            let turn = &mut turns[first.min(n)];
            *turn += 1;
            (*turn, i)
        })
        .collect();
    keyed.sort_by_key(|&(turn, _)| turn);
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Makes a pose atom `j`.
fn set_atom(dictionary: &mut Dictionary, j: usize, pose: ArrayView1<f32>) {
    if let Ok(scale) = super::dictionary::unit_scale(pose) {
        let atom = dictionary.atom_mut(j);
        atom.iter_mut()
            .zip(pose)
            .for_each(|(a, &p)| *a = (f64::from(p) * scale) as f32);
    }
}
