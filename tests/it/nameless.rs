//! `clean` of takes whose tracks have no names.

use crate::common::{command, shared};
use posing::io::MotionFile;
use posing::io::motion_file::ReadOptions;
use posing::pose::{Poses, point_at};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A gait of 39 markers, and a static take and a walk of 15.
fn example(name: &str) -> Poses {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples");
    let file = MotionFile::open(folder.join(name), &ReadOptions::default()).unwrap();
    file.poses().clone()
}

/// A table of people, each elsewhere, whose points are called as `name` says.
fn table(people: &[(&Poses, [f64; 3])], name: impl Fn(usize, usize, &str) -> String) -> String {
    let frames = people.iter().map(|(p, _)| p.frames()).min().unwrap();
    let rate = people[0].0.rate().unwrap();
    let mut header = vec!["time".to_string()];
    for (k, (poses, _)) in people.iter().enumerate() {
        for (p, own) in poses.points.iter().enumerate() {
            let name = name(k, p, own);
            header.extend(["x", "y", "z"].map(|axis| format!("{name}.{axis}")));
        }
    }
    let mut out = header.join(",") + "\n";
    for t in 0..frames {
        let mut cells = vec![format!("{:.6}", t as f64 / rate)];
        for (poses, off) in people {
            for p in 0..poses.points.len() {
                let at = point_at(poses.xyz.view(), t, p).to_array();
                let cell = |c: usize| match at[c] + off[c] {
                    v if v.is_finite() => format!("{v:.4}"),
                    _ => String::new(),
                };
                cells.extend((0..3).map(cell));
            }
        }
        out += &(cells.join(",") + "\n");
    }
    out
}

/// Names of no label, in another order than the points.
fn nameless(k: usize, p: usize, _: &str) -> String {
    format!("*{}", 100 * k + (7 * p) % 53 + 1)
}

fn own(_: usize, _: usize, name: &str) -> String {
    name.to_string()
}

struct Night(tempfile::TempDir);

impl Night {
    fn new(takes: &[(&str, String)]) -> Night {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("raw")).unwrap();
        for (name, content) in takes {
            fs::write(folder.path().join("raw").join(name), content).unwrap();
        }
        Night(folder)
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Cleans the folder; the exit code and what the JSON has of the files.
    fn clean(&self, args: &[&str]) -> (i32, Value) {
        let done = command("clean")
            .current_dir(self.0.path())
            .args(["raw/", "-o", "solved/", "--json"])
            .args(args)
            .output()
            .unwrap();
        let json = serde_json::from_slice(&done.stdout).unwrap();
        (done.status.code().unwrap(), json)
    }

    fn result(&self, name: &str) -> Poses {
        let path = self.at("solved").join(name);
        let file = MotionFile::open(path, &ReadOptions::default()).unwrap();
        file.poses().clone()
    }

    fn record(&self, name: &str) -> Value {
        let text = fs::read(self.at("solved").join(format!("{name}.json"))).unwrap();
        serde_json::from_slice(&text).unwrap()
    }
}

/// Whether each label of one table is in the other at the same positions.
fn are_named(found: &Poses, prefix: &str, want: &Poses, off: [f64; 3]) {
    for (p, name) in want.points.iter().enumerate() {
        let name = format!("{prefix}{name}");
        let of = found.points.iter().position(|n| *n == name);
        let of = of.unwrap_or_else(|| panic!("no {name}"));
        for t in (0..found.frames()).step_by(10) {
            let at = point_at(want.xyz.view(), t, p).to_array();
            let is = point_at(found.xyz.view(), t, of).to_array();
            let far = (0..3)
                .map(|c| (at[c] + off[c] - is[c]).abs())
                .fold(0.0, f64::max);
            assert!(far < 0.5, "{name} in frame {t}: {far} cm");
        }
    }
}

#[test]
fn a_static_take_in_the_folder_names_tracks_of_a_set_that_nobody_taught() {
    let (walk, still) = (example("gait/walk.c3d"), example("gait/static.c3d"));
    let nowhere = [0.0; 3];
    let night = Night::new(&[
        ("walk.csv", table(&[(&walk, nowhere)], nameless)),
        ("still.csv", table(&[(&still, nowhere)], own)),
    ]);
    night.clean(&["--solve"]);
    are_named(&night.result("walk.csv"), "", &walk, nowhere);
    let record = night.record("walk.csv");
    assert_eq!(record["named"]["by"], "still.csv");
    assert!(night.at("solved/walk.bvh").exists());
    // Another run does nothing, until the labeled take beside it is another.
    let outcome = |json: &Value| {
        let files = json["files"].as_array().unwrap();
        let walk = files.iter().find(|f| f["file"] == "walk.csv").unwrap();
        walk["outcome"].clone()
    };
    assert_eq!(outcome(&night.clean(&["--solve"]).1), "unchanged");
    fs::remove_file(night.at("raw/still.csv")).unwrap();
    let (code, json) = night.clean(&["--solve"]);
    assert_eq!((code, outcome(&json)), (3, "copied".into()));
    let findings = night.record("walk.csv")["summary"]["findings"].to_string();
    assert!(findings.contains("its tracks have no names"), "{findings}");
    assert!(!night.at("solved/walk.bvh").exists());
    // Nothing names it, so its names stay.
    let names = night.result("walk.csv").points;
    assert!(names.iter().all(|name| name.starts_with('*')), "{names:?}");
}

#[test]
fn two_people_without_names_are_two() {
    let gait = example("biomechanist/gait.c3d");
    let people = [(&gait, [0.0; 3]), (&gait, [20.0, 0.0, 110.0])];
    let night = Night::new(&[("both.csv", table(&people, nameless))]);
    night.clean(&["--solve"]);
    let found = night.result("both.csv");
    let first = found.points.iter().position(|n| n == "1:LFHD").unwrap();
    let at = point_at(found.xyz.view(), 0, first).z - point_at(gait.xyz.view(), 0, 0).z;
    let offs = if at.abs() < 1.0 {
        [people[0].1, people[1].1]
    } else {
        [people[1].1, people[0].1]
    };
    are_named(&found, "1:", &gait, offs[0]);
    are_named(&found, "2:", &gait, offs[1]);
    for person in ["1", "2"] {
        assert!(night.at(&format!("solved/both-{person}.bvh")).exists());
    }
    let record = night.record("both.csv");
    assert_eq!(record["named"]["by"], "pig");
    // The sides of one are not those of another: the body is no mirror image.
    let findings = record["summary"]["findings"].to_string();
    assert!(!findings.contains("mirror"), "{findings}");
    // The skeletons are results, and no captures of another run.
    let again = command("clean")
        .current_dir(night.at(""))
        .args(["solved/", "-o", "more/"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&again.stderr);
    assert!(said.contains("no files of motion"), "{said}");
}

#[test]
fn people_who_come_one_after_another_are_not_one() {
    let gait = example("biomechanist/gait.c3d");
    let frames = gait.frames();
    let [mut first, mut second] = [gait.clone(), gait.clone()];
    // The second, a tenth larger, comes once the first has gone.
    second.xyz.mapv_inplace(|v| 1.1 * v);
    first
        .xyz
        .slice_mut(ndarray::s![frames / 2.., ..])
        .fill(f64::NAN);
    second
        .xyz
        .slice_mut(ndarray::s![..frames / 2 + 30, ..])
        .fill(f64::NAN);
    let people = [(&first, [0.0; 3]), (&second, [20.0, 0.0, 110.0])];
    let night = Night::new(&[("relay.csv", table(&people, nameless))]);
    night.clean(&["--solve"]);
    let found = night.result("relay.csv");
    // What is named of one is nobody else's.
    for t in [10, frames - 10] {
        let seen = |person: &str| {
            let own = |n: &&String| n.starts_with(person);
            let at = |name: &String| found.points.iter().position(|n| n == name).unwrap();
            let all = found.points.iter().filter(own);
            all.filter(|n| point_at(found.xyz.view(), t, at(n)).is_finite())
                .count()
        };
        assert!(seen("1:") == 0 || seen("2:") == 0, "frame {t}");
    }
    assert!(!night.at("solved/relay.bvh").exists());
    let record = night.record("relay.csv");
    assert_eq!(record["labels"]["named"]["people"], 2);
}

#[test]
fn who_leaves_and_returns_is_one() {
    let gait = example("biomechanist/gait.c3d");
    let frames = gait.frames();
    let mut seen = gait.clone();
    let away = frames / 3..frames / 3 + 40;
    seen.xyz.slice_mut(ndarray::s![away, ..]).fill(f64::NAN);
    let [mut early, mut late] = [seen.clone(), seen.clone()];
    // Other tracks after than before.
    late.xyz
        .slice_mut(ndarray::s![..frames / 3, ..])
        .fill(f64::NAN);
    early
        .xyz
        .slice_mut(ndarray::s![frames / 3.., ..])
        .fill(f64::NAN);
    let tracks = [(&early, [0.0; 3]), (&late, [0.0; 3])];
    let night = Night::new(&[("walk.csv", table(&tracks, nameless))]);
    night.clean(&["--solve"]);
    let named = night.record("walk.csv")["labels"]["named"].clone();
    assert_eq!(named["people"], 1, "{named}");
    assert_eq!(named["labels"].as_array().unwrap().len(), gait.points.len());
    assert!(night.at("solved/walk.bvh").exists());
}

#[test]
fn the_body_says_which_side_of_an_exchange_behind_a_gap_is_right() {
    let Some(trust) = shared("data/trust") else {
        return;
    };
    let take = trust.join("swap-of-heads-behind-gap.c3d.gz");
    let out = command("label")
        .arg(take)
        .args(["--dry-run", "--json"])
        .output()
        .unwrap();
    let said: Value = serde_json::from_slice(&out.stdout).unwrap();
    let labels = &said["files"][0]["labels"];
    assert_eq!(
        labels["changes"][0]["frames"],
        serde_json::json!([100, 220]),
        "{said}"
    );
    assert_eq!(labels["changes"][0]["side"], "body", "{said}");
}

#[test]
fn names_that_are_there_and_tracks_of_no_body_stay() {
    let gait = example("biomechanist/gait.c3d");
    let nowhere = [0.0; 3];
    let labeled = table(&[(&gait, nowhere)], own);
    // Tracks of a grid that moves: no body.
    let mut grid = gait.clone();
    for ((t, c), v) in grid.xyz.indexed_iter_mut() {
        let (p, axis) = (c / 3, c % 3);
        let place = [(p % 6) as f64, (p / 6) as f64, ((p * p) % 5) as f64];
        *v = 30.0 * place[axis] + (0.05 * t as f64 + p as f64).sin();
    }
    let things = table(&[(&grid, nowhere)], nameless);
    let night = Night::new(&[
        ("gait.csv", labeled.clone()),
        ("things.csv", things.clone()),
    ]);
    night.clean(&[]);
    let bytes = |name: &str| fs::read_to_string(night.at("solved").join(name)).unwrap();
    assert_eq!(bytes("gait.csv"), labeled);
    assert_eq!(bytes("things.csv"), things);
    // As asked for, no names are looked for.
    let raw = table(&[(&gait, nowhere)], nameless);
    let night = Night::new(&[("raw.csv", raw.clone())]);
    night.clean(&["--no-labels"]);
    assert_eq!(fs::read_to_string(night.at("solved/raw.csv")).unwrap(), raw);
}

#[test]
fn two_points_are_exchanged_where_somebody_says_so_or_the_body_does() {
    let gait = example("biomechanist/gait.c3d");
    let exchanged = |pair: [&str; 2]| {
        let other = move |_: usize, _: usize, name: &str| match name {
            n if n == pair[0] => pair[1].to_string(),
            n if n == pair[1] => pair[0].to_string(),
            n => n.to_string(),
        };
        table(&[(&gait, [0.0; 3])], other)
    };
    let night = Night::new(&[("gait.csv", exchanged(["LELB", "LUPA"]))]);
    night.clean(&[]);
    are_named(&night.result("gait.csv"), "", &gait, [0.0; 3]);
    let change = night.record("gait.csv")["labels"]["changes"][0].clone();
    assert_eq!(
        (&change["kind"], &change["side"]),
        (&"whole-take".into(), &"body".into())
    );
    // What somebody says is done, right or wrong.
    let night = Night::new(&[("gait.csv", table(&[(&gait, [0.0; 3])], own))]);
    night.clean(&["--exchange", "LTHI:RTHI", "--keep-labels", "LTHI:0-9"]);
    let found = night.result("gait.csv");
    let at = |poses: &Poses, name: &str| {
        let p = poses.points.iter().position(|n| n == name).unwrap();
        point_at(poses.xyz.view(), 50, p)
    };
    assert!(at(&found, "LTHI").distance(at(&gait, "RTHI")) < 0.01);
}
