//! NPZ models: read, written again, and opened as a pose model, a metric and a body model.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::body::BodyModel;
use posing::io::Model;
use posing::metric::PoseMetric;
use posing::prior::{OpenOptions, open, published};
use posing_fuzz::{accepted, use_one_thread};

fn init() {
    use_one_thread();
    published::register();
}

fuzz_target!(init: init(), |bytes: &[u8]| {
    let bytes = with_checksums(bytes.to_vec());
    let Some(model) = accepted(Model::from_bytes(bytes, "t.npz")) else {
        return;
    };
    let written = model.to_bytes().expect("what was read is written");
    let again = Model::from_bytes(written.clone(), "t.npz").expect("and read again");
    assert_eq!(again.to_bytes().expect("and written again"), written);
    let _ = accepted(open(&model, &OpenOptions::default(), "t.npz"));
    let _ = accepted(PoseMetric::from_model(&model, "t.npz"));
    let _ = accepted(BodyModel::from_model(&model, "t.npz"));
});

/// The archive with the right checksums of its plain entries: a changed array would be refused for its checksum alone.
fn with_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    let number = |bytes: &[u8], at: usize, width: usize| {
        let digits = bytes.get(at..at + width)?.iter().rev();
        Some(digits.fold(0, |n, b| n << 8 | usize::from(*b)))
    };
    let mend = |bytes: &mut [u8], entry: usize| {
        let (size, local) = (number(bytes, entry + 20, 4)?, number(bytes, entry + 42, 4)?);
        let start = local + 30 + number(bytes, local + 26, 2)? + number(bytes, local + 28, 2)?;
        let sum = crc32fast::hash(bytes.get(start..start + size)?).to_le_bytes();
        bytes.get_mut(entry + 16..entry + 20)?.copy_from_slice(&sum);
        bytes.get_mut(local + 14..local + 18)?.copy_from_slice(&sum);
        Some(())
    };
    let is_entry = |at: &usize| bytes[*at..].starts_with(b"PK\x01\x02");
    let entries: Vec<usize> = (0..bytes.len()).filter(is_entry).collect();
    for entry in entries {
        mend(&mut bytes, entry);
    }
    bytes
}
