#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Drawings: figures as SVG, pages that play takes and meshes, pages of text.
//!
//! [`figure`] draws poses side by side as SVG; [`player`] writes one HTML page without other files
//! that plays takes, with what happened to each point in time; [`scene`], [`pair`] and
//! [`mesh_scene`] are what the pages show.
//!
//! ```
//! use ndarray::array;
//! use posing_draw::figure::{self, Options};
//! use posing_draw::scene::{Figure, Scene};
//!
//! let xyz = array![[0.0, 90.0, 0.0, 0.0, 45.0, 5.0]]; // one frame: hip and knee
//! let points = ["hip", "knee"].map(String::from);
//! let leg = Figure { name: "a leg", xyz: xyz.view(), status: None, sd: None, method: None };
//! let (bones, figures) = (&[(0, 1)][..], vec![leg]);
//! let scene = Scene { points: &points, bones, rate: 1.0, figures, ..Scene::default() };
//! let svg = figure::svg(&scene, &[0], &Options::default())?;
//! assert!(svg.starts_with("<svg"));
//! # Ok::<(), posing_core::Error>(())
//! ```

use posing_core::{Error, Place, Result, numeric, pose};
use posing_io as io;

pub mod figure;
#[doc(hidden)]
pub mod href;
#[doc(hidden)]
pub mod html;
pub mod mesh_scene;
pub mod mesh_sequences;
pub mod pair;
#[doc(hidden)]
pub mod plain_page;
pub mod player;
pub mod scene;
mod scene_geometry;
#[doc(hidden)]
pub mod stick_picture;
#[doc(hidden)]
pub mod take_page;
#[doc(hidden)]
pub mod text_table;
