//! The command `transition` from outside.

use crate::common::{command, fails, run, skipped, take};
use posing::io::Table;
use posing::metric::pose_metric::{Norm, Projection};
use posing::metric::scaling::{Scaling, ScalingRule};
use posing::metric::{JointMap, PoseFeatures, PoseMetric};
use posing::pose::Poses;
use std::path::Path;

/// A walk of CMU, from testdata.
fn walk() -> String {
    take("07", "07_01", &[]).unwrap()
}

/// The table `csv` with another take's name, its points changed by `moved`.
fn copy_of(csv: &str, name: &str, moved: impl Fn([f64; 3]) -> [f64; 3]) -> String {
    let line = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let mut out = vec![name.to_string(), cells[1].to_string()];
        for p in cells[2..].chunks_exact(3) {
            let number = |k: usize| p[k].parse::<f64>().unwrap();
            out.extend(moved([number(0), number(1), number(2)]).map(|v| v.to_string()));
        }
        out.join(",") + "\n"
    };
    csv.lines().skip(1).map(line).collect()
}

/// The rows of the output: frames of a and b, distance, good.
fn rows(csv: &str) -> Vec<(usize, usize, f64, bool)> {
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), 9);
        let good = cells[5..8].iter().all(|c| c.parse::<f64>().unwrap() <= 1.0);
        // Shares are rounded.
        assert!(good == (cells[8] == "1") || cells[5..8].contains(&"1.000"));
        let frame = |k: usize| cells[k].parse().unwrap();
        (
            frame(1),
            frame(3),
            cells[4].parse().unwrap(),
            cells[8] == "1",
        )
    };
    csv.lines().skip(1).map(row).collect()
}

fn read(path: &Path) -> Poses {
    Table::open(path).unwrap().poses
}

/// The largest step of a point from frame to frame, cm.
fn largest_step(poses: &Poses) -> f64 {
    let step = |t: usize, p: usize| {
        let square = |k: usize| (poses.xyz[[t, k]] - poses.xyz[[t - 1, k]]).powi(2);
        (3 * p..3 * p + 3).map(square).sum::<f64>().sqrt()
    };
    let points = 0..poses.points.len();
    (1..poses.frames())
        .flat_map(|t| points.clone().map(move |p| step(t, p)))
        .fold(0.0, f64::max)
}

#[test]
fn a_walk_goes_over_into_its_own_moved_copy_as_if_nothing_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("joined.csv");
    let csv = walk();
    let (sin, cos) = 2.0_f64.sin_cos();
    let moved = |[x, y, z]: [f64; 3]| [cos * x + sin * z + 300.0, y, cos * z - sin * x - 80.0];
    let both = csv.clone() + &copy_of(&csv, "copy", moved);
    let blend = [
        "--from",
        "07_01",
        "--to",
        "copy",
        "--blend",
        path.to_str().unwrap(),
    ];
    let found = rows(&run("transition", &blend, &both));
    assert_eq!(found.len(), 10);
    // 316 frames have room for some 4 candidates on the diagonal; all are the first.
    for (a, b, distance, good) in &found[..4] {
        assert!(a == b && *distance < 1e-3 && *good, "{found:?}");
    }
    let joined = read(&path);
    let table = folder.path().join("walk.csv");
    std::fs::write(&table, csv).unwrap();
    let walk = read(&table);
    assert_eq!(joined.frames(), walk.frames());
    for (a, b) in joined.xyz.iter().zip(&walk.xyz) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    for (a, b) in joined.time.unwrap().iter().zip(walk.time.unwrap()) {
        assert!((a - b).abs() < 1e-6);
    }
    assert_eq!(&*joined.take.unwrap()[0], "07_01>copy");
}

#[test]
fn a_blend_has_no_step_larger_than_its_takes() {
    let folder = tempfile::tempdir().unwrap();
    let (path, table) = (
        folder.path().join("joined.csv"),
        folder.path().join("walk.csv"),
    );
    let csv = walk();
    std::fs::write(&table, &csv).unwrap();
    let flags = ["--within", "--good", "--over", "0.25", "--blend"];
    let args = [
        &flags[..],
        &[path.to_str().unwrap(), table.to_str().unwrap()],
    ]
    .concat();
    let found = rows(&run("transition", &args, ""));
    let (a, b, ..) = found[0];
    assert!(found.iter().all(|row| row.3) && a.abs_diff(b) >= 120);
    let (joined, walk) = (read(&path), read(&table));
    assert_eq!(joined.frames(), a + walk.frames() - b);
    assert!(largest_step(&joined) <= largest_step(&walk) * (1.0 + 1e-9));
    // 15 frames before the transition the take is itself, 15 after it the moved rest.
    for t in 0..=a - 15 {
        assert_eq!(joined.frame(t), walk.frame(t));
    }
    let heights = (1..joined.xyz.ncols()).step_by(3);
    for k in heights {
        assert!((joined.xyz[[a + 15, k]] - walk.xyz[[b + 15, k]]).abs() < 1e-9);
    }
    assert_eq!(joined.rate(), Some(120.0));
    assert_eq!(joined.runs().len(), 1);
    let at = format!("{a},{b}");
    let args = [
        "--from",
        "07_01",
        "--to",
        "07_01",
        "--over",
        "0.25",
        "--at",
        &at,
        table.to_str().unwrap(),
    ];
    assert_eq!(rows(&run("transition", &args, "")), found[..1]);
}

#[test]
fn what_cannot_be_done_is_said_in_a_line() {
    let csv = walk();
    let two = csv.clone() + &copy_of(&csv, "copy", |p| p);
    let said = |args: &[&str], input: &str, code| fails("transition", args, input.as_bytes(), code);
    assert!(said(&[], &csv, 2).contains("--within"));
    let unknown = said(&["--to", "x"], &two, 1);
    assert!(
        unknown.contains("no take \"x\"; it has 07_01, copy"),
        "{unknown}"
    );
    assert!(said(&["--over", "9"], &two, 1).contains("--over"));
    assert!(said(&["--at", "100,100"], &two, 2).contains("--from"));
    let named = ["--from", "07_01", "--to", "copy", "--at", "3,100"];
    assert!(said(&named, &two, 2).contains("frame 3 of take 07_01"));
    assert!(said(&["--blend", "-"], &two, 2).contains("-o"));
    let slow = crate::common::thin(&csv, 400, 4).replace("07_01,", "slow,");
    let slow = csv.clone() + slow.split_once('\n').unwrap().1;
    let rates = said(&["-q"], &slow, 2);
    assert!(rates.contains("120 and 30 frames per second"), "{rates}");
    let untimed: String = two
        .lines()
        .map(|l| l.split(',').enumerate().filter(|(k, _)| *k != 1))
        .map(|cells| cells.map(|c| c.1).collect::<Vec<_>>().join(",") + "\n")
        .collect();
    assert!(said(&[], &untimed, 2).contains("--fps"));
    assert!(
        run("transition", &["--fps", "120"], &untimed)
            .lines()
            .count()
            > 2
    );
}

#[test]
fn the_result_is_the_same_with_any_number_of_threads() {
    let csv = walk();
    let args = |n| ["--within", "--good", "--threads", n];
    let one = run("transition", &args("1"), &csv);
    assert_eq!(one, run("transition", &args("3"), &csv));
    // A joint that is never seen leaves no candidates.
    let blind = csv.replace("lwrist.", "hand.");
    assert!(fails("transition", &["--within"], blind.as_bytes(), 1).contains("lwrist"));
}

/// The weighted joint orientation distance (Chen et al., (41)): rotations and their velocities of
/// the shoulders, elbows, hips, knees, pelvis and spine, and the hip's height.
fn write_wjod(path: &Path) {
    let features = PoseFeatures::Orientations;
    let weights: Vec<f32> = (features.feature_names().iter())
        .map(|name| if name.contains("(Neck)") { 0.0 } else { 1.0 })
        .collect();
    let metric = PoseMetric {
        map: JointMap::cmu(),
        features,
        scaling: Scaling {
            rule: ScalingRule::None,
            shift: vec![0.0; weights.len()],
            scale: vec![1.0; weights.len()],
        },
        window: 0.0,
        projection: Projection::Weights(weights),
        norm: Norm::Euclidean,
    };
    std::fs::write(path, metric.to_model().to_bytes().unwrap()).unwrap();
}

/// Takes of a subject as one table.
fn takes(subject: &str, takes: &[&str]) -> Option<String> {
    let mut table = String::new();
    for name in takes {
        let csv = take(subject, &format!("{subject}_{name}"), &[])?;
        let head = csv.find('\n').map_or(0, |end| end + 1);
        table += if table.is_empty() { &csv } else { &csv[head..] };
    }
    Some(table)
}

/// Pairs at which blends of walks of four other people are good are the labels; the metric learned
/// from them proposes better transitions of a fifth person than WJOD.
#[test]
fn more_transitions_of_a_learned_metric_are_good_than_of_wjod() {
    let people: [(&str, &[&str]); 4] = [
        ("05", &["01"]),
        ("06", &["01"]),
        ("08", &["01", "02", "03"]),
        ("35", &["01", "02", "05"]),
    ];
    let mut train = String::new();
    for (subject, names) in people {
        let Some(csv) = takes(subject, names) else {
            return;
        };
        train += if train.is_empty() {
            &csv
        } else {
            csv.split_once('\n').unwrap().1
        };
    }
    let Some(test) = takes("07", &["01", "02"]) else {
        return skipped("no second walk of subject 07");
    };
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let [pairs, wjod, learned] = ["pairs.csv", "wjod.npz", "learned.npz"].map(file);
    let labels = run(
        "transition",
        &["--good", "-n", "60", "--apart", "0.05"],
        &train,
    );
    std::fs::write(
        &pairs,
        labels.replace("acceleration,good", "acceleration,label"),
    )
    .unwrap();
    let flags = ["-q", "--reach", "0", "--pairs", &pairs, "-o", &learned];
    command("rdsr-train")
        .args(flags)
        .write_stdin(train)
        .assert()
        .success();
    write_wjod(Path::new(&wjod));
    let good = |model: &str, n: usize| {
        let (n, half) = (n.to_string(), "0.2");
        let found = rows(&run(
            "transition",
            &["-m", model, "-n", &n, "--apart", half],
            &test,
        ));
        let good = found.iter().filter(|row| row.3).count();
        eprintln!("{model}: {good} of {} are good", found.len());
        good
    };
    for n in [10, 20] {
        assert!(good(&learned, n) > good(&wjod, n));
    }
}
