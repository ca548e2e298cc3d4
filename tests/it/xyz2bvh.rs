//! xyz2bvh: a pose table as BVH, in the bone convention that other programs expect.

use crate::common::Numbers;
use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;

fn xyz2bvh(flags: &[&str], table: &str) -> assert_cmd::assert::Assert {
    Command::new(crate::common::bin().join("xyz2bvh"))
        .args(flags)
        .write_stdin(table)
        .assert()
}

fn bvh2xyz(flags: &[&str], file: &str) -> String {
    let run = Command::new(crate::common::bin().join("bvh2xyz"))
        .arg("-q")
        .args(flags)
        .write_stdin(file)
        .assert()
        .success();
    String::from_utf8(run.get_output().stdout.clone()).unwrap()
}

fn text(run: assert_cmd::assert::Assert) -> String {
    String::from_utf8(run.success().get_output().stdout.clone()).unwrap()
}

/// Names of the points, and rows of numbers.
fn points(table: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let head: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let skip = head.iter().filter(|h| !h.contains('.')).count();
    let names = head[skip..]
        .iter()
        .step_by(3)
        .map(|h| h[..h.len() - 2].to_string())
        .collect();
    let cell = |c: &str| c.parse().unwrap_or(f64::NAN);
    let rows = table
        .lines()
        .skip(1)
        .map(|l| l.split(',').skip(skip).map(cell).collect())
        .collect();
    (names, rows)
}

/// The largest difference over the points of `a`, all of which `b` has.
fn farthest(a: &str, b: &str) -> f64 {
    let ((names, a), (others, b)) = (points(a), points(b));
    assert_eq!(a.len(), b.len());
    let mut far = 0.0f64;
    for (k, name) in names.iter().enumerate() {
        let at = others.iter().position(|n| n == name).expect(name);
        for (x, y) in a.iter().zip(&b) {
            for c in 0..3 {
                let d = (x[3 * k + c] - y[3 * at + c]).abs();
                far = if d <= far { far } else { d };
            }
        }
    }
    far
}

/// The frames of a file, and its Frame Time.
fn motion(file: &str) -> (Vec<Vec<f64>>, f64) {
    let (head, rest) = file.split_once("Frame Time:").unwrap();
    let mut lines = rest.lines();
    let time = lines.next().unwrap().trim().parse().unwrap();
    let rows: Vec<Vec<f64>> = lines
        .map(|l| l.split(' ').map(|v| v.parse().unwrap()).collect())
        .collect();
    assert!(head.ends_with(&format!("Frames: {}\n", rows.len())));
    (rows, time)
}

fn jump(rows: &[Vec<f64>]) -> f64 {
    let steps = rows
        .windows(2)
        .flat_map(|w| (3..w[0].len()).map(|i| (w[0][i] - w[1][i]).abs()));
    steps.fold(0.0, f64::max)
}

const HEAD: &str = "take,time,root.x,root.y,root.z,lhipjoint.x,lhipjoint.y,lhipjoint.z,rhipjoint.x,rhipjoint.y,rhipjoint.z,lfemur.x,lfemur.y,lfemur.z,ltibia.x,ltibia.y,ltibia.z\n";

/// A pelvis that walks and turns, a leg that swings.
fn walk(frames: usize) -> String {
    let mut table = HEAD.to_string();
    for i in 0..frames {
        let t = i as f64 * 0.07;
        let (sin, cos) = (0.8 * t).sin_cos();
        let turned = |p: [f64; 3]| {
            [
                cos * p[0] + sin * p[2] + 9.0 * t,
                p[1] + 90.0,
                cos * p[2] - sin * p[0],
            ]
        };
        let knee = [10.0, -8.0 - 40.0 * t.cos(), 40.0 * t.sin()];
        let foot = [
            10.0,
            knee[1] - 38.0 * (1.3 * t).cos(),
            knee[2] + 38.0 * (1.3 * t).sin(),
        ];
        let row: Vec<String> = [[0.; 3], [10., -8., 0.], [-10., -8., 0.], knee, foot]
            .into_iter()
            .flat_map(turned)
            .map(|v| v.to_string())
            .collect();
        table += &format!("w,{},{}\n", i as f64 / 120.0, row.join(","));
    }
    table
}

/// A person in two frames.
fn tall() -> String {
    let row = "0,90,0,10,82,0,12,44,0,12,4,0,12,2,14,0,125,0,0,150,0";
    let names = [
        "root",
        "lhipjoint",
        "lfemur",
        "ltibia",
        "lfoot",
        "thorax",
        "head",
    ];
    let header: Vec<String> = names.iter().map(|n| format!("{n}.x,{n}.y,{n}.z")).collect();
    format!("time,{}\n0,{row}\n0.1,{row}\n", header.join(","))
}

#[test]
fn a_measured_skeleton_stands_where_the_table_does() {
    let table = walk(150);
    for flags in [
        &[][..],
        &["--order", "XZY"],
        &["--order", "YXZ", "--up", "z", "--units", "m"],
    ] {
        let file = text(xyz2bvh(flags, &table));
        let turned: Vec<&str> = if flags.contains(&"--up") {
            flags[2..].to_vec()
        } else {
            vec![]
        };
        let back = bvh2xyz(&[&["--ends"], &turned[..]].concat(), &file);
        // A millionth of a meter is 1e-4 cm.
        assert!(farthest(&table, &back) <= 1e-3, "{flags:?}");
        let (rows, time) = motion(&file);
        assert!((time - 1.0 / 120.0).abs() <= 1e-9);
        assert!(jump(&rows) <= 180.0);
    }
    let file = text(xyz2bvh(&["--order", "XZY"], &table));
    assert!(file.contains("CHANNELS 3 Xrotation Zrotation Yrotation"));
    assert!(file.contains("JOINT ltibia") && file.contains("End Site"));
}

#[test]
fn another_bvh_gives_hierarchy_offsets_and_channels() {
    let template = text(xyz2bvh(&["--order", "YZX"], &walk(3)));
    let table = bvh2xyz(&[], &text(xyz2bvh(&[], &walk(40))));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.bvh");
    std::fs::write(&path, &template).unwrap();
    let path = path.to_str().unwrap();
    for table in [table, walk(40)] {
        let file = text(xyz2bvh(&["--skeleton", path], &table));
        let hierarchy = |f: &str| f[..f.find("MOTION").unwrap()].to_string();
        assert_eq!(hierarchy(&file), hierarchy(&template));
        let flags: &[&str] = if table.contains("_end") {
            &[]
        } else {
            &["--ends"]
        };
        assert!(farthest(&table, &bvh2xyz(flags, &file)) <= 0.01);
    }
    xyz2bvh(&["--skeleton", path, "--order", "XYZ"], &walk(2))
        .code(2)
        .stderr(contains("--order"));
}

#[test]
fn missing_points_hold_and_the_count_of_frames_stays() {
    let table: String = walk(30)
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            match i {
                1 | 10 => cells[2..].fill(""),
                20..=22 => cells[14..].fill(""),
                _ => {}
            }
            cells.join(",") + "\n"
        })
        .collect();
    let run = xyz2bvh(&[], &table)
        .success()
        .stderr(contains("5 frames had missing points"));
    let file = String::from_utf8(run.get_output().stdout.clone()).unwrap();
    let (rows, _) = motion(&file);
    assert_eq!(rows.len(), 30);
    assert!(rows.iter().flatten().all(|v| v.is_finite()));
    assert_eq!(rows[9], rows[8]);
    let (names, back) = points(&bvh2xyz(&["--ends"], &file));
    let (others, want) = points(&walk(30));
    for i in 19..22 {
        // Of a hidden shank the rest still fits.
        for (k, name) in others.iter().enumerate().filter(|(_, n)| *n != "ltibia") {
            let at = names.iter().position(|n| n == name).unwrap();
            for c in 0..3 {
                assert!((back[i][3 * at + c] - want[i][3 * k + c]).abs() <= 0.01);
            }
        }
    }
}

/// Three joints in a row, the last without an End Site.
const LEAF: &str = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
    JOINT b\n{\nOFFSET 0 10 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nJOINT c\n{\nOFFSET 0 5 1\n\
    CHANNELS 3 Zrotation Xrotation Yrotation\n}\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.04\n";

#[test]
fn a_last_joint_without_an_end_site_goes_round() {
    let frames = "0 90 0 10 20 30 5 6 7 0 0 0\n0 91 0 11 20 30 5 7 7 0 0 0\n";
    let file = format!("{LEAF}{frames}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("leaf.bvh");
    std::fs::write(&path, &file).unwrap();
    let skeleton = ["--skeleton", path.to_str().unwrap()];
    for flags in [&[][..], &["--ends"]] {
        let table = bvh2xyz(flags, &file);
        let back = text(xyz2bvh(&skeleton, &table));
        assert!(
            farthest(&table, &bvh2xyz(flags, &back)) <= 1e-4,
            "{flags:?}"
        );
    }
    // A single frame keeps the file's rate.
    let one = LEAF.replace("Frames: 2", "Frames: 1") + "0 90 0 10 20 30 5 6 7 0 0 0\n";
    let back = text(xyz2bvh(&skeleton, &bvh2xyz(&[], &one)));
    assert_eq!(motion(&back).1, 0.04);
}

#[test]
fn a_neck_that_nods_through_straight_does_not_spin() {
    let mut table = String::from("time,root.x,root.y,root.z");
    let names = [
        "lhipjoint",
        "rhipjoint",
        "thorax",
        "lowerneck",
        "upperneck",
        "head",
    ];
    names
        .iter()
        .for_each(|n| table += &format!(",{n}.x,{n}.y,{n}.z"));
    let frames = 200;
    for t in 0..frames {
        // The head swings forth and back, a little to the side: the plane of the bend turns by half
        // a turn in a few frames.
        let (nod, side) = (0.15 * (t as f64 * 0.05).sin(), 0.004);
        let still = [
            [0., 90., 0.],
            [10., 82., 0.],
            [-10., 82., 0.],
            [0., 125., 0.],
            [0., 133., 0.],
        ];
        let upper = [side * 8.0, 141.0, 4.0 * nod];
        let head = [side * 24.0, 150.0, 4.0 * nod + 9.0 * nod];
        let all = still.into_iter().chain([upper, head]).flatten();
        let row: Vec<String> = all.map(|v: f64| v.to_string()).collect();
        table += &format!("\n{},{}", t as f64 / 120.0, row.join(","));
    }
    let (rows, _) = motion(&text(xyz2bvh(&["--order", "YZX"], &(table + "\n"))));
    assert_eq!(rows.len(), frames);
    assert!(jump(&rows) <= 15.0, "{} degrees in a frame", jump(&rows));
}

/// A file of strangers' faults, its table, and the BVH that xyz2bvh makes of it with the file as
/// skeleton.
fn there_and_back(name: &str) -> Option<(String, String, String)> {
    let file = crate::common::shared(&format!("data/field/{name}"))?;
    let original = std::fs::read_to_string(&file).unwrap();
    let table = bvh2xyz(&[], &original);
    let back = text(xyz2bvh(&["--skeleton", crate::common::text(&file)], &table));
    Some((original, table, back))
}

#[test]
fn bones_in_position_channels_come_back() {
    for name in ["bvh-zero-offsets.bvh", "bvh-positions-on-joints.bvh"] {
        let Some((_, table, back)) = there_and_back(name) else {
            return;
        };
        let far = farthest(&table, &bvh2xyz(&[], &back));
        assert!(far <= 0.1, "{name}: {far}");
    }
}

#[test]
fn end_sites_keep_their_places() {
    let Some((original, table, back)) = there_and_back("bvh-joint-root-late-end-site.bvh") else {
        return;
    };
    let lines = |file: &str| -> Vec<String> {
        let head = file.split("MOTION").next().unwrap();
        let of_structure = |l: &&str| !l.contains("OFFSET") && !l.contains("CHANNELS");
        let lines = head.lines().map(str::trim).filter(of_structure);
        lines
            .map(|l| l.replace("JOINT Hips", "ROOT Hips"))
            .collect()
    };
    assert_eq!(lines(&back), lines(&original));
    assert!(farthest(&table, &bvh2xyz(&[], &back)) <= 0.01);
}

#[test]
fn a_poor_fit_is_a_finding_and_none_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.bvh");
    let bvh = text(xyz2bvh(&[], &walk(3)));
    // A third of each bone, and another one longer.
    let scaled = |factor: f64| {
        let line = |l: &str| match l.trim().strip_prefix("OFFSET ") {
            Some(offset) => {
                let of = |v: &str| (factor * v.parse::<f64>().unwrap()).to_string();
                let values: Vec<String> = offset.split(' ').map(of).collect();
                format!("OFFSET {}\n", values.join(" "))
            }
            None => format!("{l}\n"),
        };
        std::fs::write(&rig, bvh.lines().map(line).collect::<String>()).unwrap();
    };
    let table = bvh2xyz(&[], &bvh);
    let flags = ["--skeleton", crate::common::text(&rig)];
    scaled(1.0);
    xyz2bvh(&flags, &table).success();
    scaled(0.88);
    xyz2bvh(&flags, &table)
        .code(3)
        .stdout(contains("HIERARCHY"))
        .stderr(contains("fits badly"));
    scaled(0.0);
    xyz2bvh(&flags, &table)
        .code(1)
        .stdout("")
        .stderr(contains("does not fit"));
    let forced = [&flags[..], &["--force"]].concat();
    xyz2bvh(&forced, &table)
        .code(3)
        .stdout(contains("HIERARCHY"));
}

#[test]
fn a_bvh_skeleton_becomes_a_glb() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.bvh");
    let bvh = text(xyz2bvh(&[], &walk(5)));
    std::fs::write(&rig, &bvh).unwrap();
    let done = Command::new(crate::common::bin().join("xyz2glb"))
        .args(["--skeleton", crate::common::text(&rig)])
        .write_stdin(bvh2xyz(&[], &bvh))
        .assert()
        .success();
    let glb = &done.get_output().stdout;
    assert!(glb.starts_with(b"glTF"));
    let json = String::from_utf8_lossy(glb);
    assert!(
        json.contains("\"lfemur\"") && json.contains("\"ltibia_end\""),
        "{json}"
    );
}

#[test]
fn faults_are_one_line() {
    let anonymous = "time,a.x,a.y,a.z\n0,1,2,3\n0.1,1,2,3\n";
    xyz2bvh(&[], anonymous)
        .code(2)
        .stderr(contains("--skeleton"));
    let untimed: String = walk(3)
        .lines()
        .map(|l| l.split(',').skip(2).collect::<Vec<_>>().join(",") + "\n")
        .collect();
    xyz2bvh(&[], &untimed).code(2).stderr(contains("--fps"));
    xyz2bvh(&["--fps", "30"], &untimed).success();
    xyz2bvh(&["--fps", "30"], &walk(3))
        .code(2)
        .stderr(contains("contradicts"));
    let two = walk(3)
        + &walk(3)
            .lines()
            .skip(1)
            .map(|l| format!("v{}\n", &l[1..]))
            .collect::<String>();
    xyz2bvh(&[], &two)
        .code(1)
        .stderr(contains("several takes (w, v)"));
    let (rows, _) = motion(&text(xyz2bvh(&["--take", "v"], &two)));
    assert_eq!(rows.len(), 3);
    let small: String = Numbers::read(&tall()).map(|p| p.map(|v| v / 100.0)).write();
    xyz2bvh(&[], &small)
        .code(1)
        .stderr(contains("--units").and(contains("--force")));
    xyz2bvh(&["--force"], &small).success();
    xyz2bvh(&[], &tall()).success();
    xyz2bvh(&["--order", "XYX"], &walk(1)).code(2);
    xyz2bvh(&["--skeleton", "/nowhere"], &walk(1))
        .code(1)
        .stderr(contains("/nowhere"));
}

#[test]
fn real_takes_come_back() {
    for (subject, name) in [("09", "09_06"), ("02", "02_02"), ("43", "43_01")] {
        let file = |name: String| {
            let path = crate::common::cmu(&format!("{subject}/{name}"))?;
            Some(path.to_str().unwrap().to_string())
        };
        let files = (file(format!("{subject}.asf")), file(format!("{name}.amc")));
        let (Some(asf), Some(amc)) = files else {
            continue;
        };
        let run = Command::new(crate::common::bin().join("amc2xyz"))
            .args(["--fps", "120", "--asf", &asf, &amc])
            .assert();
        let table = text(run);
        for flags in [&[][..], &["--skeleton", &asf]] {
            let bvh = text(xyz2bvh(flags, &table));
            let far = farthest(&table, &bvh2xyz(&["--ends"], &bvh));
            assert!(far <= 0.01, "{name}: {far}");
            assert!(jump(&motion(&bvh).0) <= 180.0);
        }
    }
    for name in [
        "Swagger",
        "TARZAN",
        "kick",
        "rotation_first_root",
        "test_freebvh",
        "test_mocapbank",
    ] {
        let Some(path) = crate::common::shared(&format!("data/formats/bvh/{name}.bvh")) else {
            continue;
        };
        let table = bvh2xyz(&[path.to_str().unwrap()], "");
        let bvh = text(xyz2bvh(&["--skeleton", path.to_str().unwrap()], &table));
        let far = farthest(&table, &bvh2xyz(&[], &bvh));
        assert!(far <= 0.05, "{name}: {far}");
    }
}

/// The motion of a BVH file with the values of some joints, by their channels, missing in some
/// frames.
fn with_gaps(
    file: &str,
    channels: std::ops::Range<usize>,
    frames: std::ops::Range<usize>,
) -> String {
    let (head, motion) = file.split_at(file.find("Frame Time").unwrap());
    let mut lines = motion.split_inclusive('\n');
    let mut out = format!("{head}{}", lines.next().unwrap());
    for (t, line) in lines.enumerate() {
        let cells = line.trim_end().split(' ').enumerate();
        let cells = cells.map(|(c, cell)| {
            if frames.contains(&t) && channels.contains(&c) {
                "nan"
            } else {
                cell
            }
        });
        out += &(cells.collect::<Vec<_>>().join(" ") + "\n");
    }
    out
}

#[test]
fn missing_values_of_a_bvh_file_are_filled_in_place() {
    let folder = tempfile::tempdir().unwrap();
    let whole = text(xyz2bvh(&["-q"], &walk(120)));
    let names: Vec<&str> = whole
        .lines()
        .filter_map(|l| l.trim().strip_prefix("JOINT "))
        .collect();
    // The channels of a thigh, after the six of the root and three of each joint before.
    let at = names.iter().position(|n| *n == "lfemur").unwrap();
    let channels = 6 + 3 * at..9 + 3 * at;
    let gaps = with_gaps(&whole, channels.clone(), 40..50);
    let path = folder.path().join("gaps.bvh");
    std::fs::write(&path, &gaps).unwrap();
    let table = bvh2xyz(&[], &gaps);
    let filled = crate::common::run("complete", &["-q", "--force"], &table);
    let back = text(xyz2bvh(&["-q", "--into", path.to_str().unwrap()], &filled));
    let cells = |file: &str| -> Vec<String> {
        let motion = file.split("Frame Time").nth(1).unwrap();
        motion.split_whitespace().map(str::to_string).collect()
    };
    let (was, is) = (cells(&gaps), cells(&back));
    assert_eq!(was.len(), is.len());
    for (was, is) in was.iter().zip(&is) {
        assert!(was == is || was == "nan" && is != "nan", "{was} {is}");
    }
    assert!(!back.contains("nan"));
    let far = farthest(&bvh2xyz(&[], &whole), &bvh2xyz(&[], &back));
    assert!(far < 5.0, "{far} cm");
}

/// By how much `b` trembles beside `a`: the largest second difference of what they are apart, cm.
fn trembling(a: &str, b: &str) -> f64 {
    let ((names, a), (others, b)) = (points(a), points(b));
    let mut most = 0.0f64;
    for (k, name) in names.iter().enumerate() {
        let at = others.iter().position(|n| n == name).expect(name);
        for c in 0..3 {
            let pairs = a.iter().zip(&b);
            let apart: Vec<f64> = pairs.map(|(x, y)| x[3 * k + c] - y[3 * at + c]).collect();
            let second = apart.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs());
            most = second.fold(most, f64::max);
        }
    }
    most
}

#[test]
fn the_way_to_a_bvh_and_back_adds_no_trembling() {
    let Some(walk) = crate::common::take("07", "07_01", &[]) else {
        return;
    };
    let back = bvh2xyz(&["--ends"], &text(xyz2bvh(&["-q"], &walk)));
    assert!(farthest(&walk, &back) <= 1e-3);
    // Of the walk itself it is 3.9 cm.
    let most = trembling(&walk, &back);
    assert!(most <= 1e-4, "{most} cm");
}
