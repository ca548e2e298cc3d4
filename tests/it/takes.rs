//! Takes restored in time without a model: `complete --self` and `denoise --self` on points of any
//! names.

use crate::common::{Numbers, command, run, take, thin};

/// A swinging two-part body of eight points, `frames` frames at 100 a second.
fn body(frames: usize) -> Numbers {
    let base = [
        [0.0, 0.0, 0.0],
        [20.0, 0.0, 0.0],
        [0.0, 25.0, 5.0],
        [15.0, 20.0, -8.0],
    ];
    let row = |t: usize| {
        let s = t as f64 / 100.0;
        let (a, b) = (0.8 * (2.1 * s).sin(), 0.9 * (3.7 * s).sin());
        let place = [
            60.0 * (0.9 * s).sin(),
            90.0 + 3.0 * (4.0 * s).cos(),
            40.0 * s,
        ];
        let turn = |[x, y, z]: [f64; 3], angle: f64| {
            let (sin, cos) = angle.sin_cos();
            [cos * x + sin * z, y, cos * z - sin * x]
        };
        let lower = base.map(|p| turn(p, a));
        // The upper part hinges on the second point.
        let upper = base.map(|[x, y, z]| {
            let (sin, cos) = b.sin_cos();
            turn([20.0 + cos * x - sin * y, sin * x + cos * y + 12.0, z], a)
        });
        let all = lower.into_iter().chain(upper);
        all.flat_map(|p| [p[0] + place[0], p[1] + place[1], p[2] + place[2]])
            .collect::<Vec<f64>>()
    };
    let names: Vec<String> = (0..8).map(|p| format!("m{p}")).collect();
    let mut text = String::from("time");
    for name in &names {
        text += &format!(",{name}.x,{name}.y,{name}.z");
    }
    for t in 0..frames {
        text += &format!("\n{}", t as f64 / 100.0);
        row(t).iter().for_each(|v| text += &format!(",{v:.6}"));
    }
    Numbers::read(&(text + "\n"))
}

fn hide(table: &Numbers, points: &[usize], frames: std::ops::Range<usize>) -> Numbers {
    let mut out = table.clone();
    for row in &mut out.rows[frames] {
        for p in points {
            row[3 * p..3 * p + 3].fill(f64::NAN);
        }
    }
    out
}

#[test]
fn markers_without_a_model_are_filled_from_each_other() {
    let truth = body(600);
    let damaged = hide(&truth, &[5, 6], 300..360);
    let filled = Numbers::read(&run("complete", &["-q", "--self"], &damaged.write()));
    assert_eq!(filled.missing(), 0);
    let (far, _) = filled.far(&truth);
    // A straight line misses by some 30 cm.
    assert!(far <= 0.3, "{far} cm");
}

#[test]
fn a_body_gone_for_a_moment_is_interpolated_and_for_long_is_left() {
    let truth = body(400);
    let all: Vec<usize> = (0..8).collect();
    let damaged = hide(&hide(&truth, &all, 100..105), &all, 200..320).write();
    let text = run("complete", &["-q", "--self", "--status"], &damaged);
    let lines: Vec<&str> = text.lines().collect();
    assert!(
        lines[103].contains(",inferred,") && lines[103].contains(",pchip"),
        "{}",
        lines[103]
    );
    assert!(lines[261].contains(",unknown,,"), "{}", lines[261]);
    let filled = Numbers::read(&run("complete", &["-q", "--self"], &damaged));
    assert_eq!(filled.missing(), 120 * 24);
    assert!(filled.far(&truth).0 <= 0.2);
}

#[test]
fn the_report_lists_every_gap() {
    let folder = tempfile::tempdir().unwrap();
    let damaged = hide(&hide(&body(500), &[2], 50..60), &[7], 200..240).write();
    let list = |name: &str| {
        let path = folder.path().join(name);
        run(
            "complete",
            &["-q", "--self", "--report", path.to_str().unwrap()],
            &damaged,
        );
        std::fs::read_to_string(path).unwrap()
    };
    let json: serde_json::Value = serde_json::from_str(&list("gaps.json")).unwrap();
    let gaps = json["gaps"].as_array().unwrap();
    let of = |k: usize| {
        (
            &gaps[k]["point"],
            &gaps[k]["first_frame"],
            &gaps[k]["frames"],
        )
    };
    assert_eq!(gaps.len(), 2);
    assert_eq!(of(0), (&"m2".into(), &50.into(), &10.into()));
    assert_eq!(of(1), (&"m7".into(), &200.into(), &40.into()));
    assert!(
        gaps.iter()
            .all(|g| g["method"] == "regression" && g["sd"].is_number())
    );
    let text = list("gaps.txt");
    assert_eq!(text.lines().count(), 3);
    assert!(text.lines().nth(2).unwrap().contains("m7") && text.contains("longest step, cm"));
}

#[test]
fn noise_is_removed_without_a_model_and_a_clean_take_stays() {
    let truth = body(600);
    let clean = Numbers::read(&run("denoise", &["-q", "--self"], &truth.write()));
    assert!(clean.rms(&truth) <= 0.01, "{}", clean.rms(&truth));
    let noisy = Numbers::read(&run(
        "corrupt",
        &["--dense", "1", "--seed", "3"],
        &truth.write(),
    ));
    let quiet = Numbers::read(&run("denoise", &["-q", "--self"], &noisy.write()));
    let (before, after) = (noisy.rms(&truth), quiet.rms(&truth));
    assert!(after <= 0.5 * before, "{before} {after}");
}

#[test]
fn a_frame_by_itself_needs_a_model() {
    let mut table = body(3).write();
    table = table
        .replace("time,", "")
        .lines()
        .map(|l| format!("{l}\n"))
        .collect();
    let header = table.lines().next().unwrap().to_string();
    let rows = table
        .lines()
        .skip(1)
        .map(|l| l.split_once(',').unwrap().1.to_string());
    let timeless = rows.fold(header + "\n", |all, row| all + &row + "\n");
    let out = command("complete")
        .arg("--self")
        .write_stdin(timeless)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(
        said.contains("--fps") && said.contains("without a model"),
        "{said}"
    );
}

#[test]
fn files_of_other_formats_are_told_what_they_are() {
    for (file, word) in [
        (&b"HIERARCHY\nROOT Hips\n{\n"[..], "bvh2xyz"),
        (b"\x02\x50\x2c\x00\x00\x00\x6d\x0b", "c3d2xyz"),
        (b"PathFileType\t4\t(X/Y/Z)\twalk.trc\n", "trc2xyz"),
        (b"#!OML:ASF F:\\VICON\n:FULLY-SPECIFIED\n", "amc2xyz"),
        (b"Format Version,1.25,Take Name,walk\n", "csv2xyz"),
    ] {
        let said = crate::common::fails("complete", &[], file, 1);
        assert_eq!(said.trim().lines().count(), 1, "{said}");
        assert!(
            said.contains(word) && said.contains("standard input"),
            "{said}"
        );
    }
    crate::common::fails("denoise", &["--noise", "1e300"], b"", 2);
}

#[test]
fn an_outlier_beside_a_gap_is_replaced_and_the_gap_stays_without_fill() {
    let truth = body(400);
    let mut damaged = hide(&truth, &[4], 200..210);
    damaged.rows[210][3 * 4] += 30.0;
    let quiet = Numbers::read(&run("denoise", &["-q", "--self"], &damaged.write()));
    assert_eq!(quiet.missing(), 30);
    assert!((quiet.rows[210][12] - truth.rows[210][12]).abs() <= 3.0);
    let whole = run("denoise", &["-q", "--self", "--fill"], &damaged.write());
    assert_eq!(Numbers::read(&whole).missing(), 0);
}

#[test]
fn a_jump_of_the_whole_body_is_a_cut() {
    let mut table = body(400);
    for row in &mut table.rows[200..] {
        row.iter_mut().for_each(|v| *v += 40.0);
    }
    // A gap that begins at the cut joins what follows, not what was before.
    let damaged = hide(&table, &[3], 200..230);
    let run = command("complete")
        .arg("--self")
        .write_stdin(damaged.write())
        .assert()
        .success();
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(said.contains("jumps once"), "{said}");
    let filled = Numbers::read(std::str::from_utf8(&run.get_output().stdout).unwrap());
    assert_eq!(filled.missing(), 0);
    let off = filled.far(&table).0;
    assert!(off <= 0.5, "{off} cm");
    let clean = Numbers::read(&crate::common::run(
        "denoise",
        &["-q", "--self"],
        &table.write(),
    ));
    assert!(clean.far(&table).0 <= 0.2, "{} cm", clean.far(&table).0);
}

#[test]
fn a_frame_of_another_skeleton_is_not_bent_to_the_models() {
    let left = [
        "LeftUpLeg",
        "LeftLeg",
        "LeftFoot",
        "LeftToeBase",
        "LeftArm",
        "LeftForeArm",
        "LeftHand",
    ];
    let places = [
        [10, 90],
        [10, 48],
        [10, 6],
        [10, 2],
        [20, 140],
        [48, 140],
        [75, 140],
    ];
    let (mut head, mut row) = (String::from("Hips.x,Hips.y,Hips.z"), String::from("0,95,0"));
    for (name, [x, y]) in left.iter().zip(places) {
        let right = name.replace("Left", "Right");
        head += &format!(",{name}.x,{name}.y,{name}.z,{right}.x,{right}.y,{right}.z");
        row += &format!(",{x},{y},3,-{x},{y},3");
    }
    let table = format!("{head}\n{row}\n");
    assert_eq!(run("denoise", &["-q"], &table), table);
}

#[test]
fn what_a_table_told_of_its_points_goes_through_a_pipe() {
    let Some(walk) = take("07", "07_01", &[]).map(|walk| thin(&walk, 200, 1)) else {
        return;
    };
    let gaps = [
        "--gaps", "2", "--length", "0.2", "--points", "1", "--seed", "3",
    ];
    let noisy = run("corrupt", &["--dense", "0.5cm", "--seed", "1"], &walk);
    let noisy = run("corrupt", &gaps, &noisy);
    let denoised = run("denoise", &["-q", "--status"], &noisy);
    let plain = run("complete", &["-q"], &denoised);
    assert_eq!(plain, run("complete", &["-q", "--status"], &denoised));
    let (before, after) = (Numbers::read(&denoised), Numbers::read(&plain));
    let ends = |name: &String| [".status", ".sd"].iter().any(|end| name.ends_with(end));
    let (mut kept, mut filled) = (0, 0);
    for (was, is) in before.cells.iter().zip(&after.cells) {
        for c in (0..before.names.len()).filter(|c| ends(&before.names[*c])) {
            let [was, is] = [&was[c], &is[c]];
            if was == "unknown" || was.is_empty() {
                // Filled: it is said to be, and how sure that is.
                assert!(
                    is == "inferred" || is.parse::<f64>().is_ok_and(|sd| sd > 0.0),
                    "{is}"
                );
                filled += 1;
            } else {
                assert_eq!(was, is);
                kept += 1;
            }
        }
    }
    assert!(kept > 1000 && filled > 10, "{kept} {filled}");
    // Columns of somebody's own stay as they are, and an array has none.
    let own = denoised
        .replacen("observed", "good", 1)
        .replace("changed", "good");
    let left = run("complete", &["-q"], &own);
    assert!(
        left.contains("good") && !left.contains("observed,"),
        "{}",
        &left[..200]
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.npy");
    run("complete", &["-q", "-o", path.to_str().unwrap()], &denoised);
    assert!(path.exists());
}
