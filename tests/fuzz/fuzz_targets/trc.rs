//! TRC files, whole or cut off.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::trc;
use posing_fuzz::{accepted, check_take, input};

fuzz_target!(|bytes: &[u8]| {
    for keep_whole in [false, true] {
        let take = input("t.trc", bytes).and_then(|i| trc::read(i, keep_whole));
        if let Some(take) = accepted(take) {
            check_take(&take);
        }
    }
});
