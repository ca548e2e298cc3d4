//! The model that is compiled in, for commands that name none. Made by `make model`; see `posing
//! model info`.

use crate::Result;
use crate::io::Model;

/// The file as `make model` left it.
static BYTES: &[u8] = include_bytes!("builtin.npz");

/// The model that is compiled in.
///
/// ```
/// let model = posing_models::prior::builtin_model()?;
/// assert_eq!(model.meta.points.len(), 23); // CMU's joints
/// assert_eq!(model.meta.kind, "multiscale");
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// None in a sound build.
pub fn builtin_model() -> Result<Model> {
    Model::from_bytes(BYTES, "the built-in model")
}
