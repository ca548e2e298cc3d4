//! trim: frames, points, rates and filters of tables.

use crate::common::{Numbers, command, fails, run};

/// A point that moves evenly and one that trembles, 100 frames a second.
fn table() -> String {
    let mut text = String::from("take,time,a.x,a.y,a.z,b.x,b.y,b.z,note\n");
    for t in 0..200 {
        let wave = if t % 2 == 0 { 1.0 } else { -1.0 };
        let gap = if (80..90).contains(&t) {
            String::new()
        } else {
            format!("{t}")
        };
        text += &format!("w,{},{gap},0,0,{wave},5,5,n\n", t as f64 / 100.0);
    }
    text
}

#[test]
fn frames_and_points_are_chosen_and_renamed() {
    let flags = [
        "--from", "0.5", "--to", "0.99", "--points", "b,a", "--rename", "a=hand",
    ];
    let out = run("trim", &flags, &table());
    assert!(
        out.starts_with("take,time,b.x,b.y,b.z,hand.x,hand.y,hand.z\nw,0.5,1,5,5,50,0,0\n"),
        "{out}"
    );
    assert_eq!(out.lines().count(), 51);
    let swapped = run("trim", &["--rename", "a=b,b=a"], &table());
    assert!(
        swapped.starts_with("take,time,b.x,b.y,b.z,a.x"),
        "{swapped}"
    );
    for (flags, what) in [
        (["--points", "c"], "no point \"c\""),
        (["--take", "x"], "no take \"x\""),
        (["--rename", "a=b"], "two points \"b\""),
        (["--from", "7"], "no frame"),
        (["--butterworth", "45"], "below .4"),
    ] {
        let failed = command("trim")
            .args(flags)
            .write_stdin(table())
            .assert()
            .failure();
        let said = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        assert!(said.contains(what), "{said}");
    }
}

#[test]
fn an_axis_may_point_down() {
    for flags in [&["--up=-y"][..], &["--up", "-y"]] {
        // What goes back in the file's own axes is what it was.
        assert_eq!(run("trim", flags, &table()), run("trim", &[], &table()));
        let up = run("trim", &[flags, &["--out-up", "y"]].concat(), &table());
        assert!(up.contains("w,0.01,1,-0,-0,-1,-5,-5\n"), "{up}");
    }
    assert!(fails("trim", &["--up", "-w"], table().as_bytes(), 2).contains("-w"));
}

#[test]
fn a_filter_leaves_even_movement_and_stills_trembling() {
    let out = Numbers::read(&run("trim", &["--butterworth", "6Hz"], &table()));
    for (t, row) in out.rows.iter().enumerate() {
        if (80..90).contains(&t) {
            assert!(row[0].is_nan(), "{t}");
        } else {
            assert!((row[0] - t as f64).abs() < 0.05, "{t}: {}", row[0]);
            assert!(
                row[3].abs() < if (20..180).contains(&t) { 0.01 } else { 1.1 },
                "{t}"
            );
        }
    }
}

#[test]
fn another_rate_keeps_the_gap_and_the_unit() {
    let out = Numbers::read(&run(
        "trim",
        &["-q", "--resample", "25", "--units", "mm"],
        &table(),
    ));
    assert_eq!(out.rows.len(), 50);
    for (t, row) in out.rows.iter().enumerate() {
        let at = 4 * t;
        if (80..90).contains(&at) {
            assert!(row[0].is_nan(), "{t}");
        } else {
            assert!((row[0] - at as f64).abs() < 1e-6, "{t}: {}", row[0]);
        }
    }
}

#[test]
fn the_end_and_the_format_share_a_flag() {
    let asked = ["-q", "--from", "0.5", "--to", "1", "--to", "npy", "-"];
    let done = command("trim")
        .args(asked)
        .write_stdin(table())
        .output()
        .unwrap();
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    assert!(done.stdout.starts_with(b"\x93NUMPY"));
    let text = Numbers::read(&run("trim", &asked[..5], &table()));
    assert_eq!(text.rows.len(), 51);
    let wrong = command("trim").args(["--to", "soon"]).output().unwrap();
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("csv, npy or npz"));
}

/// A rig that turns thrice in three seconds while a limb swings, 120 frames a second, with angles
/// wrapped at half a turn and a limb of another order; `rate` in its head.
fn spinning() -> String {
    let mut out = String::from(
        "HIERARCHY\nROOT hips\n{\n  OFFSET 0 0 0\n  CHANNELS 6 Xposition Yposition Zposition \
         Yrotation Xrotation Zrotation\n  JOINT leg\n  {\n    OFFSET  10.0 -4 0\n    CHANNELS 1 \
         Xrotation\n    End Site\n    {\n      OFFSET 0 -40 0\n    }\n  }\n}\nMOTION\nFrames: \
         361\nFrame Time: .0083333\n",
    );
    for t in 0..361 {
        let s = f64::from(t) / 120.0;
        let turn = (360.0 * s + 180.0).rem_euclid(360.0) - 180.0;
        let (bow, lean) = (10.0 * (2.0 * s).sin(), 5.0 * (3.0 * s).cos());
        let swing = (200.0 * s).rem_euclid(360.0) - 180.0;
        out += &format!(
            "{:.4} 90.50 {:.4}  {turn:.5} {bow:.5} {lean:.5} {swing:.5} \n",
            50.0 * s,
            20.0 * s.sin()
        );
    }
    out
}

fn frame_lines(bvh: &str) -> Vec<&str> {
    let (_, body) = bvh.split_once("Frame Time:").unwrap();
    body.lines().skip(1).collect()
}

#[test]
fn a_bvh_file_without_flags_or_with_its_own_rate_is_the_file() {
    let bvh = spinning();
    assert_eq!(run("trim", &[], &bvh), bvh);
    assert_eq!(run("trim", &["--resample", "120"], &bvh), bvh);
    assert_eq!(run("trim", &["--speed", "1"], &bvh), bvh);
    let wrong = run("trim", &["--rate-is", "60"], &bvh);
    assert_eq!(wrong, bvh.replace(".0083333", "0.0166666667"));
}

#[test]
fn frames_of_a_bvh_file_keep_their_text() {
    // No angle wraps from 1.1 to 1.3 s.
    let bvh = spinning();
    let part = run("trim", &["--from", "1.104", "--to", "1.2955"], &bvh);
    assert_eq!(frame_lines(&part), frame_lines(&bvh)[132..=155]);
    let head = bvh.split("Frames:").next().unwrap();
    assert!(part.starts_with(&format!("{head}Frames: 24\nFrame Time: .0083333\n")));
    // Where one wraps, it goes on, and only it has another text.
    let flags = ["--from", "0", "--to", "1"];
    let wrapped = Numbers::of_frames(&run("trim", &flags, &bvh));
    let own = Numbers::of_frames(&bvh);
    for (t, row) in wrapped.iter().enumerate() {
        let turns = (row[3] - own[t][3]) / 360.0;
        assert!((turns - turns.round()).abs() < 1e-9);
        let step = row[3] - wrapped[t.max(1) - 1][3];
        assert!(t == 0 || (step - 3.0).abs() < 1e-3, "{t}: {step}");
    }
    for (flags, what) in [
        (&["--from", "9"][..], "no frame"),
        (&["--from", "2", "--to", "1"], "no frame"),
        (&["--butterworth", "50"], "below .4"),
        (&["--resample", "1000000", "--speed", "1e-9"], "too many"),
    ] {
        assert!(fails("trim", flags, bvh.as_bytes(), 1).contains(what));
    }
    for flags in [
        &["--points", "leg"][..],
        &["--to", "npy"],
        &["--out-units", "m"],
    ] {
        assert!(fails("trim", flags, bvh.as_bytes(), 2).contains("bvh2xyz"));
    }
}

impl Numbers {
    /// The frames of a BVH file.
    fn of_frames(bvh: &str) -> Vec<Vec<f64>> {
        let of = |line: &&str| {
            line.split_whitespace()
                .map(|v| v.parse().unwrap())
                .collect()
        };
        frame_lines(bvh).iter().map(of).collect()
    }
}

#[test]
fn another_rate_and_speed_turn_the_shortest_way() {
    let bvh = spinning();
    let positions = |bvh: &str| Numbers::read(&run("bvh2xyz", &[], bvh)).rows;
    let own = positions(&bvh);
    for (flags, every, frames, time) in [
        (["--resample", "30"], 4, 91, "0.0333333333"),
        (["--speed", "2"], 2, 181, "0.0083333000"),
    ] {
        let new = run("trim", &flags, &bvh);
        let (head, _) = bvh.split_once("Frames").unwrap();
        let head = format!("{head}Frames: {frames}\nFrame Time: {time}\n");
        assert!(new.starts_with(&head), "{flags:?}");
        let rows = Numbers::of_frames(&new);
        for (t, row) in rows.iter().enumerate().skip(1) {
            let step = |c: usize| (row[c] - rows[t - 1][c]).abs();
            assert!((3..7).all(|c| step(c) < 20.0), "{t}: {row:?}");
        }
        for (t, row) in positions(&new).iter().enumerate() {
            let off = row.iter().zip(&own[every * t]).map(|(a, b)| (a - b).abs());
            let most = if (8..frames - 8).contains(&t) {
                0.01
            } else {
                0.3
            };
            assert!(off.fold(0.0, f64::max) < most, "{flags:?} {t}");
        }
    }
    let slow = run("trim", &["--speed", "0.5"], &bvh);
    assert_eq!(frame_lines(&slow).len(), 721);
    let calm = run("trim", &["--butterworth", "6"], &bvh);
    assert_eq!(frame_lines(&calm).len(), 361);
    for (row, was) in positions(&calm).iter().zip(&own) {
        assert!(row.iter().zip(was).all(|(a, b)| (a - b).abs() < 0.5));
    }
}

#[test]
fn missing_rotations_stay_missing() {
    let mut lines: Vec<String> = spinning().lines().map(String::from).collect();
    let first = lines
        .iter()
        .position(|line| line.starts_with("Frame Time"))
        .unwrap()
        + 1;
    for line in &mut lines[first + 100..first + 110] {
        let mut words: Vec<&str> = line.split_whitespace().collect();
        words[4] = "nan";
        *line = words.join(" ");
    }
    let new = run(
        "trim",
        &["-q", "--resample", "60"],
        &(lines.join("\n") + "\n"),
    );
    for (t, row) in Numbers::of_frames(&new).iter().enumerate() {
        let lacks = (100..110).contains(&(2 * t));
        assert!((3..6).all(|c| row[c].is_nan() == lacks), "{t}");
        assert!([0, 1, 2, 6].iter().all(|c| row[*c].is_finite()));
    }
}

#[test]
fn an_amc_take_stays_one() {
    let folder = tempfile::tempdir().unwrap();
    let cmu = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let [asf, amc] = ["07.asf", "07_01.amc"].map(|name| cmu.join(name));
    let [asf, amc] = [&asf, &amc].map(|path| path.to_str().unwrap());
    let out = folder.path().join("out.amc");
    let out = out.to_str().unwrap();
    let given = ["--asf", asf, "--fps", "120", amc, "-o", out];
    let read = || {
        let table = run("amc2xyz", &["--asf", asf, "--fps", "120", out], "");
        Numbers::read(&table).rows
    };
    let trim = |flags: &[&str]| run("trim", &[flags, &given].concat(), "");
    trim(&[]);
    assert_eq!(std::fs::read(out).unwrap(), std::fs::read(amc).unwrap());
    let own = read();
    trim(&["--from", "0.1", "--to", "0.5"]);
    assert_eq!(read(), own[12..=60]);
    trim(&["--resample", "60"]);
    for (t, row) in read().iter().enumerate().skip(10).take(60) {
        let off = row.iter().zip(&own[2 * t]).map(|(a, b)| (a - b).abs());
        // A foot of this take jumps for one frame.
        assert!(off.fold(0.0, f64::max) < 1.0, "{t}");
    }
    let flags = [&["--rate-is", "60"], &given[..]].concat();
    assert!(fails("trim", &flags, b"", 1).contains("--fps"));
    assert!(fails("trim", &["--asf", asf, amc], b"", 1).contains("--fps"));
}

#[test]
fn a_wrong_rate_of_a_table_changes_its_times_alone() {
    let csv = "take,note,time,a.x,a.y,a.z\n\"w, 1\",n,0.00,1.50,-0,1e2\n\"w, 1\",n,0.01,2,,\n\
               \"w, 1\",n,0.02,+3,1,2\n";
    let want = csv.replace("0.00,", "0,").replace("0.01,", "0.02,");
    let want = want.replacen("0.02,+3", "0.04,+3", 1);
    assert_eq!(run("trim", &["--rate-is", "50"], csv), want);
    let cut = run("trim", &["--rate-is", "50", "--from", "0.02"], csv);
    assert_eq!(
        cut,
        "take,time,a.x,a.y,a.z\n\"w, 1\",0.02,2,,\n\"w, 1\",0.04,3,1,2\n"
    );
    let bare = "a.x,a.y,a.z\n1,2,3\n1,2,3\n";
    assert!(fails("trim", &["--rate-is", "50"], bare.as_bytes(), 1).contains("--fps"));
    let fast = Numbers::read(&run("trim", &["-q", "--speed", "2"], &table()));
    assert_eq!(fast.rows.len(), 100);
    assert!((fast.rows[20][0] - 40.0).abs() < 1e-6);
}
