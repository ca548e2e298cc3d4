//! Pose tables as CSV: a pipe that gives a few bytes at a time makes the same table.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::{TableOptions, Table};
use posing_fuzz::{accepted, input, same, slow_input, use_one_thread};

fuzz_target!(init: use_one_thread(), |bytes: &[u8]| {
    for planar in [false, true] {
        let options = TableOptions {
            planar,
            cells: true,
            ..TableOptions::default()
        };
        let whole = input("t.csv", bytes).and_then(|i| Table::read(i, &options));
        let slow = slow_input("t.csv", bytes).and_then(|i| Table::read(i, &options));
        match (accepted(whole), accepted(slow)) {
            (Some(whole), Some(slow)) => {
                assert_eq!(whole.columns, slow.columns);
                assert_eq!(whole.poses.take, slow.poses.take);
                assert_eq!(whole.poses.time, slow.poses.time);
                assert_eq!(whole.poses.xyz.dim(), slow.poses.xyz.dim());
                let mut pairs = whole.poses.xyz.iter().zip(&slow.poses.xyz);
                assert!(pairs.all(|(a, b)| same(*a, *b)));
                let _ = (whole.poses.rate(), whole.poses.runs());
            }
            (whole, slow) => assert_eq!(whole.is_none(), slow.is_none()),
        }
    }
});
