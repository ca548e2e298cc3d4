//! Drawings: figures as SVG, pages that play takes and meshes, pages of text.

pub mod figure;
pub(crate) mod href;
pub(crate) mod html;
pub mod mesh_scene;
pub mod mesh_sequences;
pub(crate) mod plain_page;
pub mod player;
pub mod scene;
mod scene_geometry;
pub(crate) mod take_page;
pub(crate) mod text_table;
