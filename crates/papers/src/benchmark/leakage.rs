//! Train/test leakage: takes that share poses, possibly mirrored, and takes that a pretrained model
//! was trained from.
//!
//! Duplicates are found by digest and by pose distance: a share of one take's poses, or of their
//! mirror images, occurs in the other. Poses are sorted by their projection on one random
//! direction. Poses within a distance d have projections within d, so that few pairs are compared.

use super::dataset::Dataset;
use crate::numeric::parallel;
use crate::pose::sides;
use ndarray::{Array2, ArrayView1, ArrayView2};
use rand::Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Two poses are equal up to this RMS of a coordinate, cm. The bound allows for rounding; two takes
/// of a person standing still differ by millimeters.
const EQUAL_RMS: f64 = 0.02;
/// A pose stored in a model equals one of the dataset up to this RMS, cm: both are rounded to f32.
const STORED_RMS: f64 = 0.002;
/// Poses of a take that are searched in the others.
const PROBES: usize = 50;
/// Smallest share of probes found in another take that makes the takes duplicates.
const MIN_SHARE: f64 = 0.2;
/// Smallest mean distance of left and right joints along the lateral axis, cm.
const MIN_LATERAL: f64 = 1.0;

/// How a duplicate was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DuplicateEvidence {
    /// The digests are equal.
    Digest,
    /// Poses of one take occur in the other.
    Poses,
    /// Mirror images of poses of one take occur in the other.
    Mirrored,
}

/// Two takes that share poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DuplicateTake {
    /// The index of the earlier take in [`Dataset::takes`].
    pub a: usize,
    /// The index of the later take.
    pub b: usize,
    /// How the duplicate was found.
    pub evidence: DuplicateEvidence,
    /// The share of the poses of one take that occur in the other, 0 to 1.
    pub share: f64,
}

impl DuplicateTake {
    /// A phrase such as `take 07_02, a mirror image of take 07_01,`.
    pub fn describe(&self, data: &Dataset) -> String {
        let (a, b) = (&data.takes[self.a].name, &data.takes[self.b].name);
        match self.evidence {
            DuplicateEvidence::Digest => format!("take {b}, a copy of take {a},"),
            DuplicateEvidence::Poses => format!("take {b}, which shares poses with take {a},"),
            DuplicateEvidence::Mirrored => format!("take {b}, a mirror image of take {a},"),
        }
    }
}

/// Finds all pairs of takes that share poses, sorted by index.
pub(crate) fn find_duplicates(data: &Dataset) -> Vec<DuplicateTake> {
    let index = ProjectionIndex::new(data.xyz.view());
    let mirror = Mirror::of(data);
    let found = parallel::map_chunks(data.takes.len(), 1, |range| {
        duplicates_of(data, &index, &mirror, range.start)
    });
    let mut twins: Vec<DuplicateTake> = found.into_iter().flatten().collect();
    // Each take of a pair may have found the other: the stronger evidence is kept.
    let surer = |t: &DuplicateTake| (t.a, t.b, t.evidence as u8, (-t.share * 1e9) as i64);
    twins.sort_by_key(surer);
    twins.dedup_by_key(|t| (t.a, t.b));
    twins
}

/// The duplicates of one take.
fn duplicates_of(
    data: &Dataset,
    index: &ProjectionIndex<'_>,
    mirror: &Option<Mirror>,
    k: usize,
) -> Vec<DuplicateTake> {
    let take = &data.takes[k];
    let mut twins = Vec::new();
    let mut add = |other: usize, evidence, share| {
        let (a, b) = (k.min(other), k.max(other));
        twins.push(DuplicateTake {
            a,
            b,
            evidence,
            share,
        });
    };
    for (other, that) in data.takes.iter().enumerate().skip(k + 1) {
        if that.digest == take.digest {
            add(other, DuplicateEvidence::Digest, 1.0);
        }
    }
    let probes: Vec<usize> = take
        .rows
        .clone()
        .step_by(take.rows.len().div_ceil(PROBES).max(1))
        .collect();
    for evidence in [DuplicateEvidence::Poses, DuplicateEvidence::Mirrored] {
        let mut hits = vec![0_usize; data.takes.len()];
        for &row in &probes {
            let pose = data.xyz.row(row);
            let pose: Vec<f32> = match (evidence, mirror) {
                (DuplicateEvidence::Mirrored, Some(mirror)) => mirror.apply(pose),
                (DuplicateEvidence::Mirrored, None) => continue,
                _ => pose.to_vec(),
            };
            let mut takes: Vec<usize> = index
                .near(&pose, EQUAL_RMS)
                .map(|row| data.take_of(row))
                .collect();
            takes.sort_unstable();
            takes.dedup();
            takes.into_iter().for_each(|t| hits[t] += 1);
        }
        for (other, hits) in hits.into_iter().enumerate().filter(|(o, _)| *o != k) {
            let share = hits as f64 / probes.len() as f64;
            if share >= MIN_SHARE {
                add(other, evidence, share);
            }
        }
    }
    twins
}

/// What a model file contains of its training poses.
#[derive(Debug, Clone, Default)]
pub struct Provenance {
    /// Digests in the model's history: of all training poses and of each take.
    pub digests: Vec<String>,
    /// Arrays of the model that may contain training poses: (k, 3 J), cm.
    pub poses: Vec<Array2<f32>>,
}

impl Provenance {
    /// The indices of takes that the model was trained from: their digest is in the history or a
    /// pose is stored.
    pub(crate) fn takes(&self, data: &Dataset) -> Vec<usize> {
        let mut known: Vec<usize> = (0..data.takes.len())
            .filter(|&k| self.digests.contains(&data.takes[k].digest))
            .collect();
        let index = ProjectionIndex::new(data.xyz.view());
        for poses in self.poses.iter().filter(|p| p.ncols() == data.xyz.ncols()) {
            for pose in poses.rows() {
                // Rows of zeros or ones are parameters, not poses.
                if pose.iter().filter(|v| v.abs() > 1.0).count() * 2 >= pose.len() {
                    let pose = pose.to_vec();
                    known.extend(index.near(&pose, STORED_RMS).map(|row| data.take_of(row)));
                }
            }
        }
        known.sort_unstable();
        known.dedup();
        known
    }
}

/// Poses sorted by their projection on a direction.
struct ProjectionIndex<'a> {
    xyz: ArrayView2<'a, f32>,
    direction: Vec<f32>,
    /// (projection, row), ascending.
    projections: Vec<(f32, usize)>,
}

impl<'a> ProjectionIndex<'a> {
    fn new(xyz: ArrayView2<'a, f32>) -> ProjectionIndex<'a> {
        let mut random = parallel::rng(0, 5);
        let mut direction: Vec<f32> = (0..xyz.ncols())
            .map(|_| random.sample(StandardNormal))
            .collect();
        let length = direction.iter().map(|v| v * v).sum::<f32>().sqrt();
        direction.iter_mut().for_each(|v| *v /= length);
        let project = |row: ArrayView1<f32>| row.iter().zip(&direction).map(|(a, b)| a * b).sum();
        let rows = xyz.rows().into_iter().enumerate();
        let mut projections: Vec<(f32, usize)> = rows.map(|(i, row)| (project(row), i)).collect();
        projections.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ProjectionIndex {
            xyz,
            direction,
            projections,
        }
    }

    /// The rows within an RMS distance of a pose, cm.
    fn near(&self, pose: &[f32], rms: f64) -> impl Iterator<Item = usize> {
        let projection: f32 = pose.iter().zip(&self.direction).map(|(a, b)| a * b).sum();
        let limit = rms * rms * pose.len() as f64;
        // The f32 rounding of the projections is far below 0.01 cm.
        let reach = limit.sqrt() as f32 + 0.01;
        let from = self
            .projections
            .partition_point(|p| p.0 < projection - reach);
        let inside = self.projections[from..]
            .iter()
            .take_while(move |p| p.0 <= projection + reach);
        inside.map(|p| p.1).filter(move |&row| {
            let mut sum = 0.0;
            self.xyz.row(row).iter().zip(pose).all(|(a, b)| {
                sum += f64::from(a - b).powi(2);
                sum <= limit
            })
        })
    }
}

/// Exchanges left and right joints and negates the lateral axis.
struct Mirror {
    /// The source point of each point.
    from: Vec<usize>,
    /// The axis that is negated.
    axis: usize,
}

impl Mirror {
    /// The lateral axis is the one with the largest mean distance of left joints from their
    /// counterparts. `None` if no point has a counterpart or the distance is below
    /// [`MIN_LATERAL`] on all axes.
    fn of(data: &Dataset) -> Option<Mirror> {
        let names = &data.points;
        let from: Vec<usize> = (0..names.len())
            .map(|i| sides::mirrored(names, i).unwrap_or(i))
            .collect();
        let mut apart = [0.0_f64; 3];
        for row in data.xyz.rows() {
            for (i, &j) in from.iter().enumerate().filter(|(i, j)| i < j) {
                for (a, sum) in apart.iter_mut().enumerate() {
                    *sum += f64::from(row[3 * i + a] - row[3 * j + a]);
                }
            }
        }
        let pairs = from.iter().enumerate().filter(|(i, j)| i < j).count();
        let axis = (0..3).max_by(|&a, &b| apart[a].abs().total_cmp(&apart[b].abs()))?;
        let mean = apart[axis].abs() / (pairs * data.xyz.nrows()).max(1) as f64;
        (mean > MIN_LATERAL).then_some(Mirror { from, axis })
    }

    fn apply(&self, pose: ArrayView1<'_, f32>) -> Vec<f32> {
        let mut out = Vec::with_capacity(pose.len());
        for &from in &self.from {
            for a in 0..3 {
                let v = pose[3 * from + a];
                out.push(if a == self.axis { -v } else { v });
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::{source, takes};
    use super::*;
    use ndarray::{Axis, s};
    use std::collections::BTreeMap;
    use std::sync::Arc;

    /// Two takes, and a third made from the first.
    fn with(change: impl Fn(&Dataset, Array2<f64>) -> Array2<f64>) -> Dataset {
        let mut source = source(&[("01_01", 60), ("02_01", 50)]);
        let data = Dataset::new(std::slice::from_ref(&source), &BTreeMap::new()).unwrap();
        let third = change(&data, source.1.xyz.slice(s![..60, ..]).to_owned());
        let names = source.1.take.as_mut().unwrap();
        names.extend((0..third.nrows()).map(|_| Arc::from("03_01")));
        source.1.xyz.append(Axis(0), third.view()).unwrap();
        Dataset::new(&[source], &BTreeMap::new()).unwrap()
    }

    fn found(data: &Dataset) -> Vec<(usize, usize, DuplicateEvidence)> {
        find_duplicates(data)
            .iter()
            .map(|t| (t.a, t.b, t.evidence))
            .collect()
    }

    #[test]
    fn different_takes_are_no_duplicates() {
        assert_eq!(found(&takes(&[("01_01", 60), ("01_02", 60)])), []);
        assert_eq!(found(&takes(&[("01_01", 1)])), []);
    }

    #[test]
    fn a_copy_is_found_by_its_digest() {
        assert_eq!(found(&with(|_, x| x)), [(0, 2, DuplicateEvidence::Digest)]);
    }

    #[test]
    fn a_part_a_rounded_copy_and_every_other_frame_are_found_by_distance() {
        let part = with(|_, x| x.slice(s![20..40, ..]).to_owned());
        assert_eq!(found(&part), [(0, 2, DuplicateEvidence::Poses)]);
        let rounded = with(|_, x| x.mapv(|v| (v * 100.0).round() / 100.0));
        assert_eq!(found(&rounded), [(0, 2, DuplicateEvidence::Poses)]);
        let slower = with(|_, x| x.slice(s![..;2, ..]).to_owned());
        assert_eq!(found(&slower), [(0, 2, DuplicateEvidence::Poses)]);
        // Another pose altogether.
        assert_eq!(found(&with(|_, x| x.mapv(|v| v * 1.1))), []);
    }

    #[test]
    fn a_mirrored_take_is_found() {
        let mirrored = with(|data, x| {
            let mirror = Mirror::of(data).unwrap();
            assert_eq!(mirror.axis, 0);
            let rows: Vec<f64> = x
                .rows()
                .into_iter()
                .flat_map(|r| mirror.apply(r.mapv(|v| v as f32).view()))
                .map(f64::from)
                .collect();
            Array2::from_shape_vec(x.dim(), rows).unwrap()
        });
        let twins = find_duplicates(&mirrored);
        assert_eq!(found(&mirrored), [(0, 2, DuplicateEvidence::Mirrored)]);
        assert!(
            twins[0]
                .describe(&mirrored)
                .contains("mirror image of take 01_01")
        );
    }

    #[test]
    fn training_takes_are_known_by_digest_or_by_a_stored_pose() {
        let data = takes(&[("01_01", 30), ("01_02", 30), ("02_01", 30)]);
        let takes = |digest: &str, poses: Array2<f32>| {
            let digests = vec!["ff".into(), digest.into()];
            let poses = vec![Array2::zeros((1, 3)), poses];
            Provenance { digests, poses }.takes(&data)
        };
        let parameters = || Array2::zeros((2, 69));
        assert_eq!(takes(&data.takes[1].digest, parameters()), [1]);
        assert_eq!(takes("fe", data.xyz.slice(s![65..67, ..]).to_owned()), [2]);
        assert!(takes("fe", parameters()).is_empty());
    }
}
