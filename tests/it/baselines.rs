//! The parametric priors beside scikit-learn's on the same poses
//! (`testdata/expected/prior/make.py`).

use ndarray::Array2;
use posing::prior::published::gaussian::MixtureParams;
use posing::prior::published::gaussian::em::{self, Stop};
use posing::prior::published::gaussian::{mfa, mixture};
use posing::prior::training_set::TrainingSet;
use posing::prior::{Kind, TrainOptions, published};
use std::path::Path;

/// The take as make.py damages it.
fn poses() -> TrainingSet {
    let table =
        crate::common::take("07", "07_01", &["--space", "body"]).expect("a take of testdata");
    let numbers = crate::common::Numbers::read(&table);
    let (n, d) = (numbers.rows.len(), numbers.rows[0].len());
    let xyz = Array2::from_shape_fn((n, d), |(t, c)| {
        let (a, b) = (t as f64, c as f64);
        (numbers.rows[t][c] + (a * 12.9898 + b * 78.233 + a * b * 0.37).sin()) as f32
    });
    TrainingSet {
        points: numbers.points,
        takes: std::iter::once(0..n).collect(),
        xyz,
        body: None,
        anchor: None,
        up: None,
        incomplete: 0,
        unplaced: 0,
    }
}

fn expected(name: &str) -> Vec<Vec<f64>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/expected/prior");
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    let row = |line: &str| line.split(',').map(|v| v.parse().unwrap()).collect();
    text.lines().map(row).collect()
}

#[test]
fn pca_spans_the_same_subspace() {
    let poses = poses();
    published::register();
    let kind: Kind = "pca".parse().unwrap();
    let model = kind.train(&poses, &TrainOptions::default()).unwrap();
    let parts = MixtureParams::read(&model, "pca").unwrap();
    let theirs = expected("pca.csv");
    assert_eq!(parts.factors.nrows(), theirs.len());
    for (ours, theirs) in parts.factors.rows().into_iter().zip(&theirs) {
        let length = ours.dot(&ours);
        assert!((length / theirs[0] - 1.0).abs() <= 1e-4);
        let cosine: f64 = ours.iter().zip(&theirs[1..]).map(|(a, b)| a * b).sum();
        assert!((cosine.abs() / length.sqrt() - 1.0).abs() <= 1e-4);
    }
}

#[test]
fn the_mixture_is_as_likely_from_the_same_start() {
    let poses = poses();
    let n = poses.xyz.nrows();
    let labels: Vec<u32> = (0..n).map(|i| (i * 4 / n) as u32).collect();
    let start = mixture::full(&em::moments_of(poses.xyz.view(), &labels, 4));
    let stop = Stop {
        rounds: 200,
        gain: 1e-6,
    };
    let fitted = em::fit(poses.xyz.view(), start, stop, &mut mixture::full);
    let likelihood = em::likelihood(poses.xyz.view(), &fitted.mixture);
    let theirs = expected("mixture.csv")[0][0];
    assert!(likelihood >= theirs - 0.05, "{likelihood} against {theirs}");
}

#[test]
fn one_factor_analyzer_is_as_likely() {
    let poses = poses();
    let stop = Stop {
        rounds: 500,
        gain: 1e-6,
    };
    let (_, fitted) = mfa::fit(poses.xyz.view(), (1, 10), 0, stop).unwrap();
    let likelihood = em::likelihood(poses.xyz.view(), &fitted.mixture);
    let theirs = expected("factors.csv")[0][0];
    assert!(likelihood >= theirs - 0.05, "{likelihood} against {theirs}");
    let falls = |w: &[f64]| w[1] < w[0] - 1e-9;
    assert!(!fitted.likelihood.windows(2).any(falls));
}
