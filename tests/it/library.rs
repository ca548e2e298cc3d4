//! The library as README.md shows it: programs of ten lines.

use posing::io::NewTake;
use posing::io::motion_file::{MotionFile, ReadOptions};
use posing::pose::{LengthUnit, Poses, Units, UpAxis};
use posing::restore::{Complete, Restorer};
use std::path::Path;

/// A C3D file of five points that swing together; the last has a gap.
fn write_c3d(path: &Path) {
    let points: Vec<String> = (0..5).map(|p| format!("M{p}")).collect();
    let at = |(t, c): (usize, usize)| {
        let (p, axis) = (c / 3, c % 3);
        let swing = (0.05 * t as f64).sin() * [20.0, 5.0, 40.0][axis];
        swing + [10.0 * p as f64, 90.0, 7.0 * (p * p) as f64][axis]
    };
    let mut xyz = ndarray::Array2::from_shape_fn((200, 15), at);
    xyz.slice_mut(ndarray::s![80..95, 12..]).fill(f64::NAN);
    let poses = Poses {
        points,
        xyz,
        ..Poses::default()
    };
    let units = Units {
        unit: LengthUnit::Mm,
        up: UpAxis::Z,
    };
    let bytes = NewTake::new(poses, 100.0, units).c3d().unwrap();
    std::fs::write(path, bytes).unwrap();
}

fn fill(from: &Path, to: &Path) -> posing::Result<usize> {
    let file = MotionFile::open(from, &ReadOptions::default())?;
    let done = Restorer::without_model().complete(&file.table, &Complete::default())?;
    file.write_back(to, done.xyz())
}

#[test]
fn a_c3d_file_is_opened_filled_and_written_back() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (
        folder.path().join("gait.c3d"),
        folder.path().join("filled.c3d"),
    );
    write_c3d(&from);
    assert_eq!(fill(&from, &to).unwrap(), 0);
    let read = |path: &Path| MotionFile::open(path, &ReadOptions::default()).unwrap();
    let (gappy, whole) = (read(&from), read(&to));
    let missing = |file: &MotionFile| file.poses().xyz.iter().filter(|v| v.is_nan()).count();
    assert_eq!((missing(&gappy), missing(&whole)), (45, 0));
    // What was measured stays.
    let same = gappy.poses().xyz.iter().zip(&whole.poses().xyz);
    assert!(
        same.clone()
            .all(|(a, b)| a.is_nan() || a.to_bits() == b.to_bits())
    );
    // Positions of another shape are refused, not cut.
    let refused = gappy.write_back(&to, ndarray::Array2::zeros((9, 15)).view());
    assert!(refused.unwrap_err().to_string().contains("200 x 5"));
    // The swing goes on in the gap.
    let x = whole.poses().xyz[[87, 12]];
    assert!(
        (x - 40.0 - 20.0 * (0.05_f64 * 87.0).sin()).abs() <= 1.0,
        "{x}"
    );
}
