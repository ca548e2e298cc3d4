//! The mixture in a model file.
//!
//! | array | shape | what |
//! |---|---|---|
//! | `poses` | (N, 3 J) | the training poses, take after take, cm |
//! | `takes` | (T, 1) | where each take ends |
//! | `labels` | (N, P) | the finest cluster of each pose in each part |
//! | `means.P.L` | (K, 3 J) | the mean poses of the clusters of part P at level L |
//! | `directions.P.L` | (K d, d) | eigenvectors of the covariances, d rows per cluster |
//! | `deviations.P.L` | (K, d) | the standard deviation along each, cm |
//! | `within.P.L` | (1, d) | the variance of each coordinate within the clusters, cm² |
//! | `shares.P.L` | (K, 1) | the log of their proportions of the poses |
//! | `weights` | (sub-mixtures, P) | the log weight of each sub-mixture |
//! | `ways` | (F, 1) | the log weight of each factorization into parts |
//! | `typical` | (k, 3 J) | representative poses, from which placements start |
//! | `limit` | (1, 1) | the novelty threshold, nats; missing where no take could be held out |
//! | `up` | (N, 3) | the direction up in the space of each pose; missing where unknown |
//!
//! The parts follow from the names of the points; the scales are in `details`.

use super::MultiscaleMixture;
use super::cluster_level::{ClusterLevel, StoredCovariances};
use super::eigen_covariance::MIN_VARIANCE;
use super::exemplars::ExemplarPoses;
use super::novelty::NoveltyDetector;
use super::part_mixture::PartMixture;
use super::settings::TrainSettings;
use crate::io::Model;
use crate::pose::joints;
use crate::prior::model_arrays;
use crate::{Error, Place, Result};
use ndarray::{Array2, CowArray, Ix2};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// The kind's name in files.
pub(crate) const KIND: &str = "multiscale";
/// The name before; it is still read.
const FORMER_KIND: &str = "blocks";

/// Writes a mixture into a model.
///
/// # Errors
/// [`Error::Usage`]: the settings cannot be written as JSON.
pub(crate) fn write(
    mixture: &MultiscaleMixture,
    settings: &TrainSettings,
    model: &mut Model,
) -> Result<()> {
    let column = |v: Vec<f32>| Array2::from_shape_vec((v.len(), 1), v).unwrap_or_default();
    model.insert_quantized("poses", mixture.poses.xyz());
    let mut labels = Array2::zeros((mixture.poses.xyz().nrows(), mixture.parts.len()));
    for (p, part) in mixture.parts.iter().enumerate() {
        for (row, label) in part.exemplars.labels().into_iter().enumerate() {
            labels[[row, p]] = label as f32;
        }
        for (l, clusters) in part.levels.iter().enumerate() {
            let stored = &clusters.stored;
            model.insert_quantized(
                &format!("means.{p}.{l}"),
                &clusters.full_means.mapv(|v| v as f32),
            );
            model.insert_quantized(&format!("directions.{p}.{l}"), &stored.directions);
            model.insert(&format!("deviations.{p}.{l}"), stored.deviations.clone());
            let within = Array2::from_shape_fn((1, clusters.within.len()), |(_, i)| {
                clusters.within[i] as f32
            });
            model.insert(&format!("within.{p}.{l}"), within);
            let shares = clusters.log_proportions.iter().map(|v| *v as f32).collect();
            model.insert(&format!("shares.{p}.{l}"), column(shares));
        }
    }
    model.insert_quantized("labels", &labels);
    let ends = mixture.poses.takes.iter().map(|t| t.end as f32);
    model.insert("takes", column(ends.collect()));
    let levels = mixture.parts[0].sub_mixtures.len();
    let weights = Array2::from_shape_fn((levels, mixture.parts.len()), |(l, p)| {
        mixture.parts[p].sub_mixtures[l].log_weight as f32
    });
    model.insert("weights", weights);
    let factorizations = mixture.log_factorization_weights.iter().map(|v| *v as f32);
    model.insert("ways", column(factorizations.collect()));
    model.insert("typical", mixture.representative_poses.mapv(|v| v as f32));
    if let Some(least) = mixture.novelty.threshold {
        model.insert("limit", column(vec![least as f32]));
    }
    let settings = serde_json::to_value(settings).map_err(|e| Error::usage(e.to_string()))?;
    model.meta.details.insert(KIND.into(), settings);
    Ok(())
}

impl MultiscaleMixture {
    /// Reads a model of kind `multiscale`, or `blocks` as it was called before; `source` names it
    /// in messages.
    ///
    /// # Errors
    /// Data: an array or a setting is missing, has the wrong shape, or holds a value out of range.
    pub(crate) fn from_model(model: &Model, source: &str) -> Result<MultiscaleMixture> {
        let file = ModelFile { model, source };
        let settings = model
            .meta
            .details
            .get(KIND)
            .or_else(|| model.meta.details.get(FORMER_KIND))
            .cloned()
            .unwrap_or_default();
        let settings: TrainSettings = serde_json::from_value(settings)
            .map_err(|e| Error::data(Place::file(source).part("meta"), format!("{KIND}: {e}")))?;
        (settings.check())
            .map_err(|e| Error::data(Place::file(source).part("meta"), e.to_string()))?;
        let body = joints::body_parts(&model.meta.points);
        let width = 3 * model.meta.points.len();
        let poses = file.array("poses", None, Some(width))?;
        let takes = file.takes(poses.nrows())?;
        let labels = file.array("labels", Some(poses.nrows()), Some(body.parts.len()))?;
        let count = settings.sub_mixtures(settings.clusters.len()).len();
        let weights = file.array("weights", Some(count), Some(body.parts.len()))?;
        let poses = Arc::new(ExemplarPoses::new(poses.into_owned(), takes));
        let part = |(p, coordinates): (usize, Vec<usize>)| -> Result<PartMixture> {
            let levels: Vec<ClusterLevel> = (0..settings.clusters.len())
                .map(|l| file.clusters(p, l, &coordinates))
                .collect::<Result<_>>()?;
            let finest = levels.last().map_or(0, ClusterLevel::len);
            // Above 0, or cut off there: rounded.
            let labels = labels.column(p).mapv(|label| (label + 0.5) as u32).to_vec();
            if labels.iter().any(|l| *l as usize >= finest) {
                return Err(file.wrong("labels", "names a cluster that does not exist"));
            }
            let sub_mixtures = settings.sub_mixtures(levels.len());
            let mut part =
                PartMixture::new(coordinates, levels, poses.clone(), &labels, sub_mixtures);
            part.set_log_weights(weights.column(p).iter().map(|w| f64::from(*w)));
            part.leave_out_light();
            Ok(part)
        };
        let parts: Vec<Result<PartMixture>> =
            (body.parts.into_par_iter().enumerate()).map(part).collect();
        let parts: Vec<PartMixture> = parts.into_iter().collect::<Result<_>>()?;
        let weights = file.array("ways", Some(body.factorizations.len()), Some(1))?;
        Ok(MultiscaleMixture {
            log_factorization_weights: weights.iter().map(|w| f64::from(*w)).collect(),
            factorizations: body.factorizations,
            temperature: settings.temperature,
            representative_poses: file.array("typical", None, Some(width))?.mapv(f64::from),
            novelty: file.novelty()?,
            ..MultiscaleMixture::of_parts(parts, poses)
        })
    }
}

struct ModelFile<'a> {
    model: &'a Model,
    source: &'a str,
}

impl ModelFile<'_> {
    fn wrong(&self, name: &str, what: &str) -> Error {
        Error::data(Place::file(self.source).part(name), what)
    }

    /// An array of finite numbers; `None` allows any number of rows or columns.
    fn array(
        &self,
        name: &str,
        rows: Option<usize>,
        columns: Option<usize>,
    ) -> Result<CowArray<'_, f32, Ix2>> {
        model_arrays::array(self.model, name, (rows, columns), self.source)
    }

    /// Without takes to hold out there was no threshold.
    fn novelty(&self) -> Result<NoveltyDetector> {
        if self.model.get("limit").is_none() {
            return Ok(NoveltyDetector::default());
        }
        let least = self.array("limit", Some(1), Some(1))?[[0, 0]];
        Ok(NoveltyDetector::new(Some(f64::from(least))))
    }

    fn takes(&self, frames: usize) -> Result<Vec<Range<usize>>> {
        let ends = self.array("takes", None, Some(1))?;
        let mut takes: Vec<Range<usize>> = Vec::new();
        for end in ends {
            let start = takes.last().map_or(0, |t| t.end);
            takes.push(start..end as usize);
        }
        let fits =
            takes.iter().all(|t| t.start <= t.end) && takes.last().is_some_and(|t| t.end == frames);
        fits.then_some(takes)
            .ok_or_else(|| self.wrong("takes", "does not end with the last pose"))
    }

    fn clusters(&self, part: usize, level: usize, coordinates: &[usize]) -> Result<ClusterLevel> {
        let d = coordinates.len();
        let width = 3 * self.model.meta.points.len();
        let full_means = self.array(&format!("means.{part}.{level}"), None, Some(width))?;
        let full_means = full_means.mapv(f64::from);
        let k = full_means.nrows();
        let array = |what: &str, rows, columns| {
            self.array(&format!("{what}.{part}.{level}"), Some(rows), Some(columns))
        };
        let numbers = |array: CowArray<'_, f32, Ix2>| array.iter().map(|v| f64::from(*v)).collect();
        let stored = StoredCovariances {
            directions: array("directions", k * d, d)?.into_owned(),
            deviations: array("deviations", k, d)?.into_owned(),
        };
        let within: Vec<f64> = numbers(array("within", 1, d)?);
        Ok(ClusterLevel::new(
            full_means,
            numbers(array("shares", k, 1)?),
            stored.into(),
            within.into_iter().map(|v| v.max(MIN_VARIANCE)).collect(),
            coordinates,
        ))
    }
}
