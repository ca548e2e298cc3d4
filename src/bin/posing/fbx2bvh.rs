//! Turns takes of an FBX file into BVH files.

use clap::Parser;
use posing::cli::endings::check_ending;
use posing::cli::fbx_args::FbxArgs;
use posing::cli::messages;
use posing::cli::paths::{OutputPath, check_written};
use posing::cli::streams::write_bytes;
use posing::io::fbx::to_bvh;
use posing::io::motion_folder::{file_name_part, is_results_folder, name_of, unpacked};
use posing::io::{FbxFile, FbxTake};
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// Convert an FBX file to BVH
///
/// Writes the rotations of its skeleton as BVH in centimeters, y up, whatever the file's unit and
/// axes. The zero pose is the rest pose: the bind pose, where the file has one, else how the nodes
/// stand. The root has position channels, and each joint that moves within its parent's bone; all
/// joints are where the FBX file has them in every frame. Names stay, with _ for blanks. (What is
/// written is BVH or, by retarget and xyz2glb, GLB; never FBX.)
///
/// A file of several takes or skeletons needs --take or --skeleton, or a folder, into which each is
/// written. Keys that are no numbers are refused: clean fills them.
#[derive(Parser)]
#[command(
    name = "fbx2bvh",
    version,
    after_help = "Examples:\
        \n  posing fbx2bvh walk.fbx -o walk-fbx.bvh\
        \n  posing fbx2bvh --fps 30 walk.fbx -o takes/"
)]
pub struct Args {
    #[command(flatten)]
    fbx: FbxArgs,
    /// Write to OUT instead of standard output, or each take and skeleton into the folder DIR
    #[arg(short, long, value_name = "OUT.bvh|DIR", help_heading = "Output")]
    output: Option<OutputPath>,
}

pub fn work(args: &Args) -> Result<()> {
    let file = args.fbx.open()?;
    let path = args.fbx.path();
    let folder = args.output.as_deref();
    let Some(folder) = folder.filter(|output| is_results_folder(output, &path)) else {
        let text = text(args, &file, &file.take(&args.fbx.choice())?)?;
        check_ending(args.output.as_deref(), "bvh")?;
        return write_bytes(args.output.as_deref(), &text, false);
    };
    let takes = file.takes_of(&args.fbx.choice())?;
    let mut results = Vec::new();
    for take in &takes {
        results.push((
            result(folder, &path, take, &takes),
            text(args, &file, take)?,
        ));
    }
    check_written(results.iter().map(|(path, _)| path))?;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    for (path, text) in &results {
        write_bytes(Some(path), text, false)?;
    }
    Ok(())
}

/// The BVH file of a take.
fn text(args: &Args, file: &FbxFile, take: &FbxTake) -> Result<Vec<u8>> {
    let bvh = to_bvh(&args.fbx.motion(file, take)?);
    let said = |note: &String| messages::info(&format!("{}: {note}", file.name()));
    bvh.notes.iter().for_each(said);
    let missing = bvh.missing();
    if let Some((frame, _)) = missing.first() {
        let what = format!(
            "{} values of channels are missing, the first in frame {}: keys are not numbers; \
             `posing clean` fills them",
            missing.len(),
            frame + 1
        );
        return Err(Error::data(Place::file(file.name()), what));
    }
    Ok(bvh.to_bytes(1.0))
}

/// Where a take goes: under the file's name, and that of the skeleton and the take where there are
/// several.
fn result(folder: &Path, path: &Path, take: &FbxTake, all: &[FbxTake]) -> PathBuf {
    let name = match path.to_str() {
        Some("-") => "take".into(),
        _ => unpacked(&name_of(path)).with_extension(""),
    };
    let mut parts = vec![name.display().to_string()];
    if all.iter().any(|other| other.skeleton != take.skeleton) {
        parts.push(file_name_part(&take.skeleton));
    }
    if all.iter().any(|other| other.name != take.name) {
        parts.push(file_name_part(&take.name));
    }
    folder.join(parts.join("-") + ".bvh")
}
