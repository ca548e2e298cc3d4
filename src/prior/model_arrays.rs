//! Checked arrays of models, and models that consist of their training poses.

use crate::io::Model;
use crate::prior::OpenOptions;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::tuning::{Grid, PriorFamily, TaskSettings, TunedPrior, Tuning, tune};
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, Axis, CowArray, Ix2};

/// An array of whole rows of `width` finite numbers, at least one row.
pub(super) fn rows<'a>(
    model: &'a Model,
    name: &str,
    width: usize,
    source: &str,
) -> Result<CowArray<'a, f32, Ix2>> {
    let array = model.array(name, source)?;
    let (n, d) = array.dim();
    let place = || Place::file(source).part(name);
    if d != width || n == 0 {
        let what = format!("has the shape ({n}, {d}), expected rows of {width}");
        return Err(Error::data(place(), what));
    }
    if array.iter().any(|v| !v.is_finite()) {
        let what = "holds a value that is not finite; train the model again";
        return Err(Error::data(place(), what));
    }
    Ok(array)
}

/// The representative poses of a model, or evenly spaced ones of `own` if it has none: (k, D), cm.
pub(super) fn typical_or(
    model: &Model,
    own: ArrayView2<'_, f32>,
    source: &str,
) -> Result<Array2<f64>> {
    if model.get("typical").is_some() {
        return Ok(rows(model, "typical", own.ncols(), source)?.mapv(f64::from));
    }
    let step = own.nrows().div_ceil(32).max(1);
    let some: Vec<usize> = (0..own.nrows()).step_by(step).collect();
    Ok(own.select(Axis(0), &some).mapv(f64::from))
}

/// Opens a model that consists of its training poses `poses` (n, D), at its tuned settings.
///
/// # Errors
/// Data: no such array, a wrong shape, numbers that are not finite.
pub(super) fn open_exemplars(
    model: &Model,
    options: &OpenOptions,
    source: &str,
    learn: impl FnOnce(ArrayView2<'_, f32>, Array2<f64>) -> PriorFamily<'static>,
) -> Result<TunedPrior> {
    let poses = rows(model, "poses", 3 * model.meta.points.len(), source)?;
    let typical = typical_or(model, poses.view(), source)?;
    let tuned = TaskSettings::read(model, source)?;
    Ok(TunedPrior::new(
        tuned,
        options.task,
        &learn(poses.view(), typical),
    ))
}

/// Makes such a model and tunes it; the caller writes the tuning into the model.
///
/// # Errors
/// Data: no poses to learn from.
pub(super) fn train_exemplars(
    kind: &str,
    poses: &TrainingSet,
    options: &TrainOptions,
    grid: &Grid,
    learn: impl Fn(ArrayView2<'_, f32>, Array2<f64>) -> PriorFamily<'static>,
    report: &mut dyn FnMut(&str),
) -> Result<(Model, Tuning)> {
    let mut model = poses.model(kind)?;
    // No headings are looked for in tuning.
    let learn = |kept: &TrainingSet| Ok(learn(kept.xyz.view(), Array2::zeros((0, 0))));
    let tuning = tune(poses, options, grid, &learn, report)?;
    let poses = poses.xyz.clone();
    model.insert("poses", poses);
    Ok((model, tuning))
}
