//! FBX files: their skeletons and takes, as positions and as BVH, which is read again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::fbx::{read, to_bvh, to_poses};
use posing::io::{Bvh, FbxChoice};
use posing_fuzz::{accepted, check_line, input, use_one_thread};

/// Longer motions only take longer.
const MOST_FRAMES: f64 = 2.0;

fuzz_target!(init: use_one_thread(), |bytes: &[u8]| {
    let Some(file) = accepted(input("t.fbx", bytes).and_then(read)) else {
        return;
    };
    for skeleton in file.skeletons().iter().take(3) {
        let _ = accepted(file.rest(Some(&skeleton.name)));
    }
    let takes = accepted(file.takes_of(&FbxChoice::default())).unwrap_or_default();
    for take in takes.iter().take(3) {
        let Some(motion) = accepted(file.motion(take, Some(MOST_FRAMES))) else {
            continue;
        };
        motion.notes.iter().for_each(|note| check_line(note));
        let _ = to_poses(&motion);
        let bvh = to_bvh(&motion);
        if motion.positions.len() < 100_000 {
            accepted(Bvh::from_bytes("t.bvh", bvh.to_bytes(1.0)));
        }
    }
});
