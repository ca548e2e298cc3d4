//! `posing solve`.

use crate::common::*;
use std::fs;

/// A walk whose joints bear the names of markers.
fn markers() -> Option<String> {
    let mut table = few_markers()?;
    for (joint, marker) in [
        (",head", ",LBHD"),
        ("lfoot", "LMT5"),
        ("rfoot", "RMT5"),
        ("lwrist", "LFIN"),
        ("rwrist", "RFIN"),
        ("lhumerus", "LELB"),
        ("rhumerus", "RELB"),
    ] {
        table = table.replace(joint, marker);
    }
    Some(table)
}

/// The same without any on the head, the arms and the feet.
fn few_markers() -> Option<String> {
    let mut table = take("07", "07_01", &[])?;
    for (joint, marker) in [
        ("lhipjoint", "LFWT"),
        ("rhipjoint", "RFWT"),
        ("lfemur", "LKNE"),
        ("rfemur", "RKNE"),
        ("ltibia", "LANK"),
        ("rtibia", "RANK"),
        ("lclavicle", "LSHO"),
        ("rclavicle", "RSHO"),
        ("lowerneck", "C7"),
    ] {
        table = table.replace(joint, marker);
    }
    Some(table)
}

#[test]
fn joints_skeleton_and_motion_are_one() {
    let Some(table) = markers() else {
        return skipped("no takes");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("in.csv"), table).unwrap();
    let done = command("solve")
        .args(["--sd", text(&path("in.csv")), "-o", text(&path("out.csv"))])
        .args([
            "--amc",
            text(&path("o.amc")),
            "--asf-out",
            text(&path("o.asf")),
        ])
        .args(["--bvh", text(&path("o.bvh"))])
        .output()
        .unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.success(), "{said}");
    assert!(said.contains("16 markers of the set cmu41"), "{said}");
    assert!(
        said.contains("7 points are none of its markers and not used: root")
            && said.contains("and 2 more"),
        "{said}"
    );
    let out = fs::read_to_string(path("out.csv")).unwrap();
    let head = out.lines().next().unwrap();
    assert!(
        head.starts_with("take,time,root.x,root.y,root.z,root.sd,lhipjoint.x"),
        "{head}"
    );
    let joints = run("solve", &["-q", text(&path("in.csv"))], "");
    let some = CMU.join(",");
    let joints = Numbers::read(&run("trim", &["-q", "--points", &some], &joints));
    let by_amc = run(
        "amc2xyz",
        &[
            "-q",
            "--asf",
            text(&path("o.asf")),
            "--fps",
            "120",
            text(&path("o.amc")),
        ],
        "",
    );
    // The skeleton has hands and toes besides.
    let by_amc = run("trim", &["-q", "--points", &some], &by_amc);
    let (far, compared) = joints.far(&Numbers::read(&by_amc));
    assert!(far <= 0.005 && compared > 0, "{far} {compared}");
    let by_bvh = run("bvh2xyz", &["-q", "--ends", text(&path("o.bvh"))], "");
    let by_bvh = run("trim", &["-q", "--points", &some], &by_bvh);
    let (far, compared) = joints.far(&Numbers::read(&by_bvh));
    assert!(far <= 0.02 && compared > 0, "{far} {compared}");
}

#[test]
fn limbs_that_nobody_saw_are_empty_and_named() {
    let Some(table) = few_markers() else {
        return skipped("no takes");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("in.csv"), table).unwrap();
    let done = command("solve")
        .args(["--sd", text(&path("in.csv")), "-o", text(&path("out.csv"))])
        .args(["--bvh", text(&path("o.bvh"))])
        .arg(format!("--json={}", text(&path("o.json"))))
        .output()
        .unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(3), "{said}");
    let json = fs::read_to_string(path("o.json")).unwrap();
    for limb in ["head", "left arm", "right arm", "left foot", "right foot"] {
        let what = format!("{limb}: no marker");
        assert!(said.contains(&what) && json.contains(&what), "{said}");
    }
    assert!(said.contains("14 points are none of its markers and not used: root"));
    let out = fs::read_to_string(path("out.csv")).unwrap();
    let head: Vec<&str> = out.lines().next().unwrap().split(',').collect();
    let row: Vec<&str> = out.lines().nth(1).unwrap().split(',').collect();
    let cell = |name: &str| row[head.iter().position(|n| *n == name).unwrap()];
    assert_eq!(
        [cell("head.x"), cell("lwrist.y"), cell("lradius.sd")],
        [""; 3]
    );
    assert!(!cell("ltibia.x").is_empty() && !cell("ltibia.sd").is_empty());
    // At rest an arm is straight.
    let ends = run("bvh2xyz", &["-q", "--ends", text(&path("o.bvh"))], "");
    let arm = ["lclavicle", "lhumerus", "lradius"].join(",");
    let ends = Numbers::read(&run("trim", &["-q", "--points", &arm], &ends));
    let at = |t: usize, p: usize| [0, 1, 2].map(|c| ends.rows[t][3 * p + c]);
    let far = |a: [f64; 3], b: [f64; 3]| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt();
    for t in [0, 100, 200] {
        let [a, b, c] = [0, 1, 2].map(|p| at(t, p));
        assert!(far(a, b) + far(b, c) - far(a, c) <= 0.01, "{t}");
    }
}

const CMU: [&str; 4] = ["root", "lfemur", "rtibia", "thorax"];

#[test]
fn joints_of_a_capture_are_near_the_truth() {
    let (Some(take), Some(truth)) = (
        shared("data/markers/cmu-06_01.c3d"),
        shared("data/markers/cmu-06_01.joints.csv.gz"),
    ) else {
        return skipped("no captures of markers");
    };
    let found = run(
        "solve",
        &["-q", "--units", "mm", "--up", "z", text(&take)],
        "",
    );
    let truth = run("trim", &["-q", text(&truth)], "");
    let rms = Numbers::read(&found).rms(&Numbers::read(&truth));
    assert!(rms <= 3.0, "{rms}");
}

#[test]
fn what_cannot_be_solved_is_said() {
    let table = "time,LFWT.x,LFWT.y,LFWT.z,b.x,b.y,b.z\n0,1,2,3,4,5,6\n0.1,1,2,3,4,5,6\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.csv");
    fs::write(&path, table).unwrap();
    let said = fails("solve", &[text(&path)], b"", 1);
    assert!(said.contains("too few markers"), "{said}");
    assert!(said.contains("knows 1 of its points"), "{said}");
    let said = fails("solve", &["--set", "mine", text(&path)], b"", 2);
    assert!(said.contains("there is no marker set mine"), "{said}");
    let said = fails("solve", &[text(&path), text(&path)], b"", 2);
    assert!(said.contains("--learn"), "{said}");
    let learn = [
        "--learn",
        "s.json",
        "--truth",
        "t.csv",
        text(&path),
        text(&path),
    ];
    let said = fails("solve", &learn, b"", 2);
    assert!(said.contains("2 takes and 1 tables of joints"), "{said}");
    fs::write(&path, "LKNE = \"KNEE\"\n").unwrap();
    let said = fails("solve", &["--map", text(&path), text(&path)], b"", 1);
    assert!(said.contains("no landmark KNEE"), "{said}");
}

#[test]
fn clean_tells_limbs_that_nobody_saw() {
    let Some(table) = few_markers() else {
        return skipped("no takes");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("in.csv"), table).unwrap();
    let done = command("clean")
        .args(["--solve", text(&path("in.csv")), "-o", text(&path("o.csv"))])
        .output()
        .unwrap();
    let said = String::from_utf8(done.stdout).unwrap();
    assert_eq!(done.status.code(), Some(3), "{said}");
    assert!(said.contains("skeleton: head: no marker"), "{said}");
    let record = fs::read_to_string(path("o.csv.json")).unwrap();
    assert!(record.contains("skeleton: left arm: no marker"), "{record}");
}

#[test]
fn clean_writes_skeletons_beside_its_results() {
    let Some(table) = markers() else {
        return skipped("no takes");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("in")).unwrap();
    fs::write(path("in/walk.csv"), table).unwrap();
    let clean = |more: &[&str]| {
        let done = command("clean")
            .args([text(&path("in")), "-o", text(&path("out"))])
            .args(more)
            .output()
            .unwrap();
        let said =
            String::from_utf8(done.stdout).unwrap() + &String::from_utf8(done.stderr).unwrap();
        (done.status.code(), said)
    };
    let (code, said) = clean(&["--solve"]);
    assert_eq!(code, Some(0), "{said}");
    let bvh = fs::read(path("out/walk.bvh")).unwrap();
    // What solve makes of the result.
    let (result, own) = (path("out/walk.csv"), path("own.bvh"));
    command("solve")
        .args(["-q", text(&result), "--bvh", text(&own)])
        .args(["-o", text(&path("joints.csv"))])
        .assert()
        .success();
    assert_eq!(bvh, fs::read(&own).unwrap());
    let record = fs::read_to_string(path("out/walk.csv.json")).unwrap();
    assert!(record.contains("\"set\": \"cmu41\""), "{record}");
    assert!(!record.contains("no marker"), "{record}");
    // It is there as long as it is asked for, and nobody's file is written over.
    fs::remove_file(path("out/walk.bvh")).unwrap();
    assert_eq!(clean(&["--solve"]).0, Some(0));
    assert_eq!(fs::read(path("out/walk.bvh")).unwrap(), bvh);
    assert!(clean(&["--solve"]).1.contains("unchanged"));
    fs::write(path("out/walk.bvh"), "mine").unwrap();
    let (code, said) = clean(&["--solve", "--again"]);
    assert!(
        code == Some(1) && said.contains("in the place of a skeleton"),
        "{said}"
    );
    assert_eq!(fs::read(path("out/walk.bvh")).unwrap(), b"mine");
    // Markers of no set are told.
    fs::remove_file(path("out/walk.bvh")).unwrap();
    let (code, said) = clean(&["--solve=opencap"]);
    assert!(
        code == Some(3) && said.contains("skeleton: none: too few markers: the set opencap knows"),
        "{said}"
    );
}

/// Columns of a table by another name each, as a table.
fn renamed(table: &Numbers, names: &[(&str, &str)]) -> Numbers {
    let at = |name: &str| table.points.iter().position(|p| p == name).unwrap();
    let places: Vec<usize> = names.iter().map(|(_, own)| at(own)).collect();
    let row = |row: &Vec<f64>| -> Vec<f64> {
        let own = places.iter().flat_map(|p| row[3 * p..3 * p + 3].to_vec());
        own.collect()
    };
    Numbers {
        points: names.iter().map(|(name, _)| name.to_string()).collect(),
        rows: table.rows.iter().map(row).collect(),
        time: table.time.clone(),
        cells: table.cells.clone(),
        names: table.names.clone(),
    }
}

#[test]
fn centers_of_plug_in_gaits_markers_are_its_own() {
    let (Some(walk), Some(standing)) = (
        shared("data/gait/HC030A_Straight.c3d"),
        shared("data/gait/HC030A_Static.c3d"),
    ) else {
        return skipped("no gait");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let solved = |take: &str, more: &[&str]| {
        let (out, json) = (path("out.csv"), path("o.json"));
        let done = command("solve")
            .args(["--joints", "anatomical", "--sd", take, "-o", text(&out)])
            .arg(format!("--json={}", text(&json)))
            .args(more)
            .output()
            .unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
        let table = Numbers::read(&fs::read_to_string(out).unwrap());
        (said, json["centers"].clone(), table)
    };
    // Vicon stores them as ends of its segments' axes.
    let names = [
        ("LHJC", "LFEP"),
        ("LKJC", "LFEO"),
        ("LAJC", "LTIO"),
        ("RHJC", "RFEP"),
        ("RKJC", "RFEO"),
        ("RAJC", "RTIO"),
    ];
    let stored = run("c3d2xyz", &["-q", text(&walk)], "");
    let vicon = renamed(&Numbers::read(&stored), &names);
    let own = names.map(|(name, _)| (name, name));
    let (said, centers, table) = solved(text(&walk), &[]);
    assert_eq!(centers, "plug-in gait", "{said}");
    assert!(said.contains("are Plug-in Gait's centers"), "{said}");
    let (far, compared) = renamed(&table, &own).far(&vicon);
    assert!(far <= 0.0001 && compared > 0, "{far} cm {compared}");
    // A table stores no parameters: the body model's, unless a static trial has them.
    let rows = stored.lines().take(200).enumerate();
    let thigh = stored.lines().next().unwrap().split(',');
    let thigh = thigh.into_iter().position(|n| n == "LTHI.x").unwrap();
    let rows = rows.map(|(t, row)| {
        let mut cells: Vec<&str> = row.split(',').collect();
        if (50..70).contains(&t) {
            cells[thigh..thigh + 3].fill("");
        }
        cells.join(",") + "\n"
    });
    fs::write(path("in.csv"), rows.collect::<String>()).unwrap();
    let (said, centers, _) = solved(text(&path("in.csv")), &[]);
    assert_eq!(centers, "model", "{said}");
    assert!(said.contains("it needs LegLength"), "{said}");
    let (said, _, table) = solved(text(&path("in.csv")), &["--static", text(&standing)]);
    assert!(
        said.contains("in 20 frames markers of some are missing"),
        "{said}"
    );
    let column = table.names.iter().position(|n| n == "LKJC.sd").unwrap();
    let sd = |t: usize| table.cells[t][column].parse::<f64>().unwrap();
    assert!(sd(55) > 0.0 && sd(80) == 0.0, "{} {}", sd(55), sd(80));
    let off = (0..3).map(|c| renamed(&table, &own).rows[55][3 + c] - vicon.rows[55][3 + c]);
    let off = off.map(|v| v * v).sum::<f64>().sqrt();
    assert!(off < 0.5, "{off} cm");
}

#[test]
fn joint_angles_are_those_of_gait() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    fs::copy("testdata/examples/gait/walk.c3d", at("walk.c3d")).unwrap();
    let (other, table) = (at("other.c3d"), markers().unwrap());
    run("xyz2c3d", &["-q", "-o", &other], &table);
    let solve = |take: &str, out: &str, flags: &[&str]| {
        let own = [&at(take), "--angles", &at(out), "-o", &at("joints.csv")];
        let done = command("solve").args(own).args(flags).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        (fs::read_to_string(at(out)).expect(&said), said)
    };
    for (name, told) in [("walk", "pig"), ("other", "not Plug-in Gait")] {
        let (take, out) = (at(&format!("{name}.c3d")), at(name));
        command("gait").args(["-o", &out, &take]).output().unwrap();
        for (end, own) in [("mot", "mot"), ("sto", "mot"), ("csv", "csv")] {
            let wanted = fs::read_to_string(format!("{out}/{name}.{own}")).unwrap();
            let (angles, said) = solve(&format!("{name}.c3d"), &format!("a.{end}"), &[]);
            let (_, rows) = wanted.split_once('\n').unwrap();
            assert!(angles.ends_with(rows) && said.contains(told), "{said}");
        }
    }
    // A file that stores nothing of the person.
    let (trc, table) = (at("walk.trc"), run("c3d2xyz", &["-q", &at("walk.c3d")], ""));
    run("xyz2trc", &["-q", "-o", &trc], &table);
    let (angles, said) = solve("walk.trc", "trc.sto", &["--up", "y"]);
    assert!(said.contains("estimated") && angles.contains("\n2.69\t"));
    assert!(fails("solve", &[&trc, "--angles", "a.txt"], b"", 2).contains(".sto or .csv"));
    // A rate is asked for before anything is solved.
    let lines = markers().unwrap();
    let of = |line: &str| line.split(',').skip(2).collect::<Vec<_>>().join(",") + "\n";
    fs::write(at("untimed.csv"), lines.lines().map(of).collect::<String>()).unwrap();
    for flag in ["--angles", "--bvh"] {
        let (to, out) = (at("b.mot"), at("b.csv"));
        let said = fails(
            "solve",
            &[&at("untimed.csv"), flag, &to, "-o", &out],
            b"",
            1,
        );
        assert!(said.contains("says no rate"), "{said}");
    }
    let learn = [
        "--learn", "s.json", "--truth", &trc, "--angles", "a.mot", &trc,
    ];
    assert!(fails("solve", &learn, b"", 2).contains("cannot be used with"));
}
