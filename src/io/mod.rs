//! Readers and writers, nothing else: they know `pose` and no flags.

pub mod amc;
pub mod asf;
mod block_reader;
pub mod bvh;
mod columns;
pub mod csv;
pub mod glb;
pub mod input;
mod matrix;
pub mod mesh;
pub mod model;
pub mod npy;
pub mod npz;
mod other_formats;
pub mod output;
mod row;
mod skeleton_file;
mod table;
mod table_reader;
mod table_writer;
pub mod text;

pub use amc::Amc;
pub use asf::Asf;
pub use bvh::Bvh;
pub use columns::{Columns, parse_point_names};
pub use glb::SkinnedMesh;
pub use input::Input;
pub use mesh::{Mesh, MeshFormat, MeshSet};
pub use model::Model;
pub use output::Output;
pub use row::{Cells, ReadOptions, Row};
pub use skeleton_file::SkeletonFile;
pub use table::{PosesBuilder, Table};
pub use table_reader::RowReader;
pub use table_writer::{TableFormat, TableWriter};
