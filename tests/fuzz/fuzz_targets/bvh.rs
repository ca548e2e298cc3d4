//! BVH files: positions, the file written and read again, and missing values filled.
#![no_main]

use libfuzzer_sys::fuzz_target;
use ndarray::Array2;
use posing::io::{Bvh, bvh::BvhTemplate};
use posing_fuzz::{accepted, check_line, input, same, use_one_thread};

fuzz_target!(init: use_one_thread(), |bytes: &[u8]| {
    let read = |bytes: &[u8]| input("t.bvh", bytes).and_then(|i| Bvh::read(i, 1.0, true));
    let Some(file) = accepted(read(bytes)) else {
        return;
    };
    file.notes.iter().for_each(|note| check_line(note));
    let _ = accepted(file.to_poses());
    let again = read(&file.to_bytes(1.0)).expect("what was written is read");
    assert_near(&file, &again);

    let filled = file.motion.mapv(|v| if v.is_nan() { 1.0 } else { v });
    let filled = file.with_motion(bytes, filled.view(), 1.0);
    let again = read(&filled.expect("it was read")).expect("a filled file stays one");
    let is_filled = |(a, b): (&f64, &f64)| same(*a, *b) || a.is_nan() && (b - 1.0).abs() < 1e-6;
    assert!(file.motion.iter().zip(&again.motion).all(is_filled));

    let _ = accepted(BvhTemplate::new(file, glam::DMat3::IDENTITY));
});

/// Equal to the digits that are written.
fn assert_near(a: &Bvh, b: &Bvh) {
    let near = |a: f64, b: f64| same(a, b) || (a - b).abs() <= 1e-6 + 1e-14 * a.abs();
    let all = |a: &Array2<f64>, b: &Array2<f64>| a.iter().zip(b).all(|(a, b)| near(*a, *b));
    assert_eq!(a.joints.len(), b.joints.len());
    for (a, b) in a.joints.iter().zip(&b.joints) {
        assert_eq!((&a.name, a.parent), (&b.name, b.parent));
        assert_eq!((&a.channels, a.ends.len()), (&b.channels, b.ends.len()));
        assert!((a.offset - b.offset).abs().max_element() <= 1e-6);
    }
    assert_eq!(a.motion.dim(), b.motion.dim());
    assert!(all(&a.motion, &b.motion));
}
