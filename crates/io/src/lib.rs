#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Readers and writers of motion files, meshes and models.
//!
//! [`MotionFile`] opens a take of any format (BVH, C3D, TRC, AMC, CSV, NPY and others) with its
//! unit and axes, and writes it back; what was not changed stays as it was, byte for byte.
//! [`Table`] reads a table of poses from a stream, [`TableWriter`] writes one. Each format has a
//! type and a file of its own ([`Bvh`], [`C3d`], [`Asf`], [`Amc`]). [`Mesh`] is a
//! body, [`Model`] is a trained model, one NPZ file. An [`Output`] is at its path only when it is
//! complete.
//!
//! ```
//! use posing_io::{MotionFile, motion_file::ReadOptions};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("hand.csv");
//! std::fs::write(&path, "time,hand.x,hand.y,hand.z\n0.0,150,2,\n0.1,1e2,2,3\n")?;
//! let take = MotionFile::open(&path, &ReadOptions::default())?;
//! assert_eq!(take.rate(), Some(10.0));
//! assert!(take.poses().xyz[[0, 2]].is_nan()); // missing
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, numeric, pose};

pub mod amc;
pub(crate) mod asf;
mod asf_writer;
mod block_reader;
pub mod bvh;
pub(crate) mod c3d;
mod columns;
pub mod command_files;
pub mod csv;
#[cfg(feature = "fbx")]
pub mod fbx;
mod foreign_format;
mod frame_times;
pub mod input;
#[doc(hidden)]
pub mod keypoint_files;
pub mod keypoints;
mod long_titles;
pub mod marker_csv;
mod marker_rows;
pub(crate) mod marker_take;
pub mod mesh;
pub mod mesh_output;
pub mod model;
mod model_array;
pub mod model_outputs;
pub mod motion_file;
#[doc(hidden)]
pub mod motion_folder;
pub mod motion_format;
mod new_take;
pub mod npy;
pub mod npz;
mod npz_entries;
mod npz_take;
mod number_words;
pub mod opensim;
pub mod output;
mod point_move;
mod point_titles;
pub mod rotation_take;
mod row;
mod row_cells;
mod skeleton_file;
mod table;
mod table_archive;
mod table_reader;
mod table_writer;
pub mod text;
mod text_cells;
mod text_start;
pub mod trc;
mod unfinished_file;
pub mod unit_writer;
mod utf16;
pub mod zeros;

pub use amc::Amc;
pub use asf::Asf;
pub use bvh::Bvh;
pub use c3d::{Analog, C3d, FileEvent, ForcePlate, OutputPoint};
pub use columns::{Columns, parse_point_names};
pub use input::Input;
pub use marker_csv::MotivePoints;
pub use marker_take::{CarriedColumns, CarriedRows, MarkerTake, Quantity};
pub use mesh::{Mesh, MeshFormat, MeshSet};
pub use model::Model;
pub use model_array::{Matrix, PackedMatrix};
pub use motion_file::MotionFile;
pub use motion_format::MotionFormat;
pub use new_take::NewTake;
pub use npz_take::{NpzTake, read_npy};
pub use output::Output;
pub use point_move::PointMove;
pub use row::{Cells, Row, TableOptions};
pub use skeleton_file::SkeletonFile;
#[doc(hidden)]
pub use table::deviations;
pub use table::{PosesBuilder, Table};
pub use table_reader::{RowReader, TakeRows};
pub use table_writer::{TableFormat, TableWriter};
pub use text_cells::{Separator, TextCells};
