//! A skeleton fitted to a take, from poses to a motion file.

use super::bone_normalization::BoneNormalizer;
use super::correspondence::{Correspondence, match_points};
use super::fit_quality::{FitQuality, drives, leg_length};
use super::sequence::{SequenceFit, Targets, fit_sequence, key_stride};
use crate::io::Bvh;
use crate::io::bvh::{BvhPoints, BvhTemplate};
use crate::pose::rotation::Axis;
use crate::pose::{Body, NameMap, PointNaming, Poses, Skeleton, joints};
use crate::prior::rotations::RotationPrior;
use crate::{Error, Result};
use glam::DMat3;
use ndarray::ArrayView2;

/// Inverse kinematics of a take: the degrees of freedom of a skeleton from the positions of its
/// joints.
///
/// ```
/// use posing_io::{Amc, Asf};
/// use posing_joints::ik::SkeletonFit;
///
/// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
/// let mut take = Amc::open("../../testdata/cmu/09/09_06.amc", &asf)?.to_poses(120.0)?;
/// take = take.slice(0..3);
/// let fit = SkeletonFit::new(&asf.skeleton).fit(&take)?;
/// assert!(fit.sequence.mean <= 0.1); // centimeters
/// let folder = tempfile::tempdir()?;
/// fit.to_bvh()?.save(folder.path().join("walk.bvh"))?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SkeletonFit<'a> {
    target: Target<'a>,
    limits: bool,
    prior: Option<&'a RotationPrior>,
    map: Option<&'a NameMap>,
    sd: Option<ArrayView2<'a, f64>>,
}

#[derive(Debug, Clone, Copy)]
enum Target<'a> {
    Skeleton(&'a Skeleton),
    Template(&'a BvhTemplate),
    /// A template whose points are its joints, not the ends of its bones.
    Joints(&'a BvhTemplate),
}

impl<'a> SkeletonFit<'a> {
    /// Fits `skeleton`, whose joints are the ends of its bones.
    pub fn new(skeleton: &'a Skeleton) -> SkeletonFit<'a> {
        SkeletonFit::of(Target::Skeleton(skeleton))
    }

    /// Fits the skeleton of a BVH file; [`FittedTake::to_bvh`] keeps that file's hierarchy, offsets
    /// and channels.
    pub fn with_template(template: &'a BvhTemplate) -> SkeletonFit<'a> {
        SkeletonFit::of(Target::Template(template))
    }

    /// The same for a table whose points are the joints of `template` by their names.
    pub fn with_joints(template: &'a BvhTemplate) -> SkeletonFit<'a> {
        SkeletonFit::of(Target::Joints(template))
    }

    fn of(target: Target<'a>) -> SkeletonFit<'a> {
        SkeletonFit {
            target,
            limits: false,
            prior: None,
            map: None,
            sd: None,
        }
    }

    /// Takes another prior of rotations than the one that is compiled in.
    #[must_use]
    pub fn prior(mut self, prior: Option<&'a RotationPrior>) -> SkeletonFit<'a> {
        self.prior = prior;
        self
    }

    /// Says which of the points are which of CMU's joints, of which the prior knows. `None`: by
    /// their names.
    #[must_use]
    pub fn map(mut self, map: Option<&'a NameMap>) -> SkeletonFit<'a> {
        self.map = map;
        self
    }

    /// Gives the points' standard deviations of a coordinate (frames, points), cm; NaN: measured.
    /// The surer a point, the nearer is its joint.
    #[must_use]
    pub fn sd(mut self, sd: Option<ArrayView2<'a, f64>>) -> SkeletonFit<'a> {
        self.sd = sd;
        self
    }

    /// Keeps the degrees of freedom within the skeleton's limits. Off by default: captured motion
    /// often exceeds them.
    #[must_use]
    pub fn limits(mut self, keep: bool) -> SkeletonFit<'a> {
        self.limits = keep;
        self
    }

    /// The skeleton that is solved for.
    pub fn skeleton(&self) -> &'a Skeleton {
        match self.target {
            Target::Skeleton(skeleton) => skeleton,
            Target::Template(template) | Target::Joints(template) => &template.skeleton.skeleton,
        }
    }

    /// The points of `poses` that are joints of the skeleton, by name.
    pub fn correspondence(&self, poses: &Poses) -> Correspondence {
        let names = &poses.points;
        let bones: Vec<Option<usize>> = match self.target {
            Target::Skeleton(skeleton) => names.iter().map(|n| skeleton.find(n)).collect(),
            Target::Template(template) => bones_of_template(template, poses),
            Target::Joints(template) => template.bones_of(names, BvhPoints::Origins),
        };
        match_points(poses, &bones)
    }

    /// Fits the skeleton to one take. What the points leave open is as it mostly is in people.
    ///
    /// # Errors
    /// [`Error::Usage`]: no point has the name of a joint, or the skeleton has too many degrees of
    /// freedom.
    pub fn fit(&self, poses: &Poses) -> Result<FittedTake<'a>> {
        self.fit_with_progress(poses, &mut |_| ())
    }

    /// [`SkeletonFit::fit`], and calls `observer` with the number of frames done.
    ///
    /// # Errors
    /// Those of [`SkeletonFit::fit`].
    pub fn fit_with_progress(
        &self,
        poses: &Poses,
        observer: &mut dyn FnMut(usize),
    ) -> Result<FittedTake<'a>> {
        let matched = self.correspondence(poses);
        let builtin;
        let prior = match self.prior {
            Some(prior) => prior,
            None => {
                builtin = RotationPrior::builtin()?;
                &builtin
            }
        };
        let sd = self
            .sd
            .map(|sd| sd.select(ndarray::Axis(1), &matched.columns));
        let targets = Targets {
            joints: &matched.joints,
            cmu: &cmu_joints(&matched, self.map),
            xyz: matched.xyz.view(),
            sd: sd.as_ref().map(|sd| sd.view()),
            stride: key_stride(poses.rate()),
        };
        let sequence = fit_sequence(self.skeleton(), &targets, prior, self.limits, observer)?;
        Ok(FittedTake {
            target: self.target,
            sequence,
            points: matched.names,
            rate: poses.rate(),
        })
    }
}

/// Which of CMU's joints each point is, by a map or by its name. For the neck and the head of a map
/// CMU's nearest will do.
fn cmu_joints(matched: &Correspondence, map: Option<&NameMap>) -> Vec<Option<usize>> {
    let names = &matched.names;
    let naming = match map {
        Some(map) => PointNaming::Map(map.clone()),
        None => PointNaming::of(names, matched.xyz.view(), &joints::cmu_names()),
    };
    let known = naming.model_names(names);
    let index = |name: &str| joints::CMU.iter().position(|c| *c == name);
    let mut found: Vec<Option<usize>> = known.iter().map(|name| index(name)).collect();
    if let PointNaming::Map(map) = &naming {
        for (name, cmu) in [("Neck", "thorax"), ("Head", "head")] {
            let column = map.trunk_column(name, names);
            let is_new = |cmu: &usize| !found.contains(&Some(*cmu));
            if let (Some(column), Some(cmu)) = (column, index(cmu).filter(is_new)) {
                found[column] = found[column].or(Some(cmu));
            }
        }
    }
    found
}

/// The bone of a BVH file whose end each point is, by name. Joints and bone ends have the same
/// names, End Sites apart: where a table holds no End Site, it is what its lengths fit better.
fn bones_of_template(template: &BvhTemplate, poses: &Poses) -> Vec<Option<usize>> {
    let bones = |which| template.bones_of(&poses.points, which);
    let (origins, ends) = (bones(BvhPoints::Origins), bones(BvhPoints::Ends));
    let misfit = |bones: &[Option<usize>]| {
        let matched = match_points(poses, bones);
        let own = BoneNormalizer::for_skeleton(&template.skeleton.skeleton, &matched.joints);
        let measured = Body::measure(own.parents(), matched.xyz.view());
        let apart = own.lengths().iter().zip(&measured.lengths);
        let apart = apart.map(|(a, b)| (a - b).abs());
        let apart: Vec<f64> = apart.filter(|d| d.is_finite()).collect();
        // No length at all tells nothing: joints, as bvh2xyz writes.
        (!apart.is_empty()).then(|| apart.iter().sum::<f64>())
    };
    let (by_origins, by_ends) = (misfit(&origins), misfit(&ends));
    let is_ends = by_origins.is_some_and(|origins| by_ends.is_some_and(|ends| ends <= origins));
    if is_ends && !template.has_end_site_among(&poses.points) {
        ends
    } else {
        origins
    }
}

/// The motion of a skeleton that was fitted to a take.
#[derive(Debug, Clone)]
pub struct FittedTake<'a> {
    target: Target<'a>,
    /// The degrees of freedom, and how well they fit.
    pub sequence: SequenceFit,
    /// The names of the points that were fitted.
    pub points: Vec<String>,
    /// Frames a second, where the take has times.
    pub rate: Option<f64>,
}

impl FittedTake<'_> {
    /// (frames, degrees of freedom of the skeleton), radians and centimeters.
    pub fn values(&self) -> ArrayView2<'_, f64> {
        self.sequence.values.view()
    }

    /// The joint that turns most from one frame to the next, the second of them, and by how much,
    /// radians; `None` of a single frame.
    pub fn largest_turn(&self) -> Option<(&str, usize, f64)> {
        let (bone, frame, turn) = self.sequence.largest_step?;
        let name = match &self.target {
            Target::Skeleton(skeleton) => Some(skeleton.bones()[bone].name.as_str()),
            Target::Template(template) | Target::Joints(template) => template.joint_of(bone),
        };
        Some((name?, frame, turn))
    }

    /// How well the skeleton fits `poses`, the take that it was fitted to; `None` where the take
    /// shows none of its joints.
    pub fn quality(&self, poses: &Poses) -> Option<FitQuality> {
        let is_seen = |t: usize| self.sequence.by_target.get(t).is_some_and(|own| own.1 > 0);
        let counted: Vec<bool> = self.points.iter().map(|name| drives(name)).collect();
        let driving = self.sequence.mean_of(|t| counted[t]);
        let mean = if driving.is_nan() {
            self.sequence.mean
        } else {
            driving
        };
        let names: Vec<&String> = match self.target {
            Target::Skeleton(skeleton) => skeleton.bones().iter().map(|b| &b.name).collect(),
            Target::Template(template) | Target::Joints(template) => {
                template.joints().iter().map(|j| &j.name).collect()
            }
        };
        let joints: Vec<_> = names.into_iter().filter(|name| drives(name)).collect();
        let with_points = joints.iter().filter(|name| {
            let mut points = self.points.iter().enumerate();
            points.any(|(t, point)| point == **name && is_seen(t))
        });
        let with_points = with_points.count();
        (!mean.is_nan()).then(|| FitQuality {
            mean,
            leg: leg_length(poses),
            joints: (joints.len(), with_points),
        })
    }

    /// The motion as a BVH with rotation channels Z, Y, X and the y axis up (a template keeps its
    /// own).
    ///
    /// # Errors
    /// [`Error::Usage`]: the take has no times, so that its rate is unknown.
    pub fn to_bvh(&self) -> Result<Bvh> {
        let Some(rate) = self.rate else {
            return Err(Error::usage("the take has no times: its rate is unknown"));
        };
        self.to_bvh_with([Axis::Z, Axis::Y, Axis::X], DMat3::IDENTITY, rate)
    }

    /// The motion as a BVH at `rate` frames a second. `order` is that of the rotation channels, the
    /// last turning first; `turn` carries the file's axes to ours (y up). A template keeps its
    /// own order and axes.
    ///
    /// # Errors
    /// None for values that [`SkeletonFit`] made.
    pub fn to_bvh_with(&self, order: [Axis; 3], turn: DMat3, rate: f64) -> Result<Bvh> {
        match self.target {
            Target::Template(template) | Target::Joints(template) => {
                Ok(template.with_values(self.values(), 1.0 / rate))
            }
            Target::Skeleton(skeleton) => {
                Bvh::from_values(skeleton, self.values(), order, turn.transpose(), 1.0 / rate)
            }
        }
    }
}
