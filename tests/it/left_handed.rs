//! Left-handed axes, as of Unity and Unreal: files in them are read as what they show, in every
//! command that is told of the axis that points up.

use crate::common::{Numbers, command, command_names, fails, run, take, text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A take in left-handed axes is the mirror image of its numbers: reflected once more it is right.
#[test]
fn left_handed_files_are_read_as_what_they_show() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let bvh = run(
        "fbx2bvh",
        &["-q", "testdata/examples/animator/walk.fbx.gz"],
        "",
    );
    // In a left-handed file, x has the other sign, and rotations but about x the other way round.
    let mut rows: Vec<&str> = bvh.lines().collect();
    let motion = rows
        .iter()
        .position(|line| line.starts_with("Frame Time"))
        .unwrap()
        + 1;
    let channels: Vec<&str> = rows
        .iter()
        .filter(|line| line.trim().starts_with("CHANNELS"))
        .flat_map(|line| line.split_whitespace().skip(2))
        .collect();
    let frames = rows.split_off(motion);
    let flip = |value: &str| (-value.parse::<f64>().unwrap()).to_string();
    let mut left: Vec<String> = rows
        .iter()
        .map(|line| match line.trim().strip_prefix("OFFSET ") {
            Some(offset) => {
                let (x, rest) = offset.split_once(' ').unwrap();
                format!("OFFSET {} {rest}", flip(x))
            }
            None => line.to_string(),
        })
        .collect();
    left.extend(frames.iter().map(|frame| {
        let values = frame
            .split(' ')
            .zip(&channels)
            .map(|(value, channel)| match *channel {
                "Xposition" | "Yrotation" | "Zrotation" => flip(value),
                _ => value.to_string(),
            });
        values.collect::<Vec<_>>().join(" ")
    }));
    fs::write(at("right.bvh"), &bvh).unwrap();
    fs::write(at("left.bvh"), left.join("\n") + "\n").unwrap();
    let (right, left) = (at("right.bvh"), at("left.bvh"));
    let table = |flags: &[&str], path| {
        Numbers::read(&run(
            "bvh2xyz",
            &[&["-q"], flags, &[text(path)]].concat(),
            "",
        ))
    };
    let wanted = table(&[], &right);
    assert!(table(&["--left-handed"], &left).far(&wanted).0 < 1e-9);
    assert!(table(&[], &left).far(&wanted).0 > 10.0);
    let goblin = "testdata/examples/animator/goblin.bvh";
    let retarget = |flags: &[&str], path| {
        run(
            "retarget",
            &[&["-q", "--to", goblin], flags, &[text(path)]].concat(),
            "",
        )
    };
    let joints = |bvh: &str| Numbers::read(&run("bvh2xyz", &["-q"], bvh));
    let carried = joints(&retarget(&["--left-handed"], &left));
    assert!(carried.far(&joints(&retarget(&[], &right))).0 < 1e-3);
    // Tables, and the axes of what is written.
    let shown = wanted.map(|[x, y, z]| [-x, y, z]).write();
    fs::write(at("left.csv"), shown).unwrap();
    let trimmed = run(
        "trim",
        &["--left-handed", "--out-up", "y", text(&at("left.csv"))],
        "",
    );
    assert!(Numbers::read(&trimmed).far(&wanted).0 < 1e-5);
    let completed = run("trim", &["--left-handed", text(&at("left.csv"))], "");
    assert!(
        Numbers::read(&completed)
            .far(&wanted.map(|[x, y, z]| [-x, y, z]))
            .0
            < 1e-5
    );
    // z up, as in Unreal: y to the right.
    let unreal = wanted.map(|[x, y, z]| [x, z, y]).write();
    let path = at("unreal.csv");
    fs::write(&path, unreal).unwrap();
    let flags = ["--left-handed", "--up", "z", "--out-up", "y", text(&path)];
    assert!(Numbers::read(&run("trim", &flags, "")).far(&wanted).0 < 1e-5);
    let audit = run("audit", &["--json", "--left-handed", text(&left)], "");
    assert!(audit.contains("\"frames\": 40"), "{audit}");
}

#[test]
fn a_glb_file_without_a_bvh_skeleton_has_no_other_axes() {
    for flags in [&["--up", "z"][..], &["--left-handed"], &["--units", "m"]] {
        let all = [flags, &["-o", "walk.glb"]].concat();
        let said = fails("xyz2glb", &all, walk(3, |at| at).as_bytes(), 2);
        assert!(said.contains("--skeleton FILE.bvh"), "{said}");
    }
}

/// The flags of a command and of those below it.
fn flags(command: &Value) -> Vec<&str> {
    let below = command["commands"].as_array().into_iter().flatten();
    let own = command["arguments"].as_array().unwrap().iter();
    let own = own.filter_map(|argument| argument["flag"].as_str());
    own.chain(below.flat_map(flags)).collect()
}

#[test]
fn every_command_with_an_axis_is_told_of_its_hand() {
    let usage: Value = serde_json::from_str(&run("posing", &["--json-usage"], "")).unwrap();
    let commands = usage["commands"].as_array().unwrap();
    assert!(commands.len() + 5 > command_names().len());
    let mut count = 0;
    for command in commands {
        let flags = flags(command);
        let has = |flag: &str| flags.contains(&flag);
        assert_eq!(has("--up"), has("--left-handed"), "{}", command["name"]);
        count += usize::from(has("--up"));
    }
    assert!(count > 25, "{count}");
}

/// The joints of a walk as a table, in the axes that `to` carries it to.
fn walk(frames: usize, to: impl Fn([f64; 3]) -> [f64; 3]) -> String {
    let table = take("07", "07_01", &[]).expect("a take of testdata");
    let rows: Vec<&str> = table.lines().take(frames + 1).collect();
    Numbers::read(&(rows.join("\n") + "\n")).map(to).write()
}

/// Y up: x has the other sign.
fn y_up([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x, y, z]
}

#[test]
fn files_of_tables_are_written_left_handed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&folder.path().join(name)).to_string();
    let table = walk(20, |p| p);
    let wanted = Numbers::read(&table);
    for (writer, reader, ending, least) in [
        ("xyz2trc", "trc2xyz", "trc", 1e-9),
        ("xyz2c3d", "c3d2xyz", "c3d", 1e-4),
        ("xyz2bvh", "bvh2xyz", "bvh", 1e-3),
    ] {
        let ends = if ending == "bvh" {
            &["--ends"][..]
        } else {
            &[]
        };
        for up in ["y", "z", "-x"] {
            let (file, flags) = (path(&format!("t.{ending}")), ["--up", up, "--left-handed"]);
            let out = ["-q", "-o", &file];
            run(writer, &[&out[..], &flags].concat(), &table);
            let read = |flags: &[&str]| {
                let table = run(reader, &[&["-q"], ends, flags, &[&file]].concat(), "");
                Numbers::read(&table).far(&wanted).0
            };
            assert!(read(&flags) < least, "{writer} {up}");
            assert!(read(&flags[..2]) > 10.0, "{writer} {up}");
            if ending == "c3d" && up != "-x" {
                // C3D files say what is up, not the hand.
                assert!(read(&flags[2..]) < least, "{up}");
            }
        }
    }
    // Points that go back into a left-handed file, and a left-handed skeleton.
    let [c3d, bvh, into] = ["t.c3d", "t.bvh", "into.c3d"].map(path);
    let flags = ["-q", "--up", "-x", "--left-handed"];
    let out = ["--into", &c3d, "-o", &into];
    let table_of_c3d = run("c3d2xyz", &[&flags[..], &[&c3d]].concat(), "");
    run("xyz2c3d", &[&flags[..], &out].concat(), &table_of_c3d);
    assert_eq!(fs::read(&c3d).unwrap(), fs::read(&into).unwrap());
    let fitted = run(
        "xyz2bvh",
        &[&flags[..], &["--skeleton", &bvh]].concat(),
        &table,
    );
    fs::write(&bvh, fitted).unwrap();
    let back = run("bvh2xyz", &[&flags[..], &["--ends", &bvh]].concat(), "");
    assert!(Numbers::read(&back).far(&wanted).0 < 0.01);
}

#[test]
fn libraries_and_keys_are_read_left_handed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("right.csv"), walk(300, |p| p)).unwrap();
    fs::create_dir(at("left")).unwrap();
    fs::write(at("left/right.csv"), walk(300, y_up)).unwrap();
    let library = |name: &str, flags: &[&str]| {
        let out = at("motion.npz");
        let all = [&["-q", "--motion", "-o", text(&out)], flags];
        run(
            "prior-train",
            &[&all.concat()[..], &[text(&at(name))]].concat(),
            "",
        );
        fs::read(out).unwrap()
    };
    let right = library("right.csv", &[]);
    assert!(library("left/right.csv", &["--left-handed"]) == right);
    assert!(library("left/right.csv", &[]) != right);
    let motion = at("motion.npz");
    fs::write(&motion, right).unwrap();
    let keys = |table: &str| {
        let lines = table.lines().enumerate();
        let kept = lines.filter(|(n, _)| *n == 0 || (n - 1) % 60 == 0);
        kept.map(|(_, line)| format!("{line}\n"))
            .collect::<String>()
    };
    let between = |name: &str, flags: &[&str]| {
        let keys = keys(&fs::read_to_string(at(name)).unwrap());
        let all = [&["-q", "--prior", text(&motion)], flags].concat();
        Numbers::read(&run("between", &all, &keys))
    };
    let wanted = between("right.csv", &[]).map(y_up);
    let found = between("left/right.csv", &["--left-handed"]);
    assert!(found.rows.len() > 60 && found.far(&wanted).0 < 1e-9);
}

/// Where the data of a parameter are in a C3D file.
fn parameter(file: &[u8], group: u8, name: &str) -> Range<usize> {
    let mut at = 512 * (usize::from(file[0]) - 1) + 4;
    loop {
        let end = at + 2 + usize::from((file[at] as i8).unsigned_abs());
        if file[at + 1] == group && &file[at + 2..end] == name.as_bytes() {
            let sizes = &file[end + 4..][..usize::from(file[end + 3])];
            let count: usize = sizes.iter().map(|n| usize::from(*n)).product();
            let start = end + 4 + sizes.len();
            return start..start + 4 * count;
        }
        at = end + usize::from(u16::from_le_bytes([file[end], file[end + 1]]));
    }
}

/// Exchanges the signs of some of a parameter's reals.
fn flip(file: &mut [u8], group: u8, name: &str, is_it: impl Fn(usize) -> bool) {
    let at = parameter(file, group, name);
    let signs = file[at].iter_mut().skip(3).step_by(4).enumerate();
    let own = signs.filter(|(i, _)| is_it(*i));
    own.for_each(|(_, sign)| *sign ^= 0x80);
}

/// A trial of the worked case in a left-handed laboratory, z up: y has the other sign. With
/// `all_mirrored` the plates' own axes are left-handed, too: their x is turned round.
fn left_handed(name: &str, folder: &Path, all_mirrored: bool) -> PathBuf {
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait");
    let (trial, path) = (case.join(name), folder.join(name));
    let table = run("c3d2xyz", &["-q", text(&trial)], "");
    let flags = [
        "-q",
        "--left-handed",
        "--into",
        text(&trial),
        "-o",
        text(&path),
    ];
    run("xyz2c3d", &flags, &table);
    let mut file = fs::read(&path).unwrap();
    if name == "static.c3d" {
        return path;
    }
    flip(&mut file, 3, "CORNERS", |i| i % 3 == 1);
    if all_mirrored {
        flip(&mut file, 3, "ORIGIN", |i| i % 3 == 0);
        // Of both plates fx, as places are mirrored, and my, mz, as what turns is.
        flip(&mut file, 2, "SCALE", |i| [0, 4, 5].contains(&(i % 6)));
        let corners = parameter(&file, 3, "CORNERS");
        for pair in file[corners].chunks_exact_mut(24) {
            let (one, other) = pair.split_at_mut(12);
            one.swap_with_slice(other);
        }
    }
    fs::write(&path, file).unwrap();
    path
}

/// The columns of a table; NaN in empty cells.
fn columns(table: &str) -> BTreeMap<String, Vec<f64>> {
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let names = reader.headers().unwrap().clone();
    let mut all: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for record in reader.records() {
        for (name, cell) in names.iter().zip(record.unwrap().iter()) {
            let value = cell.parse().unwrap_or(f64::NAN);
            all.entry(name.to_string()).or_default().push(value);
        }
    }
    all
}

/// The largest difference of two tables, as a share of the largest value of each column.
fn apart(one: &str, other: &str) -> f64 {
    let (one, other) = (columns(one), columns(other));
    assert!(one.keys().eq(other.keys()));
    let most = |values: &[f64]| values.iter().fold(1.0_f64, |most, v| most.max(v.abs()));
    let of = |(own, its): (&Vec<f64>, &Vec<f64>)| {
        let pairs = own.iter().zip(its);
        let pairs = pairs.inspect(|(a, b)| assert_eq!(a.is_nan(), b.is_nan()));
        let far = pairs.map(|(a, b)| if a.is_nan() { 0.0 } else { (a - b).abs() });
        far.fold(0.0, f64::max) / most(own)
    };
    one.values().zip(other.values()).map(of).fold(0.0, f64::max)
}

#[test]
fn plates_in_left_handed_laboratories_have_the_same_forces() {
    let folder = tempfile::tempdir().unwrap();
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait/walk.c3d");
    let forces = |flags: &[&str], path: &Path| {
        run("c3d2forces", &[&["-q"], flags, &[text(path)]].concat(), "")
    };
    let wanted = forces(&[], &case);
    for all_mirrored in [false, true] {
        let path = left_handed("walk.c3d", folder.path(), all_mirrored);
        let found = apart(&wanted, &forces(&["--left-handed"], &path));
        assert!(found < 1e-9, "{all_mirrored}: {found}");
        assert!(wanted != forces(&[], &path));
    }
    // A plate whose own z points up is not as the format has it.
    let path = left_handed("walk.c3d", folder.path(), false);
    let mut file = fs::read(&path).unwrap();
    flip(&mut file, 2, "SCALE", |i| [2, 3, 4].contains(&(i % 6)));
    fs::write(&path, file).unwrap();
    let said = fails("c3d2forces", &["--left-handed", text(&path)], b"", 1);
    assert!(
        said.contains("force plate 1: its forces point into the floor"),
        "{said}"
    );
}

#[test]
fn gait_of_left_handed_trials_is_that_of_right_handed_ones() {
    let folder = tempfile::tempdir().unwrap();
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait");
    let gait = |flags: &[&str], trials: &Path, out: &str| {
        let [walk, standing] = ["walk.c3d", "static.c3d"].map(|name| trials.join(name));
        let out = folder.path().join(out);
        let own = [
            "-q",
            "--static",
            text(&standing),
            "-o",
            text(&out),
            text(&walk),
        ];
        command("gait").args(own).args(flags).assert().success();
        fs::read_to_string(out.join("walk.csv")).unwrap()
    };
    let wanted = gait(&[], &case, "right");
    for all_mirrored in [false, true] {
        for name in ["walk.c3d", "static.c3d"] {
            left_handed(name, folder.path(), all_mirrored);
        }
        let out = ["made", "mirrored"][usize::from(all_mirrored)];
        let found = apart(&wanted, &gait(&["--left-handed"], folder.path(), out));
        assert!(found < 1e-6, "{all_mirrored}: {found}");
    }
}
