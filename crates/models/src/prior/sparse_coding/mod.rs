//! A pose is a sparse code over a learned dictionary.
//!
//! After R. Y. Q. Lai, P. C. Yuen, K. K. W. Lee, J. Lai: Interactive Character Posing by Sparse
//! Coding. arXiv.
//!
//! On top of the published estimate A x, the model may carry the covariance S of the training
//! poses' residuals y − A x. Then the pose answered is A x + S_:o (S_oo + R)⁻¹ (y_o − (A x)_o):
//! what three atoms cannot say, and what neighboring coordinates imply about each other, is not
//! lost. [`OpenOptions::published`] answers A x alone, as Lai et al. do.

mod train;

use crate::io::Model;
use crate::numeric::gaussian::ConditionalGaussian;
use crate::pose::{Observation, PoseTransform};
use crate::prior::model_arrays;
use crate::prior::noise_cache::NoiseCache;
use crate::prior::{EXACT_VARIANCE, OpenOptions, Posterior, Prior, Reconstruction, Want};
use crate::sparse::{
    Dictionary, Encoder, Omp, SparseCode, SparseCodes, Tolerance, WeightedDictionary, refit,
};
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2, ArrayView1, ArrayView2};
use std::sync::Arc;

pub use train::{joined_model, sparse_model, train};

/// Residual variance of a coordinate for models that state none, cm².
const UNKNOWN_RESIDUAL: f64 = 1.0;

/// The prior: a dictionary, and the covariance of the residuals of its codes.
#[derive(Debug, Clone)]
pub struct SparseCodingPrior {
    dictionary: Dictionary,
    omp: Omp,
    published: bool,
    /// S (D, D), cm².
    residual: Array2<f64>,
    /// Its diagonal.
    variance: Vec<f64>,
    typical: Array2<f64>,
    conditionals: NoiseCache<ConditionalGaussian>,
    /// The dictionary as observations with the noise patterns met so far see it.
    weighted: NoiseCache<WeightedDictionary>,
}

/// The dictionary of a model: its `atoms` (n, D), D numbers for the model's points.
///
/// # Errors
/// Data: a model without atoms, with atoms that are none of its points, or with one that is zero or
/// not finite.
pub fn dictionary(model: &Model, source: &str) -> Result<Dictionary> {
    if model.meta.kind != "sparse" {
        let what = format!(
            "is a model of kind {}, expected a dictionary (sparse)",
            model.meta.kind
        );
        return Err(Error::data(Place::file(source), what));
    }
    let wrong = |what: String| Error::data(Place::file(source).part("atoms"), what);
    let atoms = model.array("atoms", source)?;
    let (d, points) = (atoms.ncols(), model.meta.points.len());
    if d != 3 * points {
        return Err(wrong(format!(
            "have {d} coordinates, but the model has {points} points"
        )));
    }
    Dictionary::from_rows(atoms.view()).map_err(|e| wrong(e.to_string()))
}

/// Conditioned residual covariances kept in the cache (40 kB each).
const MOST_MET: usize = 64;
/// The dictionary as one noise pattern sees it may be of so many numbers, 128 MiB, with what
/// searches add. Of larger ones the dictionary is coded with as it is.
const MOST_NUMBERS: usize = 1 << 25;
/// That many patterns are remembered as are of so many numbers together, but some in any case.
const MOST_TOGETHER: usize = 1 << 27;
const LEAST_MET: usize = 4;

impl SparseCodingPrior {
    /// Makes a prior of a model of kind `sparse`, from its arrays `atoms` (n, D), and where they
    /// are there `residual` (D, D) and `typical` (k, D).
    ///
    /// # Errors
    /// [`Error::Data`]: an array is missing, of a wrong shape or not finite. [`Error::Usage`]:
    /// options out of range.
    pub fn from_model(
        model: &Model,
        options: &OpenOptions,
        source: &str,
    ) -> Result<SparseCodingPrior> {
        let width = 3 * model.meta.points.len();
        let dictionary = dictionary(model, source)?;
        let residual = if model.get("residual").is_some() {
            let shape = (Some(width), Some(width));
            model_arrays::array(model, "residual", shape, source)?.mapv(f64::from)
        } else {
            let rms = model.meta.training_rms.filter(|r| r.is_finite());
            Array2::from_diag_elem(width, rms.map_or(UNKNOWN_RESIDUAL, |r| r * r))
        };
        let typical = match model.get("typical") {
            Some(_) => model_arrays::poses(model, "typical", source)?.mapv(f64::from),
            None => typical_of(&dictionary),
        };
        let sparsity = options.sparsity.or(model.meta.sparsity).unwrap_or(3).max(1);
        let omp = Omp {
            sparsity,
            rule: options.rule,
            tolerance: Tolerance::Never,
        };
        Ok(SparseCodingPrior::new(
            dictionary,
            omp,
            options.published,
            residual,
            typical,
        ))
    }

    fn new(
        dictionary: Dictionary,
        omp: Omp,
        published: bool,
        mut residual: Array2<f64>,
        typical: Array2<f64>,
    ) -> SparseCodingPrior {
        // It was stored in single precision: its least directions may be below nothing by as much
        // as that rounds.
        let most = residual.diag().fold(0.0, |most: f64, v| most.max(*v));
        let rounded = residual.nrows() as f64 * f64::from(f32::EPSILON) * most;
        let least = EXACT_VARIANCE.max(rounded);
        residual.diag_mut().mapv_inplace(|v| v.max(0.0) + least);
        let variance = residual.diag().to_vec();
        SparseCodingPrior {
            dictionary,
            omp,
            published,
            residual,
            variance,
            typical,
            conditionals: NoiseCache::default(),
            weighted: NoiseCache::default(),
        }
    }

    /// The residual's Gaussian conditioned on coordinates with this noise.
    fn conditional(&self, noise: &[f64]) -> Arc<ConditionalGaussian> {
        let condition = || ConditionalGaussian::new(self.residual.view(), noise);
        self.conditionals.get(noise, MOST_MET, condition)
    }

    /// The weights of an observation: 1 / (noise + what the model leaves unexplained), 0 where
    /// missing.
    fn weights(&self, noise: &[f64]) -> Array1<f64> {
        noise
            .iter()
            .zip(&self.variance)
            .map(|(n, v)| if n.is_finite() { 1.0 / (n + v) } else { 0.0 })
            .collect()
    }

    /// The dictionary as observations with this noise see it; none where it is too large.
    fn weighted(&self, noise: &[f64], weights: &Array1<f64>) -> Option<Arc<WeightedDictionary>> {
        let n = self.dictionary.len();
        let seen = weights.iter().filter(|w| **w > 0.0).count();
        // As they are and as they are scanned; beyond that leaves, or rows of a small Gram matrix.
        let numbers = n * (2 * seen + if n > 2048 { 40 + seen } else { n });
        if numbers > MOST_NUMBERS {
            return None;
        }
        let most = (MOST_TOGETHER / numbers).clamp(LEAST_MET, MOST_MET);
        Some(self.weighted.get(noise, most, || {
            WeightedDictionary::new(&self.dictionary, weights.view())
                .expect("weights are finite, not negative, and as many as an atom's numbers")
        }))
    }

    /// The reconstruction of a new code, or of the `previous` support refitted where that has the
    /// lower objective. Greedy coding can do worse than an older support.
    fn better(
        &self,
        code: Result<SparseCode>,
        previous: Option<&Reconstruction>,
        y: ArrayView1<f64>,
        weights: &Array1<f64>,
    ) -> Reconstruction {
        // Coding fails only for observed values that are not finite, which readers refuse.
        let new = code
            .map(|c| self.decode(c))
            .unwrap_or_else(|_| Reconstruction {
                pose: vec![0.0; y.len()],
                support: Vec::new(),
                objective: f64::INFINITY,
            });
        let refitted = previous
            .and_then(|p| refit(&self.dictionary, &p.support, y, Some(weights.view())).ok());
        match refitted {
            Some(kept) if kept.squared_residual < new.objective => self.decode(kept),
            _ => new,
        }
    }

    fn decode(&self, code: SparseCode) -> Reconstruction {
        Reconstruction {
            pose: code.decode(&self.dictionary).to_vec(),
            support: code.atoms,
            objective: code.squared_residual,
        }
    }

    /// How the unsure coefficients spread over the coordinates, beside the residual's own variance:
    /// B (D, k) and (A_oᵀ W A_o)⁻¹, with B = A − K A_o; the covariance is B (A_oᵀ W A_o)⁻¹ Bᵀ.
    fn coefficients(
        &self,
        weights: &Array1<f64>,
        conditional: Option<&ConditionalGaussian>,
        support: &[u32],
    ) -> (Vec<Vec<f64>>, Array2<f64>) {
        let d = self.variance.len();
        let atoms: Vec<Vec<f64>> = support
            .iter()
            .map(|&a| {
                self.dictionary
                    .atom(a as usize)
                    .iter()
                    .map(|v| f64::from(*v))
                    .collect()
            })
            .collect();
        let k = atoms.len();
        let mut normal = Array2::<f64>::zeros((k, k));
        for i in 0..k {
            for j in 0..k {
                normal[[i, j]] = (0..d).map(|c| weights[c] * atoms[i][c] * atoms[j][c]).sum();
            }
        }
        // Noise of infinite variance on the missing directions would spread without bound: people
        // are finite.
        normal.diag_mut().mapv_inplace(|v| v + 1e-4);
        let spread: Vec<Vec<f64>> = atoms
            .iter()
            .map(|a| match conditional {
                None => a.clone(),
                Some(c) => a.iter().zip(c.mean(a)).map(|(a, k)| a - k).collect(),
            })
            .collect();
        (spread, invert(normal))
    }

    /// The diagonal of B (A_oᵀ W A_o)⁻¹ Bᵀ.
    fn coefficient_variance(
        &self,
        weights: &Array1<f64>,
        conditional: Option<&ConditionalGaussian>,
        support: &[u32],
    ) -> Vec<f64> {
        let (spread, inverse) = self.coefficients(weights, conditional, support);
        let k = support.len();
        (0..self.variance.len())
            .map(|c| {
                let mut sum = 0.0;
                for i in 0..k {
                    for j in 0..k {
                        sum += spread[i][c] * inverse[[i, j]] * spread[j][c];
                    }
                }
                sum.max(0.0)
            })
            .collect()
    }
}

impl SparseCodingPrior {
    fn encode(&self, y: ArrayView1<'_, f64>, weights: &Array1<f64>) -> Result<SparseCode> {
        Encoder::new(&self.dictionary, self.omp)?.encode_one(y, Some(weights.view()))
    }
}

impl Prior for SparseCodingPrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let weights = self.weights(observation.variance);
        let y = ArrayView1::from(observation.values);
        let code = self.encode(y, &weights);
        let reconstruction = self.better(code, None, y, &weights);
        self.posterior_given(observation, &reconstruction, want)
    }

    /// The weighted dictionary of an observation's variances is kept for the next ones.
    fn reconstruct(
        &self,
        observation: &Observation<'_>,
        previous: Option<&Reconstruction>,
    ) -> Reconstruction {
        let weights = self.weights(observation.variance);
        let y = ArrayView1::from(observation.values);
        let code = match self.weighted(observation.variance, &weights) {
            Some(weighted) => weighted.code(&self.omp, &self.dictionary, y),
            None => self.encode(y, &weights),
        };
        self.better(code, previous, y, &weights)
    }

    fn posterior_given(
        &self,
        observation: &Observation<'_>,
        reconstruction: &Reconstruction,
        want: Want,
    ) -> Posterior {
        let noise = observation.variance.iter().map(|n| n.max(EXACT_VARIANCE));
        let noise: Vec<f64> = noise.collect();
        let conditional = self.conditional(&noise);
        let pose = &reconstruction.pose;
        let rest: Vec<f64> = observation
            .values
            .iter()
            .zip(pose)
            .map(|(y, p)| y - p)
            .collect();
        let mut posterior = Posterior {
            mean: pose.clone(),
            log_evidence: conditional.log_density(&rest),
            ..Posterior::default()
        };
        let conditioned = (!self.published).then_some(&*conditional);
        if let Some(conditional) = conditioned {
            let residual = conditional.mean(&rest);
            posterior
                .mean
                .iter_mut()
                .zip(residual)
                .for_each(|(m, e)| *m += e);
        }
        let weights = self.weights(&noise);
        match want {
            Want::Mean => {}
            Want::Variances => {
                let own = conditioned.map_or(&self.variance, |c| &c.variance);
                let coefficients =
                    self.coefficient_variance(&weights, conditioned, &reconstruction.support);
                posterior.variance = own.iter().zip(coefficients).map(|(v, c)| v + c).collect();
            }
            Want::Covariance => {
                let mut covariance = match conditioned {
                    Some(conditional) => conditional.covariance(self.residual.view()),
                    None => self.residual.clone(),
                };
                let (spread, inverse) =
                    self.coefficients(&weights, conditioned, &reconstruction.support);
                for (i, a) in spread.iter().enumerate() {
                    for (j, b) in spread.iter().enumerate() {
                        for (c, a) in a.iter().enumerate() {
                            let scale = inverse[[i, j]] * a;
                            let mut row = covariance.row_mut(c);
                            row.iter_mut().zip(b).for_each(|(v, b)| *v += scale * b);
                        }
                    }
                }
                return Posterior::full(posterior.mean, covariance, posterior.log_evidence);
            }
        }
        posterior
    }

    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        self.typical.view()
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        if map.is_identity() {
            return Box::new(self.clone());
        }
        let atoms = map.apply_rows(self.dictionary.atoms().mapv(f64::from).view());
        // A linear map of full rank turns no atom into nothing.
        let dictionary =
            Dictionary::from_rows(atoms.view()).unwrap_or_else(|_| self.dictionary.clone());
        let mut residual = map.apply_covariance(self.residual.view());
        residual.diag_mut().mapv_inplace(|v| v - EXACT_VARIANCE);
        let typical = map.apply_rows(self.typical.view());
        Box::new(SparseCodingPrior::new(
            dictionary,
            self.omp,
            self.published,
            residual,
            typical,
        ))
    }
}

/// The inverse of a small positive definite matrix, by Gauss and Jordan.
fn invert(mut a: Array2<f64>) -> Array2<f64> {
    let n = a.nrows();
    let mut b = Array2::eye(n);
    for i in 0..n {
        let pivot = if a[[i, i]].abs() > 1e-300 {
            a[[i, i]]
        } else {
            1e-300
        };
        for j in 0..n {
            a[[i, j]] /= pivot;
            b[[i, j]] /= pivot;
        }
        for r in (0..n).filter(|&r| r != i) {
            let factor = a[[r, i]];
            for j in 0..n {
                a[[r, j]] -= factor * a[[i, j]];
                b[[r, j]] -= factor * b[[i, j]];
            }
        }
    }
    b
}

/// Stand-ins for typical poses where a model has none: up to 24 atoms, far apart, the right way up.
///
/// Atoms are poses of length 1, perhaps turned inside out; headings are fitted with a free scale,
/// so only the sign matters. It is chosen by the mean atom, as poses share the mean body.
fn typical_of(dictionary: &Dictionary) -> Array2<f64> {
    let atoms = dictionary.atoms().mapv(f64::from);
    let leader = atoms.row(0).to_owned();
    let signed: Array2<f64> = {
        let mut a = atoms;
        for mut row in a.rows_mut() {
            if row.dot(&leader) < 0.0 {
                row.mapv_inplace(|v| -v);
            }
        }
        a
    };
    let mut chosen = vec![0];
    let mut nearest = vec![f64::INFINITY; signed.nrows()];
    while chosen.len() < signed.nrows().min(24) {
        let last = signed.row(chosen[chosen.len() - 1]);
        for (n, row) in nearest.iter_mut().zip(signed.rows()) {
            *n = n.min((&row - &last).mapv(|v| v * v).sum());
        }
        let far = (0..nearest.len()).max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]));
        match far {
            Some(i) if nearest[i] > 0.0 => chosen.push(i),
            _ => break,
        }
    }
    signed.select(ndarray::Axis(0), &chosen)
}

/// The covariance of the residuals y − A x of coded poses (m, D), uncentered, cm².
///
/// # Errors
/// Those of [`SparseCodes::decode`].
pub(crate) fn residual_covariance(
    dictionary: &Dictionary,
    poses: ArrayView2<'_, f32>,
    codes: &SparseCodes,
) -> Result<Array2<f64>> {
    let rest = &poses - &codes.decode(dictionary)?;
    let mut sum = Array2::<f64>::zeros((poses.ncols(), poses.ncols()));
    // In f64 by fixed blocks: the same sum for any number of threads.
    for block in rest.axis_chunks_iter(ndarray::Axis(0), 4096) {
        let block = block.mapv(f64::from);
        sum += &block.t().dot(&block);
    }
    Ok(sum / poses.nrows().max(1) as f64)
}
