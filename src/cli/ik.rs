//! What the commands share that fit a skeleton: a progress bar, the messages about the fit, and its
//! verdict.

use super::Outcome;
use super::input::{IN_CENTIMETERS, open};
use super::messages;
use super::name_maps::name_map;
use super::progress::Progress;
use crate::audit::count;
use crate::ik::correspondence::Correspondence;
use crate::ik::sequence::SequenceFit;
use crate::ik::{
    FitQuality, FitVerdict, FittedTake, SkeletonFit, estimate_skeleton, named_skeleton,
};
use crate::io::bvh::BvhTemplate;
use crate::io::{Model, SkeletonFile};
use crate::pose::bone_points::bone_ends_of_starts;
use crate::pose::orientation::BodyPoints;
use crate::pose::rotation::Axis;
use crate::pose::{BonePoints, NameMap, PointNaming, Poses, Skeleton, UpAxis, joints};
use crate::prior::rotations::RotationPrior;
use crate::restore::body_size::check_body_size;
use crate::{Error, Place, Result};
use glam::DMat3;
use ndarray::Array2;
use posing_core::often;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The number of names that a message lists.
const LISTED: usize = 8;

/// Reports jumps of a take's times, which `format` cannot express.
pub fn report_time_jumps(poses: &Poses, name: &str, format: &str) {
    let jumps = poses.runs().len().saturating_sub(1);
    if jumps > 0 {
        let times = often(jumps);
        messages::info(&format!(
            "{name}: the time jumps {times}; {format} cannot show the pause"
        ));
    }
}

/// Reads a skeleton to fit, and says what is odd about it.
///
/// # Errors
/// Those of [`SkeletonFile::read`].
pub fn read_skeleton(path: &Path, unit: f64, rotation: DMat3) -> Result<SkeletonFile> {
    let (file, notes) = SkeletonFile::read(open(path)?, unit, rotation)?;
    notes.iter().for_each(|note| messages::info(note));
    Ok(file)
}

/// Fails for a body that is of no person's size, unless it is taken all the same with `force`; then
/// gives points at the starts of bones the names of the ends there, but not where the skeleton
/// `keeps_starts`.
///
/// # Errors
/// [`Error::Data`]: see `check_body_size`.
pub fn name_bone_ends(
    poses: &mut Poses,
    table: &str,
    force: bool,
    keeps_starts: bool,
) -> Result<()> {
    let points = BonePoints::of(&poses.points, poses.xyz.view());
    if !force {
        let names = points.bone_ends(&poses.points);
        check_body_size(poses, &names, table, IN_CENTIMETERS)?;
    }
    if points == BonePoints::Starts && !keeps_starts {
        poses.points = bone_ends_of_starts(&poses.points);
    }
    Ok(())
}

/// What the joints of a table are, and how people's are rotated.
#[derive(Debug, clap::Args)]
pub struct JointArgs {
    /// Which point is which joint of a body, where the names do not say it: a shipped map of names,
    /// or a TOML file (see posing-table(5)) [default: the shipped map that fits]
    #[arg(long, value_name = "NAME|FILE.toml")]
    map: Option<String>,
    /// Prior of rotations that rotations-train wrote [default: built in]
    #[arg(long, value_name = "ROTATIONS.npz")]
    rotations: Option<PathBuf>,
}

/// A skeleton that is given, or measured from the take, and what it needs to be fitted.
pub struct TakeSkeleton {
    skeleton: SkeletonKind,
    map: Option<NameMap>,
    prior: Option<RotationPrior>,
    sd: Option<Array2<f64>>,
}

enum SkeletonKind {
    Given(SkeletonFile),
    Measured(Skeleton),
    Named(Box<BvhTemplate>),
}

impl JointArgs {
    /// Whether the body of a table stands along y, as it has to; said where it surely does not.
    ///
    /// # Errors
    /// Those of [`name_map`].
    pub fn check_axis(&self, poses: &Poses, table: &str) -> Result<Outcome> {
        let map = self
            .map
            .as_ref()
            .map(|map| name_map(map, &joints::cmu_names()));
        let map = map.transpose()?;
        let body = BodyPoints::of_joints(&poses.points, poses.xyz.view(), map.as_ref());
        let standing = body.standing(poses.xyz.view());
        let Some(wrong) = standing.filter(|s| s.axis != UpAxis::Y && s.is_sure) else {
            return Ok(Outcome::Done);
        };
        let what = wrong.sentence();
        messages::info(&format!("{table}: {what} of the command that read it"));
        Ok(Outcome::Findings)
    }

    /// The skeleton for a take: the one that is given, else measured from the table; its points are
    /// then named as the joints. `sd` are the points' deviations (frames, points; cm); `order` is
    /// that of the rotation channels of a new skeleton.
    ///
    /// # Errors
    /// Those of [`name_map`], [`estimate_skeleton`] and [`named_skeleton`]; [`Error::Io`] and
    /// [`Error::Data`] of the prior.
    pub fn skeleton(
        &self,
        given: Option<SkeletonFile>,
        poses: &mut Poses,
        mut sd: Option<Array2<f64>>,
        order: [Axis; 3],
    ) -> Result<TakeSkeleton> {
        let known = joints::cmu_names();
        let map = self
            .map
            .as_ref()
            .map(|map| name_map(map, &known))
            .transpose()?;
        let prior = self.rotations.as_ref().map(|path| {
            let model = Model::open(path)?;
            RotationPrior::from_model(&model, &path.display().to_string())
        });
        let prior = prior.transpose()?;
        if let Some(given) = given {
            let map = map.filter(|map| !renamed(poses, map, &given));
            return Ok(TakeSkeleton {
                skeleton: SkeletonKind::Given(given),
                map,
                prior,
                sd,
            });
        }
        let naming = PointNaming::of(&poses.points, poses.xyz.view(), &known);
        let map = map.or(match naming {
            PointNaming::Map(map) => Some(map),
            PointNaming::Bones(_) => None,
        });
        let skeleton = match &map {
            None => SkeletonKind::Measured(estimate_skeleton(poses)?),
            Some(map) => {
                let named = named_skeleton(poses, map, order)?;
                sd = sd.map(|sd| named.with_middles(&sd));
                *poses = named.poses;
                SkeletonKind::Named(Box::new(named.template))
            }
        };
        Ok(TakeSkeleton {
            skeleton,
            map,
            prior,
            sd,
        })
    }
}

impl TakeSkeleton {
    /// What fits it.
    pub fn fit(&self) -> SkeletonFit<'_> {
        let fit = match &self.skeleton {
            SkeletonKind::Given(SkeletonFile::Bvh(template)) => {
                SkeletonFit::with_template(template)
            }
            SkeletonKind::Given(SkeletonFile::Asf(asf)) => SkeletonFit::new(&asf.skeleton),
            SkeletonKind::Measured(skeleton) => SkeletonFit::new(skeleton),
            SkeletonKind::Named(template) => SkeletonFit::with_joints(template),
        };
        let sd = self.sd.as_ref().map(|sd| sd.view());
        fit.map(self.map.as_ref()).prior(self.prior.as_ref()).sd(sd)
    }

    /// The hierarchy, where it is one of joints, not of bones.
    pub fn template(&self) -> Option<&BvhTemplate> {
        match &self.skeleton {
            SkeletonKind::Given(SkeletonFile::Bvh(template)) | SkeletonKind::Named(template) => {
                Some(template)
            }
            _ => None,
        }
    }
}

/// Names the points of a table as the joints of a skeleton that stand for the same of CMU's; not
/// where the map names the joints themselves, half of them or more.
fn renamed(poses: &mut Poses, map: &NameMap, skeleton: &SkeletonFile) -> bool {
    let theirs = map.model_names(&poses.points);
    let SkeletonFile::Bvh(template) = skeleton else {
        poses.points = theirs;
        return true;
    };
    let joints = template.joint_names();
    if 2 * map.columns(&joints).len() >= map.joints.len() {
        return false;
    }
    let own = NameMap::fitting(&joints).map(|map| map.model_names(&joints));
    let own = own.unwrap_or_else(|| joints.clone());
    let joint = |name: &String| own.iter().position(|n| n == name);
    let names = theirs.iter().zip(&poses.points);
    let names = names.map(|(cmu, name)| joint(cmu).map_or(name, |j| &joints[j]).clone());
    poses.points = names.collect();
    true
}

/// Fits `skeleton` to the take of a table named `table`; `no_joint` is the error if no point is a
/// joint. A poor fit is a finding. One that is none fails, unless it is taken all the same with
/// `force`.
///
/// # Errors
/// [`Error::Data`]: no point is a joint, or the skeleton does not fit: see [`FitQuality`].
pub fn fit<'a>(
    skeleton: &SkeletonFit<'a>,
    poses: &Poses,
    table: &str,
    no_joint: &str,
    force: bool,
) -> Result<(FittedTake<'a>, FitReport)> {
    let matched = skeleton.correspondence(poses);
    if matched.joints.is_empty() {
        return Err(Error::data(Place::file(table), no_joint));
    }
    if let Some(message) = unmatched_message(&matched, table) {
        messages::info(&message);
    }
    let bar = Progress::new("solving", poses.frames() as u64);
    let fitted = skeleton.fit_with_progress(poses, &mut |n| bar.set(n as u64))?;
    drop(bar);
    let quality = fitted.quality(poses);
    // One mean for both lines: that of the points by which the fit is judged.
    let mean = quality.map_or(fitted.sequence.mean, |quality| quality.mean);
    let lines = fit_messages(&fitted.sequence, mean, &fitted.points);
    lines.iter().for_each(|line| messages::info(line));
    if let Some((name, frame, turn)) = fitted.largest_turn() {
        messages::info(&format!(
            "the largest turn of a bone in a frame: {:.0} degrees ({name} in row {})",
            turn.to_degrees(),
            frame + 1
        ));
    }
    let verdict = match quality {
        Some(quality) => judged(&quality, table, force)?,
        None => Outcome::Done,
    };
    let report = FitReport {
        left_out: matched.unmatched,
        ..FitReport::of(&fitted, mean, quality.as_ref(), verdict)
    };
    Ok((fitted, report))
}

/// How well a skeleton fits a take.
#[derive(Debug, Clone, Serialize)]
pub struct FitReport {
    frames: usize,
    /// Mean distance of a joint from its point, cm; `None`: there are no points.
    mean: Option<f64>,
    /// The largest.
    max: f64,
    /// The point and the row of the largest, from 1.
    worst: Option<(String, usize)>,
    /// The joint that turns most from a frame to the next, the row of the second, and by how many
    /// degrees.
    largest_turn: Option<(String, usize, f64)>,
    /// The length of the leg, cm.
    leg: Option<f64>,
    /// The joints of the skeleton, and those that have points.
    joints: Option<(usize, usize)>,
    /// Points that are no joints of the skeleton.
    left_out: Vec<String>,
    incomplete_frames: usize,
    unplaced_frames: usize,
    unconverged_frames: usize,
    /// Whether it is as it should be, or somebody has to look at it.
    fit: &'static str,
    /// The outcome of the command.
    #[serde(skip)]
    pub outcome: Outcome,
}

impl FitReport {
    fn of(
        fitted: &FittedTake<'_>,
        mean: f64,
        quality: Option<&FitQuality>,
        outcome: Outcome,
    ) -> FitReport {
        let sequence = &fitted.sequence;
        let name = |point: usize| fitted.points.get(point).cloned().unwrap_or_default();
        let turn = fitted.largest_turn();
        FitReport {
            frames: sequence.values.nrows(),
            mean: mean.is_finite().then_some(mean),
            max: sequence.max,
            worst: sequence.worst.map(|(row, point)| (name(point), row + 1)),
            largest_turn: turn.map(|(name, row, angle)| {
                let angle = angle.to_degrees();
                (name.to_string(), row + 1, angle)
            }),
            leg: quality.and_then(|quality| quality.leg),
            joints: quality.map(|quality| quality.joints),
            left_out: Vec::new(),
            incomplete_frames: sequence.incomplete,
            unplaced_frames: sequence.unplaced,
            unconverged_frames: sequence.unconverged,
            fit: if outcome == Outcome::Done {
                "good"
            } else {
                "poor"
            },
            outcome,
        }
    }
}

/// The outcome of a fit, with a line where it is not good.
fn judged(quality: &FitQuality, table: &str, force: bool) -> Result<Outcome> {
    let [poor, failed] = quality.limits();
    let mean = length(quality.mean);
    let far = |limit: f64| {
        format!(
            "the skeleton's joints are {mean} cm from their points in the mean (limit {limit:.2} \
             cm)"
        )
    };
    match quality.verdict() {
        FitVerdict::Good => Ok(Outcome::Done),
        FitVerdict::Failed if !force => {
            let what = format!(
                "the skeleton does not fit: {}; give one of this body's size and names, or use \
                 --force to continue",
                far(failed)
            );
            Err(Error::data(Place::file(table), what))
        }
        FitVerdict::Poor if quality.mean <= poor => {
            let (all, driven) = quality.joints;
            messages::info(&format!(
                "only {driven} of the skeleton's {all} joints have points; the others keep their \
                 rest pose"
            ));
            Ok(Outcome::Findings)
        }
        FitVerdict::Poor | FitVerdict::Failed => {
            messages::info(&format!("the skeleton fits badly: {}", far(poor)));
            Ok(Outcome::Findings)
        }
    }
}

/// Names the points that are no joints of the skeleton.
fn unmatched_message(matched: &Correspondence, table: &str) -> Option<String> {
    let count = matched.unmatched.len();
    let mut names = matched.unmatched[..count.min(LISTED)].join(", ");
    if count > LISTED {
        names.push_str(", ...");
    }
    let points = match count {
        0 => return None,
        1 => "1 point is",
        _ => &format!("{count} points are"),
    };
    Some(format!(
        "{table}: {points} not in the skeleton and left out: {names}"
    ))
}

/// How well a sequence fits, with the mean distance `mean`, cm; `names` are those of the points.
fn fit_messages(fit: &SequenceFit, mean: f64, names: &[String]) -> Vec<String> {
    let frames = |n: usize| count(n, "frame");
    let mut lines = Vec::new();
    match fit.worst {
        Some((frame, point)) => lines.push(format!(
            "fit: mean {} cm, max {} cm ({} in row {})",
            length(mean),
            length(fit.max),
            names.get(point).map_or("?", String::as_str),
            frame + 1
        )),
        None => lines.push("fit: no point to fit; writing the rest pose".into()),
    }
    if fit.incomplete > 0 {
        lines.push(format!(
            "{} had missing points; joints without them go from the frame before to the one \
             after",
            frames(fit.incomplete)
        ));
    }
    if fit.unplaced > 0 {
        lines.push(format!(
            "{} could not place the root; it keeps its last position",
            frames(fit.unplaced)
        ));
    }
    if fit.unconverged > 0 {
        lines.push(format!(
            "{} did not converge; their values are the best found",
            frames(fit.unconverged)
        ));
    }
    lines
}

/// Four decimals, or fewer figures of something smaller.
fn length(cm: f64) -> String {
    if cm < 1e-4 {
        format!("{cm:.0e}")
    } else {
        format!("{cm:.4}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unmatched_points_are_named() {
        let mut matched = Correspondence::default();
        assert_eq!(unmatched_message(&matched, "t"), None);
        matched.unmatched = vec!["b".into()];
        let message = unmatched_message(&matched, "t").unwrap();
        assert!(message.contains("1 point is not in the skeleton") && message.ends_with("b"));
    }

    #[test]
    fn a_bad_fit_is_a_finding_and_none_is_an_error() {
        let of = |mean: f64, driven: usize| FitQuality {
            mean,
            leg: Some(86.0),
            joints: (20, driven),
        };
        assert_eq!(judged(&of(0.5, 20), "t", false).unwrap(), Outcome::Done);
        assert_eq!(judged(&of(0.5, 5), "t", false).unwrap(), Outcome::Findings);
        assert_eq!(judged(&of(2.5, 20), "t", false).unwrap(), Outcome::Findings);
        let failed = judged(&of(25.0, 20), "t", false).unwrap_err().to_string();
        assert!(
            failed.starts_with("t: ") && failed.contains("--force"),
            "{failed}"
        );
        assert_eq!(judged(&of(25.0, 20), "t", true).unwrap(), Outcome::Findings);
    }

    #[test]
    fn a_fit_is_described() {
        let fit = SequenceFit {
            max: 2.0,
            worst: Some((6, 0)),
            incomplete: 1,
            ..SequenceFit::default()
        };
        let lines = fit_messages(&fit, 0.5, &["lfoot".into()]);
        assert_eq!(
            lines[0],
            "fit: mean 0.5000 cm, max 2.0000 cm (lfoot in row 7)"
        );
        assert_eq!(lines.len(), 2);
        assert!(fit_messages(&SequenceFit::default(), 0.0, &[])[0].contains("no point"));
    }
}
