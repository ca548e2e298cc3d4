//! The skeleton of a cleaned take of markers: its motion as a BVH beside the result, or its joint
//! centers as a table.

use super::earlier_result::EarlierResult;
use super::record::Fingerprint;
use crate::gait::GivenValues;
use crate::io::output::write_file;
use crate::io::{MotionFile, Output};
use crate::pose::{Poses, Status};
use crate::prior::provenance::hex;
use crate::restore::Restoration;
use crate::solve::{JointSet, MarkerSet, SolveSettings, solve};
use crate::{Error, Place, Result};
use ndarray::Array2;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
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

/// The ends of the names of skeletons and of centers.
const ENDS: [&str; 2] = [".bvh", ".centers.csv"];

/// Where what has such an end goes.
fn beside(output: &Path, end: &str) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(end);
    PathBuf::from(name)
}

impl SkeletonSettings {
    /// What is known of the settings in a record.
    ///
    /// # Errors
    /// None for sets of finite numbers.
    pub(super) fn recorded(&self) -> Result<Value> {
        let set = match &self.set {
            None => json!("auto"),
            Some(set) => json!(hex(&Sha256::digest(set.to_json()?))),
        };
        Ok(match self.joints {
            JointSet::Cmu => set,
            JointSet::Anatomical => json!({ "anatomical": set }),
        })
    }

    /// Where the skeleton or the centers of a result go.
    pub(super) fn path(&self, output: &Path) -> PathBuf {
        beside(
            output,
            ENDS[usize::from(self.joints == JointSet::Anatomical)],
        )
    }

    /// Whether the skeleton that a record tells of is there, or why there is none.
    pub(super) fn is_done(&self, earlier: &EarlierResult<'_>) -> bool {
        earlier.solved()["none"].is_string() || is_own(earlier, &self.path(earlier.output))
    }

    /// Fails where a file of somebody else stands at the path of the skeleton.
    pub(super) fn check(&self, earlier: &EarlierResult<'_>) -> Result<()> {
        let path = self.path(earlier.output);
        if !path.exists() || is_own(earlier, &path) {
            return Ok(());
        }
        let what = "stands in the place of a skeleton and is none that clean wrote, or somebody \
                    changed it since; move it";
        Err(Error::data(Place::file(path.display().to_string()), what))
    }

    /// Solves a take whose points were cleaned, and writes its skeleton and motion, or its centers,
    /// beside the result; what is to be told of it.
    ///
    /// # Errors
    /// Those of [`solve`]; [`Error::Usage`]: several takes. [`Error::Io`]: writing fails.
    pub(super) fn write(
        &self,
        output: &Path,
        file: &MotionFile,
        points: &Restoration<'_>,
    ) -> Result<Value> {
        let poses = Poses {
            xyz: points.xyz().to_owned(),
            ..file.poses().clone()
        };
        if poses.takes().len() > 1 {
            return Err(Error::usage("several takes, and a skeleton is of one"));
        }
        let is_centers = self.joints == JointSet::Anatomical;
        let of_points = (poses.frames(), poses.points.len());
        let doubt = |(t, p): (usize, usize)| match points.status(t, p) {
            Status::Observed => 0.0,
            _ => points.sd(t, p),
        };
        let filled = is_centers.then(|| Array2::from_shape_fn(of_points, doubt));
        let subject = file.c3d().map(GivenValues::of_c3d);
        let settings = SolveSettings {
            set: self.set.as_ref(),
            joints: self.joints,
            deviations: true,
            subject: subject.as_ref(),
            filled: filled.as_ref(),
            ..SolveSettings::default()
        };
        let solved = solve(&poses, &settings, &mut |_| ())?;
        let path = self.path(output);
        if is_centers {
            solved.write_table(Output::file(&path)?)?;
        } else {
            let rate = file.rate().ok_or("no rate, which BVH needs")?;
            write_file(&path, &solved.to_bvh(rate)?.to_bytes(1.0))?;
        }
        let mut report = solved.report();
        report["output"] = json!(Fingerprint::read(&path)?);
        Ok(report)
    }
}

/// Whether a file beside a result is there, and the one that its record tells of.
fn is_own(earlier: &EarlierResult<'_>, path: &Path) -> bool {
    let found = Fingerprint::read(path);
    found.is_ok_and(|found| earlier.solved()["output"]["sha256"] == json!(found.sha256))
}

/// Takes away the skeleton or the centers of a result that is made anew.
pub(super) fn remove_old(earlier: &EarlierResult<'_>) {
    let paths = ENDS.map(|end| beside(earlier.output, end));
    for path in paths.iter().filter(|path| is_own(earlier, path)) {
        // Where that fails, it stands there as an old one.
        let _ = std::fs::remove_file(path);
    }
}

/// Whether a file is a skeleton or centers that stand beside a result.
pub(super) fn is_skeleton(path: &Path) -> bool {
    let name = path.to_string_lossy();
    let mut results = ENDS.iter().filter_map(|end| name.strip_suffix(end));
    results.any(|result| is_own(&EarlierResult::read(Path::new(result)), path))
}
