//! Maps of names, TOML.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::cli::toml_file;
use posing_fuzz::accepted;
use std::collections::BTreeMap;

fuzz_target!(|text: &str| {
    let _ = accepted(toml_file::parse::<BTreeMap<String, String>>(text, "t.toml"));
});
