//! Positions in NPZ archives, and the way back.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::NpzTake;
use posing_fuzz::{accepted, check_take, input};

fuzz_target!(|bytes: &[u8]| {
    let names = ["smpl".to_string()];
    for joints in [None, Some(&names[..])] {
        let read = input("t.npz", bytes).and_then(|i| NpzTake::read(i, joints));
        if let Some(npz) = accepted(read) {
            check_take(&npz.take);
            accepted(npz.with_points(npz.take.xyz.mapv(|v| v + 1.0).view()));
        }
    }
    let is_other = input("t.npz", bytes).and_then(NpzTake::is_other);
    accepted(is_other);
});
