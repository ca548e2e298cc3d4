//! Random poses as the initial atoms of K-SVD.

use super::Dictionary;
use crate::numeric::parallel;
use crate::{Error, Place, Result};
use ndarray::{ArrayView2, Axis};
use rand::seq::SliceRandom;
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hasher};

/// `n` distinct poses of (m, D), drawn at random, scaled to unit norm: atoms to start from.
///
/// More atoms of one seed begin with the same ones. Poses that are zero cannot be atoms, and equal
/// poses count once.
///
/// ```
/// use posing_models::sparse::random_atoms;
///
/// let poses = ndarray::array![[3.0_f32, 4.0], [0.0, 0.0], [3.0, 4.0], [0.0, 5.0]];
/// assert_eq!(random_atoms(poses.view(), 2, 0)?.len(), 2);
/// assert!(random_atoms(poses.view(), 3, 0).is_err()); // one is zero, two are equal
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// Fewer such poses than atoms, or a pose that is not finite.
pub fn random_atoms(poses: ArrayView2<f32>, n: usize, seed: u64) -> Result<Dictionary> {
    let rows = distinct(poses, n, seed);
    if rows.len() < n {
        let found = rows.len();
        return Err(Error::usage(format!(
            "{n} atoms, but only {found} training poses are distinct and not zero; use at most \
             {found} atoms"
        )));
    }
    atoms_of(poses, &rows)
}

/// Up to `n` rows of (m, D) that differ and are not zero, in an order drawn at random.
pub(super) fn distinct(poses: ArrayView2<f32>, n: usize, seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..poses.nrows()).collect();
    order.shuffle(&mut parallel::rng(seed, 0));
    let mut seen = HashSet::new(); // 128 bits a pose in place of the pose
    let new = |&i: &usize| {
        let mut hashers = [DefaultHasher::new(), DefaultHasher::new()];
        hashers[1].write_u8(1);
        for value in poses.row(i) {
            hashers
                .iter_mut()
                .for_each(|h| h.write_u32(value.to_bits()));
        }
        poses.row(i).iter().any(|&v| v != 0.0) && seen.insert(hashers.map(|h| h.finish()))
    };
    order.into_iter().filter(new).take(n).collect()
}

/// The poses `rows` as atoms.
pub(super) fn atoms_of(poses: ArrayView2<f32>, rows: &[usize]) -> Result<Dictionary> {
    if let Some(i) = rows
        .iter()
        .find(|&&i| poses.row(i).iter().any(|v| !v.is_finite()))
    {
        let what = "a training pose has a coordinate that is missing or not finite";
        return Err(Error::data(
            Place::line("training poses", (i + 1) as u64),
            what,
        ));
    }
    Dictionary::from_rows(poses.select(Axis(0), rows).view())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, s};

    #[test]
    fn poses_are_drawn_once_and_larger_draws_begin_with_smaller_ones() {
        let y = Array2::from_shape_fn((50, 3), |(i, j)| (i * 3 + j) as f32 + 1.0);
        let all = random_atoms(y.view(), 50, 4).unwrap();
        assert_eq!(all.len(), 50);
        let some = random_atoms(y.view(), 20, 4).unwrap();
        assert_eq!(some.atoms(), all.atoms().slice(s![..20, ..]));
        assert_ne!(random_atoms(y.view(), 20, 5).unwrap(), some);
    }

    #[test]
    fn zero_and_repeated_poses_do_not_count() {
        let mut y = Array2::from_shape_fn((10, 2), |(i, j)| (i / 2 + j) as f32 + 1.0);
        y.slice_mut(s![..2, ..]).fill(0.0);
        assert_eq!(random_atoms(y.view(), 4, 0).unwrap().len(), 4);
        let said = random_atoms(y.view(), 5, 0).unwrap_err();
        assert!(said.to_string().contains("at most 4"), "{said}");
        y[[5, 0]] = f32::NAN;
        assert!(random_atoms(y.view(), 5, 0).is_err());
    }
}
