//! Pose tables as NPY arrays, of any order and precision.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::{TableOptions, Table};
use posing_fuzz::{accepted, input};

fuzz_target!(|bytes: &[u8]| {
    let options = TableOptions::default();
    let table = input("t.npy", bytes).and_then(|i| Table::read(i, &options));
    if let Some(table) = accepted(table) {
        assert_eq!(table.poses.xyz.ncols(), 3 * table.poses.points.len());
    }
});
