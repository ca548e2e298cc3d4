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
//! | `ways` | (F, 1) | the log weight of each way to make a body of parts |
//! | `typical` | (k, 3 J) | what headings are found with |
//! | `limit` | (1, 1) | the least log evidence of a pose like those seen, nats; missing where no take could be held back |
//!
//! Which coordinates make which part follows from the points' names; the scales are in `details`.

use super::Blocks;
use super::basis::LEAST;
use super::cells::{Cells, Stored};
use super::learn::{Settings, variance_of};
use super::leaves::Poses;
use super::limit::Limit;
use super::part::Part;
use super::parts::parts;
use crate::io::Model;
use crate::io::model::Matrix;
use crate::{Error, Place, Result};
use ndarray::{Array2, CowArray, Ix2};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Writes blocks into a model.
pub fn write(blocks: &Blocks, settings: &Settings, model: &mut Model) -> Result<()> {
    let column = |v: Vec<f32>| Array2::from_shape_vec((v.len(), 1), v).unwrap_or_default();
    model.insert_packed("poses", &blocks.poses.xyz());
    let mut labels = Array2::zeros((blocks.poses.len(), blocks.parts.len()));
    for (p, part) in blocks.parts.iter().enumerate() {
        for (row, label) in part.leaves.labels().into_iter().enumerate() {
            labels[[row, p]] = label as f32;
        }
        for (l, cells) in part.cells.iter().enumerate() {
            let (directions, deviations) = cells.parts(&part.coordinates);
            model.insert_packed(&format!("means.{p}.{l}"), &cells.wholes.mapv(|v| v as f32));
            model.insert_packed(&format!("directions.{p}.{l}"), &directions);
            model.insert(&format!("deviations.{p}.{l}"), deviations);
            let within =
                Array2::from_shape_fn((1, cells.within.len()), |(_, i)| cells.within[i] as f32);
            model.insert(&format!("within.{p}.{l}"), within);
            let shares = cells.log_shares.iter().map(|v| *v as f32).collect();
            model.insert(&format!("shares.{p}.{l}"), column(shares));
        }
    }
    model.insert_packed("labels", &labels);
    let ends = blocks.poses.takes.iter().map(|t| t.end as f32);
    model.insert("takes", column(ends.collect()));
    let levels = blocks.parts[0].levels.len();
    let weights = Array2::from_shape_fn((levels, blocks.parts.len()), |(l, p)| {
        blocks.parts[p].log_weights[l] as f32
    });
    model.insert("weights", weights);
    let ways = blocks.log_ways.iter().map(|v| *v as f32);
    model.insert("ways", column(ways.collect()));
    model.insert("typical", blocks.typical.mapv(|v| v as f32));
    if let Some(least) = blocks.limit.least {
        model.insert("limit", column(vec![least as f32]));
    }
    let settings = serde_json::to_value(settings).map_err(|e| Error::usage(e.to_string()))?;
    model.meta.details.insert("blocks".into(), settings);
    Ok(())
}

impl Blocks {
    /// From a model of kind `blocks`; `source` is for messages.
    pub fn from_model(model: &Model, source: &str) -> Result<Blocks> {
        let file = File { model, source };
        let settings = model
            .meta
            .details
            .get("blocks")
            .cloned()
            .unwrap_or_default();
        let settings: Settings = serde_json::from_value(settings)
            .map_err(|e| Error::data(Place::file(source).part("meta"), format!("blocks: {e}")))?;
        (settings.check())
            .map_err(|e| Error::data(Place::file(source).part("meta"), e.to_string()))?;
        let (coordinates, ways) = parts(&model.meta.points);
        let width = 3 * model.meta.points.len();
        let poses = file.matrix("poses", None, Some(width))?;
        let takes = file.takes(poses.nrows())?;
        let labels = file.matrix("labels", Some(poses.nrows()), Some(coordinates.len()))?;
        let count = settings.levels(settings.cells.len()).len();
        let weights = file.array("weights", Some(count), Some(coordinates.len()))?;
        let poses = Arc::new(Poses::new(poses.clone(), takes));
        let part = |(p, coordinates): (usize, Vec<usize>)| -> Result<Part> {
            let cells: Vec<Cells> = (0..settings.cells.len())
                .map(|l| file.cells(p, l, &coordinates))
                .collect::<Result<_>>()?;
            let finest = cells.last().map_or(0, Cells::len);
            // Above 0, or cut off there: rounded.
            let labels = (0..labels.nrows()).map(|row| (labels.at(row, p) + 0.5) as u32);
            let labels: Vec<u32> = labels.collect();
            if labels.iter().any(|l| *l as usize >= finest) {
                return Err(file.wrong("labels", "names a cell that is not there"));
            }
            let levels = settings.levels(cells.len());
            let mut part = Part::new(coordinates, cells, poses.clone(), &labels, levels);
            part.weigh(weights.column(p).iter().map(|w| f64::from(*w)).collect());
            Ok(part)
        };
        let made: Vec<Result<Part>> = (coordinates.into_par_iter().enumerate())
            .map(part)
            .collect();
        let made: Vec<Part> = made.into_iter().collect::<Result<_>>()?;
        let log_ways = file.array("ways", Some(ways.len()), Some(1))?;
        Ok(Blocks {
            width,
            variance: variance_of(&made[0]),
            met: super::unmet(made.len()),
            even: super::unmet(made.len()),
            parts: made,
            log_ways: log_ways.iter().map(|w| f64::from(*w)).collect(),
            ways,
            temperature: settings.temperature,
            poses,
            typical: file.array("typical", None, Some(width))?.mapv(f64::from),
            limit: file.limit()?,
        })
    }
}

struct File<'a> {
    model: &'a Model,
    source: &'a str,
}

impl File<'_> {
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
    fn limit(&self) -> Result<Limit> {
        if self.model.get("limit").is_none() {
            return Ok(Limit::default());
        }
        let least = self.array("limit", Some(1), Some(1))?[[0, 0]];
        Ok(Limit::new(Some(f64::from(least))))
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

    fn cells(&self, part: usize, level: usize, coordinates: &[usize]) -> Result<Cells> {
        let d = coordinates.len();
        let width = 3 * self.model.meta.points.len();
        let wholes = self.array(&format!("means.{part}.{level}"), None, Some(width))?;
        let wholes = wholes.mapv(f64::from);
        let k = wholes.nrows();
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
        let stored = Stored {
            directions: directions.clone(),
            deviations: deviations.clone(),
        };
        Ok(Cells::stored(wholes, shares, stored, within, coordinates))
    }
}
