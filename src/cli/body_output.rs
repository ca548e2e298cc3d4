//! Writing takes of bodies: meshes, or an animated body.

use super::messages;
use crate::body::BodyModel;
use crate::body::glb::SkinnedTake;
use crate::body::take::BodyTake;
use crate::io::mesh_output::MeshOutput;
use crate::pose::units::Units;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Frames of which meshes are made and written at a time.
const BLOCK: usize = 64;

/// Where a take goes.
#[derive(Debug, Clone, PartialEq)]
pub enum TakeOutput {
    /// Meshes.
    Meshes(MeshOutput),
    /// An animated body in a `.glb`.
    Glb(PathBuf),
}

impl TakeOutput {
    /// The output of a name; a folder's files are of the format `format`.
    ///
    /// # Errors
    /// [`Error::Usage`]: the extension is of no format, a `.glb` is asked for in other units than
    /// its own, meters and y up, or
    /// `format` is given without a folder.
    pub fn of(path: &Path, format: Option<&str>, units: Units) -> Result<TakeOutput> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        let is_glb = extension.eq_ignore_ascii_case("glb");
        if is_glb && units != Units::CM_Y {
            return Err(Error::usage(
                "a .glb is in meters, y up; leave --out-units and --out-up out",
            ));
        }
        let output = if is_glb {
            TakeOutput::Glb(path.to_path_buf())
        } else {
            TakeOutput::Meshes(MeshOutput::of(path, format.unwrap_or("ply"))?)
        };
        let is_folder = matches!(output, TakeOutput::Meshes(MeshOutput::Folder(..)));
        match format {
            Some(format) if !is_folder => Err(Error::usage(format!(
                "--mesh-format {format} is for a folder; name one (ending in /), or leave it out"
            ))),
            _ => Ok(output),
        }
    }

    /// Fails before any work if the take's rate would be missed at the end.
    ///
    /// # Errors
    /// [`Error::Usage`]: an animation without times.
    pub fn check_times(&self, frames: usize, has_times: bool) -> Result<()> {
        match self {
            TakeOutput::Glb(_) if frames > 1 && !has_times => Err(Error::usage(
                "the table has no times, which an animation needs; give the rate with --fps",
            )),
            _ => Ok(()),
        }
    }

    /// Writes a take in the unit and axis `units`.
    ///
    /// # Errors
    /// Those of [`MeshOutput::write`] and `save_glb`.
    pub fn write(&self, take: &BodyTake, body: &BodyModel, units: Units) -> Result<()> {
        let faces = body.template.surface();
        let (count, digits) = (take.frames.len(), take.frames.len().max(10_000));
        match self {
            TakeOutput::Glb(path) => save_glb(path, body, take),
            TakeOutput::Meshes(output @ MeshOutput::Folder(..)) => {
                output.prepare()?;
                for start in (0..count).step_by(BLOCK) {
                    let end = (start + BLOCK).min(count);
                    let meshes = take.part(start..end).meshes(body);
                    output.write_files(start, digits, &meshes, faces, units)?;
                }
                Ok(())
            }
            TakeOutput::Meshes(output) => output.write(&take.meshes(body), faces, units),
        }
    }
}

fn save_glb(path: &Path, body: &BodyModel, take: &BodyTake) -> Result<()> {
    let skinned = SkinnedTake::new(body, take, &path.display().to_string())?;
    skinned.mesh.save(path)?;
    messages::info(&format!(
        "{}: {} frames; linear skinning with {} corrective shapes is {:.2} mm from the model \
         (mean)",
        path.display(),
        skinned.frames,
        skinned.corrections,
        skinned.error_mm
    ));
    Ok(())
}
