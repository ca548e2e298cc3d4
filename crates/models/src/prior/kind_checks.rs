//! What each kind of prior keeps to, for the tests of the kinds that are always there and of those
//! that are registered.

use super::testdata::PriorExt;
use crate::io::Model;
use crate::pose::PoseTransform;
use crate::pose::rotation::from_rotation_vector;
use crate::prior::{Kind, open};
use crate::prior::{OpenOptions, Prior, TrainOptions, TrainingSet};
use glam::DVec3;
use ndarray::{Array2, s};

/// Three points on closed curves, in three takes.
fn poses() -> TrainingSet {
    TrainingSet {
        points: ["a", "b", "c"].map(String::from).to_vec(),
        xyz: Array2::from_shape_fn((120, 9), |(t, c)| {
            let phase = t as f32 * 0.11;
            20.0 * (phase + c as f32).sin() + 5.0 * (2.3 * phase + (c * c) as f32).cos()
        }),
        takes: vec![0..50, 50..80, 80..120],
        body: None,
        anchor: None,
        up: None,
        incomplete: 0,
        unplaced: 0,
    }
}

fn trained(kind: Kind) -> Model {
    kind.train(&poses(), &TrainOptions::default()).unwrap()
}

fn opened(model: &Model) -> Box<dyn Prior> {
    open(model, &OpenOptions::default(), "m").unwrap()
}

/// Observations with noise and gaps, and one of nothing.
fn observed() -> (Array2<f64>, Array2<f64>) {
    let mut noise = Array2::from_elem((40, 9), 1.0);
    noise.slice_mut(s![10..20, 3..6]).fill(f64::INFINITY);
    noise.slice_mut(s![25.., 1]).fill(0.1);
    noise.row_mut(39).fill(f64::INFINITY);
    (poses().xyz.slice(s![..40, ..]).mapv(f64::from) + 0.4, noise)
}

/// A model and its answers are the same bits on any number of threads, from a file or not, in a
/// batch or alone.
pub(crate) fn files_batches_and_threads_change_no_bit(kinds: &[Kind]) {
    let (y, noise) = observed();
    for &kind in kinds {
        let pool = |n| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap()
        };
        let model = pool(1).install(|| trained(kind));
        let bytes = model.to_bytes().unwrap();
        let again = pool(3).install(|| trained(kind)).to_bytes().unwrap();
        assert!(bytes == again, "{kind}");
        let prior = opened(&model);
        let read = opened(&Model::from_bytes(bytes, "m").unwrap());
        let all = pool(3).install(|| read.full_rows(y.view(), noise.view()));
        for (i, posterior) in all.iter().enumerate() {
            let alone = prior.full(&y.row(i).to_vec(), &noise.row(i).to_vec());
            assert_eq!(*posterior, alone, "{kind}");
            assert!(
                alone
                    .mean
                    .iter()
                    .chain(&alone.covariance)
                    .all(|v| v.is_finite())
            );
        }
        let none = Array2::zeros((0, 9));
        assert!(prior.full_rows(none.view(), none.view()).is_empty());
    }
}

/// The posterior of rotated poses is that of the poses, rotated.
pub(crate) fn rotated_poses_have_rotated_posteriors(kinds: &[Kind]) {
    let map = PoseTransform::Rotate(from_rotation_vector(DVec3::new(0.4, -1.0, 0.2)));
    let (y, noise) = observed();
    let rotated = map.apply_rows(y.view());
    for &kind in kinds {
        let prior = opened(&trained(kind));
        let mapped = prior.mapped(&map);
        // Whole points are missing, and those seen have equal noise.
        for i in [5, 15] {
            let (here, there) = (y.row(i).to_vec(), rotated.row(i).to_vec());
            let noise = noise.row(i).to_vec();
            let (here, there) = (prior.full(&here, &noise), mapped.full(&there, &noise));
            let mut mean = vec![0.0; 9];
            map.apply(&here.mean, &mut mean);
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-2;
            assert!(
                mean.iter().zip(&there.mean).all(|(a, b)| near(*a, *b)),
                "{kind}"
            );
            let covariance = map.apply_covariance(here.covariance.view());
            let mut both = covariance.iter().zip(&there.covariance);
            assert!(both.all(|(a, b)| near(*a, *b)), "{kind}");
        }
    }
}

/// A number that is not finite is an error, whichever array it stands in.
pub(crate) fn a_damaged_array_is_an_error_that_names_it(kinds: &[Kind]) {
    for &kind in kinds {
        let model = trained(kind);
        for (name, _) in model
            .arrays()
            .filter(|(name, _)| !name.starts_with("rigid"))
        {
            let mut broken = model.clone();
            let mut array = model.get(name).unwrap().into_owned();
            array[[0, 0]] = f32::NAN;
            broken.insert(name, array);
            let Err(e) = open(&broken, &OpenOptions::default(), "m") else {
                panic!("{kind}: {name}")
            };
            assert!(e.to_string().starts_with(&format!("m: {name}")), "{e}");
        }
    }
}
