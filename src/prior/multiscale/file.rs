//! Blocks in a model file.
//!
//! | array | shape | what |
//! |---|---|---|
//! | `poses` | (N, 3 J) | the training poses, take after take, cm |
//! | `takes` | (T, 1) | where each take ends |
//! | `labels` | (N, P) | the finest cell of each pose in each part |
//! | `means.P.L` | (K, 3 J) | the cells' mean poses of part P at level L |
//! | `directions.P.L` | (K d, d) | the directions of their covariances: d rows a cell, one a column |
//! | `deviations.P.L` | (K, d) | the standard deviation along each, cm |
//! | `within.P.L` | (1, d) | the variance of each coordinate within the cells, cm²; may be missing: it follows from the above |
//! | `shares.P.L` | (K, 1) | the log of their shares of the poses |
//! | `weights` | (levels, P) | the log weight of each level |
//! | `factorizations` | (F, 1) | the log weight of each way to make a body of parts |
//! | `typical` | (k, 3 J) | what headings are found with |
//! | `limit` | (1, 1) | the least log evidence of a pose like those seen, nats; missing where no take could be held back |
//!
//! Which coordinates make which part follows from the points' names; the scales are in `details`.

use super::MultiscaleMixture;
use super::body_parts::parts;
use super::cluster_level::{ClusterLevel, StoredCovariances};
use super::eigen_covariance::LEAST;
use super::exemplars::ExemplarPoses;
use super::novelty::NoveltyDetector;
use super::part_mixture::PartMixture;
use super::train::{TrainSettings, variance_of};
use crate::io::Model;
use crate::io::model::Matrix;
use crate::{Error, Place, Result};
use ndarray::{Array2, CowArray, Ix2};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// The kind's name in files.
const KIND: &str = "multiscale";
/// The name before; it is still read.
const FORMER_KIND: &str = "blocks";

/// Writes blocks into a model.
pub fn write(
    mixture: &MultiscaleMixture,
    settings: &TrainSettings,
    model: &mut Model,
) -> Result<()> {
    let column = |v: Vec<f32>| Array2::from_shape_vec((v.len(), 1), v).unwrap_or_default();
    model.insert_quantized("poses", &mixture.poses.xyz());
    let mut labels = Array2::zeros((mixture.poses.len(), mixture.parts.len()));
    for (p, part) in mixture.parts.iter().enumerate() {
        for (row, label) in part.exemplars.labels().into_iter().enumerate() {
            labels[[row, p]] = label as f32;
        }
        for (l, clusters) in part.cluster_levels.iter().enumerate() {
            let (directions, deviations) = clusters.parts(&part.coordinates);
            model.insert_quantized(
                &format!("means.{p}.{l}"),
                &clusters.full_means.mapv(|v| v as f32),
            );
            model.insert_quantized(&format!("directions.{p}.{l}"), &directions);
            model.insert(&format!("deviations.{p}.{l}"), deviations);
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
    let levels = mixture.parts[0].levels.len();
    let weights = Array2::from_shape_fn((levels, mixture.parts.len()), |(l, p)| {
        mixture.parts[p].log_weights[l] as f32
    });
    model.insert("weights", weights);
    let factorizations = mixture.log_factorization_weights.iter().map(|v| *v as f32);
    model.insert("ways", column(factorizations.collect()));
    model.insert("typical", mixture.typical.mapv(|v| v as f32));
    if let Some(least) = mixture.limit.threshold {
        model.insert("limit", column(vec![least as f32]));
    }
    let settings = serde_json::to_value(settings).map_err(|e| Error::usage(e.to_string()))?;
    model.meta.details.insert(KIND.into(), settings);
    Ok(())
}

impl MultiscaleMixture {
    /// From a model of kind `blocks`; `source` is for messages.
    pub fn from_model(model: &Model, source: &str) -> Result<MultiscaleMixture> {
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
        let (coordinates, factorizations) = parts(&model.meta.points);
        let width = 3 * model.meta.points.len();
        let poses = file.matrix("poses", None, Some(width))?;
        let takes = file.takes(poses.nrows())?;
        let labels = file.matrix("labels", Some(poses.nrows()), Some(coordinates.len()))?;
        let count = settings.levels(settings.clusters.len()).len();
        let weights = file.array("weights", Some(count), Some(coordinates.len()))?;
        let poses = Arc::new(ExemplarPoses::new(poses.clone(), takes));
        let part = |(p, coordinates): (usize, Vec<usize>)| -> Result<PartMixture> {
            let clusters: Vec<ClusterLevel> = (0..settings.clusters.len())
                .map(|l| file.clusters(p, l, &coordinates))
                .collect::<Result<_>>()?;
            let finest = clusters.last().map_or(0, ClusterLevel::len);
            // Above 0, or cut off there: rounded.
            let labels = (0..labels.nrows()).map(|row| (labels.at(row, p) + 0.5) as u32);
            let labels: Vec<u32> = labels.collect();
            if labels.iter().any(|l| *l as usize >= finest) {
                return Err(file.wrong("labels", "names a cluster that does not exist"));
            }
            let levels = settings.levels(clusters.len());
            let mut part = PartMixture::new(coordinates, clusters, poses.clone(), &labels, levels);
            part.set_log_weights(weights.column(p).iter().map(|w| f64::from(*w)).collect());
            Ok(part)
        };
        let made: Vec<Result<PartMixture>> = (coordinates.into_par_iter().enumerate())
            .map(part)
            .collect();
        let made: Vec<PartMixture> = made.into_iter().collect::<Result<_>>()?;
        let log_factorization_weights = file.array("ways", Some(factorizations.len()), Some(1))?;
        Ok(MultiscaleMixture {
            width,
            variance: variance_of(&made[0]),
            conditioned_cache: super::empty_caches(made.len()),
            isotropic: super::empty_caches(made.len()),
            parts: made,
            log_factorization_weights: log_factorization_weights
                .iter()
                .map(|w| f64::from(*w))
                .collect(),
            factorizations,
            temperature: settings.temperature,
            poses,
            typical: file.array("typical", None, Some(width))?.mapv(f64::from),
            limit: file.limit()?,
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

    /// An array of finite numbers, with so many rows and columns, as it is kept.
    fn matrix(&self, name: &str, rows: Option<usize>, columns: Option<usize>) -> Result<&Matrix> {
        let array = self.model.matrix(name, self.source)?;
        let (n, d) = array.dim();
        if n == 0 || rows.is_some_and(|r| r != n) || columns.is_some_and(|c| c != d) {
            let shown = |v: Option<usize>| v.map_or("some".into(), |v| v.to_string());
            let what = format!(
                "has the shape ({n}, {d}), expected ({}, {})",
                shown(rows),
                shown(columns)
            );
            return Err(self.wrong(name, &what));
        }
        if !array.is_finite() {
            return Err(self.wrong(name, "holds a value that is not finite"));
        }
        Ok(array)
    }

    /// The same as single precision.
    fn array(
        &self,
        name: &str,
        rows: Option<usize>,
        columns: Option<usize>,
    ) -> Result<CowArray<'_, f32, Ix2>> {
        Ok(self.matrix(name, rows, columns)?.floats())
    }

    /// Models of before there were limits have none.
    fn limit(&self) -> Result<NoveltyDetector> {
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
        let directions =
            self.matrix(&format!("directions.{part}.{level}"), Some(k * d), Some(d))?;
        let deviations = self.matrix(&format!("deviations.{part}.{level}"), Some(k), Some(d))?;
        let shares = self.array(&format!("shares.{part}.{level}"), Some(k), Some(1))?;
        let shares = shares.iter().map(|v| f64::from(*v)).collect();
        let name = format!("within.{part}.{level}");
        let within = match self.model.get(&name) {
            Some(_) => Some(self.array(&name, Some(1), Some(d))?),
            None => None,
        };
        let within = within.map(|w| w.iter().map(|v| f64::from(*v).max(LEAST)).collect());
        let stored = StoredCovariances {
            directions: directions.clone(),
            deviations: deviations.clone(),
        };
        Ok(ClusterLevel::stored(
            full_means,
            shares,
            stored,
            within,
            coordinates,
        ))
    }
}
