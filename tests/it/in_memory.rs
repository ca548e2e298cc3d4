//! Three programs that only know the prelude: bytes in, bytes out, the same as the commands write.

use crate::common::command;
use posing::io::PointMove;
use posing::prelude::*;
use std::path::Path;

fn testdata(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata");
    std::fs::read(folder.join(name)).unwrap()
}

/// The labels of a C3D file put right, the motion of its joints as BVH, and the angle of the left
/// knee, degrees.
fn labeled_and_solved(c3d: Vec<u8>) -> Result<(Vec<u8>, Vec<u8>, Vec<f64>)> {
    let file = MotionFile::from_bytes("gait.c3d", c3d, &ReadOptions::default())?;
    let report = check_labels(&file, &LabelSettings::default())?;
    let labeled = file.moved(&report.moves)?;
    let joints = JointSet::Anatomical;
    let settings = SolveSettings {
        joints,
        ..SolveSettings::default()
    };
    let solved = solve(labeled.poses(), &settings, &mut |_| {})?;
    let knee = solved.joints.angle(["LHJC", "LKJC", "LAJC"])?;
    let bvh = solved.to_bvh(file.rate().ok_or("no rate")?)?;
    Ok((labeled.to_bytes()?, bvh.to_bytes(1.0), knee))
}

/// A BVH file whose rotations are cleaned.
fn cleaned(bvh: Vec<u8>) -> Result<Vec<u8>> {
    let file = MotionFile::from_bytes("walk.bvh", bvh, &ReadOptions::default())?;
    let (motion, rate) = file.motion().zip(file.rate()).ok_or("no rotations")?;
    let how = RotationCleaning::default();
    let cleaned = clean_rotations(&file.channels(), motion, rate, &how);
    file.bytes_with_motion(cleaned.motion.view())
}

/// The motion of a BVH file on the rig of another.
fn on_another_rig(walk: Vec<u8>, rig: Vec<u8>) -> Result<Vec<u8>> {
    let walk = Bvh::from_bytes("walk.bvh", walk)?;
    let hero = Retargeter::new(Bvh::from_bytes("hero.bvh", rig.clone())?, UpAxis::Y, None)?;
    let done = hero.retarget(&walk, &RetargetOptions::default())?;
    done.bvh.with_hierarchy_of(&rig, 1.0)
}

/// What `posing NAME ARGS -o RESULT` writes with a file of these bytes.
fn by_command(name: &str, args: &[&str], file: &str, bytes: &[u8]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let [input, output] = [file, "result"].map(|name| folder.path().join(name));
    std::fs::write(&input, bytes).unwrap();
    let output = output.with_extension(input.extension().unwrap());
    let mut command = command(name);
    command.args(args).arg(&input).arg("-o").arg(&output);
    let done = command.assert().get_output().status.code();
    assert!(matches!(done, Some(0 | 3)), "{done:?}"); // 3: with findings
    std::fs::read(output).unwrap()
}

/// A walk of subject 07 with a pop in its left knee.
fn walk() -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let asf = Asf::open(folder.join("07.asf")).unwrap();
    let amc = Amc::open(folder.join("07_01.amc"), &asf).unwrap();
    let mut bvh = amc.to_bvh(120.0).unwrap();
    let knee = bvh.joints.iter().position(|j| j.name == "ltibia").unwrap();
    let before: usize = bvh.joints[..knee].iter().map(|j| j.channels.len()).sum();
    bvh.motion[[100, before]] += 1.0;
    bvh.to_bytes(1.0)
}

#[test]
fn a_c3d_file_is_labeled_and_solved() {
    let mut file = testdata("examples/biomechanist/gait.c3d");
    let (whole, bvh, knee) = labeled_and_solved(file.clone()).unwrap();
    assert!(whole == file, "right labels stay");
    assert!(bvh == solved_bvh(&file));
    let most = knee.iter().copied().fold(0.0, f64::max);
    let least = knee.iter().copied().fold(180.0, f64::min);
    assert!(
        most > 170.0 && (100.0..140.0).contains(&least),
        "{least} {most}"
    );

    // Two labels that change places in half of the take.
    let own = MotionFile::from_bytes("gait.c3d", file, &ReadOptions::default()).unwrap();
    let at = |name| own.poses().points.iter().position(|p| p == name).unwrap();
    let half = own.poses().frames() / 2;
    let swap = [("LANK", "RANK"), ("RANK", "LANK")].map(|(from, to)| PointMove {
        from: at(from),
        to: Some(at(to)),
        frames: half..half + 20,
    });
    file = own.moved(&swap).unwrap().to_bytes().unwrap();
    let (labeled, solved, _) = labeled_and_solved(file.clone()).unwrap();
    assert!(labeled == by_command("label", &[], "gait.c3d", &file));
    assert!(labeled == whole && solved == bvh);
}

fn solved_bvh(c3d: &[u8]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let [input, bvh, csv] = ["gait.c3d", "gait.bvh", "gait.csv"].map(|n| folder.path().join(n));
    std::fs::write(&input, c3d).unwrap();
    let mut solve = command("solve");
    solve.args(["--joints", "anatomical", "--bvh"]).arg(&bvh);
    solve.arg(&input).arg("-o").arg(csv).assert().success();
    std::fs::read(bvh).unwrap()
}

#[test]
fn the_rotations_of_a_bvh_file_are_cleaned() {
    let walk = walk();
    let done = cleaned(walk.clone()).unwrap();
    assert!(done != walk && done == by_command("clean", &[], "walk.bvh", &walk));
    assert!(
        cleaned(done.clone()).unwrap() == done,
        "what is clean stays"
    );
}

#[test]
fn a_motion_goes_on_another_rig() {
    let (walk, hero) = (walk(), testdata("examples/animator/goblin.bvh"));
    let folder = tempfile::tempdir().unwrap();
    let rig = folder.path().join("hero.bvh");
    std::fs::write(&rig, &hero).unwrap();
    let to = ["--to", rig.to_str().unwrap()];
    let done = on_another_rig(walk.clone(), hero).unwrap();
    assert!(done == by_command("retarget", &to, "walk.bvh", &walk));
}
