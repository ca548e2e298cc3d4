//! retarget: takes on another skeleton.

use crate::common::{command, fails, run};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// A rig in a T-pose, with odd spaces and line ends.
fn rig() -> String {
    let mut text = String::from("HIERARCHY\r\nROOT rig:Hips\n{\n  OFFSET 0 0 0.0\n");
    text += "\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n";
    let chain = |joints: &[(&str, &str)]| -> String {
        let open = joints.iter().map(|(name, offset)| {
            format!(
                "JOINT rig:{name}\n{{\nOFFSET  {offset}\nCHANNELS 3 Yrotation Xrotation Zrotation\n"
            )
        });
        open.collect::<String>() + "End Site\n{\nOFFSET 0 0 5\n}\n" + &"}\n".repeat(joints.len())
    };
    for (side, sign) in [("Left", ""), ("Right", "-")] {
        let name = |n: &str| format!("{side}{n}");
        let names = ["UpLeg", "Leg", "Foot", "ToeBase"].map(name);
        let hip = format!("{sign}8 -4 0");
        let offsets = [&hip, "0 -38 0", "0 -44 0", "0 -8 13"];
        let joints: Vec<(&str, &str)> = names
            .iter()
            .map(String::as_str)
            .zip(offsets.map(|o| o))
            .collect();
        text += &chain(&joints);
    }
    text += "JOINT rig:Spine\n{\nOFFSET 0 12 -1\nCHANNELS 3 Zrotation Xrotation Yrotation\n";
    text += "JOINT rig:Spine1\n{\nOFFSET 0 25 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n";
    for (side, sign) in [("Left", ""), ("Right", "-")] {
        let name = |n: &str| format!("{side}{n}");
        let names = ["Shoulder", "Arm", "ForeArm", "Hand"].map(name);
        let offsets = ["4 15 0", "13 0 0", "24 0 0", "27 0 0"].map(|o| format!("{sign}{o}"));
        let names = names.iter().map(String::as_str);
        let joints: Vec<(&str, &str)> = names.zip(offsets.iter().map(String::as_str)).collect();
        text += &chain(&joints);
    }
    text += &chain(&[("Neck", "0 20 1"), ("Head", "0 9 2")]);
    text + "}\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.04\n" + &"0 ".repeat(66) + "\n"
}

fn at(folder: &Path, name: &str) -> String {
    folder.join(name).display().to_string()
}

/// The hierarchy, the Frame Time, and the frames.
fn parts(text: &str) -> (&str, f64, Vec<Vec<f64>>) {
    let (head, motion) = text.split_once("MOTION").unwrap();
    let time = motion.split("Frame Time:").nth(1).unwrap();
    let (time, rows) = time.split_once('\n').unwrap();
    let row = |line: &str| {
        line.split_whitespace()
            .map(|v| v.parse().unwrap())
            .collect()
    };
    (
        head,
        time.trim().parse().unwrap(),
        rows.lines().map(row).collect(),
    )
}

#[test]
fn a_take_of_cmu_walks_on_another_rig() {
    let Some(take) = crate::common::cmu("09/09_06.amc") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (hero, out) = (at(folder.path(), "hero.bvh"), at(folder.path(), "out.bvh"));
    fs::write(&hero, rig()).unwrap();
    let take = take.display().to_string();
    let flags = ["--to", &hero, "--fps", "120", &take, "-o", &out];
    let done = command("retarget").args(flags).assert().success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("names cmu to hik") && said.contains("held"),
        "{said}"
    );
    let text = fs::read_to_string(&out).unwrap();
    let (head, time, rows) = parts(&text);
    let theirs = rig();
    assert_eq!(head, parts(&theirs).0);
    assert!((time - 1.0 / 120.0).abs() <= 1e-9);
    let frames = fs::read_to_string(&take).unwrap();
    let frames = frames
        .lines()
        .filter(|l| l.trim().parse::<u32>().is_ok())
        .count();
    assert_eq!((rows.len(), rows[0].len()), (frames, 66));
    // One thread or three, a file or standard output: the same bytes.
    let other = run(
        "retarget",
        &["-q", "--threads", "1", "--to", &hero, "--fps", "120", &take],
        "",
    );
    assert_eq!(other, text);
    // The limbs' directions are the take's without feet: a second rig leads back to them.
    let plain = run(
        "retarget",
        &["-q", "--no-feet", "--to", &hero, "--fps", "120", &take],
        "",
    );
    let own = run("retarget", &["-q", "--no-feet", "--to", &hero], &plain);
    let (a, b) = (parts(&plain).2, parts(&own).2);
    let values = a.iter().flatten().zip(b.iter().flatten());
    let far = values.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(far <= 1e-3, "{far}");
}

#[test]
fn folders_are_carried_over_and_one_bad_file_stops_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir_all(folder.join("in/deep")).unwrap();
    let (hero, input, out) = (at(folder, "hero.bvh"), at(folder, "in"), at(folder, "out"));
    fs::write(&hero, rig()).unwrap();
    fs::write(folder.join("in/a.bvh"), rig()).unwrap();
    fs::write(folder.join("in/deep/b.BVH"), rig().replace("Left", "L ")).unwrap();
    fs::write(folder.join("in/notes.txt"), "x").unwrap();
    command("retarget")
        .args(["-q", "--to", &hero, &input, "-o", &out])
        .assert()
        .success();
    for name in ["out/a.bvh", "out/deep/b.bvh"] {
        assert_eq!(
            fs::read_to_string(folder.join(name))
                .unwrap()
                .lines()
                .count(),
            rig().lines().count()
        );
    }
    fs::write(folder.join("in/bad.bvh"), "HIERARCHY\n").unwrap();
    let said = fails(
        "retarget",
        &["-q", "--to", &hero, &input, "-o", &out],
        b"",
        1,
    );
    assert!(said.contains("bad.bvh"), "{said}");
    let said = fails("retarget", &["--to", &hero, &input], b"", 2);
    assert!(said.contains("-o DIR"), "{said}");
    let said = fails(
        "retarget",
        &["--to", &hero, &at(folder, "in/a.bvh"), "-o", &hero],
        b"",
        2,
    );
    assert!(said.contains("would be replaced"), "{said}");
}

#[test]
fn takes_of_one_file_name_stay_two() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (hero, out) = (at(folder, "hero.bvh"), at(folder, "out"));
    fs::write(&hero, rig()).unwrap();
    for (day, time) in [("monday", "0.04"), ("tuesday", "0.02")] {
        fs::create_dir(folder.join(day)).unwrap();
        let take = rig().replace("Time: 0.04", &format!("Time: {time}"));
        fs::write(folder.join(day).join("walk.bvh"), take).unwrap();
    }
    let takes = ["monday/walk.bvh", "tuesday/walk.bvh"].map(|name| at(folder, name));
    let done = command("retarget")
        .args(["--to", &hero, &takes[0], &takes[1], "-o", &out])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("becomes") && said.contains("walk'.bvh"),
        "{said}"
    );
    for (name, time) in [("walk.bvh", 0.04), ("walk'.bvh", 0.02)] {
        let text = fs::read_to_string(folder.join("out").join(name)).unwrap();
        assert!((parts(&text).1 - time).abs() <= 1e-9, "{name}");
    }
    let twice = ["--to", &hero, &takes[0], &takes[0], "-o", &out];
    let said = fails("retarget", &twice, b"", 2);
    assert!(said.contains("is given twice"), "{said}");
}

#[test]
fn a_source_or_a_rig_that_never_stands_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (hero, odd) = (at(folder.path(), "hero.bvh"), at(folder.path(), "odd.bvh"));
    fs::write(&hero, rig()).unwrap();
    // Legs that point up, beside the trunk.
    fs::write(
        &odd,
        rig()
            .replace("0 -38 0", "0 38 0")
            .replace("0 -44 0", "0 44 0"),
    )
    .unwrap();
    for (to, source, whose, flag) in [
        (&hero, &odd, ": its zero pose", "--map-from"),
        (&odd, &hero, ": the rig's zero pose", "--map-to"),
    ] {
        let done = command("retarget").args(["--to", to, source]).assert();
        let done = done.success();
        let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        let lines: Vec<&str> = said.lines().filter(|l| l.contains("no frame is")).collect();
        assert_eq!(lines.len(), 1, "{said}");
        assert!(
            lines[0].contains(whose) && lines[0].contains(flag),
            "{said}"
        );
    }
}

#[test]
fn names_are_told_by_maps_and_what_nothing_tells_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (hero, odd) = (at(folder, "hero.bvh"), at(folder, "odd.bvh"));
    fs::write(&hero, rig()).unwrap();
    // Legs without feet, arms without hands: no map's names, and no shape.
    let renamed = rig()
        .replace("Foot", "Fuss")
        .replace("Hand", "Pfote")
        .replace("ToeBase", "Zeh");
    fs::write(&odd, renamed.replace("38 0", "0 0")).unwrap();
    let said = fails("retarget", &["--to", &odd, &hero], b"", 1);
    assert!(
        said.contains("nearest shipped map is") && said.contains("--map-to NAME"),
        "{said}"
    );
    let said = fails("retarget", &["--to", &hero, &odd], b"", 1);
    assert!(said.contains("--map-from NAME"), "{said}");
    let said = fails(
        "retarget",
        &["--to", &hero, "--map-to", "smpl", &hero],
        b"",
        1,
    );
    assert!(said.contains("not those of the map smpl"), "{said}");
    fails(
        "retarget",
        &["--to", &hero, "--map-to", "nothing", &hero],
        b"",
        2,
    );
    let map = at(folder, "map.toml");
    let sides = [("l", "Left"), ("r", "Right")];
    let limbs = [("hipjoint", "UpLeg"), ("femur", "Leg"), ("tibia", "Fuss")];
    let line = |(s, side): (&str, &str)| -> String {
        limbs
            .iter()
            .map(|(point, joint)| format!("{s}{point} = \"{side}{joint}\"\n"))
            .collect()
    };
    fs::write(&map, sides.map(line).concat()).unwrap();
    fs::write(&odd, renamed).unwrap();
    let done = run(
        "retarget",
        &["-q", "--to", &odd, "--map-to", &map, &hero],
        "",
    );
    assert_eq!(parts(&done).2.len(), 1);
    // By its shape, as the toes point.
    let bare = fs::read_to_string(&odd).unwrap();
    let mut n = 0;
    let bare: String = (bare.lines())
        .map(|line| match line.split_once("rig:") {
            Some((start, _)) => {
                n += 1;
                format!("{start}bone{n}\n")
            }
            None => format!("{line}\n"),
        })
        .collect();
    fs::write(&odd, bare).unwrap();
    let done = command("retarget")
        .args(["--to", &odd, &hero])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(said.contains("names hik to shape"), "{said}");
}

#[test]
fn missing_values_stay_missing_and_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let hero = at(folder.path(), "hero.bvh");
    fs::write(&hero, rig()).unwrap();
    let mut values = vec!["0"; 66];
    values[10] = "nan";
    let (start, _) = rig()
        .rsplit_once("0.04\n")
        .map(|(a, b)| (a.to_string(), b.len()))
        .unwrap();
    let source = start + "0.04\n" + &values.join(" ") + "\n";
    let done = command("retarget")
        .args(["--to", &hero])
        .write_stdin(source)
        .assert()
        .code(3);
    let output = done.get_output();
    let text = String::from_utf8_lossy(&output.stdout);
    let row: Vec<&str> = text.lines().last().unwrap().split(' ').collect();
    let is_missing = |c: &usize| row[*c].eq_ignore_ascii_case("nan");
    assert_eq!((0..66).filter(is_missing).collect::<Vec<_>>(), [9, 10, 11]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("3 values are missing"), "{said}");
}

#[test]
fn an_amc_file_needs_a_rate_and_a_table_has_no_rotations() {
    let folder = tempfile::tempdir().unwrap();
    let hero = at(folder.path(), "hero.bvh");
    fs::write(&hero, rig()).unwrap();
    let said = fails(
        "retarget",
        &["--to", &hero],
        b"take,time,a.x,a.y,a.z\nw,0,1,2,3\n",
        1,
    );
    assert!(said.contains("without rotations"), "{said}");
    if let Some(take) = crate::common::cmu("09/09_06.amc") {
        let said = fails(
            "retarget",
            &["--to", &hero, &take.display().to_string()],
            b"",
            1,
        );
        assert!(said.contains("give it with --fps F"), "{said}");
    }
}

/// The values of an AMC take by frame and bone, whatever the order of the bones.
fn amc_values(text: &str) -> BTreeMap<(usize, String), Vec<f64>> {
    let mut frame = 0;
    let mut all = BTreeMap::new();
    for line in text.lines().filter(|line| !line.starts_with([':', '#'])) {
        let mut words = line.split_whitespace();
        let bone = words.next().unwrap();
        let values: Vec<f64> = words.map(|word| word.parse().unwrap()).collect();
        if values.is_empty() {
            frame = bone.parse().unwrap();
        } else {
            assert!(all.insert((frame, bone.into()), values).is_none());
        }
    }
    all
}

#[test]
fn an_amc_take_of_its_own_skeleton_comes_back_with_its_angles() {
    let Some(take) = crate::common::cmu("09/09_06.amc") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (asf, out) = (take.with_file_name("09.asf"), at(folder.path(), "out.amc"));
    let [asf, take] = [asf, take].map(|path| path.display().to_string());
    let flags = ["--to", &asf, "--fps", "120", &take, "-o", &out];
    let done = command("retarget").args(flags).assert().success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("leave bones 0.00 cm") && said.contains("no rate: it is 120"),
        "{said}"
    );
    let [was, is] = [&take, &out].map(|path| amc_values(&fs::read_to_string(path).unwrap()));
    assert!(was.keys().eq(is.keys()) && was.len() > 141 * 20);
    for (at, was) in &was {
        assert_eq!(was.len(), is[at].len());
        for (a, b) in was.iter().zip(&is[at]) {
            assert!((a - b).abs() <= 1e-3, "{at:?}: {a} {b}");
        }
    }
}

#[test]
fn an_amc_take_needs_an_asf_rig_and_an_asf_rig_gives_bvh_too() {
    let Some(take) = crate::common::cmu("07/07_01.amc") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let asf = take.with_file_name("07.asf").display().to_string();
    let (hero, out) = (at(folder.path(), "hero.bvh"), at(folder.path(), "out.amc"));
    fs::write(&hero, rig()).unwrap();
    let take = take.display().to_string();
    let said = fails(
        "retarget",
        &["--to", &hero, "--fps", "120", &take, "-o", &out],
        b"",
        2,
    );
    assert!(
        said.contains("give --to RIG.asf") && said.lines().count() == 1,
        "{said}"
    );
    let said = fails(
        "retarget",
        &["--to", &asf, "--out-up", "z", &take, "-o", &out],
        b"",
        2,
    );
    assert!(said.contains("y points up"), "{said}");
    let walk = "testdata/examples/animator/walk.fbx.gz";
    let bvh = at(folder.path(), "out.bvh");
    for out in [&out, &bvh] {
        command("retarget")
            .args(["--to", &asf, walk, "-o", out])
            .assert()
            .success();
    }
    let values = amc_values(&fs::read_to_string(&out).unwrap());
    assert!(
        values.contains_key(&(40, "lfemur".into())) && !values.contains_key(&(41, "lfemur".into()))
    );
    assert!(fs::read_to_string(&bvh).unwrap().contains("JOINT lfemur"));
    // Missing values have no words in AMC.
    let broken = fs::read_to_string(&bvh).unwrap();
    let (head, last) = broken.trim_end().rsplit_once(' ').unwrap();
    assert!(last.parse::<f64>().is_ok());
    fs::write(&bvh, format!("{head} nan\n")).unwrap();
    let said = fails("retarget", &["-q", "--to", &asf, &bvh, "-o", &out], b"", 1);
    assert!(said.contains("AMC file cannot hold"), "{said}");
}
