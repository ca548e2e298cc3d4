//! mirror: left and right exchanged, in tables, markers and rotations.

use super::common::{Numbers, command, fails, run, take, text};
use std::fs;

/// x to -x, and the points of one side those of the other.
fn image(table: &Numbers, other: impl Fn(&str) -> String) -> Numbers {
    let mut out = table.map(|[x, y, z]| [-x, y, z]);
    for (p, name) in table.points.iter().enumerate() {
        let from = table.points.iter().position(|n| *n == other(name)).unwrap();
        for (to, own) in out.rows.iter_mut().zip(&table.rows) {
            let own = &own[3 * from..3 * from + 3];
            to[3 * p..3 * p + 3].copy_from_slice(&[-own[0], own[1], own[2]]);
        }
    }
    out
}

fn cmu_other(name: &str) -> String {
    match name {
        "root" | "lowerback" | "lowerneck" => name.into(),
        _ if name.starts_with('l') => format!("r{}", &name[1..]),
        _ if name.starts_with('r') => format!("l{}", &name[1..]),
        _ => name.into(),
    }
}

#[test]
fn a_table_changes_sides_and_comes_back_as_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let walk = take("07", "07_01", &[]).unwrap();
    // Gaps, and what stands beside the points.
    let gaps = ["--gaps", "3", "--length", "0.2", "--points", "2"];
    let gaps = run("corrupt", &gaps, &walk);
    let table = run("complete", &["-q", "--status", "--max-gap", "0.01"], &gaps);
    fs::write(at("walk.csv"), &table).unwrap();
    run(
        "mirror",
        &["-q", text(&at("walk.csv")), "-o", text(&at("once.csv"))],
        "",
    );
    let once = fs::read_to_string(at("once.csv")).unwrap();
    let (own, found) = (Numbers::read(&table), Numbers::read(&once));
    let wanted = image(&own, cmu_other);
    assert_eq!(found.names, own.names);
    assert!(own.missing() > 0);
    assert!(found.far(&wanted).0 < 1e-12);
    for (a, b) in found
        .rows
        .iter()
        .flatten()
        .zip(wanted.rows.iter().flatten())
    {
        assert_eq!(a.is_nan(), b.is_nan());
    }
    // A status goes with its point.
    let of = |table: &Numbers, name: &str| {
        let at = table.names.iter().position(|n| n == name).unwrap();
        table
            .cells
            .iter()
            .map(|row| row[at].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(of(&found, "lfemur.status"), of(&own, "rfemur.status"));
    run(
        "mirror",
        &["-q", text(&at("once.csv")), "-o", text(&at("twice.csv"))],
        "",
    );
    assert_eq!(fs::read_to_string(at("twice.csv")).unwrap(), table);
}

#[test]
fn rotations_change_sides_and_come_back_as_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let fbx = "testdata/examples/animator/walk.fbx.gz";
    let bvh = run("fbx2bvh", &["-q", fbx], "");
    fs::write(at("walk.bvh"), &bvh).unwrap();
    let (walk, once) = (at("walk.bvh"), at("once.bvh"));
    let said = command("mirror")
        .args([text(&walk), "-o", text(&once)])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(said.contains("10 pairs change sides"), "{said}");
    let joints = |bvh: &str| Numbers::read(&run("bvh2xyz", &["-q"], bvh));
    let once = fs::read_to_string(once).unwrap();
    let other = |name: &str| match name {
        _ if name.contains("Left") => name.replace("Left", "Right"),
        _ => name.replace("Right", "Left"),
    };
    assert!(joints(&once).far(&image(&joints(&bvh), other)).0 < 1e-9);
    run(
        "mirror",
        &["-q", text(&at("once.bvh")), "-o", text(&at("twice.bvh"))],
        "",
    );
    assert_eq!(fs::read_to_string(at("twice.bvh")).unwrap(), bvh);
    // FBX becomes that BVH.
    assert_eq!(run("mirror", &["-q", fbx], ""), once);
}

#[test]
fn markers_of_a_c3d_file_change_sides_and_the_rest_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let gait = "testdata/examples/gait/walk.c3d";
    let said = command("mirror")
        .args([gait, "-o", text(&at("once.c3d"))])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(said.contains("force plates and events stay"), "{said}");
    let table = |path: &str| Numbers::read(&run("c3d2xyz", &["-q", path], ""));
    let (own, found) = (table(gait), table(text(&at("once.c3d"))));
    let other = |name: &str| {
        let other = match name.chars().next() {
            Some('L') => format!("R{}", &name[1..]),
            Some('R') => format!("L{}", &name[1..]),
            _ => name.to_string(),
        };
        let is_there = own.points.contains(&other);
        if is_there { other } else { name.to_string() }
    };
    // Single precision, millimeters.
    assert!(found.far(&image(&own, other)).0 < 1e-4);
}

#[test]
fn sides_without_names_are_given_or_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.csv");
    fs::write(&path, "a.x,a.y,a.z,b.x,b.y,b.z\n1,2,3,-4,5,6\n").unwrap();
    let said = fails("mirror", &[text(&path)], b"", 1);
    assert!(said.contains("--pairs LEFT:RIGHT"), "{said}");
    let named = ["--pairs", "a:b", text(&path), "-o", "mirrored.json"];
    let said = fails("mirror", &named, b"", 2);
    assert!(said.contains("the result is CSV; call it .csv"), "{said}");
    let said = fails("mirror", &["--pairs", "a:c", text(&path)], b"", 1);
    assert!(said.contains("no point or joint \"c\""), "{said}");
    let found = run("mirror", &["-q", "--pairs", "a:b", text(&path)], "");
    assert_eq!(found, "a.x,a.y,a.z,b.x,b.y,b.z\n4,5,6,-1,2,3\n");
    let amc = "testdata/cmu/07/07_01.amc";
    let said = fails("mirror", &["--fps", "120", amc], b"", 1);
    assert!(said.contains("retarget"), "{said}");
}

#[test]
fn a_figure_that_stands_along_z_stays_on_its_feet() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("z.bvh");
    // The walk turned by a quarter about x: z is up.
    let bvh = run(
        "fbx2bvh",
        &["-q", "testdata/examples/animator/walk.fbx.gz"],
        "",
    );
    let table = Numbers::read(&run("bvh2xyz", &["-q"], &bvh));
    let flags = [
        "-q",
        "--up",
        "z",
        "--skeleton",
        "testdata/examples/animator/walk.fbx.gz",
    ];
    fs::write(&path, run("xyz2bvh", &flags, &table.write())).unwrap();
    let said = command("mirror").arg(text(&path)).assert().success();
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    let image = run("mirror", &["-q", text(&path)], "");
    let height = |bvh: &str| {
        let joints = Numbers::read(&run("bvh2xyz", &["-q", "--up", "z"], bvh));
        let head = joints
            .points
            .iter()
            .position(|p| p.ends_with("Head"))
            .unwrap();
        joints.rows[0][3 * head + 1]
    };
    let own = fs::read_to_string(&path).unwrap();
    assert!((height(&image) - height(&own)).abs() < 1e-6, "{said}");
}
