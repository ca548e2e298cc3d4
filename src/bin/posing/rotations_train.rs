//! Learns the prior over the rotations of a body's joints.

use clap::Parser;
use posing::cli::input::open;
use posing::cli::messages;
use posing::cli::paths::{OutputPath, check_read};
use posing::cli::progress::Progress;
use posing::cli::streams;
use posing::io::{Amc, Asf};
use posing::pose::Skeleton;
use posing::prior::provenance::{entry, hex};
use posing::prior::rotations::{LocalRotations, RotationPrior, local_rotations};
use posing::{Error, Place, Result};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Learn how the joints of people are rotated
///
/// xyz2bvh, xyz2amc and xyz2glb take the file with --rotations: what the positions of points leave
/// open, such as the twist of a limb, follows from it. A folder has the skeleton of one person
/// (ASF, with CMU's bones) and that person's takes (AMC). Each person weighs as the square root of
/// the number of frames. Of three people and more the lengths of their bones are learned too.
#[derive(Parser)]
#[command(
    name = "rotations-train",
    version,
    after_help = "Examples:\
        \n  posing rotations-train -o rotations.npz cmu/*/\
        \n  posing xyz2bvh --rotations rotations.npz -o walk.bvh walk.csv"
)]
pub struct Args {
    /// Folders, each with the skeleton and the takes of a person
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// Credit line of the training data, stored in the file
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// Output file
    #[arg(short, long, value_name = "ROTATIONS.npz")]
    output: OutputPath,
}

/// Frames of a take that are learned from, spread over it.
const MOST_FRAMES: usize = 300;

pub fn work(args: &Args) -> Result<()> {
    let bar = Progress::new("rotations-train", args.folders.len() as u64);
    let (mut subjects, mut skeletons) = (Vec::new(), Vec::new());
    let mut digests = Vec::new();
    for (n, folder) in args.folders.iter().enumerate() {
        let (skeleton, frames) = person(folder, &mut digests)?;
        skeletons.push(skeleton);
        subjects.push(frames);
        bar.set(n as u64 + 1);
    }
    drop(bar);
    let mut prior = RotationPrior::train(&subjects)?;
    match prior.clone().with_bones(&skeletons) {
        Ok(with_bones) => prior = with_bones,
        Err(e) => messages::info(&format!("bones were not learned: {e}")),
    }
    let mut model = prior.to_model();
    model.meta.credit.clone_from(&args.credit);
    let flags = [("frames", MOST_FRAMES.to_string())];
    model
        .meta
        .history
        .push(entry("rotations-train", &flags, digests));
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)
}

/// The skeleton of a person, and the rotations of the takes, at most [`MOST_FRAMES`] of each.
fn person(folder: &Path, digests: &mut Vec<String>) -> Result<(Skeleton, Vec<LocalRotations>)> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    files.sort();
    check_read(&files)?;
    let with = |ending: &str| {
        let is_one = |f: &&PathBuf| {
            f.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case(ending))
        };
        files.iter().filter(is_one).collect::<Vec<_>>()
    };
    let [skeleton] = with("asf")[..] else {
        let what = "has no skeleton or several; expected one ASF file and its AMC takes";
        return Err(Error::usage(format!("{}: {what}", folder.display())));
    };
    let asf = Asf::read(open(skeleton)?, None)?;
    let mut frames = Vec::new();
    for file in with("amc") {
        let amc = Amc::open(file, &asf)?;
        let every = amc.frames.numbers.len().div_ceil(MOST_FRAMES).max(1);
        let values = amc
            .frames
            .values
            .chunks_exact(asf.skeleton.dof_count().max(1));
        let thinned: Vec<&[f64]> = values.step_by(every).collect();
        frames.extend(local_rotations(&asf.skeleton, &thinned).map_err(|e| {
            let place = Place::file(skeleton.display().to_string());
            Error::data(place, e.to_string())
        })?);
        digests.push(of_file(file)?);
    }
    Ok((asf.skeleton, frames))
}

/// The digest of a file, by which a model tells what it was made from.
fn of_file(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    Ok(hex(&Sha256::digest(bytes)))
}
