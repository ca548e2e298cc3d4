//! The names that most programs need: `use posing::prelude::*;`
//!
//! ```
//! use posing::prelude::*;
//! # fn main() -> Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let whole = folder.path().join("whole.csv");
//! # let asf = Asf::open(concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/cmu/07/07.asf"))?;
//! # let amc = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/cmu/07/07_01.amc");
//! # let mut take = Amc::open(amc, &asf)?
//! #     .to_poses(120.0)?
//! #     .slice(0..60);
//! # let wrist = take.points.iter().position(|p| p == "lwrist").unwrap();
//! # take.xyz.slice_mut(ndarray::s![20..30, 3 * wrist..3 * wrist + 3]).fill(f64::NAN);
//! # let walk = Table::from_poses(take);
//! let model = builtin_model()?;
//! // let walk = Table::open("walk.csv")?;
//! let options = Complete { max_gap: Some(0.5), ..Default::default() };
//! let done = Restorer::new(&model).complete(&walk, &options)?;
//! assert_eq!(done.filled(), 10); // one point of ten frames
//! done.table().save(&whole)?;
//! # Ok(())
//! # }
//! ```
//!
//! A marker file in, its gaps filled, the file out with all else that it holds:
//!
//! ```
//! use posing::prelude::*;
//! # fn main() -> Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let (walk, filled) = (folder.path().join("walk.trc"), folder.path().join("filled.trc"));
//! # let head = "PathFileType\t4\t(X/Y/Z)\twalk.trc\nDataRate\tCameraRate\tNumFrames\t\
//! #     NumMarkers\tUnits\n100\t100\t9\t1\tmm\nFrame#\tTime\tknee\n\t\tX1\tY1\tZ1\n";
//! # let cells = |i| if i == 4 { "\t\t".into() } else { format!("{}\t500\t0", 10 * i) };
//! # let rows = (0..9).map(|i| format!("{}\t0.0{i}\t{}\n", i + 1, cells(i)));
//! # std::fs::write(&walk, head.to_string() + &rows.collect::<String>()).unwrap();
//! // let walk = "walk.c3d"; // or .trc, .bvh, .csv
//! let options = ReadOptions { up: Some(UpAxis::Y), ..ReadOptions::default() };
//! let file = MotionFile::open(&walk, &options)?;
//! let done = Restorer::without_model().complete(&file.table, &Complete::default())?;
//! // Positions that the numbers of the format cannot hold.
//! let out_of_range = file.write_back(&filled, done.xyz())?;
//! assert_eq!((done.filled(), out_of_range), (1, 0));
//! # Ok(())
//! # }
//! ```

pub use crate::cluster::KMeans;
pub use crate::edit::Session;
pub use crate::evaluate::Score;
pub use crate::ik::SkeletonFit;
pub use crate::ik::retarget::{RetargetOptions, Retargeter};
pub use crate::ik::rotation_cleaning::{RotationCleaning, clean_rotations};
pub use crate::io::motion_file::{MotionFile, ReadOptions};
pub use crate::io::{Amc, Asf, Bvh, Model, Table};
pub use crate::label::{LabelSettings, check_labels};
pub use crate::pose::{Body, Observation, Poses, Skeleton, Space, UpAxis};
pub use crate::prior::{
    self, Kind, OpenOptions, Posterior, Prior, TrainOptions, TrainingSet, Want, builtin_model,
};
pub use crate::restore::{Clean, Complete, Denoise, Restoration, Restorer};
pub use crate::solve::{JointSet, SolveSettings, solve};
pub use crate::sparse::{Dictionary, Encoder, Ksvd, Omp, SparseCodes};
pub use crate::{Error, Result};
