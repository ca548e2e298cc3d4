//! The flags that say what is taken for files that do not say it.

use super::args::{ZeroArgs, parse_rate};
use super::choice::named;
use super::fbx_choice::FbxChoiceArgs;
use crate::Result;
use crate::io::motion_file::{ReadOptions, ReadRules, Scope, Scoped};
use crate::io::parse_point_names;
use crate::pose::{LengthUnit, UpAxis};
use clap::Args;
use std::path::PathBuf;

/// What is taken for files that do not say it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Input")]
pub struct ReadArgs {
    #[command(flatten)]
    takes: TakeReadArgs,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's:
    /// 07.asf for 07_01.amc]
    #[arg(long, value_name = "SUBJECT.asf")]
    asf: Option<PathBuf>,
    #[command(flatten)]
    fbx: FbxChoiceArgs,
    /// Point names for an array: 23 (the CMU joints), smpl (22, 24, 52 or 55 joints) or a
    /// comma-separated list
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
}

/// What is taken for takes of points that do not say it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Input")]
pub struct TakeReadArgs {
    /// Frames per second of files that do not say it; c3d=100 is for files of a format, FOLDER=100
    /// for those of a folder, which counts first; several parted by commas, or the flag again
    #[arg(
        long,
        value_name = "[FORMAT|FOLDER=]F",
        value_delimiter = ',',
        value_parser = parse_scoped_rate
    )]
    fps: Vec<Scoped<f64>>,
    /// Unit of length of files that do not say it (BVH files and tables: cm): cm, m, mm, in or
    /// asf; for a format or a folder as for --fps
    #[arg(
        long,
        value_name = "[FORMAT|FOLDER=]UNIT",
        value_delimiter = ',',
        value_parser = parse_scoped_units
    )]
    units: Vec<Scoped<LengthUnit>>,
    /// Axis that points up in files that do not say it (BVH files and tables: y): x, y or z, or
    /// -x, -y or -z where that axis points down; for a format or a folder as for --fps
    #[arg(
        long,
        value_name = "[FORMAT|FOLDER=]AXIS",
        allow_hyphen_values = true,
        value_delimiter = ',',
        value_parser = parse_scoped_up
    )]
    up: Vec<Scoped<UpAxis>>,
    /// Axes of all files are left-handed, as Unity's and Unreal's: one is reflected (FBX files say
    /// it themselves)
    #[arg(long)]
    left_handed: bool,
    /// Accept files that end early (not tables): the whole frames before that are kept
    #[arg(long)]
    keep_whole: bool,
    #[command(flatten)]
    zeros: ZeroArgs,
}

impl ReadArgs {
    /// Checks the flags.
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: names of points that cannot be.
    pub fn rules(&self) -> Result<ReadRules> {
        let mut rules = self.takes.rules();
        rules.all.asf.clone_from(&self.asf);
        rules.all = self.fbx.chosen(rules.all);
        rules.all.joints = self.joints.as_deref().map(parse_point_names).transpose()?;
        Ok(rules)
    }
}

impl TakeReadArgs {
    /// What is taken for each file.
    pub fn rules(&self) -> ReadRules {
        ReadRules {
            fps: self.fps.clone(),
            units: self.units.clone(),
            up: self.up.clone(),
            all: ReadOptions {
                keep_whole: self.keep_whole,
                left_handed: self.left_handed,
                zeros_are_missing: self.zeros.zeros_are_missing,
                ..ReadOptions::default()
            },
        }
    }
}

/// `VALUE`, or `c3d=VALUE`, or `captures/lab1=VALUE`.
fn parse_scoped<T>(
    text: &str,
    value: impl Fn(&str) -> std::result::Result<T, String>,
) -> std::result::Result<Scoped<T>, String> {
    let (scope, text) = match text.rsplit_once('=') {
        Some((word, text)) => (Scope::parse(word).map_err(|e| e.to_string())?, text),
        None => (Scope::All, text),
    };
    let value = value(text)?;
    Ok(Scoped { scope, value })
}

fn parse_scoped_rate(text: &str) -> std::result::Result<Scoped<f64>, String> {
    parse_scoped(text, parse_rate)
}

fn parse_scoped_units(text: &str) -> std::result::Result<Scoped<LengthUnit>, String> {
    parse_scoped(text, |text| {
        named(text).ok_or_else(|| "expected cm, m, mm, in or asf".to_string())
    })
}

fn parse_scoped_up(text: &str) -> std::result::Result<Scoped<UpAxis>, String> {
    parse_scoped(text, |text| {
        named(text).ok_or_else(|| "expected x, y, z, -x, -y or -z".to_string())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_stands_behind_its_format() {
        let scoped = parse_scoped_up("c3d=z").unwrap();
        assert_eq!(
            (scoped.scope, scoped.value),
            (Scope::Format("c3d".into()), UpAxis::Z)
        );
        for (text, up) in [("-y", UpAxis::MinusY), ("trc=-z", UpAxis::MinusZ)] {
            assert_eq!(parse_scoped_up(text).unwrap().value, up);
        }
        for bad in ["w", "--y", "c3d=w", "c4d=z", "=z", "c3d="] {
            assert!(parse_scoped_up(bad).is_err(), "{bad}");
        }
    }
}
