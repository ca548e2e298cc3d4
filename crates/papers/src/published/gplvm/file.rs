//! A scaled GPLVM in a model file.

use super::process::Learned;
use crate::io::Model;
use crate::prior::model_arrays;
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2};

/// Largest number of active poses M; the kernel matrix is (M, M).
const MOST_ACTIVE: usize = 4000;

/// Stores the learned process in a model.
pub(crate) fn write(learned: &Learned, model: &mut Model) {
    let row = |v: &[f64]| Array2::from_shape_fn((1, v.len()), |(_, c)| v[c] as f32);
    let poses = &learned.poses + &Array1::from(learned.mean.clone());
    let mut put = |name: &str, array: Array2<f32>| model.insert(name, array);
    put("active", poses.mapv(|v| v as f32));
    put("latent", learned.latent.mapv(|v| v as f32));
    put("scales", row(&learned.scales));
    put("mean", row(&learned.mean));
    let details = &mut model.meta.details;
    details.insert("gamma".into(), learned.gamma.into());
    details.insert("noise".into(), learned.noise.into());
}

/// Reads and checks the arrays of a model; `source` names it in messages.
///
/// # Errors
/// [`Error::Data`]: an array or a number is missing, of a wrong shape or not finite.
pub(crate) fn read(model: &Model, source: &str) -> Result<Learned> {
    let width = 3 * model.meta.points.len();
    let place = |part: &str| Place::file(source).part(part);
    let array = |name: &str, rows, columns| {
        let array = model_arrays::array(model, name, (rows, columns), source);
        array.map(|a| a.mapv(f64::from))
    };
    let active = array("active", None, Some(width))?;
    let latent = array("latent", Some(active.nrows()), None)?;
    if latent.ncols() == 0 || active.nrows() > MOST_ACTIVE {
        let what = format!("has no columns, or more than {MOST_ACTIVE} rows");
        return Err(Error::data(place("latent"), what));
    }
    let scales = array("scales", Some(1), Some(width))?
        .into_raw_vec_and_offset()
        .0;
    let mean = array("mean", Some(1), Some(width))?.row(0).to_owned();
    let number = |name: &str| -> Result<f64> {
        let value = model
            .meta
            .details
            .get(name)
            .and_then(serde_json::Value::as_f64);
        let sound = value.filter(|v| *v > 0.0 && v.is_finite());
        sound.ok_or_else(|| Error::data(place("meta"), format!("needs {name}, a number above 0")))
    };
    if !scales.iter().all(|s| *s > 0.0) {
        return Err(Error::data(
            place("scales"),
            "holds a variance that is not above 0",
        ));
    }
    Ok(Learned {
        poses: active - &mean,
        latent,
        gamma: number("gamma")?,
        noise: number("noise")?,
        scales,
        mean: mean.to_vec(),
    })
}
