//! Inputs in gzip or zstd, and what is in them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::{TableOptions, Table};
use posing_fuzz::{accepted, input};

fuzz_target!(|bytes: &[u8]| {
    let _ = accepted(input("t.gz", bytes).and_then(|i| i.read_all(1 << 26)));
    let options = TableOptions::default();
    let _ = accepted(input("t.gz", bytes).and_then(|i| Table::read(i, &options)));
});
