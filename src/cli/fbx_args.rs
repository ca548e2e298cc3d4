//! The flags of commands that convert an FBX file: the file, its take, its skeleton, its rate.

use super::args::parse_rate;
use super::fbx_choice::FbxChoiceArgs;
use super::input::open;
use super::messages;
use crate::Result;
use crate::io::{FbxChoice, FbxFile, FbxMotion, FbxTake, fbx};
use clap::Args;
use std::path::PathBuf;

/// The file and what is taken of it.
#[derive(Debug, Clone, Args)]
pub struct FbxArgs {
    /// FBX file; - or nothing: standard input
    #[arg(value_name = "FILE.fbx")]
    file: Option<PathBuf>,
    #[command(flatten)]
    choice: FbxChoiceArgs,
    /// Frames per second of the result [default: the file's, or that of its keys where these are
    /// closer]
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
}

impl FbxArgs {
    /// The path of the file; `-` is standard input.
    pub fn path(&self) -> PathBuf {
        self.file.clone().unwrap_or_else(|| PathBuf::from("-"))
    }

    /// Opens the file.
    ///
    /// # Errors
    /// Those of [`fbx::read`].
    pub fn open(&self) -> Result<FbxFile> {
        fbx::read(open(&self.path())?)
    }

    /// What the flags choose.
    pub fn choice(&self) -> FbxChoice {
        FbxChoice {
            take: self.choice.take.clone(),
            skeleton: self.choice.skeleton.clone(),
        }
    }

    /// The motion of a take; what was odd is said.
    ///
    /// # Errors
    /// Those of [`FbxFile::motion`].
    pub fn motion(&self, file: &FbxFile, take: &FbxTake) -> Result<FbxMotion> {
        let motion = file.motion(take, self.fps)?;
        let said = |note: &String| messages::info(&format!("{}: {note}", file.name()));
        motion.notes.iter().for_each(said);
        Ok(motion)
    }
}
