//! Every frame of a take by itself, once bones and markers are known.

use super::body::Body;
use super::calibration::frame_solver;
use super::deviations::Deviations;
use super::landmarks::JointSet;
use crate::ik::frame_solver::Scratch;
use crate::ik::sequence::{SequenceFit, Targets, fit_frames};
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel::map_chunks;
use crate::pose::Skeleton;
use crate::prior::rotations::JointPrior;
use crate::{Error, Result};
use ndarray::Array2;

/// A body that was fitted, and the take.
pub(super) struct Fitted<'a> {
    pub body: &'a Body,
    pub prior: &'a JointPrior,
    /// With markers.
    pub skeleton: Skeleton,
    /// The markers (frames, 3 M), cm.
    pub xyz: &'a Array2<f64>,
    /// Every so many frames is a key frame.
    pub stride: usize,
}

impl Fitted<'_> {
    pub(super) fn sequence(&self, watch: &mut dyn FnMut(usize)) -> Result<SequenceFit> {
        let joints = self.body.marker_bones();
        let solver = frame_solver(&self.skeleton, &joints, self.prior)?;
        let shape = (self.xyz.nrows(), joints.len());
        let sd = Array2::from_shape_fn(shape, |(_, m)| self.body.markers[m].sd);
        let targets = Targets {
            joints: &joints,
            cmu: &vec![None; joints.len()],
            xyz: self.xyz.view(),
            sd: Some(sd.view()),
            stride: self.stride,
        };
        Ok(fit_frames(
            &self.skeleton,
            &targets,
            0,
            solver,
            false,
            watch,
        ))
    }

    /// Where some bones end in every frame (frames, 3 B), cm.
    pub(super) fn ends(&self, sequence: &SequenceFit, bones: &[usize]) -> Result<Array2<f64>> {
        let count = sequence.values.nrows();
        let rows = map_chunks(count, 64, |range| {
            let of = |t: usize| {
                let posture = self.skeleton.posture(&sequence.values.row(t).to_vec());
                let ends = bones.iter().flat_map(|b| posture.ends[*b].to_array());
                ends.collect::<Vec<f64>>()
            };
            range.flat_map(of).collect::<Vec<f64>>()
        });
        Array2::from_shape_vec((count, 3 * bones.len()), rows.concat())
            .map_err(|e| Error::usage(e.to_string()))
    }

    /// The names of joints and the bones that end there.
    pub(super) fn named_bones(&self, set: JointSet) -> Result<(Vec<String>, Vec<usize>)> {
        let missing = |bone: &str| Error::usage(format!("the body has no bone {bone}"));
        let all = set.joints().into_iter().map(|(name, bone)| {
            let found = self.skeleton.find(&bone).ok_or_else(|| missing(&bone))?;
            Ok((name, found))
        });
        Ok(all.collect::<Result<Vec<_>>>()?.into_iter().unzip())
    }

    /// The deviations of the joints of a set in every so many frames; NaN in the others.
    pub(super) fn deviations(
        &self,
        sequence: &SequenceFit,
        precision: &Array2<f64>,
        (set, every): (JointSet, usize),
    ) -> Result<Array2<f64>> {
        let (names, bones) = self.named_bones(set)?;
        let joints = self.body.marker_bones();
        let solver = frame_solver(&self.skeleton, &joints, self.prior)?;
        let singular = || Error::usage("bones and markers are not known: singular equations");
        let numbers = Cholesky::new(precision.clone()).ok_or_else(singular)?;
        let deviations = Deviations {
            body: self.body,
            solver: &solver,
            numbers: &numbers,
            bones: &bones,
        };
        let weights = self.body.weights();
        let count = sequence.values.nrows();
        let rows = map_chunks(count, 8, |range| {
            let mut scratch = Scratch::default();
            let mut of = |t: usize| {
                if !t.is_multiple_of(every) {
                    return vec![f64::NAN; bones.len()];
                }
                let state = solver
                    .equations
                    .states
                    .state_of(&sequence.values.row(t).to_vec());
                let frame = self.xyz.row(t).to_vec();
                let at = solver
                    .equations
                    .linearized(&state, &frame, &weights, &mut scratch);
                let own = deviations.of(&at, &scratch);
                own.unwrap_or_else(|| vec![f64::NAN; bones.len()])
            };
            range.flat_map(&mut of).collect::<Vec<f64>>()
        });
        let mut sd = Array2::from_shape_vec((count, bones.len()), rows.concat())
            .map_err(|e| Error::usage(e.to_string()))?;
        for (j, name) in names.iter().enumerate() {
            sd.column_mut(j)
                .mapv_inplace(|v| v * Deviations::factor_of(name));
        }
        Ok(sd)
    }
}
