//! FBX: as tables, as BVH, and in the commands that open motion files.

use super::common::{Numbers, command, fails, run, shared, text};
use flate2::read::GzDecoder;
use serde_json::Value;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

const WALK: &str = "testdata/examples/animator/walk.fbx.gz";
const GOBLIN: &str = "testdata/examples/animator/goblin.bvh";

/// The joints of a BVH file.
fn joints(bvh: &str) -> Numbers {
    Numbers::read(&run("bvh2xyz", &["-q"], bvh))
}

/// The largest distance of points that both have, cm.
fn far(a: &Numbers, b: &Numbers) -> f64 {
    assert_eq!(a.rows.len(), b.rows.len());
    let at = |name: &String| b.points.iter().position(|p| p == name);
    let shared: Vec<_> = a
        .points
        .iter()
        .enumerate()
        .filter_map(|(i, p)| Some((i, at(p)?)))
        .collect();
    assert!(shared.len() >= 3, "{:?} {:?}", a.points, b.points);
    let mut far = 0.0_f64;
    for (a, b) in a.rows.iter().zip(&b.rows) {
        for (i, j) in shared
            .iter()
            .flat_map(|(i, j)| (0..3).map(move |c| (3 * i + c, 3 * j + c)))
        {
            assert_eq!(a[i].is_nan(), b[j].is_nan());
            far = far.max((a[i] - b[j]).abs());
        }
    }
    far
}

#[test]
fn a_table_and_a_bvh_file_have_the_same_joints() {
    let table = Numbers::read(&run("fbx2xyz", &["-q", WALK], ""));
    assert_eq!((table.rows.len(), table.points.len()), (40, 26));
    assert_eq!(
        (table.points[0].as_str(), &table.cells[0][0]),
        ("mixamorig:Hips", &"walk.fbx".into())
    );
    assert!((table.time[39] - 1.3).abs() < 1e-9);
    let bvh = run("fbx2bvh", &[WALK], "");
    assert!(far(&table, &joints(&bvh)) < 0.003);
    // The zero pose is the bind pose, a T: both hands are level with the shoulders.
    let still = bvh.split("MOTION").next().unwrap();
    let zeros = "0 ".repeat(bvh.lines().last().unwrap().split(' ').count());
    let still = joints(&format!(
        "{still}MOTION\nFrames: 1\nFrame Time: 0.1\n{zeros}\n"
    ));
    let height = |name: &str| {
        let at = still
            .points
            .iter()
            .position(|p| *p == format!("mixamorig:{name}"));
        still.rows[0][3 * at.unwrap() + 1]
    };
    assert!((height("LeftHand") - height("LeftArm")).abs() < 2.0);
    // A stream, and fewer frames a second.
    let bytes = fs::read(WALK).unwrap();
    let run = command("fbx2xyz")
        .args(["-q", "--fps", "10"])
        .write_stdin(bytes)
        .assert()
        .success();
    let fewer = Numbers::read(&String::from_utf8_lossy(&run.get_output().stdout));
    assert_eq!(fewer.rows.len(), 14);
    assert!(
        fewer.rows[1]
            .iter()
            .zip(&table.rows[3])
            .all(|(a, b)| (a - b).abs() < 1e-6)
    );
}

#[test]
fn motion_commands_open_it_as_a_bvh_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let bvh = run("fbx2bvh", &[WALK], "");
    fs::write(at("walk.bvh"), &bvh).unwrap();
    // Sound motion is written as it was read; the record stands beside it.
    run("clean", &["-q", WALK, "-o", text(&at("clean.bvh"))], "");
    assert_eq!(fs::read_to_string(at("clean.bvh")).unwrap(), bvh);
    // In a folder beside a BVH file of the same name, both results are there.
    fs::create_dir(at("in")).unwrap();
    fs::copy(WALK, at("in/walk.fbx.gz")).unwrap();
    fs::copy(at("walk.bvh"), at("in/walk.bvh")).unwrap();
    run(
        "clean",
        &["-q", text(&at("in")), "-o", text(&at("out/"))],
        "",
    );
    let mut made: Vec<String> = fs::read_dir(at("out"))
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.ends_with(".bvh"))
        .collect();
    made.sort();
    assert_eq!(made, ["walk.bvh", "walk.fbx.gz.bvh"]);
    let report = run("audit", &["--json", WALK], "");
    let report: Value = serde_json::from_str(&report).unwrap();
    let take = &report[0]["takes"][0];
    assert_eq!((&take["frames"], &take["rate"]), (&40.into(), &30.0.into()));
    let page = run("plot", &["--to", "html", WALK], "");
    assert!(page.contains("mixamorig:LeftHand"));
    // A source and a rig.
    let from_fbx = run("retarget", &["-q", "--to", GOBLIN, WALK], "");
    assert_eq!(
        from_fbx,
        run(
            "retarget",
            &["-q", "--to", GOBLIN, text(&at("walk.bvh"))],
            ""
        )
    );
    let to_fbx = run("retarget", &["-q", "--to", WALK, text(&at("walk.bvh"))], "");
    assert!(far(&joints(&bvh), &joints(&to_fbx)) < 1.0);
}

#[test]
fn its_skeleton_is_a_rig_for_tables_and_glb() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let table = run("fbx2xyz", &["-q", WALK], "");
    let bvh = run("xyz2bvh", &["-q", "--skeleton", WALK], &table);
    let rig = run("fbx2bvh", &["-q", WALK], "");
    let joints_of = |bvh: &str| bvh.matches("JOINT ").count();
    assert_eq!(joints_of(&bvh), joints_of(&rig));
    assert!(far(&Numbers::read(&table), &joints(&bvh)) < 0.5);
    let (glb, moved) = (at("walk.glb"), at("walk.bvh"));
    run(
        "retarget",
        &["-q", "--to", GOBLIN, WALK, "-o", text(&glb)],
        "",
    );
    assert!(fs::read(&glb).unwrap().starts_with(b"glTF"));
    // What is missing cannot stand in a GLB file.
    let gap = rig.lines().map(|line| match line.split_once(' ') {
        Some((x, rest)) if x.parse::<f64>().is_ok() => format!("nan {rest}"),
        _ => line.to_string(),
    });
    fs::write(&moved, gap.collect::<Vec<_>>().join("\n")).unwrap();
    fs::remove_file(&glb).unwrap();
    let said = command("retarget")
        .args(["-q", "--to", GOBLIN, text(&moved), "-o", text(&glb)])
        .assert()
        .code(1);
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(said.contains("posing clean") && !glb.exists(), "{said}");
}

#[test]
fn a_command_that_reads_no_fbx_says_which_do() {
    for name in ["denoise", "bvh2xyz"] {
        let said = fails(name, &[WALK], b"", 1);
        assert!(
            said.contains("fbx2xyz") && said.contains("fbx2bvh"),
            "{said}"
        );
    }
    let said = fails("fbx2xyz", &[GOBLIN], b"", 1);
    assert!(said.contains("is a BVH file"), "{said}");
    let said = fails("clean", &[WALK, "-o", "x.fbx"], b"", 1);
    assert!(said.contains("x.fbx"), "{said}");
    let mut bytes = Vec::new();
    let packed = fs::File::open(WALK).unwrap();
    GzDecoder::new(packed).read_to_end(&mut bytes).unwrap();
    for end in [27, 1000, 9000] {
        let said = fails("fbx2bvh", &[], &bytes[..end], 1);
        assert!(said.contains("early") || said.contains("empty"), "{said}");
    }
}

/// A sample of the shared collection, unpacked into a folder.
fn sample(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut bytes = Vec::new();
    let packed = fs::File::open(shared(&format!("data/fbx/{name}.fbx.gz"))?).unwrap();
    GzDecoder::new(packed).read_to_end(&mut bytes).unwrap();
    let path = folder.join(format!("{name}.fbx"));
    fs::write(&path, bytes).unwrap();
    Some(path)
}

/// The truth was computed before or beside the files: by Blender, and by the FBX SDK's formula.
#[test]
fn every_sample_has_its_true_joints() {
    let Some(list) = shared("data/fbx/truth.json") else {
        return;
    };
    let list: Value = serde_json::from_str(&fs::read_to_string(list).unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, truth) in list.as_object().unwrap() {
        if name == "pop" {
            continue; // whose truth is that without its fault
        }
        let path = sample(folder.path(), truth["file"].as_str().unwrap()).unwrap();
        let mut args = vec!["-q", text(&path)];
        for flag in ["take", "skeleton"] {
            args.extend(truth[flag].as_str().into_iter().flat_map(|v| {
                [
                    if flag == "take" {
                        "--take"
                    } else {
                        "--skeleton"
                    },
                    v,
                ]
            }));
        }
        let packed =
            fs::File::open(shared(&format!("data/fbx/{name}.truth.csv.gz")).unwrap()).unwrap();
        let mut wanted = String::new();
        GzDecoder::new(packed).read_to_string(&mut wanted).unwrap();
        let out = command("fbx2xyz")
            .args(&args)
            .assert()
            .code(if name == "nan-key" { 3 } else { 0 });
        let table = Numbers::read(&String::from_utf8_lossy(&out.get_output().stdout));
        let mut wanted = Numbers::read(&wanted);
        // Of names that repeat, the first reading is that of the first.
        let repeats = |p: &String| wanted.points.iter().filter(|other| *other == p).count() > 1;
        wanted.points = wanted
            .points
            .iter()
            .map(|p| format!("{p}{}", if repeats(p) { "?" } else { "" }))
            .collect();
        let error = far(&wanted, &table);
        assert!(error < 0.01, "{name}: {error}");
        if name == "nan-key" {
            let said = fails("fbx2bvh", &args, b"", 1);
            assert!(
                said.contains("not numbers") && said.contains("frame 6"),
                "{said}"
            );
        } else {
            let bvh = joints(&run("fbx2bvh", &args, ""));
            let is_plain = |p: &String| !p.contains(|c: char| c.is_whitespace());
            if wanted.points.iter().all(is_plain) {
                assert!(far(&wanted, &bvh) < 0.01, "{name}");
            }
        }
    }
}

#[test]
fn several_takes_go_into_a_folder_or_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let Some(path) = sample(folder.path(), "two-takes") else {
        return;
    };
    let said = fails("fbx2bvh", &[text(&path)], b"", 1);
    assert!(
        said.contains("--take NAME") && said.contains("Armature|A_idle"),
        "{said}"
    );
    let out = folder.path().join("out/");
    run("fbx2bvh", &["-q", text(&path), "-o", text(&out)], "");
    let mut made: Vec<_> = fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    made.sort();
    assert_eq!(
        made,
        [
            "two-takes-Armature%7CA_idle.bvh",
            "two-takes-Armature%7Cwalk.bvh"
        ]
    );
    let said = fails(
        "clean",
        &[text(&path), "-o", text(&folder.path().join("c.bvh"))],
        b"",
        1,
    );
    assert!(said.contains("--take NAME"), "{said}");
    run(
        "clean",
        &[
            "-q",
            "--take",
            "Armature|walk",
            text(&path),
            "-o",
            text(&folder.path().join("c.bvh")),
        ],
        "",
    );
}

#[test]
fn a_key_that_is_no_number_is_filled_by_clean() {
    let folder = tempfile::tempdir().unwrap();
    let Some(path) = sample(folder.path(), "nan-key") else {
        return;
    };
    let out = folder.path().join("o.bvh");
    command("clean")
        .args(["-q", text(&path), "-o", text(&out)])
        .assert()
        .success();
    let filled = joints(&fs::read_to_string(out).unwrap());
    assert_eq!((filled.rows.len(), filled.missing()), (24, 0));
}
