//! The weights of bones at a vertex.
//!
//! Given the motion (R, t) of each bone b in each sample i, the weights of a vertex x minimize
//!
//! ```text
//! Σ_i |Σ_b w_b (R_b^i x + t_b^i) - y^i|²   over w ≥ 0, Σ w = 1
//! ```
//!
//! As the weights sum to 1, the objective is wᵀ G w with G_ab = Σ_i (R_a x + t_a - y)·
//! (R_b x + t_b - y); its minimum is the minimum of ½ zᵀ G z - Σ z over z ≥ 0, divided by its sum.

use super::Sample;
use super::tree::Tree;
use crate::numeric::nnls::nonnegative_least_squares;
use crate::numeric::parallel;
use crate::template::Template;
use glam::{DAffine3, DMat3, DVec3};
use ndarray::{Array1, Array2, Axis};

/// Up to four bones that a vertex follows, with their weights: at least 0, sum 1. What is not used
/// is bone 0 with weight 0.
pub(crate) type BoneWeights = [(u16, f32); 4];

/// The bones that a vertex follows.
const MOST: usize = 4;
/// The accuracy of vertices, centimeters: where a bone fits better, others may share its weight.
const ACCURACY: f64 = 1e-3;
/// The share that is added to the squared misfit of each bone: nearly equal motions share a vertex
/// evenly.
const RIDGE: f64 = 1e-6;
/// Smaller weights are left out.
const LEAST: f64 = 1e-4;

/// Each vertex follows its own part.
pub(crate) fn rigid(template: &Template) -> Vec<BoneWeights> {
    let mut weights = vec![[(0, 0.0); MOST]; template.vertices.len()];
    for (weights, part) in weights.iter_mut().zip(&template.vertex_parts) {
        weights[0] = (*part as u16, 1.0);
    }
    weights
}

/// The blended motion of a vertex.
pub(crate) fn blend(weights: &BoneWeights, motions: &[DAffine3]) -> DAffine3 {
    let mut blended = DAffine3 {
        matrix3: DMat3::ZERO,
        translation: DVec3::ZERO,
    };
    for (bone, weight) in used(weights) {
        blended.matrix3 += motions[bone].matrix3 * weight;
        blended.translation += motions[bone].translation * weight;
    }
    blended
}

/// The bones with a weight above 0.
pub(crate) fn used(weights: &BoneWeights) -> impl Iterator<Item = (usize, f64)> + '_ {
    let used = weights.iter().filter(|(_, w)| *w > 0.0);
    used.map(|(bone, w)| (usize::from(*bone), f64::from(*w)))
}

/// Fits the weights of all vertices to the motions of the bones in the samples.
pub(crate) fn fit(
    template: &Template,
    tree: &Tree,
    samples: &[Sample<'_>],
    motions: &[Vec<DAffine3>],
) -> Vec<BoneWeights> {
    let near: Vec<Vec<usize>> = (0..tree.len()).map(|bone| tree.near(bone)).collect();
    let fitted = parallel::map_chunks(template.vertices.len(), 256, |range| {
        let one = |v: usize| {
            let part = template.vertex_parts[v];
            let x = template.vertices[v];
            let targets = samples.iter().map(|s| s.vertices[v]).zip(motions);
            vertex(x, &near[part], targets).unwrap_or_else(|| alone(part))
        };
        range.map(one).collect::<Vec<_>>()
    });
    fitted.concat()
}

fn alone(part: usize) -> BoneWeights {
    let mut weights = [(0, 0.0); MOST];
    weights[0] = (part as u16, 1.0);
    weights
}

/// The weights of one vertex over `bones`. `None` where the samples are not finite.
fn vertex<'a>(
    x: DVec3,
    bones: &[usize],
    targets: impl Iterator<Item = (DVec3, &'a Vec<DAffine3>)>,
) -> Option<BoneWeights> {
    let mut gram = Array2::zeros((bones.len(), bones.len()));
    let mut misfits = vec![DVec3::ZERO; bones.len()];
    let mut count = 0.0;
    for (y, motions) in targets {
        for (misfit, bone) in misfits.iter_mut().zip(bones) {
            *misfit = motions[*bone].transform_point3(x) - y;
        }
        for a in 0..bones.len() {
            for b in 0..bones.len() {
                gram[[a, b]] += misfits[a].dot(misfits[b]);
            }
        }
        count += 1.0;
    }
    for a in 0..bones.len() {
        gram[[a, a]] += RIDGE * gram[[a, a]] + count * ACCURACY.powi(2);
    }
    let mut chosen: Vec<(usize, f64)> = (shares(&gram)?.into_iter().enumerate())
        .filter(|(_, w)| *w >= LEAST)
        .collect();
    chosen.sort_by(|a, b| b.1.total_cmp(&a.1));
    chosen.truncate(MOST);
    let kept: Vec<usize> = chosen.iter().map(|(a, _)| *a).collect();
    let gram = gram.select(Axis(0), &kept).select(Axis(1), &kept);
    let mut weights = [(0, 0.0); MOST];
    let last = kept.iter().zip(shares(&gram)?).filter(|(_, w)| *w > 0.0);
    for (to, (a, w)) in weights.iter_mut().zip(last) {
        *to = (bones[*a] as u16, w as f32);
    }
    Some(weights)
}

/// Minimizes wᵀ G w over w ≥ 0 of sum 1.
fn shares(gram: &Array2<f64>) -> Option<Array1<f64>> {
    let size = gram.diag().mapv(f64::sqrt);
    let scaled = Array2::from_shape_fn(gram.dim(), |(a, b)| gram[[a, b]] / (size[a] * size[b]));
    let right = size.mapv(|s| 1.0 / s);
    let largest = right.iter().copied().fold(0.0, f64::max);
    let z = nonnegative_least_squares(&scaled, &(&right / largest))? / &size;
    let sum = z.sum();
    (sum > 0.0).then(|| z / sum)
}
