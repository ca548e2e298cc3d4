//! Poses made ready for learning, and the model that comes of it.

use super::pairs::RigidPairs;
use super::sparse::residual_covariance;
use crate::cluster;
use crate::io::Model;
use crate::io::model::{BodyMeta, Entry, MOST_POINTS};
use crate::pose::{Anchor, Body, PoseMap, Poses, joints};
use crate::sparse::{Dictionary, Pursuit};
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2, ArrayView2, Axis};
use sha2::{Digest, Sha256};
use std::ops::Range;

/// How many typical poses a model keeps to find headings with.
const TYPICAL: usize = 32;
/// How many poses they are chosen from at most.
const TYPICAL_FROM: usize = 20_000;

/// How much of the poses' own covariance is added to that of their residuals.
///
/// Residuals of poses that were learnt from say too little about poses that were not. Measured on whole takes held out
/// (five subjects, 2,000 atoms, 3 a pose): 0.2 lowers the error of three missing joints from 2.9 to 2.5 cm and of dense
/// noise of 5.6 cm from 3.7 to 3.2 cm. The stated deviations come closer to the true ones, from 3 to 11 times too small
/// to 1.4 to 2.6 times.
const UNSEEN: f64 = 0.2;

/// Poses ready for learning.
#[derive(Debug, Clone)]
pub struct TrainingPoses {
    /// The points' names.
    pub points: Vec<String>,
    /// (m, 3 J), cm, in the model's space.
    pub xyz: Array2<f32>,
    /// The rows of each take, in time order.
    pub takes: Vec<Range<usize>>,
    /// The bones they all have (world) or mostly have (body), where the points' bones are known.
    pub body: Option<Body>,
    /// What they were placed by, in world space.
    pub anchor: Option<Anchor>,
    /// Frames left out: some point was missing.
    pub incomplete: usize,
    /// Frames left out: their placement is not determined.
    pub unplaced: usize,
}

impl TrainingPoses {
    /// What a model's history keeps of its inputs: the digest of all poses and, where there are several, of each take, so
    /// that a model is never tested on a take it was trained from.
    pub fn digests(&self) -> Vec<String> {
        let mut all = vec![digest(&self.points, self.xyz.view())];
        if self.takes.len() > 1 {
            let take =
                |r: &Range<usize>| digest(&self.points, self.xyz.slice(ndarray::s![r.clone(), ..]));
            all.extend(self.takes.iter().map(take));
        }
        all
    }
}

/// Carries complete poses to the model's space: root at the origin, no global rotation and, in world space, the mean
/// body's bone lengths. With `world` false rows are used as they are. With `like`, they become comparable to those poses:
/// the same points in the same order, the same body, the same placement.
pub fn ready(
    poses: &Poses,
    world: bool,
    like: Option<&TrainingPoses>,
    name: &str,
) -> Result<TrainingPoses> {
    let points = poses.points.len();
    if points > MOST_POINTS {
        let what =
            format!("has {points} points, a model has at most {MOST_POINTS}; pick those of a body");
        return Err(Error::data(Place::file(name), what));
    }
    let ordered;
    let poses = match like {
        Some(like) if like.points != poses.points => {
            ordered = in_order(poses, &like.points, name)?;
            &ordered
        }
        _ => poses,
    };
    let parents = joints::parents_by_name(&poses.points);
    let bones = parents.iter().any(Option::is_some);
    let takes = poses.takes();
    let bodies: Vec<Body> = takes
        .iter()
        .map(|r| Body::measure(&parents, poses.xyz.slice(ndarray::s![r.clone(), ..])))
        .collect();
    let (body, anchor) = match like {
        Some(like) => (like.body.clone(), like.anchor.clone()),
        None => (
            bones.then(|| mean_body(&parents, &bodies)),
            world.then(|| anchor(poses)),
        ),
    };
    let mut out = TrainingPoses {
        points: poses.points.clone(),
        xyz: Array2::zeros((0, 0)),
        takes: Vec::new(),
        body,
        anchor: anchor.clone(),
        incomplete: 0,
        unplaced: 0,
    };
    let mut rows: Vec<f32> = Vec::new();
    let width = poses.xyz.ncols();
    let (mut pose, mut placed) = (vec![0.0; width], vec![0.0; width]);
    for (take, measured) in takes.iter().zip(&bodies) {
        let map = match (&anchor, &out.body) {
            (Some(_), Some(common)) => Some(PoseMap::reshape(measured, common)),
            _ => None,
        };
        let first = rows.len() / width.max(1);
        for t in take.clone() {
            pose.iter_mut()
                .zip(poses.xyz.row(t))
                .for_each(|(p, v)| *p = *v);
            if pose.iter().any(|v| !v.is_finite()) {
                out.incomplete += 1;
                continue;
            }
            if let Some(anchor) = &anchor {
                let Some(placement) = anchor.place(&pose) else {
                    out.unplaced += 1;
                    continue;
                };
                placement.undo_pose(&pose, &mut placed);
                match &map {
                    Some(map) => map.apply(&placed, &mut pose),
                    None => pose.copy_from_slice(&placed),
                }
            }
            rows.extend(pose.iter().map(|v| *v as f32));
        }
        let end = rows.len() / width.max(1);
        if end > first {
            out.takes.push(first..end);
        }
    }
    let frames = rows.len() / width.max(1);
    if frames == 0 {
        return Err(Error::data(
            Place::file(name),
            "holds no complete pose to learn from",
        ));
    }
    out.xyz =
        Array2::from_shape_vec((frames, width), rows).map_err(|e| Error::usage(e.to_string()))?;
    Ok(out)
}

/// The poses with their points in another order; every point must be there.
fn in_order(poses: &Poses, points: &[String], name: &str) -> Result<Poses> {
    let mut columns = Vec::new();
    for point in points {
        let Some(p) = poses.points.iter().position(|n| n == point) else {
            let what = format!("has no point \"{point}\", which the training poses have");
            return Err(Error::data(Place::file(name), what));
        };
        columns.extend(3 * p..3 * p + 3);
    }
    let xyz = poses.xyz.select(Axis(1), &columns);
    Ok(Poses {
        points: points.to_vec(),
        xyz,
        time: poses.time.clone(),
        take: poses.take.clone(),
    })
}

/// What poses are placed by: CMU's pelvis, or their own mean, found by aligning them to each other.
fn anchor(poses: &Poses) -> Anchor {
    if let Some(pelvis) = Anchor::pelvis(&poses.points) {
        return pelvis;
    }
    let complete: Vec<Vec<f64>> = poses
        .xyz
        .rows()
        .into_iter()
        .filter(|r| r.iter().all(|v| v.is_finite()))
        .step_by((poses.frames() / 500).max(1))
        .map(|r| r.to_vec())
        .collect();
    let Some(mut mean) = complete.first().map(|p| centred(p)) else {
        return Anchor::mean(&[]);
    };
    // Generalised Procrustes analysis: three rounds settle it to far below the noise of a capture.
    for _ in 0..3 {
        let anchor = Anchor::mean(&mean);
        let mut sum = vec![0.0; mean.len()];
        let mut placed = mean.clone();
        for pose in &complete {
            if let Some(placement) = anchor.place(pose) {
                placement.undo_pose(pose, &mut placed);
                sum.iter_mut().zip(&placed).for_each(|(s, p)| *s += p);
            }
        }
        mean = centred(
            &sum.iter()
                .map(|s| s / complete.len() as f64)
                .collect::<Vec<_>>(),
        );
    }
    Anchor::mean(&mean)
}

/// The pose about its own centre.
fn centred(pose: &[f64]) -> Vec<f64> {
    let count = (pose.len() / 3).max(1) as f64;
    let centre: Vec<f64> = (0..3)
        .map(|a| pose.iter().skip(a).step_by(3).sum::<f64>() / count)
        .collect();
    pose.iter()
        .enumerate()
        .map(|(i, v)| v - centre[i % 3])
        .collect()
}

fn mean_body(parents: &[Option<usize>], bodies: &[Body]) -> Body {
    let lengths = (0..parents.len())
        .map(|k| {
            let seen: Vec<f64> = bodies
                .iter()
                .map(|b| b.lengths[k])
                .filter(|l| l.is_finite())
                .collect();
            seen.iter().sum::<f64>() / seen.len() as f64
        })
        .collect();
    Body {
        parents: parents.to_vec(),
        lengths,
    }
}

/// Makes the model of a learnt dictionary: its atoms, what its codes leave, and a few typical poses.
pub fn sparse_model(
    poses: &TrainingPoses,
    dictionary: &Dictionary,
    pursuit: &Pursuit,
    world: bool,
) -> Result<Model> {
    let mut model = Model::new(
        "sparse",
        &poses.points,
        if world { "world" } else { "body" },
    );
    let codes = pursuit.code_batch(dictionary, poses.xyz.view(), None)?;
    let residual = residual_covariance(dictionary, poses.xyz.view(), &codes)?
        + covariance(poses.xyz.view()) * UNSEEN;
    model.meta.body = poses.body.as_ref().map(BodyMeta::from);
    model.meta.sparsity = Some(pursuit.sparsity);
    model.meta.training_rms = Some(codes.mean_squared_error(poses.xyz.ncols()).sqrt());
    model
        .meta
        .details
        .insert("frames".into(), poses.xyz.nrows().into());
    model.meta.details.insert(
        "pursuit".into(),
        serde_json::to_value(pursuit.rule).unwrap_or_default(),
    );
    model
        .arrays
        .insert("atoms".into(), dictionary.atoms().to_owned());
    model
        .arrays
        .insert("residual".into(), residual.mapv(|v| v as f32));
    model
        .arrays
        .insert("typical".into(), typical(poses.xyz.view())?);
    RigidPairs::learn(poses.xyz.view(), &poses.takes).write(&mut model);
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

/// The model of joined dictionaries: what the parts leave is pooled by their numbers of training poses, their typical
/// poses stand one after another, and so do their histories.
pub fn joined_model(parts: &[Model], dictionary: &Dictionary, step: Entry) -> Model {
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
    model
        .arrays
        .insert("atoms".into(), dictionary.atoms().to_owned());
    let residuals: Option<Vec<_>> = parts.iter().map(|m| m.arrays.get("residual")).collect();
    if let Some(residuals) = residuals
        && residuals.iter().all(|r| r.dim() == residuals[0].dim())
    {
        let mut sum = Array2::<f64>::zeros(residuals[0].dim());
        for (part, residual) in parts.iter().zip(residuals) {
            sum.zip_mut_with(residual, |s, r| *s += f64::from(*r) * frames(part) / total);
        }
        model
            .arrays
            .insert("residual".into(), sum.mapv(|v| v as f32));
    }
    let typical: Option<Vec<_>> = parts
        .iter()
        .map(|m| m.arrays.get("typical").map(|t| t.view()))
        .collect();
    if let Some(Ok(typical)) = typical.map(|t| ndarray::concatenate(Axis(0), &t)) {
        // Spread over all parts, no more than one model has.
        let step = typical.nrows().div_ceil(TYPICAL).max(1);
        let some: Vec<usize> = (0..typical.nrows()).step_by(step).collect();
        model
            .arrays
            .insert("typical".into(), typical.select(Axis(0), &some));
    }
    model.meta.history = parts.iter().flat_map(|m| m.meta.history.clone()).collect();
    model.meta.history.push(step);
    model
}

/// Poses nearest to the centres of a few clusters.
pub(super) fn typical(xyz: ArrayView2<'_, f32>) -> Result<Array2<f32>> {
    let step = xyz.nrows().div_ceil(TYPICAL_FROM).max(1);
    let some: Vec<usize> = (0..xyz.nrows()).step_by(step).collect();
    let poses = xyz.select(Axis(0), &some);
    let parameters = cluster::Parameters {
        k: TYPICAL.min(poses.nrows()),
        max_iterations: 20,
        ..Default::default()
    };
    let clustering = match cluster::fit(poses.view(), &parameters, &mut |_| {}) {
        Ok(c) => c,
        // Fewer different poses than clusters: the poses themselves.
        Err(_) => {
            return Ok(poses
                .slice(ndarray::s![..poses.nrows().min(TYPICAL), ..])
                .to_owned());
        }
    };
    let mut best = vec![(f64::INFINITY, 0); clustering.centroids.nrows()];
    for (i, (row, &label)) in poses.rows().into_iter().zip(&clustering.labels).enumerate() {
        let centre = clustering.centroids.row(label as usize);
        let d: f64 = row
            .iter()
            .zip(centre)
            .map(|(a, b)| (f64::from(*a) - b).powi(2))
            .sum();
        let slot = &mut best[label as usize];
        if d < slot.0 {
            *slot = (d, i);
        }
    }
    let chosen: Vec<usize> = best
        .iter()
        .filter(|b| b.0.is_finite())
        .map(|b| b.1)
        .collect();
    Ok(poses.select(Axis(0), &chosen))
}

/// The digest of poses that a model's history keeps: names and numbers, not files.
pub fn digest(points: &[String], xyz: ArrayView2<'_, f32>) -> String {
    let mut hash = Sha256::new();
    hash.update(points.join(",").as_bytes());
    for v in xyz {
        hash.update(v.to_le_bytes());
    }
    hex(&hash.finalize())
}

/// Bytes as lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// A step for a model's history.
pub fn entry(command: &str, flags: &[(&str, String)], inputs: Vec<String>) -> Entry {
    Entry {
        command: command.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        flags: flags
            .iter()
            .map(|(k, v)| (k.to_string(), v.clone()))
            .collect(),
        inputs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Similarity;
    use crate::pose::rotation::exponential;
    use glam::DVec3;

    fn table(world: bool) -> Poses {
        let names = joints::cmu_names();
        let mut xyz = Array2::zeros((40, 69));
        for t in 0..40 {
            let pose: Vec<f64> = (0..69)
                .map(|i| match i / 3 {
                    0 => 0.0,
                    1 => [9.4, -9.9, 5.1][i % 3],
                    5 => [-9.1, -10.0, 5.1][i % 3],
                    9 => [0.1, 11.8, -0.1][i % 3],
                    j => {
                        20.0 * (j as f64 * 1.3 + (i % 3) as f64).sin()
                            + (t as f64 * 0.2 + i as f64).cos()
                    }
                })
                .collect();
            let mut out = pose.clone();
            if world {
                let v = DVec3::new(0.3, t as f64 * 0.4, -0.2);
                let s = Similarity {
                    rotation: exponential(v),
                    shift: DVec3::new(9.0, 80.0, t as f64),
                    scale: 1.0,
                };
                s.apply_pose(&pose, &mut out);
            }
            xyz.row_mut(t).iter_mut().zip(out).for_each(|(a, b)| *a = b);
        }
        Poses {
            points: names,
            xyz,
            time: None,
            take: None,
        }
    }

    #[test]
    fn turned_poses_are_learnt_from_as_unturned_ones() {
        let here = ready(&table(false), true, None, "t").unwrap();
        let there = ready(&table(true), true, None, "t").unwrap();
        assert!(
            here.xyz
                .iter()
                .zip(&there.xyz)
                .all(|(a, b)| (a - b).abs() <= 1e-3)
        );
        let as_is = ready(&table(true), false, None, "t").unwrap();
        assert!(
            as_is
                .xyz
                .iter()
                .zip(&there.xyz)
                .any(|(a, b)| (a - b).abs() > 1.0)
        );
    }

    #[test]
    fn incomplete_frames_are_counted_and_left_out() {
        let mut poses = table(true);
        poses.xyz[[3, 50]] = f64::NAN;
        let out = ready(&poses, true, None, "t").unwrap();
        assert_eq!((out.xyz.nrows(), out.incomplete), (39, 1));
        poses.xyz.fill(f64::NAN);
        assert!(
            ready(&poses, true, None, "t")
                .unwrap_err()
                .to_string()
                .contains("no complete pose")
        );
    }
}
