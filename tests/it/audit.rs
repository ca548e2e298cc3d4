//! audit: findings, their exit code, text and JSON.

use crate::common::command;

/// A body of ten points that walks, 120 frames a second; `change` is given each row (30 cells).
fn walk(change: impl Fn(usize, &mut Vec<String>)) -> String {
    let mut text = String::from("take,time");
    (0..10).for_each(|p| text += &format!(",p{p}.x,p{p}.y,p{p}.z"));
    for t in 0..240 {
        let time = t as f64 / 120.0;
        let mut row: Vec<String> = (0..30)
            .map(|c| {
                let swing = 2.4 * (6.0 * time + (c / 3) as f64).sin();
                match c % 3 {
                    0 => format!("{:.5}", 5.0 * (c / 3) as f64 % 15.0 + swing + 1.0),
                    1 => format!("{:.5}", 6.0 * c as f64 + 5.0),
                    _ => format!("{:.5}", 120.0 * time + swing),
                }
            })
            .collect();
        change(t, &mut row);
        text += &format!("\nw,{time:.6},{}", row.join(","));
    }
    text + "\n"
}

#[test]
fn a_sound_take_exits_0_and_one_with_findings_3() {
    let sound = command("audit").write_stdin(walk(|_, _| ())).assert();
    let text = String::from_utf8(sound.code(0).get_output().stdout.clone()).unwrap();
    assert!(
        text.contains("w: 240 frames at 120 a second, 2.0 s; 10 points"),
        "{text}"
    );
    assert!(text.contains("nothing found"), "{text}");
    let gap = walk(|t, row| {
        if (50..150).contains(&t) {
            row[9..12].fill(String::new());
        }
    });
    let found = command("audit").write_stdin(gap.clone()).assert().code(3);
    let text = String::from_utf8(found.get_output().stdout.clone()).unwrap();
    assert!(
        text.contains("long gap: p3 is missing for 0.83 s (limit 0.5 s)"),
        "{text}"
    );
    let patient = ["--max-gap", "1", "--max-missing", "1"];
    let done = command("audit").args(patient).write_stdin(gap).assert();
    done.code(0);
}

#[test]
fn json_has_each_file_and_a_bad_one_stops_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(path("a.csv"), "no table\n").unwrap();
    std::fs::write(path("b.csv"), walk(|_, _| ())).unwrap();
    let files = [path("a.csv"), path("b.csv")];
    let done = command("audit").arg("--json").args(&files).assert().code(1);
    assert!(String::from_utf8_lossy(&done.get_output().stderr).contains("a.csv"));
    let audits: serde_json::Value = serde_json::from_slice(&done.get_output().stdout).unwrap();
    assert!(
        audits[0]["error"]
            .as_str()
            .unwrap()
            .contains("has no points")
    );
    assert_eq!(audits[1]["takes"][0]["rate"], 120.0);
    assert_eq!(audits[1]["takes"][0]["findings"], serde_json::json!([]));
}

#[test]
fn zeros_that_mean_missing_are_told() {
    let zeros = walk(|t, row| {
        if (50..70).contains(&t) {
            row[9..12].fill("0".to_string());
        }
    });
    let done = command("audit").write_stdin(zeros).assert().code(3);
    let text = String::from_utf8(done.get_output().stdout.clone()).unwrap();
    assert!(
        text.contains("zeros: p3 is exactly 0, 0, 0 in 20 frames"),
        "{text}"
    );
}

#[test]
fn a_wrong_rate_unit_or_axis_is_told_with_its_remedy() {
    let sound = walk(|_, _| ());
    let says = |args: &[&str], table: &str, part: &str| {
        let done = command("audit").args(args).write_stdin(table).assert();
        let text = String::from_utf8_lossy(&done.code(3).get_output().stdout).into_owned();
        assert!(text.contains(part), "{text}");
    };
    says(
        &["--units", "mm"],
        &sound,
        "give the unit of the file with --units",
    );
    says(&["--up", "z"], &sound, "or z is up (--up z)");
    // Twenty times as fast.
    let mut fast = String::new();
    for (i, line) in sound.lines().enumerate() {
        let rest = line.splitn(3, ',').nth(2).unwrap();
        fast += &match i {
            0 => format!("{line}\n"),
            i => format!("w,{},{rest}\n", (i - 1) as f64 / 2400.0),
        };
    }
    says(&[], &fast, "is the rate 2400.00 frames per second");
}

#[test]
fn a_folder_is_searched() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    std::fs::create_dir_all(root.join("deep")).unwrap();
    std::fs::write(root.join("a.csv"), walk(|_, _| ())).unwrap();
    std::fs::write(root.join("deep/b.csv"), walk(|_, _| ())).unwrap();
    std::fs::write(root.join("notes.txt"), "no motion").unwrap();
    let done = command("audit").arg(root).assert().code(0);
    let text = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(text.contains("a.csv") && text.contains("b.csv"), "{text}");
    assert!(!text.contains("notes"), "{text}");
    // A rate is for files that do not say theirs.
    command("audit")
        .args(["--fps", "50"])
        .arg(root)
        .assert()
        .code(0);
    std::fs::write(root.join("deep/c.c3d"), "x").unwrap();
    command("audit").arg(root).assert().code(1);
    std::fs::create_dir(root.join("empty")).unwrap();
    command("audit").arg(root.join("empty")).assert().code(1);
    // An empty folder stops no other; a file that is named may not say another rate.
    let both = [root.join("empty"), root.join("a.csv")];
    let done = command("audit").args(&both).assert().code(1);
    let text = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(
        text.contains("a.csv\n") && text.contains("no files of motion"),
        "{text}"
    );
    let named = [root.join("deep/b.csv"), root.join("empty")];
    let done = command("audit").args(["--fps", "50"]).args(&named).assert();
    done.code(2);
    let searched = [root.join("deep"), root.join("empty")];
    let done = command("audit")
        .args(["--fps", "50"])
        .args(&searched)
        .assert();
    done.code(1);
}

#[test]
fn a_page_links_to_takes_and_stays_small() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let gaps = walk(|t, row| {
        for p in 0..10 {
            if (t + p) % 2 == 0 || p == 4 && (50..150).contains(&t) {
                row[3 * p..3 * p + 3].fill(String::new());
            }
        }
    });
    std::fs::write(at("a b.csv"), gaps).unwrap();
    std::fs::write(at("sound.csv"), walk(|_, _| ())).unwrap();
    std::fs::create_dir(at("audit_takes")).unwrap();
    let audit = || {
        let page = at("audit.html");
        let files = [at("a b.csv"), at("sound.csv")];
        command("audit")
            .arg("-o")
            .arg(page)
            .args(files)
            .assert()
            .code(3);
        std::fs::read_to_string(at("audit.html")).unwrap()
    };
    let page = audit();
    assert!(
        page.contains("<a href=\"audit_takes/001-a%20b.csv.html#frame=50&amp;trail=p4\">"),
        "{page}"
    );
    assert!(at("audit_takes/001-a b.csv.html").exists());
    assert!(!at("audit_takes/002-sound.csv.html").exists());
    assert!(page.len() < 400_000, "{}", page.len());
    // A file of somebody else in the place of a take's page stays.
    std::fs::write(at("audit_takes/001-a b.csv.html"), "mine").unwrap();
    assert!(!audit().contains("audit_takes/"));
    assert_eq!(
        std::fs::read(at("audit_takes/001-a b.csv.html")).unwrap(),
        b"mine"
    );
}

#[test]
fn a_point_far_off_is_a_stray_point_and_no_wrong_unit() {
    for far in [
        ["900", "5", "-400"],
        ["0", "3000", "0"],
        ["-500", "100", "600"],
    ] {
        let table = walk(|_, row| (0..3).for_each(|c| row[6 + c] = far[c].to_string()));
        let done = command("audit").write_stdin(table).assert().code(3);
        let text = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
        assert!(text.contains("stray point: p2 stands "), "{text}");
        for word in ["--units", "--up", "held"] {
            assert!(!text.contains(word), "{text}");
        }
    }
}

#[test]
fn a_far_point_that_moves_may_be_a_thing_and_stays() {
    let table = walk(|t, row| (0..3).for_each(|c| row[6 + c] = (900 + 2 * t + c).to_string()));
    let done = command("audit").write_stdin(table).assert().code(3);
    let text = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(text.contains("far from all other points"), "{text}");
    assert!(!text.contains("make its cells empty"), "{text}");
}

/// Captures and animations of many makers have rests, pauses, and joints at their limits, but no
/// held rotations, except for one whose head stands still in its first frames and then leaps.
#[test]
fn files_of_many_makers_have_no_held_rotations() {
    let Some(folder) = crate::common::shared("data/formats/bvh") else {
        return;
    };
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let done = crate::common::command("audit").arg(&path).output().unwrap();
        let said = String::from_utf8_lossy(&done.stdout).into_owned();
        let held = said.matches("while others turn").count();
        let is_known = path.ends_with("Swagger.bvh");
        assert_eq!(held, usize::from(is_known), "{said}");
    }
}
