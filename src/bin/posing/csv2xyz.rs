//! Turns a table of markers of another program into a pose table.

use clap::Parser;
use posing::Result;
use posing::cli::choice::choice;
use posing::cli::marker_files::MarkerFileArgs;
use posing::io::{
    Input, MotionFormat, MotivePoints, NpzTake, keypoints, marker_csv, opensim, parse_point_names,
    read_npy,
};

/// Convert a table of another program to a pose table
///
/// Reads Motive CSV, Vicon CSV (Nexus' Trajectories or Tracker's Objects), Qualisys TSV (3D and
/// 6D), tables whose columns are NAME_x, NAME_y, NAME_z (or NAME.X, "NAME x"; Anipose), or names
/// above x, y, z (pandas, DeepLabCut), long tables (a row per point and frame), JSON of
/// MediaPipe's and OpenPose's keypoints in space (of OpenPose a folder with a frame per file), NPY
/// arrays and NPZ archives of positions, and OpenSim's .mot and .sto; the first lines tell which.
/// Writes a pose table in centimeters, y up: a row per frame, three columns per point, empty where
/// the file has an empty cell, NaN or null, or a confidence of 0. Other columns are carried along:
/// all of .mot and .sto, which hold no points, and the rotations of Qualisys 6D and Tracker as
/// NAME.rx, NAME.ry, NAME.rz, in degrees as in the file, or NAME.qx to NAME.qw. Zeros stay: a
/// position of exactly 0 0 0, which some programs write for a missing one, is reported. What a
/// file does not say is asked for: --up (Motive's default is y, QTM's and Vicon's z), --units
/// (Motive and Vicon say theirs, QTM exports millimeters), --fps. From Motive come the measured
/// markers or, without any, the expected ones or the bones: --points chooses.
#[derive(Parser)]
#[command(
    name = "csv2xyz",
    version,
    after_help = "Examples:\n  posing csv2xyz --up y motive.csv > walk.csv\n  posing csv2xyz --up \
                  z nexus.csv > walk.csv\n  posing csv2xyz --units mm --up z qualisys.tsv > \
                  walk.csv\n  posing csv2xyz --units m --up y --fps 30 anipose.csv > walk.csv\n  \
                  posing csv2xyz --fps 30 mediapipe.json > walk.csv\n  posing csv2xyz --units m \
                  --up -y --fps 30 openpose > walk.csv\n  posing csv2xyz angles.mot > angles.csv\n \
                  \x20posing csv2xyz --up y motive.csv | posing complete --self | posing xyz2c3d \
                  -o filled.c3d"
)]
pub struct Args {
    /// Points of a Motive file [default: the first of these that it has]
    #[arg(long, value_parser = choice::<MotivePoints>(), value_name = "KIND")]
    points: Option<MotivePoints>,
    /// Point names for an array without any: smpl, 23 (the CMU joints) or a comma-separated list
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    #[command(flatten)]
    file: MarkerFileArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let joints = args.joints.as_deref().map(parse_point_names).transpose()?;
    let read = |input: Input, keep_whole| match MotionFormat::of(input.first_bytes()) {
        MotionFormat::Keypoints => keypoints::read(input, keep_whole),
        MotionFormat::OpenSim => opensim::read(input, keep_whole),
        MotionFormat::Npy => read_npy(input, joints.as_deref()),
        MotionFormat::Npz => Ok(NpzTake::read(input, joints.as_deref())?.take),
        _ => marker_csv::read(input, args.points, keep_whole),
    };
    args.file.convert(read, false)
}
