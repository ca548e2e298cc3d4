//! The model of a learned dictionary, and of several joined.

use super::residual_covariance;
use crate::Result;
use crate::io::Model;
use crate::io::model::{BodyMeta, HistoryEntry};
use crate::prior::representative_poses::TYPICAL;
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::training_set::TrainingSet;
use crate::sparse::{Dictionary, Encoder, Ksvd, Omp, TrainingState};
use ndarray::{Array1, Array2, ArrayView2, Axis};

/// How much of the poses' own covariance is added to that of their residuals.
///
/// Residuals of poses that were learned from say too little about poses that were not. Measured on
/// whole takes held out (five subjects, 2,000 atoms, 3 per pose): 0.2 lowers the error of three
/// missing joints from 2.9 to 2.5 cm and of dense noise of 5.6 cm from 3.7 to 3.2 cm. The stated
/// deviations come closer to the true ones, from 3 to 11 times too small to 1.4 to 2.6 times.
const UNSEEN: f64 = 0.2;

/// Learns a dictionary from training poses by K-SVD and makes its model. `observer` sees the state
/// after each iteration.
///
/// # Errors
/// As [`Ksvd::train_with`].
pub fn train(
    poses: &TrainingSet,
    ksvd: &Ksvd,
    observer: &mut dyn FnMut(&TrainingState) -> Result<()>,
) -> Result<Model> {
    let state = ksvd.train_with(poses.xyz.view(), observer)?;
    sparse_model(poses, &state.dictionary, &ksvd.omp())
}

/// The model of a learned dictionary: its atoms, the covariance of the residuals of its codes, and
/// what all models hold.
///
/// # Errors
/// Data: a dictionary of another width than the poses.
pub fn sparse_model(poses: &TrainingSet, dictionary: &Dictionary, omp: &Omp) -> Result<Model> {
    let mut model = poses.model("sparse")?;
    let codes = Encoder::new(dictionary, *omp)?.encode(poses.xyz.view())?;
    let residual = residual_covariance(dictionary, poses.xyz.view(), &codes)?
        + covariance(poses.xyz.view()) * UNSEEN;
    model.meta.sparsity = Some(omp.sparsity);
    model.meta.training_rms = Some(codes.mean_squared_error(poses.xyz.ncols()).sqrt());
    let rule = serde_json::to_value(omp.rule).unwrap_or_default();
    model.meta.details.insert("pursuit".into(), rule);
    model.insert("atoms", dictionary.atoms().to_owned());
    model.insert("residual", residual.mapv(|v| v as f32));
    Ok(model)
}

/// The covariance of poses (m, D), cm².
fn covariance(xyz: ArrayView2<'_, f32>) -> Array2<f64> {
    let (m, d) = xyz.dim();
    let mean: Array1<f64> = xyz.mapv(f64::from).sum_axis(Axis(0)) / m as f64;
    let mut sum = Array2::<f64>::zeros((d, d));
    for block in xyz.axis_chunks_iter(Axis(0), 4096) {
        let block = block.mapv(f64::from) - &mean;
        sum += &block.t().dot(&block);
    }
    sum / m as f64
}

/// The model of joined dictionaries: what the parts leave is pooled by their numbers of training
/// poses, their typical poses stand one after another, and so do their histories; rigid is what is
/// rigid in all. `names` are the parts'.
///
/// # Errors
/// Data: rigid pairs of a part that cannot be used.
pub fn joined_model(
    parts: &[Model],
    names: &[String],
    dictionary: &Dictionary,
    step: HistoryEntry,
) -> Result<Model> {
    let first = &parts[0];
    let mut model = Model::new("sparse", &first.meta.points, &first.meta.space);
    let frames = |m: &Model| {
        m.meta
            .details
            .get("frames")
            .and_then(serde_json::Value::as_f64)
            .unwrap_or(1.0)
    };
    let total: f64 = parts.iter().map(frames).sum();
    let pooled = |value: &dyn Fn(&Model) -> Option<f64>| -> Option<f64> {
        let sum: Option<f64> = parts.iter().map(|m| value(m).map(|v| v * frames(m))).sum();
        sum.map(|s| s / total)
    };
    model.meta.sparsity = parts.iter().filter_map(|m| m.meta.sparsity).max();
    model.meta.training_rms = pooled(&|m| m.meta.training_rms.map(|r| r * r)).map(f64::sqrt);
    let mut credits: Vec<&str> = parts
        .iter()
        .filter_map(|m| m.meta.credit.as_deref())
        .collect();
    credits.sort_unstable();
    credits.dedup();
    model.meta.credit = (!credits.is_empty()).then(|| credits.join(" "));
    model.meta.details.insert("frames".into(), total.into());
    if let Some(body) = &first.meta.body {
        let lengths = (0..body.lengths.len())
            .map(|k| {
                pooled(&|m| {
                    m.meta
                        .body
                        .as_ref()
                        .and_then(|b| b.lengths.get(k).copied().flatten())
                })
            })
            .collect();
        model.meta.body = Some(BodyMeta {
            parents: body.parents.clone(),
            lengths,
        });
    }
    model.insert("atoms", dictionary.atoms().to_owned());
    let residuals: Option<Vec<_>> = parts.iter().map(|m| m.get("residual")).collect();
    if let Some(residuals) = residuals
        && residuals.iter().all(|r| r.dim() == residuals[0].dim())
    {
        let mut sum = Array2::<f64>::zeros(residuals[0].dim());
        for (part, residual) in parts.iter().zip(residuals) {
            sum.zip_mut_with(&residual, |s, r| *s += f64::from(*r) * frames(part) / total);
        }
        model.insert("residual", sum.mapv(|v| v as f32));
    }
    let typical: Option<Vec<_>> = parts.iter().map(|m| m.get("typical")).collect();
    let typical = typical.map(|all| {
        let views: Vec<_> = all.iter().map(|t| t.view()).collect();
        ndarray::concatenate(Axis(0), &views)
    });
    if let Some(Ok(typical)) = typical {
        // Spread over all parts, no more than one model has.
        let step = typical.nrows().div_ceil(TYPICAL).max(1);
        let some: Vec<usize> = (0..typical.nrows()).step_by(step).collect();
        model.insert("typical", typical.select(Axis(0), &some));
    }
    model.meta.history = parts.iter().flat_map(|m| m.meta.history.clone()).collect();
    model.meta.history.push(step);
    let rigid = parts.iter().zip(names);
    let rigid: Vec<RigidPairs> = rigid
        .map(|(part, name)| RigidPairs::read(part, name))
        .collect::<Result<_>>()?;
    let weights: Vec<f64> = parts.iter().map(frames).collect();
    RigidPairs::joined(&rigid, &weights).write(&mut model);
    Ok(model)
}
