//! The skeleton of a restored take of points, or its joint centers, written beside the result.

use super::joint_skeleton::SolvedJoints;
use super::person::picture;
use super::record::Fingerprint;
use super::restored::Restored;
use super::skeleton::SkeletonSettings;
use crate::gait::GivenValues;
use crate::io::Output;
use crate::io::output::write_file;
use crate::label::people::people_by_name;
use crate::pose::{FillMethod, PointNaming, Poses, Status};
use crate::solve::{JointSet, MarkerSet, SolveSettings, solve};
use crate::{Error, Result};
use ndarray::{Array2, Axis};
use serde_json::{Value, json};
use std::path::Path;

/// Frames from which the record has the median deviations of a skeleton's joints.
const FRAMES_OF_SD: usize = 30;

impl SkeletonSettings {
    /// Whether more of the points are joints by their naming than are markers: then the skeleton is
    /// theirs.
    fn are_joints(&self, points: &[String], naming: &PointNaming) -> bool {
        let is_for_markers = self.set.is_some() || self.joints == JointSet::Anatomical;
        !is_for_markers && naming.joints(points) > MarkerSet::known(points)
    }

    /// Solves a take whose points were cleaned, and writes its skeleton and motion, or its centers,
    /// beside the result; what is to be told of it. Each of several people has their own, all with
    /// the frames of the take.
    ///
    /// # Errors
    /// Those of [`solve`]; [`Error::Usage`]: several takes. [`Error::Io`]: writing fails.
    pub(super) fn write(&self, restored: &Restored<'_>) -> Result<Value> {
        let file = &restored.take.file;
        let run = &restored.take.run;
        let (earlier, named) = (&run.earlier, &run.job.named);
        if file.poses().takes().len() > 1 {
            return Err(Error::usage("several takes, and a skeleton is of one"));
        }
        let all = (0..file.poses().points.len()).map(|p| (p, file.poses().points[p].clone()));
        let people = people_by_name(&file.poses().points);
        if people.len() < 2 {
            return self.write_person(&self.path(named), restored, &all.collect::<Vec<_>>());
        }
        let one = |(person, own): &(String, Vec<(usize, String)>)| {
            let mut path = self.path_of_person(named, person);
            if run.job.others.contains(&path) {
                path = self.path_of_person(&run.job.output, person);
            }
            let mut report = match self.check_path(earlier, &path) {
                Err(e) => json!({"none": e.to_string(), "in_the_way": true}),
                Ok(()) => match self.write_person(&path, restored, own) {
                    Err(e @ Error::Io { .. }) => return Err(e),
                    written => written.unwrap_or_else(|e| json!({"none": e.to_string()})),
                },
            };
            report["person"] = json!(person);
            Ok(report)
        };
        let reports = people.iter().map(one).collect::<Result<Vec<Value>>>()?;
        Ok(json!({ "people": reports }))
    }

    /// Solves one person, of some points with their own names.
    fn write_person(
        &self,
        path: &Path,
        restored: &Restored<'_>,
        own: &[(usize, String)],
    ) -> Result<Value> {
        let Restored { take, points, .. } = restored;
        let file = &take.file;
        let columns: Vec<usize> = own.iter().flat_map(|(p, _)| 3 * p..3 * p + 3).collect();
        let poses = Poses {
            points: own.iter().map(|(_, name)| name.clone()).collect(),
            xyz: points.xyz().select(Axis(1), &columns),
            ..file.poses().clone()
        };
        // Names that two people have are of no map; those of one of them may be.
        let naming = take.run.naming(&poses);
        if self.are_joints(&poses.points, &naming) {
            return write_joints(path, restored, own, &poses, &naming);
        }
        let is_centers = self.joints == JointSet::Anatomical;
        let of_points = (poses.frames(), poses.points.len());
        let doubt = |(t, k): (usize, usize)| match points.status(t, own[k].0) {
            Status::Observed => 0.0,
            _ => points.sd(t, own[k].0),
        };
        let filled = is_centers.then(|| Array2::from_shape_fn(of_points, doubt));
        let subject = file.c3d().map(GivenValues::of_c3d);
        let settings = SolveSettings {
            set: self.set.as_ref(),
            joints: self.joints,
            // The record has their medians.
            deviations_every: if is_centers {
                1
            } else {
                poses.frames().div_ceil(FRAMES_OF_SD)
            },
            subject: subject.as_ref(),
            filled: filled.as_ref(),
            ..SolveSettings::default()
        };
        let solved = solve(&poses, &settings, &mut |_| ())?;
        if is_centers {
            solved.write_table(Output::file(path)?)?;
        } else {
            let rate = file.rate().ok_or("no rate, which BVH needs")?;
            write_file(path, &solved.to_bvh(rate)?.to_bytes(1.0))?;
        }
        let mut report = solved.report();
        report["output"] = json!(Fingerprint::read(path)?);
        let seen = |t: usize| {
            let is_seen = |(p, _): &&(usize, String)| points.status(t, *p) == Status::Observed;
            own.iter().filter(is_seen).count()
        };
        report["picture"] = json!(picture(&solved.joints, None, seen));
        Ok(report)
    }
}

/// Solves the joints of one person, and writes their skeleton and motion.
fn write_joints(
    path: &Path,
    restored: &Restored<'_>,
    own: &[(usize, String)],
    poses: &Poses,
    naming: &PointNaming,
) -> Result<Value> {
    let points = &restored.points;
    let sd = |(t, k): (usize, usize)| match points.method(t, own[k].0) {
        // A foot that stands is to stand.
        Some(FillMethod::Contact) => 0.0,
        _ => points.sd(t, own[k].0),
    };
    let sd = Array2::from_shape_fn((poses.frames(), own.len()), sd);
    let rate = restored.take.file.rate();
    let rate = rate.ok_or("no rate, which BVH needs")?;
    let mut solved = SolvedJoints::of(poses, naming, &sd, rate)?;
    write_file(path, &solved.bvh.to_bytes(1.0))?;
    solved.report["output"] = json!(Fingerprint::read(path)?);
    Ok(solved.report)
}
