//! Motive's CSV and Qualisys' TSV files, with each choice of points.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::{MotivePoints, marker_csv};
use posing_fuzz::{accepted, check_take, input};

fuzz_target!(|bytes: &[u8]| {
    let kinds = [
        MotivePoints::Markers,
        MotivePoints::Expected,
        MotivePoints::Bones,
    ];
    for points in [None].into_iter().chain(kinds.map(Some)) {
        let take = input("t.csv", bytes).and_then(|i| marker_csv::read(i, points, true));
        if let Some(take) = accepted(take) {
            check_take(&take);
        }
    }
});
