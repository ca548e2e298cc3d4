//! ASF skeletons: what is read has a posture, with all of its values at zero.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::Asf;
use posing_fuzz::{accepted, input, use_one_thread};

fuzz_target!(init: use_one_thread(), |bytes: &[u8]| {
    for unit in [None, Some(1.0)] {
        let asf = input("t.asf", bytes).and_then(|i| Asf::read(i, unit));
        if let Some(asf) = accepted(asf) {
            let zeros = vec![0.0; asf.skeleton.dof_count()];
            let ends = asf.skeleton.posture(&zeros).ends;
            assert!(ends.iter().all(|end| end.is_finite()));
        }
    }
});
