//! How the evidence changes as an observation moves: what a placement is optimized by.
//!
//! With the responsibilities ρ of the clusters that explain y, S = (a C_oo + R)⁻¹ of each, and the
//! directions d_i in which y moves:
//!
//! ```text
//! ∂ log p(y) / ∂θ_i        = − Σ ρ d_iᵀ S (y − m)
//! −∂² log p(y) / ∂θ_i ∂θ_j ≈   Σ ρ d_iᵀ S d_j
//! ```
//!
//! The second line leaves out that responsibilities change: it is positive semidefinite, as Gauss
//! and Newton's is.

use super::conditioned::ConditionedPart;
use super::part_mixture::PartMixture;
use crate::numeric::simd;
use crate::prior::EvidenceGradient;

impl PartMixture {
    /// The log evidence of `y` (d) by the clusters alone, with its derivatives along `directions`
    /// (each d; all are read where observed).
    pub(crate) fn evidence_gradient(
        &self,
        conditioned: &ConditionedPart,
        y: &[f64],
        directions: &[Vec<f64>],
    ) -> EvidenceGradient {
        let candidates = self.cluster_candidates(conditioned, y);
        let n = directions.len();
        let mut out = EvidenceGradient {
            log_evidence: candidates.evidence,
            gradient: vec![0.0; n],
            curvature: vec![0.0; n * n],
        };
        if !conditioned.observes_any() || n == 0 {
            return out;
        }
        let directions: Vec<Vec<f32>> = directions.iter().map(|d| conditioned.masked(d)).collect();
        let responsibilities = candidates.responsibilities();
        let (best, order) = (&candidates.best, candidates.by_cluster());
        for of_cluster in order.chunk_by(|a, b| best[*a].cluster == best[*b].cluster) {
            let index = best[of_cluster[0]].cluster;
            let cluster = candidates.clusters[index];
            let conditioned_cluster = conditioned.cluster(self, cluster.level, cluster.index);
            let (noisy, precisions) = (&conditioned_cluster.noisy, &conditioned_cluster.precisions);
            let residual = candidates.z(index, conditioned_cluster);
            let mut projected = vec![Vec::new(); n];
            for (direction, z) in directions.iter().zip(&mut projected) {
                noisy.project(direction, z);
            }
            for i in 0..n {
                // Σ ρ S d_i along the axes.
                let mut product = vec![0.0; residual.len()];
                for &candidate in of_cluster {
                    let at = precisions.at(self.sub_mixtures[best[candidate].sub_mixture].scale);
                    let weight = responsibilities[candidate];
                    precisions.add_product(at, &projected[i], weight, &mut product);
                }
                out.gradient[i] -= f64::from(simd::dot(&product, residual));
                for (j, z) in projected.iter().enumerate() {
                    out.curvature[i * n + j] += f64::from(simd::dot(&product, z));
                }
            }
        }
        out
    }
}
