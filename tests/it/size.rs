//! A budget of lines for each crate: one that grows over it wants a reason in the CHANGELOG, or
//! something taken away.

use crate::architecture::sources;
use std::collections::BTreeMap;

/// Lines of code that a crate may have, `posing` being the facade and the program.
const BUDGET: [(&str, usize); 18] = [
    // What a user says of the noise holds, else leaving markers out decides; doubts are told.
    ("body", 4_500),
    // Tracks without names get some, by labeled takes beside them or sets; people apart; the page
    // of a night of takes with findings in groups, places in seconds, and people (750). Skeletons of
    // joints (110). Angles of any file of markers (25).
    // Folders of keypoints, joints of several people (72).
    ("clean", 6_338),
    // Products of a matrix with itself, and rotations without an eigenvalue problem: for speed.
    // Splines, rotations at other rates, a low-pass filter before them (370).
    // An axis that points down by documentation (1), triangles in left-handed axes (5),
    // points that are the same but for a prefix (45).
    ("core", 6_142),
    // Pages of many takes have a small picture of each person. Two takes on one timeline, with
    // their differences (430). Ranks, distances and a legend of poses that were found (80).
    ("draw", 3_370),
    ("edit", 3_600),
    // FBX: skeletons, rest poses, takes.
    ("fbx", 790),
    // Force plates of types 1 and 3, and their forces as tables (180); in left-handed axes (17).
    ("gait", 4_747),
    ("glb", 1_600),
    // Whole bodies over gaps, and between key poses, from motion that is known.
    ("inbetween", 1_680),
    // FBX as BVH (260), mirror images (340), frames of BVH and AMC files as they stand, their rate,
    // the times of tables (240), files of OpenSim (35), rigid bodies of Vicon Tracker (80),
    // long tables (300), keypoints as JSON (530), and rotations as AMC takes (135), meshes in
    // left-handed axes (4), keypoints in folders (120) and with other numbers (60), told by what
    // their reader reads, people by where they are (77).
    ("io", 17_362),
    // Feet stand on the soles of the rig (330).
    // Rotations by the least turns to positions (90).
    // Takes on their floor: the fit, contacts, legs that hold feet, and their tests (1,300).
    ("joints", 10_280),
    // Labels of any set by the postures of labeled takes (800 lines), several people without
    // names, the body as evidence, and loose pieces that close gaps. Points that follow a limb (40).
    ("label", 6_520),
    // How two recordings of one performance lie in time (710).
    ("likeness", 5_275),
    ("models", 10_800),
    ("papers", 6_250),
    // FBX (200), the forces of plates (45), mirror (80), endings of results (45), align, and trim
    // in rotations (450), takes on their floor (80), folders of keypoints (7), plots of two takes
    // (135), AMC takes (35), joint angles (60), help on left-handed axes (30).
    ("posing", 14_300),
    // Fills that break steady distances stay missing; a gap and its simulated ones share one
    // factor; what a table told of its points stays.
    // Gaps of a whole body from motion (150). Keypoints of video: slow noise, lengths, feet (810).
    ("restore", 10_806),
    ("score", 2_100),
];

/// A budget is lowered where a crate has fewer lines than it by more than this.
const SPARE: usize = 400;

/// The lines of code of each crate, files of tests aside.
fn lines_of_code(sources: &[(String, String)]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    for (file, code) in sources {
        let (name, _) = file.split_once('/').unwrap();
        if !file.ends_with("tests.rs") && !file.contains("/tests/") {
            let lines = code.lines().filter(|line| !line.trim().is_empty());
            *counts.entry(name).or_default() += lines.count();
        }
    }
    counts
}

#[test]
fn each_crate_keeps_to_its_budget() {
    let sources = sources();
    let mut counts = lines_of_code(&sources);
    println!("{} lines of code", counts.values().sum::<usize>());
    let mut wrong = Vec::new();
    for (name, budget) in BUDGET {
        let count = counts.remove(name).unwrap_or_default();
        println!("{name}: {count} of {budget}");
        if count > budget || count + SPARE < budget {
            wrong.push(format!("{name}: {count} lines of code, {budget} allowed"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
    assert!(counts.is_empty(), "crates without a budget: {counts:?}");
}

#[test]
fn blanks_and_files_of_tests_do_not_count() {
    let file = |name: &str| {
        (
            name.to_string(),
            "use a::b;\n\nfn f() {\n    b()\n}\n".to_string(),
        )
    };
    let files = ["io/bvh/mod.rs", "io/bvh/tests.rs", "posing/lib.rs"].map(file);
    let counts = lines_of_code(&files);
    assert_eq!(
        counts.into_iter().collect::<Vec<_>>(),
        [("io", 4), ("posing", 4)]
    );
}
