//! The commands that learn and use distances of poses: rdsr-train, pose-distance, retrieve,
//! evaluate metric.

use crate::common::{fails, run};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A walk and a run of CMU from testdata, each cut into four takes, and labeled pairs of their
/// frames.
struct Setup {
    folder: tempfile::TempDir,
}

impl Setup {
    fn new() -> Setup {
        let folder = tempfile::tempdir().unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu");
        let table = |subject: &str, take: &str| {
            let file = |name: String| root.join(subject).join(name).display().to_string();
            let asf = file(format!("{subject}.asf"));
            let amc = file(format!("{take}.amc"));
            run("amc2xyz", &["--asf", &asf, "--fps", "120", &amc], "")
        };
        let (walk, run) = (table("07", "07_01"), table("09", "09_06"));
        let mut lines = vec![walk.lines().next().unwrap().to_string()];
        for (table, name) in [(&walk, "walk"), (&run, "run")] {
            let rows: Vec<&str> = table.lines().skip(1).collect();
            for (k, row) in rows.iter().enumerate() {
                let part = 1 + 4 * k / rows.len();
                let rest = row.split_once(',').unwrap().1;
                lines.push(format!("{name}_{part},{rest}"));
            }
        }
        let setup = Setup { folder };
        setup.write("poses.csv", &(lines.join("\n") + "\n"));
        let mut pairs = String::from("a_take,a_frame,b_take,b_frame,label\n");
        for k in 0..12 {
            let (a, b) = (2 * k, 2 * k + 1);
            pairs += &format!("walk_1,{a},walk_2,{b},1\nrun_1,{a},run_2,{b},1\n");
            pairs += &format!("walk_1,{a},run_2,{b},0\nrun_1,{a},walk_2,{b},0\n");
        }
        setup.write("pairs.csv", &pairs);
        setup.write(
            "classes.csv",
            "take,class,subject\nwalk_1,walk,a\nwalk_2,walk,b\nwalk_3,walk,c\nwalk_4,walk,d\n\
             run_1,run,a\nrun_2,run,b\nrun_3,run,c\nrun_4,run,d\n",
        );
        setup
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Trains a metric with more flags; its file.
    fn train(&self, name: &str, flags: &[&str]) -> String {
        let (pairs, poses, out) = (
            self.file("pairs.csv"),
            self.file("poses.csv"),
            self.file(name),
        );
        let mut all = vec!["-q", "--pairs", &pairs, "-o", &out];
        all.extend(flags);
        all.push(&poses);
        run("rdsr-train", &all, "");
        out
    }
}

fn rows(csv: &str) -> Vec<Vec<&str>> {
    csv.lines()
        .skip(1)
        .map(|l| l.split(',').collect())
        .collect()
}

#[test]
fn retrieval_finds_the_pose_itself_first_and_other_takes_when_asked() {
    let setup = Setup::new();
    let metric = setup.train("m.npz", &["--rank", "10"]);
    let poses = setup.file("poses.csv");
    let flags = [
        "-q",
        "-m",
        &metric,
        "-k",
        "3",
        "--every",
        "12",
        "--database",
        &poses,
    ];
    let found = run("retrieve", &[&flags[..], &[&*poses]].concat(), "");
    let head = found.lines().next().unwrap();
    assert_eq!(
        head,
        "take,frame,rank,found_take,found_frame,distance,found_time"
    );
    for row in rows(&found) {
        if row[2] == "1" {
            assert_eq!((row[0], row[1], row[5]), (row[3], row[4], "0"));
        }
        assert_eq!(row[1].parse::<usize>().unwrap() % 12, 0);
    }
    let picture = setup.file("found.svg");
    let classes = setup.file("classes.csv");
    let judged = [
        &flags[1..],
        &["--other-takes", "--classes", &classes, "--scope", "1,3"],
    ]
    .concat();
    let judged = [&judged[..], &["--picture", &picture, &poses]].concat();
    let found = run("retrieve", &judged, "");
    assert!(
        found.starts_with("take,frame,rank,found_take,found_frame,distance,right,found_time\n")
    );
    let found = rows(&found);
    assert!(found.iter().all(|r| r[0] != r[3]));
    let right = found.iter().filter(|r| r[6] == "1").count();
    assert!(10 * right > 8 * found.len(), "{right} of {}", found.len());
    assert!(fs::read_to_string(picture).unwrap().starts_with("<svg"));
}

#[test]
fn poses_are_found_without_a_metric_and_an_index_answers_alike() {
    let setup = Setup::new();
    let (poses, index) = (setup.file("poses.csv"), setup.file("poses.idx"));
    let flags = ["-q", "-k", "3", "--every", "12", "--other-takes"];
    let retrieve = |more: &[&str]| run("retrieve", &[&flags[..], more, &[&*poses]].concat(), "");
    let plain = retrieve(&["--database", &poses]);
    assert_eq!(retrieve(&["--database", &poses, "--index", &index]), plain);
    assert_eq!(retrieve(&["--index", &index]), plain);
    let found = rows(&plain);
    let same = found.iter().filter(|r| r[0][..3] == r[3][..3]).count();
    assert!(3 * same > 2 * found.len(), "{same} of {}", found.len());
    // Each take goes on where the one before it ends.
    let time = |r: &Vec<&str>| r[6].parse::<f64>().unwrap();
    assert!(found.iter().any(|r| r[3] == "walk_2" && time(r) > 0.6));
    // An index of a learned metric has that metric.
    let metric = setup.train("m.npz", &["--rank", "10"]);
    let learned = setup.file("learned.idx");
    let told = retrieve(&["-m", &metric, "--database", &poses, "--index", &learned]);
    assert_eq!(retrieve(&["--index", &learned]), told);
    assert_ne!(told, plain);
    let args = ["-m", &metric, "--index", &index, &poses];
    assert!(fails("retrieve", &args, b"", 1).contains("another metric"));
    let args = ["--index", &metric, &poses];
    assert!(fails("retrieve", &args, b"", 1).contains("no index"));
    let args = ["--index", &index, "--picture", "x.svg", &poses];
    assert!(fails("retrieve", &args, b"", 2).contains("--database"));
}

#[test]
fn motions_are_found_as_events_that_overlap_nowhere() {
    let setup = Setup::new();
    let poses = setup.file("whole.csv");
    let table = fs::read_to_string(setup.path("poses.csv")).unwrap();
    // The walk and the run whole: the same steps again and again.
    let whole = |line: &str| match line.split_once('_') {
        Some((take, rest)) => format!("{take}{}\n", &rest[1..]),
        None => format!("{line}\n"),
    };
    let head = format!("{}\n", table.lines().next().unwrap());
    let rows_of = |take: &str| -> Vec<String> {
        let lines = table.lines().filter(|l| l.starts_with(take));
        lines.map(whole).collect()
    };
    let (walk, run_rows) = (rows_of("walk"), rows_of("run"));
    setup.write(
        "whole.csv",
        &(head.clone() + &walk.concat() + &run_rows.concat()),
    );
    setup.write("step.csv", &(head + &walk[20..140].concat()));
    let example = setup.file("step.csv");
    let events = |more: &[&str]| {
        let flags = ["-q", "--events", "--database", &poses];
        run("retrieve", &[&flags[..], more, &[&*example]].concat(), "")
    };
    let found = events(&["-k", "2"]);
    assert!(
        found.starts_with("found_take,from,to,distance\n"),
        "{found}"
    );
    // The steps themselves are nearest, then the next ones.
    let found = rows(&found);
    let number = |r: &Vec<&str>, k: usize| r[k].parse::<f64>().unwrap();
    assert_eq!((found[0][0], found[1][0]), ("walk", "walk"));
    assert!(number(&found[0], 3) < 1e-2 && number(&found[0], 3) < number(&found[1], 3));
    let from = number(&found[0], 1) - 20.0 / 120.0;
    let to = number(&found[0], 2) - 139.0 / 120.0;
    assert!(from.abs() < 0.04 && to.abs() < 0.04, "{found:?}");
    let all = events(&["--within", "100"]);
    let all = rows(&all);
    for (k, x) in all.iter().enumerate() {
        assert!(number(x, 1) < number(x, 2));
        for y in &all[..k] {
            let apart = number(x, 2) <= number(y, 1) || number(y, 2) <= number(x, 1);
            assert!(x[0] != y[0] || apart, "{x:?} {y:?}");
        }
    }
    let ranked = events(&["--within", "100", "--apart", "1000"]);
    let takes: Vec<&str> = rows(&ranked).iter().map(|r| r[0]).collect();
    assert_eq!(takes, ["walk", "run"]);
    let liked = events(&["--like", "run"]);
    assert!(rows(&liked).iter().any(|r| r[0] == "run") && rows(&liked).len() <= all.len());
    let others = events(&["--other-takes"]);
    assert!(rows(&others).iter().all(|r| r[0] != "walk"));
    let said = |args: &[&str], code| {
        let flags = ["--events", "--database", &poses];
        fails("retrieve", &[&flags[..], args].concat(), b"", code)
    };
    assert!(said(&["--like", "swim", &example], 1).contains("no take \"swim\""));
    let short: Vec<&str> = table.lines().take(5).collect();
    setup.write("short.csv", &(short.join("\n") + "\n"));
    let short = setup.file("short.csv");
    assert!(said(&[&short], 1).contains("a motion has at least 3"));
}

#[test]
fn people_may_contradict_each_other() {
    let setup = Setup::new();
    let pairs = fs::read_to_string(setup.path("pairs.csv")).unwrap();
    let mut more = pairs.clone();
    more += "walk_1,0,walk_2,1,0\nwalk_2,1,walk_1,0,0\n";
    setup.write("more.csv", &more);
    let (more, poses, out) = (
        setup.file("more.csv"),
        setup.file("poses.csv"),
        setup.file("m.npz"),
    );
    let args = ["--rank", "10", "--pairs", &more, "-o", &out, &poses];
    let done = crate::common::command("rdsr-train")
        .args(args)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{said}");
    assert!(said.contains("labeled both 1 and 0: 1 pairs"), "{said}");
    assert!(said.contains("23 pairs of label 1"), "{said}");
}

#[test]
fn every_learner_learns_and_equal_runs_give_equal_files() {
    let setup = Setup::new();
    for learner in [
        "l2", "lms", "boost", "xing", "sda", "rca", "lmnn", "nca", "rdsr",
    ] {
        let flags = ["--learner", learner, "--rank", "5", "--features", "jc"];
        let once = setup.train("a.npz", &[&flags[..], &["--threads", "1"]].concat());
        let again = setup.train("b.npz", &[&flags[..], &["--threads", "2"]].concat());
        assert_eq!(
            fs::read(once).unwrap(),
            fs::read(again).unwrap(),
            "{learner}"
        );
    }
    setup.train(
        "paper.npz",
        &["--paper", "--rank", "5", "--unlabelled", "60"],
    );
    setup.train("supervised.npz", &["--unlabelled", "0", "--rank", "5"]);
}

#[test]
fn distances_of_pairs_tell_labels_and_tables_compare_row_by_row() {
    let setup = Setup::new();
    let metric = setup.train("m.npz", &["--rank", "10"]);
    let (pairs, poses) = (setup.file("pairs.csv"), setup.file("poses.csv"));
    let distances = |flags: &[&str]| -> Vec<f64> {
        let out = run("pose-distance", flags, "");
        assert!(out.starts_with("a_take,a_frame,b_take,b_frame,distance\n"));
        rows(&out).iter().map(|r| r[4].parse().unwrap()).collect()
    };
    let mut names = vec![("-m", metric.as_str())];
    names
        .extend(["jod", "wjcd", "ljcd", "jrf-lms", "rgf-boost", "game"].map(|b| ("--baseline", b)));
    for (flag, name) in names {
        let learned = ["ljcd", "jrf-lms", "rgf-boost"].contains(&name);
        let labels = if learned {
            vec!["--labels", &pairs]
        } else {
            vec![]
        };
        let all = [
            &["-q", flag, name, "--pairs", &pairs][..],
            &labels,
            &[&*poses],
        ]
        .concat();
        let found = distances(&all);
        let mean = |label: usize| {
            let own = found
                .iter()
                .enumerate()
                .filter(|(k, _)| (k / 2 + label) % 2 == 1);
            own.map(|(_, d)| d).sum::<f64>() / 24.0
        };
        assert_eq!(found.len(), 48);
        // What is not learned does not know what is called alike here.
        let (alike, unlike) = (mean(1), mean(0));
        assert!(
            alike < unlike || !(learned || flag == "-m"),
            "{name}: {alike} {unlike}"
        );
    }
    let itself = distances(&["-q", "-m", &metric, &poses, &poses]);
    assert!(itself.iter().all(|d| *d == 0.0));
    let few = setup.path("few.csv");
    let table = fs::read_to_string(&poses).unwrap();
    let lines: Vec<&str> = table.lines().take(6).collect();
    fs::write(&few, lines.join("\n")).unwrap();
    let few = few.display().to_string();
    let all = distances(&["-q", "--baseline", "wjod", "--all", &few, &few]);
    assert_eq!(all.len(), 25);
    let said = fails("pose-distance", &["-m", &metric, &few, &poses], b"", 1);
    assert!(said.contains("--all"), "{said}");
}

#[test]
fn bad_labels_are_told_in_one_line() {
    let setup = Setup::new();
    let poses = setup.file("poses.csv");
    let head = "a_take,a_frame,b_take,b_frame,label\n";
    let said = |text: &str, flags: &[&str], code: i32| {
        setup.write("bad.csv", text);
        let (bad, out) = (setup.file("bad.csv"), setup.file("out.npz"));
        let flags = [&["--pairs", &bad, "-o", &out][..], flags, &[&*poses]].concat();
        let said = fails("rdsr-train", &flags, b"", code);
        assert_eq!(said.trim().lines().count(), 1, "{said}");
        assert!(!Path::new(&out).exists());
        said
    };
    let cases = [
        (
            format!("{head}nobody,0,walk_1,0,1\n"),
            "bad.csv:2:",
            "\"nobody\"",
        ),
        (
            format!("{head}walk_1,99999,walk_2,0,1\n"),
            "bad.csv:2:",
            "expected 0 to",
        ),
        (
            format!("{head}walk_1,-1,walk_2,0,1\n"),
            "bad.csv:2:",
            "\"-1\"",
        ),
        (
            format!("{head}walk_1,0,walk_2,0,maybe\n"),
            "bad.csv:2:",
            "expected 1 or 0",
        ),
        (head.to_string(), "bad.csv", "no pairs"),
        ("a_take,a_frame\n".to_string(), "bad.csv:1:", "b_take"),
        (
            format!("{head}walk_1,0,walk_2,0,0\n"),
            "poses.csv",
            "label 1",
        ),
    ];
    for (text, place, what) in &cases {
        let said = said(text, &[], 1);
        assert!(said.contains(place) && said.contains(what), "{said}");
    }
    let only_alike = format!("{head}walk_1,0,walk_2,0,1\nrun_1,0,run_2,4,1\n");
    for learner in ["lms", "boost", "xing", "sda", "lmnn"] {
        let said = said(&only_alike, &["--learner", learner], 1);
        assert!(said.contains("label 0"), "{learner}: {said}");
    }
    let alike = setup.file("alike.csv");
    setup.write("alike.csv", &only_alike);
    for learner in ["l2", "rca", "rdsr"] {
        let out = setup.file("alike.npz");
        let flags = [
            "-q",
            "--learner",
            learner,
            "--pairs",
            &alike,
            "-o",
            &out,
            &poses,
        ];
        run("rdsr-train", &flags, "");
    }
}

#[test]
fn takes_with_other_joints_or_rates_are_told() {
    let setup = Setup::new();
    let metric = setup.train("m.npz", &["--rank", "5"]);
    let poses = setup.file("poses.csv");
    let table = fs::read_to_string(&poses).unwrap();
    let renamed = setup.file("renamed.csv");
    setup.write("renamed.csv", &table.replace("lwrist.", "paw."));
    let flags = ["-m", &*metric, "--database", &*poses, &*renamed];
    let said = fails("retrieve", &flags, b"", 1);
    assert!(
        said.contains("renamed.csv") && said.contains("\"lwrist\""),
        "{said}"
    );
    // The walk again, at half the rate.
    let slow: Vec<String> = (table.lines())
        .enumerate()
        .filter(|(k, line)| *k == 0 || (line.starts_with("walk_1") && k % 2 == 1))
        .map(|(_, line)| line.replace("walk_1", "slow"))
        .collect();
    setup.write("both.csv", &(table.clone() + &slow[1..].join("\n") + "\n"));
    let both = setup.file("both.csv");
    let out = crate::common::command("retrieve")
        .args(["-m", &metric, "--database", &both, &poses])
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success());
    assert!(said.contains("60 to 120 frames per second"), "{said}");
    let dictionary = setup.file("dict.npz");
    run(
        "ksvd-train",
        &[
            "-q",
            "-n",
            "20",
            "--iterations",
            "1",
            "-o",
            &dictionary,
            &poses,
        ],
        "",
    );
    let said = fails(
        "retrieve",
        &["-m", &dictionary, "--database", &poses, &poses],
        b"",
        1,
    );
    assert!(said.contains("rdsr-train"), "{said}");
}

#[test]
fn an_evaluation_writes_tables_that_agree() {
    let setup = Setup::new();
    let (classes, poses, out) = (
        setup.file("classes.csv"),
        setup.file("poses.csv"),
        setup.path("out"),
    );
    let folder = out.display().to_string();
    let flags = [
        "metric",
        "--classes",
        &classes,
        "--labels",
        "class,phase",
        "--pairs",
        "20",
        "--short",
        "-o",
        &folder,
        &poses,
    ];
    let text = run("evaluate", &flags, "");
    assert!(text.contains("gpd+rdsr") && text.contains("wjod"), "{text}");
    let csv = fs::read_to_string(out.join("metric.csv")).unwrap();
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("metric.json")).unwrap()).unwrap();
    let methods: BTreeSet<&str> = csv
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(2).unwrap())
        .collect();
    assert!(methods.len() >= 12, "{methods:?}");
    assert_eq!(json["tables"].as_array().unwrap().len(), 2);
    assert_eq!(json["learned"][0], "a");
    assert_eq!(json["learned"][1], "c");
    assert_eq!(json["tested"][0], "b");
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(html.contains("<svg") && !html.contains("http://") || html.contains("www.w3.org"));
    let flags = ["metric", "--classes", &classes, "--test", "zz", &poses];
    assert!(fails("evaluate", &flags, b"", 2).contains("subjects are a, b, c, d"));
}
