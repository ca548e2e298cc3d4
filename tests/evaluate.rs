//! The command `evaluate` from outside, on takes cut from the two that lie in testdata.

mod common;

use common::{bin, command, fails, run};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The takes of a subject: its one take of testdata cut into `parts`, named SUBJECT_a, SUBJECT_b, ...
fn takes(subject: &str, take: &str, parts: usize) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("testdata/cmu")
        .join(subject);
    let asf = folder.join(format!("{subject}.asf"));
    let amc = folder.join(format!("{take}.amc"));
    let (asf, amc) = (asf.to_str().unwrap(), amc.to_str().unwrap());
    let table = run(
        "amc2xyz",
        &["--asf", asf, "--fps", "120", "--space", "body", amc],
        "",
    );
    let mut lines = table.lines();
    let mut out = lines.next().unwrap().to_string() + "\n";
    let rows: Vec<&str> = lines.collect();
    for (i, row) in rows.iter().enumerate() {
        let part = b'a' + (i * parts / rows.len()) as u8;
        let (_, rest) = row.split_once(',').unwrap();
        out.push_str(&format!("{subject}_{},{rest}\n", part as char));
    }
    out
}

struct Folder(tempfile::TempDir);

impl Folder {
    /// With walk.csv (07, four takes) and run.csv (09, three takes).
    fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.file("walk.csv", &takes("07", "07_01", 4));
        folder.file("run.csv", &takes("09", "09_06", 3));
        folder
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_string()
    }
    fn file(&self, name: &str, text: &str) -> String {
        fs::write(self.path(name), text).unwrap();
        self.name(name)
    }
    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }
    /// The arguments of a small evaluation into a folder.
    fn small(&self, out: &str) -> Vec<String> {
        let mut args: Vec<String> = [
            "--models",
            "sparse:n=20,ksvd:n=20",
            "--seeds",
            "2",
            "--frames",
            "30",
            "-o",
        ]
        .map(String::from)
        .to_vec();
        args.extend([self.name(out), self.name("walk.csv"), self.name("run.csv")]);
        args
    }
}

fn texts(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
}

/// The lines of a table of one take.
fn of_take<'t>(table: &'t str, take: &str) -> Vec<&'t str> {
    let start = format!("{take},");
    table.lines().filter(|l| l.starts_with(&start)).collect()
}

#[test]
fn a_small_evaluation_says_what_it_found_in_three_ways() {
    let dir = Folder::new();
    let said = run("evaluate", &texts(&dir.small("out")), "");
    for part in [
        "split frames:",
        "split takes:",
        "split subjects:",
        "2 seeds",
        "*",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let json: Value = serde_json::from_str(&dir.read("out/results.json")).unwrap();
    let (rows, cells) = (&json["summary"], json["cells"].as_array().unwrap());
    assert_eq!((rows.as_array().unwrap().len(), cells.len()), (18, 36));
    for row in rows.as_array().unwrap() {
        let number = |v: &Value| v.as_f64().unwrap();
        let mse = number(&row["mse"]);
        assert!(
            number(&row["interval"][0]) <= mse && mse <= number(&row["interval"][1]),
            "{row}"
        );
        assert!(mse > 0.0 && mse < 20.0, "{row}");
        assert_eq!(row["by_joint"].as_array().unwrap().len(), 23);
        assert!(row["frames"] == 60 && row["seeds"].as_array().unwrap().len() == 2);
    }
    // Whoever is learnt from is restored better than somebody else.
    let subjects = rows
        .as_array()
        .unwrap()
        .iter()
        .filter(|r| r["split"] == "subjects");
    for row in subjects {
        assert!(row["training_mse"].as_f64() < row["mse"].as_f64(), "{row}");
    }
    assert_eq!(dir.read("out/results.csv").lines().count(), 1 + 36 + 18);
    assert_eq!(dir.read("out/times.csv").lines().count(), 1 + 36);
    assert_eq!(dir.read("out/cells.jsonl").lines().count(), 36);
    // Both models' answers to what the page shows: a pose in three tasks, two from two dimensions, a stretch of a take.
    assert_eq!(dir.read("out/examples.jsonl").lines().count(), 2);
    let page = dir.read("out/report.html");
    assert_eq!(page.matches("<div class=\"player\">").count(), 6);
    assert!(page.contains("Under the split takes, seed 0.") && page.len() < 1_000_000);
    for outside in ["http:", "https:", "src=", "@import"] {
        assert!(!page.contains(outside), "{outside}");
    }
}

#[test]
fn finished_runs_stand_beside_the_papers_tables() {
    let dir = Folder::new();
    let (walk, runs) = (dir.name("walk.csv"), dir.name("run.csv"));
    let small = [
        "-q",
        "--models",
        "ksvd-omp:n=20,gaussian,ksvd-omp",
        "--seeds",
        "1",
    ];
    let one = |out: &str, tables: &[&str]| {
        let out = dir.name(out);
        let more = ["--frames", "20", "-o", &out];
        run("evaluate", &[&small[..], &more, tables].concat(), "");
        out
    };
    let (single, both) = (one("single", &[&walk]), one("both", &[&walk, &runs]));
    let tables = dir.name("tables");
    let args = ["--paper", &single, "--paper", &both, "-o", &tables];
    let pages = || {
        run("evaluate", &args, "");
        (
            dir.read("tables/tables.html"),
            dir.read("tables/tables.csv"),
        )
    };
    let (page, csv) = pages();
    assert!((page.clone(), csv.clone()) == pages());
    for part in [
        "Table 1:",
        "Table 2: dense noise",
        "subject 07",
        "rank correlation",
        "href=\"single/report.html\"",
    ] {
        assert!(page.contains(part), "{part}");
    }
    // The paper's figure and the measured one in one line.
    let line = |start: &str| csv.lines().find(|l| l.starts_with(start)).unwrap();
    let json: Value = serde_json::from_str(&dir.read("single/results.json")).unwrap();
    let rows = json["summary"].as_array().unwrap();
    let row = rows
        .iter()
        .find(|r| r["model"] == "ksvd-omp" && r["task"] == "dense" && r["split"] == "takes");
    let mse = row.unwrap()["mse"].as_f64().unwrap();
    let start = format!("2,07,dense,Our model,ksvd-omp,0.02,takes,{mse},");
    assert!(line(&start).ends_with(",1,20"));
    assert!(line("1,all,complete,Gaussian,gaussian,0.3,subjects,").ends_with(",1,20"));
    let said = fails(
        "evaluate",
        &["--paper", &dir.name("none"), "-o", &tables],
        b"",
        1,
    );
    assert!(said.contains("none/results.json"), "{said}");
    dir.file("results.json", "{}");
    let here = dir.0.path().to_str().unwrap();
    let said = fails("evaluate", &["--paper", here, "-o", &tables], b"", 1);
    assert!(said.contains("is no results.json of a run"), "{said}");
    fails("evaluate", &["--paper", &single], b"", 2);
}

/// `make tables` without make.
fn tables(args: &[&str]) -> std::process::Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    Command::new("sh")
        .arg(root.join("testdata/examples/tables.sh"))
        .args(args)
        .env("POSING_BIN", bin())
        .env("MODELS", "ksvd,gaussian")
        .env("FRAMES", "20")
        .output()
        .unwrap()
}

#[test]
fn the_tables_of_the_paper_are_made_in_one_go() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let cmu = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu");
    let (cmu, out) = (cmu.to_str().unwrap(), out.to_str().unwrap());
    let done = tables(&["--quick", cmu, out]);
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{said}");
    for made in [
        "tables.html",
        "tables.csv",
        "07/report.html",
        "all/report.html",
    ] {
        assert!(Path::new(out).join(made).is_file(), "{made}");
    }
    let none = tables(&["--quick", "", out]);
    assert_eq!(none.status.code(), Some(2));
    let said = String::from_utf8_lossy(&none.stderr).into_owned();
    assert!(said.lines().count() == 1 && said.contains("CMU="), "{said}");
}

#[test]
fn any_number_of_threads_and_a_kill_give_the_same_bytes() {
    let dir = Folder::new();
    let with = |out: &str, threads: &str| {
        let mut args = dir.small(out);
        args.extend(["--threads", threads, "-q"].map(String::from));
        run("evaluate", &texts(&args), "");
        (
            dir.read(&format!("{out}/results.csv")),
            dir.read(&format!("{out}/results.json")),
            dir.read(&format!("{out}/report.html")),
        )
    };
    let whole = with("one", "1");
    assert!(whole == with("seven", "7"));
    // Killed when it has finished some cells, and with a line half written.
    let mut child = Command::new(bin().join("evaluate"))
        .args(dir.small("killed"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let cells = dir.path("killed/cells.jsonl");
    let began = Instant::now();
    let lines = || fs::read_to_string(&cells).map_or(0, |t| t.lines().count());
    while lines() < 3 && began.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let mut kept = fs::read_to_string(&cells).unwrap();
    let at = kept.rfind('\n').unwrap() + 1;
    kept.truncate(at);
    kept.push_str("{\"key\":\"12");
    fs::write(&cells, &kept).unwrap();
    assert!(whole == with("killed", "2"));
    assert!(dir.read("killed/cells.jsonl").starts_with(&kept[..at]));
    // Nothing is left to do.
    let before = dir.read("killed/cells.jsonl");
    assert!(whole == with("killed", "2"));
    assert!(dir.read("killed/cells.jsonl") == before);
    // A cell with lists that are too short is made again.
    let list = before.find("\"within\":[").unwrap() + 10;
    let end = list + before[list..].find(']').unwrap();
    let short = [&before[..list], &before[end..]].concat();
    fs::write(&cells, &short).unwrap();
    assert!(whole == with("killed", "2"));
    assert!(dir.read("killed/cells.jsonl").starts_with(&short));
    fs::write(&cells, &before).unwrap();
    // With a seed more, only that is done.
    let mut more = dir.small("killed");
    more.extend(["--seeds", "3"].map(String::from));
    more.retain({
        let mut seen = 0;
        move |a| {
            seen += usize::from(a == "--seeds" || a == "2");
            !(seen <= 2 && (a == "--seeds" || a == "2"))
        }
    });
    let done = command("evaluate").args(&more).assert().success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(said.contains("36 of 54 cells were done before"), "{said}");
    // A work file that is none is not gone on from.
    fs::write(&cells, "hello\n").unwrap();
    let said = fails("evaluate", &texts(&dir.small("killed")), b"", 1);
    assert!(
        said.contains("cells.jsonl:1: is no finished cell"),
        "{said}"
    );
}

#[test]
fn a_model_is_not_tested_on_what_it_was_trained_from() {
    let dir = Folder::new();
    let (walk, runs) = (dir.name("walk.csv"), dir.name("run.csv"));
    let train = |name: &str, table: &str| {
        let model = dir.name(name);
        run(
            "ksvd-train",
            &[
                "-n",
                "15",
                "--iterations",
                "2",
                "--space",
                "body",
                "-q",
                "-o",
                &model,
                table,
            ],
            "",
        );
        model
    };
    let test = |model: &str, split: &str| {
        fails(
            "evaluate",
            &["-q", "-m", model, "--splits", split, "--seeds", "1", &walk],
            b"",
            1,
        )
    };
    // From all takes, from one of them among others, and from every third frame of one.
    let whole = dir.read("walk.csv");
    let head = whole.lines().next().unwrap().to_string() + "\n";
    let with = |takes: &[&str], step: usize| {
        let rows: Vec<&str> = takes
            .iter()
            .flat_map(|t| of_take(&whole, t))
            .step_by(step)
            .collect();
        head.clone() + &rows.join("\n") + "\n"
    };
    let mixed = with(&["07_b"], 1) + dir.read("run.csv").split_once('\n').unwrap().1;
    let mixed = dir.file("mixed.csv", &mixed);
    let third = dir.file("third.csv", &with(&["07_c"], 3));
    for (name, table, take) in [
        ("a.npz", &walk, "07_a and 3 more"),
        ("b.npz", &mixed, "07_b"),
        ("c.npz", &third, "07_c"),
    ] {
        let model = train(name, table);
        for split in ["takes", "frames"] {
            let said = test(&model, split);
            assert!(
                said.contains(&format!("was trained from take {take}")),
                "{said}"
            );
        }
    }
    // Another subject's model may be tested.
    let other = train("runs.npz", &runs);
    let said = run(
        "evaluate",
        &[
            "-m", &other, "--splits", "takes", "--seeds", "1", "--frames", "20", &walk,
        ],
        "",
    );
    assert!(said.contains("  runs "), "{said}");
    // World-space models are not compared.
    let world = dir.name("world.npz");
    run(
        "ksvd-train",
        &["-n", "15", "--iterations", "1", "-q", "-o", &world, &runs],
        "",
    );
    assert!(test(&world, "takes").contains("world space"));
}

#[test]
fn copies_and_mirror_images_of_takes_are_found_and_kept_together() {
    let dir = Folder::new();
    let walk = dir.read("walk.csv");
    let mut more = walk.lines().next().unwrap().to_string() + "\n";
    for row in of_take(&walk, "07_a") {
        more.push_str(&row.replace("07_a", "55_copy"));
        more.push('\n');
    }
    // Left and right exchanged: the points' columns by name, x negated.
    let names: Vec<&str> = walk.lines().next().unwrap().split(',').collect();
    for row in of_take(&walk, "07_b") {
        let cells: Vec<&str> = row.split(',').collect();
        let mirrored = names.iter().enumerate().map(|(i, name)| match i {
            0 => "66_mirror".to_string(),
            1 => cells[1].to_string(),
            _ => {
                let other = match name.as_bytes()[0] {
                    b'l' => format!("r{}", &name[1..]),
                    b'r' => format!("l{}", &name[1..]),
                    _ => name.to_string(),
                };
                let from = names.iter().position(|n| *n == other).unwrap_or(i);
                match name.ends_with(".x") {
                    true => format!("{}", -cells[from].parse::<f64>().unwrap()),
                    false => cells[from].to_string(),
                }
            }
        });
        more.push_str(&mirrored.collect::<Vec<_>>().join(","));
        more.push('\n');
    }
    let more = dir.file("more.csv", &more);
    let args = [
        "--models",
        "sparse:n=20",
        "--tasks",
        "dense",
        "--seeds",
        "2",
        "--frames",
        "30",
        "-o",
    ];
    let done = command("evaluate")
        .args(args)
        .args([&dir.name("out"), &dir.name("walk.csv"), &more])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("take 55_copy, the same as take 07_a,"),
        "{said}"
    );
    assert!(
        said.contains("take 66_mirror, a mirror image of take 07_b,"),
        "{said}"
    );
    // All subjects share takes: nobody can be held out.
    assert!(said.contains("left out: the split subjects"), "{said}");
    let json: Value = serde_json::from_str(&dir.read("out/results.json")).unwrap();
    assert_eq!(json["data"]["twins"][0]["found_by"], "digest");
    assert_eq!(json["data"]["twins"][1]["found_by"], "mirrored");
    for cell in json["cells"].as_array().unwrap() {
        let tested: Vec<&str> = cell["by_take"]
            .as_array()
            .unwrap()
            .iter()
            .map(|t| t[0].as_str().unwrap())
            .collect();
        if cell["split"] == "takes" {
            assert_eq!(
                tested.contains(&"07_a"),
                tested.contains(&"55_copy"),
                "{tested:?}"
            );
            assert_eq!(
                tested.contains(&"07_b"),
                tested.contains(&"66_mirror"),
                "{tested:?}"
            );
        }
    }
}

#[test]
fn a_toml_file_says_what_flags_do_not() {
    let dir = Folder::new();
    let toml = "tables = [\"walk.csv\"]\nmodels = [\"ksvd:n=20\"]\nsplits = [\"takes\"]\ntasks = [\"complete\"]\n\
                seeds = 3\nframes = 20\nbase = [\"0.05asf\"]\noutput = \"from-toml\"\n[subjects]\n\"07_a\" = \"x\"\n";
    let config = dir.file("bench.toml", toml);
    let said = run("evaluate", &["--config", &config, "--seeds", "1", "-q"], "");
    assert!(
        said.contains("split takes, 0.050 asf") && said.contains("1 seed,"),
        "{said}"
    );
    let json: Value = serde_json::from_str(&dir.read("from-toml/results.json")).unwrap();
    assert_eq!(json["data"]["takes"][0]["subject"], "x");
    assert_eq!(json["settings"]["frames"], 20);
    let bad = dir.file("bad.toml", &toml.replace("frames", "frame"));
    let said = fails("evaluate", &["--config", &bad], b"", 1);
    assert!(said.contains("bad.toml:6: unknown field `frame`"), "{said}");
}

#[test]
fn what_cannot_be_run_is_said_in_a_line() {
    let dir = Folder::new();
    let walk = dir.name("walk.csv");
    for (args, code, part) in [
        (
            vec!["--models", "magic", &walk],
            2,
            "--models magic: expected one of",
        ),
        (vec!["--tasks", "jump", &walk], 2, "--tasks jump"),
        (vec!["--splits", "halves", &walk], 2, "--splits halves"),
        (
            vec!["--splits", "subjects", &walk],
            2,
            "takes of at least 2 subjects",
        ),
        (vec!["--seeds", "0", &walk], 2, "--seeds 0"),
        (vec!["--frames", "0", &walk], 2, "--frames 0"),
        (vec!["--base", "0,99asf", &walk], 2, "--base"),
        (
            vec!["--observe", "tail", "--splits", "takes", &walk],
            2,
            "observe: the takes have no point \"tail\"",
        ),
        (vec!["-m", &walk, &walk], 1, "is no model"),
        (vec![&walk, &walk], 1, "is here again"),
    ] {
        let said = fails("evaluate", &[&["-q"][..], &args].concat(), b"", code);
        assert!(said.contains(part), "{said}");
    }
    let world = dir
        .read("walk.csv")
        .replace("07_a,0,0,0,0", "07_a,0,0,90,0");
    let world = dir.file("world.csv", &world);
    let said = fails("evaluate", &["-q", &world], b"", 1);
    assert!(said.contains("posing amc2xyz --space body"), "{said}");
}
