//! OpenSim's .mot and .sto files, whole or cut off.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::opensim;
use posing_fuzz::{accepted, check_take, input};

fuzz_target!(|bytes: &[u8]| {
    for keep_whole in [false, true] {
        let take = input("t.mot", bytes).and_then(|i| opensim::read(i, keep_whole));
        if let Some(take) = accepted(take) {
            check_take(&take);
            assert_eq!(take.carried.rows.len().max(1), match take.carried.names.len() {
                0 => 1,
                _ => take.xyz.nrows(),
            });
        }
    }
});
