//! The skeleton of a cleaned take of markers: its motion as a BVH beside the result, or its joint
//! centers as a table.

use super::earlier_result::EarlierResult;
use super::joint_skeleton::SolvedJoints;
use super::name_source::digest;
use super::person::picture;
use super::record::Fingerprint;
use super::restored::Restored;
use crate::gait::GivenValues;
use crate::io::Output;
use crate::io::motion_folder::{EXTENSIONS, file_name_part, unpacked};
use crate::io::output::write_file;
use crate::label::people::people_by_name;
use crate::pose::{FillMethod, NameMap, PointNaming, Poses, Status};
use crate::solve::{JointSet, MarkerSet, SolveSettings, solve};
use crate::{Error, Place, Result};
use ndarray::{Array2, Axis};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How the markers of takes are solved for skeletons, or for joint centers.
#[derive(Debug, Clone, Default)]
pub struct SkeletonSettings {
    /// The marker set; `None`: of each file the built-in one that knows most of its markers.
    pub set: Option<MarkerSet>,
    /// Anatomical joints: a table of their centers stands beside the result, with columns of
    /// deviations; else skeleton and motion, as a BVH.
    pub joints: JointSet,
}

/// Frames from which the record has the median deviations of a skeleton's joints.
const FRAMES_OF_SD: usize = 30;

/// The ends of the names of skeletons and of centers.
const ENDS: [&str; 2] = [".bvh", ".centers.csv"];

/// A path with more at its end.
fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    PathBuf::from(name)
}

/// What stands beside a result is called after it without its ending: `walk.bvh` beside `walk.c3d`.
pub(super) fn stem(output: &Path) -> PathBuf {
    unpacked(output).with_extension("")
}

impl SkeletonSettings {
    /// What is known of the settings in a record.
    ///
    /// # Errors
    /// None for sets of finite numbers.
    pub(super) fn recorded(&self) -> Result<Value> {
        let set = match &self.set {
            None => json!("auto"),
            Some(set) => json!(digest(set)?),
        };
        Ok(match self.joints {
            JointSet::Cmu => set,
            JointSet::Anatomical => json!({ "anatomical": set }),
        })
    }

    /// Where the skeleton or the centers go, called after this.
    pub(super) fn path(&self, named: &Path) -> PathBuf {
        with_end(named, self.end())
    }

    /// Where those of one of several people go.
    fn path_of_person(&self, named: &Path, person: &str) -> PathBuf {
        let end = format!("-{}{}", file_name_part(person), self.end());
        with_end(named, &end)
    }

    /// The map of names by which more of the points are joints than are markers: then the skeleton
    /// is theirs.
    fn map_of_joints<'n>(&self, points: &[String], naming: &'n PointNaming) -> Option<&'n NameMap> {
        let is_for_markers = self.set.is_some() || self.joints == JointSet::Anatomical;
        let PointNaming::Map(map) = naming else {
            return None;
        };
        let joints = map.columns(points).len();
        (!is_for_markers && joints > MarkerSet::known(points)).then_some(map)
    }

    fn end(&self) -> &'static str {
        ENDS[usize::from(self.joints == JointSet::Anatomical)]
    }

    /// Whether the skeleton that a record tells of is there, or why there is none.
    pub(super) fn is_done(&self, earlier: &EarlierResult<'_>) -> bool {
        let of_people = people_of(earlier.solved());
        let is_done = |solved: &Value| {
            solved["in_the_way"].is_null() && solved["none"].is_string()
                || file_of(earlier, solved).is_some_and(|path| path.exists())
        };
        !earlier.solved().is_null() && of_people.iter().all(is_done)
    }

    /// Fails where a file of somebody else stands at the path of the skeleton.
    pub(super) fn check(&self, earlier: &EarlierResult<'_>, named: &Path) -> Result<()> {
        self.check_path(earlier, &self.path(named))
    }

    fn check_path(&self, earlier: &EarlierResult<'_>, path: &Path) -> Result<()> {
        if !path.exists() || is_own(earlier, path) {
            return Ok(());
        }
        let what = "stands in the place of a skeleton and is none that clean wrote, or somebody \
                    changed it since; move it";
        Err(Error::data(Place::file(path.display().to_string()), what))
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
            let path = self.path_of_person(named, person);
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
        if let Some(map) = self.map_of_joints(&poses.points, &restored.naming) {
            return write_joints(path, restored, own, &poses, map);
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
    map: &NameMap,
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
    let mut solved = SolvedJoints::of(poses, map, &sd, rate)?;
    write_file(path, &solved.bvh.to_bytes(1.0))?;
    solved.report["output"] = json!(Fingerprint::read(path)?);
    Ok(solved.report)
}

/// What a record says of the skeleton of each person.
pub(super) fn people_of(solved: &Value) -> Vec<Value> {
    match solved["people"].as_array() {
        Some(people) => people.clone(),
        None => vec![solved.clone()],
    }
}

/// The file of a skeleton that a record tells of, beside the result.
fn file_of(earlier: &EarlierResult<'_>, solved: &Value) -> Option<PathBuf> {
    let name = solved["output"]["file"].as_str()?;
    let path = earlier.output.with_file_name(name);
    is_own(earlier, &path).then_some(path)
}

/// Whether a file beside a result is there, and one that its record tells of.
fn is_own(earlier: &EarlierResult<'_>, path: &Path) -> bool {
    let Ok(found) = Fingerprint::read(path) else {
        return false;
    };
    let is_it = |solved: &Value| {
        let output = &solved["output"];
        output["sha256"] == json!(found.sha256) && output["file"] == json!(found.file)
    };
    people_of(earlier.solved()).iter().any(is_it)
}

/// Takes away the skeletons or the centers of a result that is made anew.
pub(super) fn remove_old(earlier: &EarlierResult<'_>) {
    for solved in people_of(earlier.solved()) {
        // Where that fails, it stands there as an old one.
        let _ = file_of(earlier, &solved).map(std::fs::remove_file);
    }
}

/// Whether a file is a skeleton or centers that stand beside a result.
pub(super) fn is_skeleton(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let Some(stem) = ENDS.iter().find_map(|end| name.strip_suffix(end)) else {
        return false;
    };
    // The result's name ends there, or at a dash before one of several people.
    let stems = stem.match_indices('-').map(|(at, _)| &stem[..at]);
    let ends = EXTENSIONS
        .iter()
        .flat_map(|e| [format!(".{e}"), format!(".{e}.gz")]);
    let ends: Vec<String> = ends.chain([String::new(), ".C3D".to_string()]).collect();
    let is_of = |stem: &str| {
        let result = |end: &String| path.with_file_name(format!("{stem}{end}"));
        ends.iter()
            .map(result)
            .any(|result| is_own(&EarlierResult::read(&result), path))
    };
    stems.chain([stem]).any(is_of)
}
