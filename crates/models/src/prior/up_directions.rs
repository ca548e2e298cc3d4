//! Which way is up for each training pose: how the pelvis was tilted, which the model's space does
//! not keep.

use super::model_arrays;
use crate::io::Model;
use crate::pose::Similarity;
use crate::{Error, Place, Result};
use glam::DVec3;
use ndarray::{Array2, Axis};

/// The array's name in files: (N, 3), the unit vector of the world's y axis in the space of each of
/// the `poses` (N, 3 J).
const ARRAY: &str = "up";
/// Where y is up, people are upright most of the time: the mean of their up directions is at least
/// this long. CMU's is .95; that of people who turn about another axis is near zero.
const LEAST_MEAN: f64 = 0.5;

/// The up directions (m, 3) of poses that were placed so; `None` where y is not up, or where all
/// poses were aligned: then they are in body space, which says nothing of the world.
pub(super) fn of_placements(placements: &[Similarity]) -> Option<Array2<f32>> {
    let up = |p: &Similarity| p.rotation.transpose() * DVec3::Y;
    let sum: DVec3 = placements.iter().map(up).sum();
    let are_aligned = placements.iter().all(|p| *p == Similarity::IDENTITY);
    if are_aligned || sum.length() < LEAST_MEAN * placements.len() as f64 {
        return None;
    }
    let all: Vec<f32> = (placements.iter())
        .flat_map(|p| up(p).as_vec3().to_array())
        .collect();
    Array2::from_shape_vec((placements.len(), 3), all).ok()
}

/// Stores the up directions of the poses in `rows`, which the model keeps.
pub(super) fn write(up: Option<&Array2<f32>>, rows: &[usize], model: &mut Model) {
    if let Some(up) = up {
        model.insert_quantized(ARRAY, &up.select(Axis(0), rows));
    }
}

/// Reads what [`write`] left (N, 3); `None` where the model named `source` has none.
///
/// # Errors
/// Data: not one direction for each of the model's poses.
pub fn read(model: &Model, source: &str) -> Result<Option<Array2<f64>>> {
    let (Some(_), Some(poses)) = (model.get(ARRAY), model.get("poses")) else {
        return Ok(None);
    };
    let up = model_arrays::array(model, ARRAY, (Some(poses.nrows()), Some(3)), source)?;
    let up = up.mapv(f64::from);
    let is_unit = |v: f64| (v - 1.0).abs() <= 0.01;
    if !up.rows().into_iter().all(|row| is_unit(row.dot(&row))) {
        let what = "holds a direction that is no unit vector; train the model again";
        return Err(Error::data(Place::file(source).part(ARRAY), what));
    }
    Ok(Some(up))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;

    fn placed(turn: DVec3) -> Similarity {
        Similarity {
            rotation: from_rotation_vector(turn),
            shift: DVec3::new(1.0, 90.0, 2.0),
            scale: 1.0,
        }
    }

    #[test]
    fn up_is_kept_in_the_space_of_the_pose_where_y_is_up() {
        let lean = from_rotation_vector(DVec3::X * 0.3);
        let turns = (0..9).map(|k| Similarity {
            rotation: from_rotation_vector(DVec3::Y * f64::from(k)) * lean,
            ..placed(DVec3::ZERO)
        });
        let up = of_placements(&turns.collect::<Vec<_>>()).unwrap();
        let expected = lean.transpose() * DVec3::Y;
        for row in up.rows() {
            let off = DVec3::new(row[0].into(), row[1].into(), row[2].into()) - expected;
            assert!(off.length() <= 1e-6);
        }
        // About z, as where z is up; and in body space.
        let about_z = (0..9).map(|k| placed(DVec3::Z * f64::from(k) * 0.7));
        assert!(of_placements(&about_z.collect::<Vec<_>>()).is_none());
        assert!(of_placements(&[Similarity::IDENTITY; 3]).is_none());
    }

    #[test]
    fn it_travels_in_a_model_that_keeps_its_poses() {
        let mut model = Model::new("multiscale", &["a".to_string()], "world");
        let up = Array2::from_shape_fn((4, 3), |(_, c)| if c == 1 { 1.0 } else { 0.0 });
        write(Some(&up), &[0, 2], &mut model);
        assert!(read(&model, "m").unwrap().is_none());
        model.insert("poses", Array2::zeros((2, 3)));
        assert_eq!(read(&model, "m").unwrap().unwrap().dim(), (2, 3));
        model.insert(ARRAY, Array2::zeros((2, 3)));
        assert!(read(&model, "m").is_err());
        model.insert(ARRAY, Array2::zeros((3, 3)));
        assert!(read(&model, "m").is_err());
    }
}
