//! A person whose bones and markers were fitted to some frames.

use super::body::{BONES, Body};
use super::calibration::{Calibration, Calibrator};
use super::fitted::Fitted;
use super::landmarks::{JointSet, landmark};
use super::marker_sets::NamedMarker;
use super::tuning::*;
use crate::numeric::linalg::Cholesky;
use crate::numeric::statistics::median;
use crate::pose::joints::CMU;
use crate::pose::kinematics::Posture;
use crate::pose::{Skeleton, point_at};
use crate::prior::rotations::bones::mirror;
use crate::prior::rotations::{JointPrior, RotationPrior};
use crate::{Error, Result};
use glam::DVec3;
use ndarray::{Array2, ArrayView2, Axis, s};

/// A person whose bones and markers were fitted.
pub(super) struct Calibrated {
    pub body: Body,
    pub prior: JointPrior,
    /// The markers (frames, 3 M), cm.
    pub xyz: Array2<f64>,
    /// The numbers of bones and markers, and one over their covariance.
    pub numbers: Vec<f64>,
    pub precision: Array2<f64>,
}

/// Fits bones and markers to so many frames of a take of points at `xyz` (frames, 3 P), and of a
/// static one; bones are those of `given`, if it is.
pub(super) fn calibrated(
    named: &[NamedMarker],
    (xyz, count): (&ArrayView2<'_, f64>, usize),
    statics: Option<&Array2<f64>>,
    joints: JointSet,
    given: Option<&Skeleton>,
) -> Result<Calibrated> {
    let prior = RotationPrior::builtin()?;
    let bones = prior
        .bones()
        .ok_or_else(|| Error::usage("the prior of rotations has no bones"))?;
    let mut body = Body::new(named, joints, bones, given)?;
    let columns = named.iter().flat_map(|m| 3 * m.point..3 * m.point + 3);
    let columns: Vec<usize> = columns.collect();
    let xyz = xyz.select(Axis(1), &columns);
    let statics = statics.map(|statics| statics.select(Axis(1), &columns));
    if given.is_none()
        && let Some(width) = pelvis_width(named, &xyz, joints)
    {
        body.scale_pelvis(width);
    }
    let still = if statics.is_some() { STATIC_FRAMES } else { 0 };
    let mut frames = frames_to_fit(&xyz, count - still);
    frames.extend(statics.iter().flat_map(|s| frames_to_fit(s, still)));
    let prior = pose_prior(&body, &prior, joints)?;
    let calibrator = Calibrator {
        body: &body,
        prior: &prior,
        frames: &frames,
    };
    let Calibration { numbers, precision } = calibrator.calibrate()?;
    Ok(Calibrated {
        body,
        prior,
        xyz,
        numbers,
        precision,
    })
}

impl Calibrated {
    /// How far a marker is from where such markers are mostly, standard deviations.
    pub(super) fn deviations(&self, marker: usize) -> f64 {
        self.square_from(marker, marker).sqrt()
    }

    /// The marker on the other side of its bone that it changes places with: each is likelier the
    /// other. (Others of a bone may be turned about with it: a wrist's.)
    pub(super) fn exchanged_with(&self, marker: usize) -> Option<usize> {
        let bone = |m: usize| self.body.markers[m].bone;
        let mean = |m: usize| DVec3::from_slice(&self.body.mean[BONES + 3 * m..]);
        let is_mirrored = |other: &usize| {
            bone(*other) == bone(marker)
                && *other != marker
                && mirror(mean(*other)).distance(mean(marker)) < 1e-9
        };
        let gain = |other: usize| {
            let as_named = self.square_from(marker, marker) + self.square_from(other, other);
            as_named - self.square_from(marker, other) - self.square_from(other, marker)
        };
        let others = (0..self.body.markers.len()).filter(is_mirrored);
        let best = others.max_by(|a, b| gain(*a).total_cmp(&gain(*b)))?;
        (gain(best) >= EXCHANGED).then_some(best)
    }

    /// Squared deviations of a marker's position from where those like `other` are, on one bone.
    fn square_from(&self, marker: usize, other: usize) -> f64 {
        let of = |c: usize| {
            let [own, there] = [marker, other].map(|m| BONES + 3 * m + c);
            let off = self.numbers[own] - self.body.mean[there];
            off.powi(2) * self.body.precision[[there, there]]
        };
        (0..3).map(of).sum()
    }

    /// Standard deviation of the position of each marker on its bone, cm.
    ///
    /// # Errors
    /// [`Error::Usage`]: bones and markers are not known.
    pub(super) fn position_deviations(&self) -> Result<Vec<f64>> {
        let singular = || Error::usage("bones and markers are not known: singular equations");
        let factor = Cholesky::new(self.precision.clone()).ok_or_else(singular)?;
        let covariance = factor
            .solve(&Array2::eye(self.numbers.len()))
            .ok_or_else(singular)?;
        let of = |m: usize| {
            let own = BONES + 3 * m..BONES + 3 * m + 3;
            own.map(|n| covariance[[n, n]]).sum::<f64>().sqrt()
        };
        Ok((0..self.body.markers.len()).map(of).collect())
    }

    /// Where each marker is in every frame (frames, 3 M), cm.
    ///
    /// # Errors
    /// [`Error::Usage`]: the equations of the prior are singular.
    pub(super) fn positions(&self) -> Result<Array2<f64>> {
        let fitted = self.fitted(&self.xyz)?;
        let sequence = fitted.sequence(&mut |_| ())?;
        fitted.ends(&sequence, &self.body.marker_bones())
    }

    /// How the body stands in some frames.
    ///
    /// # Errors
    /// [`Error::Usage`]: the equations of the prior are singular.
    pub(super) fn postures(&self, frames: &[usize]) -> Result<Vec<Posture>> {
        let xyz = self.xyz.select(Axis(0), frames);
        let fitted = self.fitted(&xyz)?;
        let sequence = fitted.sequence(&mut |_| ())?;
        let rows = sequence.values.rows().into_iter();
        Ok(rows
            .map(|row| fitted.skeleton.posture(&row.to_vec()))
            .collect())
    }

    fn fitted<'a>(&'a self, xyz: &'a Array2<f64>) -> Result<Fitted<'a>> {
        Ok(Fitted {
            body: &self.body,
            prior: &self.prior,
            skeleton: self.body.skeleton(&self.numbers)?,
            xyz,
            stride: 1,
        })
    }
}

/// The width between the front hips, of that which the landmarks have; `None` where it is not seen.
fn pelvis_width(named: &[NamedMarker], xyz: &Array2<f64>, joints: JointSet) -> Option<f64> {
    let front = landmark("ASI")?;
    let of = |right: bool| {
        named
            .iter()
            .position(|m| m.landmark == *front && m.is_right == right)
    };
    let (left, right) = (of(false)?, of(true)?);
    let widths = (0..xyz.nrows())
        .map(|t| point_at(xyz.view(), t, left).distance(point_at(xyz.view(), t, right)));
    let expected = 2.0 * front.offset_and_sd(joints, false)[0].x;
    Some(median(widths.filter(|w| w.is_finite()).collect())? / expected)
}

/// The frames that bones and markers are fitted on: of equal stretches those with most markers.
fn frames_to_fit(xyz: &Array2<f64>, wanted: usize) -> Vec<Vec<f64>> {
    let count = xyz.nrows();
    let seen = |t: usize| xyz.row(t).iter().filter(|v| v.is_finite()).count();
    let of_stretch = |n: usize| {
        let stretch = n * count / wanted..((n + 1) * count / wanted);
        let middle = (stretch.start + stretch.end) / 2;
        stretch.max_by_key(|t| (seen(*t), usize::MAX - t.abs_diff(middle)))
    };
    let frames = (0..wanted).filter_map(of_stretch).filter(|t| seen(*t) >= 9);
    frames.map(|t| xyz.row(t).to_vec()).collect()
}

/// What is known of the poses of people, for the joints of the body.
pub(super) fn pose_prior(
    body: &Body,
    prior: &RotationPrior,
    joints: JointSet,
) -> Result<JointPrior> {
    let skeleton = body.bare_skeleton(&body.mean)?;
    let points: Vec<(usize, usize)> = (CMU.iter().enumerate())
        .filter_map(|(n, name)| Some((skeleton.find(name)?, n)))
        .collect();
    let mut own = JointPrior::new(prior, &skeleton, 0, &points);
    if joints == JointSet::Anatomical {
        own.covariance *= FREER * FREER;
        for (n, &bone) in own.bones.iter().enumerate() {
            if skeleton.bones()[bone].name.ends_with("clavicle") {
                let mut diagonal = own.covariance.diag_mut();
                let mut block = diagonal.slice_mut(s![3 * n..3 * n + 3]);
                block += COLLAR.to_radians().powi(2);
            }
        }
    }
    Ok(own)
}
