//! The skeleton of a cleaned take of markers: its motion as a BVH beside the result.

use super::earlier_result::EarlierResult;
use super::record::Fingerprint;
use crate::io::MotionFile;
use crate::io::output::write_file;
use crate::pose::Poses;
use crate::prior::provenance::hex;
use crate::solve::{MarkerSet, SolveSettings, solve};
use crate::{Error, Place, Result};
use ndarray::Array2;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// How the markers of takes are solved for skeletons.
#[derive(Debug, Clone, Default)]
pub struct SkeletonSettings {
    /// The marker set; `None`: of each file the built-in one that knows most of its markers.
    pub set: Option<MarkerSet>,
}

/// Where the skeleton of a result goes.
pub(super) fn skeleton_path(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".bvh");
    PathBuf::from(name)
}

impl SkeletonSettings {
    /// What is known of the settings in a record.
    ///
    /// # Errors
    /// None for sets of finite numbers.
    pub(super) fn recorded(&self) -> Result<Value> {
        Ok(match &self.set {
            None => json!("auto"),
            Some(set) => json!(hex(&Sha256::digest(set.to_json()?))),
        })
    }

    /// Whether the skeleton that a record tells of is there, or why there is none.
    pub(super) fn is_done(&self, earlier: &EarlierResult<'_>) -> bool {
        earlier.solved()["none"].is_string() || is_own(earlier)
    }

    /// Fails where a file of somebody else stands at the path of the skeleton.
    pub(super) fn check(&self, earlier: &EarlierResult<'_>) -> Result<()> {
        let path = skeleton_path(earlier.output);
        if !path.exists() || is_own(earlier) {
            return Ok(());
        }
        let what = "stands in the place of a skeleton and is none that clean wrote, or somebody \
                    changed it since; move it";
        Err(Error::data(Place::file(path.display().to_string()), what))
    }

    /// Solves a take whose points were cleaned, at `xyz` (frames, 3 P; cm), and writes its skeleton
    /// and motion beside the result; what is to be told of it.
    ///
    /// # Errors
    /// Those of [`solve`]; [`Error::Usage`]: several takes. [`Error::Io`]: writing fails.
    pub(super) fn write(
        &self,
        output: &Path,
        file: &MotionFile,
        xyz: Array2<f64>,
    ) -> Result<Value> {
        let poses = Poses {
            xyz,
            ..file.poses().clone()
        };
        if poses.takes().len() > 1 {
            return Err(Error::usage("several takes, and a skeleton is of one"));
        }
        let settings = SolveSettings {
            set: self.set.as_ref(),
            ..SolveSettings::default()
        };
        let solved = solve(&poses, &settings, &mut |_| ())?;
        let rate = file.rate().ok_or("no rate, which BVH needs")?;
        let bvh = solved.to_bvh(rate)?;
        let path = skeleton_path(output);
        write_file(&path, &bvh.to_bytes(1.0))?;
        let mut report = solved.report();
        report["output"] = json!(Fingerprint::read(&path)?);
        Ok(report)
    }
}

/// Whether the skeleton beside a result is there, and the one that its record tells of.
fn is_own(earlier: &EarlierResult<'_>) -> bool {
    let found = Fingerprint::read(&skeleton_path(earlier.output));
    found.is_ok_and(|found| earlier.solved()["output"]["sha256"] == json!(found.sha256))
}

/// Takes away the skeleton of a result that is made anew.
pub(super) fn remove_old(earlier: &EarlierResult<'_>) {
    if is_own(earlier) {
        // Where that fails, it stands there as an old one.
        let _ = std::fs::remove_file(skeleton_path(earlier.output));
    }
}

/// Whether a file is a skeleton that stands beside a result.
pub(super) fn is_skeleton(path: &Path) -> bool {
    let is_bvh = path.extension().is_some_and(|e| e == "bvh");
    is_bvh && is_own(&EarlierResult::read(&path.with_extension("")))
}
