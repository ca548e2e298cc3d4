//! C3D files: what is read is written back byte for byte, and what is written of changed points is
//! read; what is beside the points makes a trial, or none.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::gait::{GaitSettings, GaitTrial, Trial};
use posing::io::C3d;
use posing::pose::{LengthUnit, UpAxis};
use posing_fuzz::{accepted, check_take, input};

fuzz_target!(|bytes: &[u8]| {
    let read = |bytes: &[u8]| input("t.c3d", bytes).and_then(|i| C3d::read(i, true));
    let Some(file) = accepted(read(bytes)) else {
        return;
    };
    check_take(&file.take);
    let trial = Trial::from_c3d(&file, Some(LengthUnit::Mm), Some(UpAxis::Z));
    if let Some(trial) = accepted(trial) {
        accepted(GaitTrial::new(&trial, Some(&trial), &GaitSettings::default()));
    }
    let same = accepted(file.with_points(file.take.xyz.view()));
    assert!(same.is_none_or(|same| same == bytes));
    let mut moved = file.take.xyz.mapv(|v| v + 1.0);
    moved.row_mut(0).fill(f64::NAN);
    if let Some(moved) = accepted(file.with_points(moved.view())) {
        assert_eq!(moved.len(), bytes.len());
        // Frames of a broken file may stand among its parameters; then it reads differently.
        if let Some(again) = accepted(read(&moved)) {
            check_take(&again.take);
        }
    }
});
