//! The command `evaluate` from outside, on takes cut from the two that lie in testdata.

use crate::common::evaluations::Folder;
use crate::common::{bin, command, fails, run};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

fn texts(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
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
    // Whoever is learned from is restored better than somebody else.
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
    let page = dir.read("out/report.html");
    assert_eq!(page.matches("<div class=\"player\">").count(), 6);
    assert!(page.contains("Split takes, seed 0.") && page.len() < 1_000_000);
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
    let (_, data) = page.split_once("id=\"results\">").unwrap();
    let data: Value = serde_json::from_str(data.split("</script").next().unwrap()).unwrap();
    assert_eq!(data["runs"][0]["name"], "single");
    // All subjects in three tasks, subject 07 in three tasks.
    let columns = data["columns"].as_array().unwrap().iter();
    let measured = |c: &&Value| !c["measured"].as_array().unwrap().is_empty();
    assert_eq!(columns.filter(measured).count(), 6);
    // Lai et al.'s figure and the measured one in one line.
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
    assert!(
        said.contains("is not the results.json of an evaluate run"),
        "{said}"
    );
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
    let lines = || fs::read_to_string(&cells).map_or(0, |t| t.lines().count());
    while lines() < 3 && child.try_wait().unwrap().is_none() {
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
    for list in ["within", "by_joint", "units"] {
        let list = before.find(&format!("\"{list}\":[")).unwrap() + list.len() + 4;
        let end = list + before[list..].find(']').unwrap();
        let short = [&before[..list], &before[end..]].concat();
        fs::write(&cells, &short).unwrap();
        assert!(whole == with("killed", "2"));
        assert!(dir.read("killed/cells.jsonl").starts_with(&short));
    }
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
    assert!(
        said.contains("36 of 54 results found in the cache"),
        "{said}"
    );
    // A work file that is none is not gone on from.
    fs::write(&cells, "hello\n").unwrap();
    let said = fails("evaluate", &texts(&dir.small("killed")), b"", 1);
    assert!(
        said.contains("cells.jsonl:1: is not a cached result"),
        "{said}"
    );
}

#[test]
fn shares_on_several_machines_give_the_same_bytes() {
    let dir = Folder::new();
    let small = |out: &str, more: &[&str]| {
        let mut args = dir.small(out);
        args.extend(["-q".to_string()]);
        args.extend(more.iter().map(|m| m.to_string()));
        args
    };
    let results = |out: &str| ["csv", "json"].map(|e| dir.read(&format!("{out}/results.{e}")));
    let said = run("evaluate", &texts(&small("whole", &[])), "");
    let names: Vec<String> = (1..=8).map(|i| format!("cells/{i}")).collect();
    let folders: Vec<String> = names.iter().map(|n| dir.name(n)).collect();
    for (i, name) in names.iter().enumerate() {
        let share = format!("{}/8", i + 1);
        assert_eq!(
            run("evaluate", &texts(&small(name, &["--cells", &share])), ""),
            ""
        );
        assert!(!dir.path(&format!("{name}/results.csv")).exists());
    }
    let lines = |name: &String| dir.read(&format!("{name}/cells.jsonl")).lines().count();
    // One model for three splits and two seeds: six trainings of two methods and three tasks.
    let counts: Vec<usize> = names.iter().map(lines).collect();
    assert_eq!(counts, [6, 6, 6, 6, 6, 6, 0, 0]);
    let merge = |out: &str, folders: &[String]| {
        let folders = folders.iter().map(String::as_str);
        small(
            out,
            &["--merge"].into_iter().chain(folders).collect::<Vec<_>>(),
        )
    };
    assert_eq!(
        run("evaluate", &texts(&merge("merged", &folders)), ""),
        said
    );
    assert!(results("whole") == results("merged"));
    assert!(dir.read("whole/report.html") == dir.read("merged/report.html"));

    // A share that is not there, or was stopped.
    let refused = |args: &[String], part: &str| {
        let said = fails("evaluate", &texts(args), b"", 1);
        assert!(said.contains(part), "{said}");
        assert!(!dir.path("refused/results.csv").exists());
        fs::remove_dir_all(dir.path("refused")).unwrap();
    };
    refused(
        &merge("refused", &folders[1..]),
        "6 of 36 results are missing, the first sparse:n=20 (task dense, split frames, seed 0)",
    );
    let kept = dir.read("cells/2/cells.jsonl");
    fs::write(dir.path("cells/2/cells.jsonl"), &kept[..kept.len() - 9]).unwrap();
    refused(&merge("refused", &folders), "1 of 36 results are missing");
    run(
        "evaluate",
        &texts(&small("cells/2", &["--cells", "2/8"])),
        "",
    );
    run("evaluate", &texts(&merge("again", &folders)), "");
    assert!(results("whole") == results("again"));

    // Results of other settings and other takes do not count, and are kept.
    let other = ["--cells", "2/8", "--observe", "root,lwrist"];
    run("evaluate", &texts(&small("other", &other)), "");
    let [mut mixed, only] = [folders.clone(), folders.clone()].map(|mut f| {
        f[1] = dir.name("other");
        f
    });
    refused(
        &merge("refused", &only),
        "other/cells.jsonl: has only results of other takes, other settings",
    );
    run("evaluate", &texts(&small("other", &["--cells", "1/8"])), "");
    assert_eq!(lines(&"other".into()), 12);
    refused(
        &merge("refused", &mixed),
        "6 of 36 results are missing, the first sparse:n=20 (task dense, split frames, seed 1)",
    );
    mixed.push(folders[1].clone());
    run("evaluate", &texts(&merge("mixed", &mixed)), "");
    assert!(results("whole") == results("mixed"));
    let walk = dir.read("walk.csv");
    dir.file("walk.csv", walk.trim_end().rsplit_once('\n').unwrap().0);
    refused(
        &merge("refused", &folders),
        "cells/1/cells.jsonl: has only results of other takes",
    );
}

#[test]
fn shares_and_merges_are_asked_for_rightly() {
    let dir = Folder::new();
    let (walk, out) = (dir.name("walk.csv"), dir.name("out"));
    for share in ["0/8", "9/8", "1", "1/0", "a/b"] {
        let said = fails("evaluate", &["--cells", share, "-o", &out, &walk], b"", 2);
        assert!(said.contains("I from 1 to N"), "{said}");
    }
    let said = fails("evaluate", &["--cells", "1/2", &walk], b"", 2);
    assert!(said.contains("--output"), "{said}");
    let none = dir.name("none");
    let said = fails(
        "evaluate",
        &["-q", &walk, "--merge", &none, "-o", &out],
        b"",
        1,
    );
    assert!(said.contains("none/cells.jsonl"), "{said}");
    let said = fails("evaluate", &["-o", &out, "--merge", &none, &walk], b"", 2);
    assert!(said.contains("name the tables before --merge"), "{said}");
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
        (vec!["-m", &walk, &walk], 1, "is not a model"),
        (vec![&walk, &walk], 1, "appears again"),
    ] {
        let said = fails("evaluate", &[&["-q"][..], &args].concat(), b"", code);
        assert!(said.contains(part), "{said}");
    }
    let world = dir
        .read("walk.csv")
        .replace("07_a,0,0,0,0", "07_a,0,0,90,0");
    let world = dir.file("world.csv", &world);
    let said = fails("evaluate", &["-q", &world], b"", 1);
    assert!(said.contains("amc2xyz makes with --space body"), "{said}");
}

/// The take of a subject that lies in testdata, in world space.
fn world(subject: &str, take: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("testdata/cmu/{subject}"));
    let asf = folder.join(format!("{subject}.asf"));
    let amc = folder.join(format!("{take}.amc"));
    let (asf, amc) = (asf.to_str().unwrap(), amc.to_str().unwrap());
    run("amc2xyz", &["--asf", asf, "--fps", "120", amc], "")
}

#[test]
fn takes_are_tested_by_gaps_and_noise_beside_simple_methods() {
    let dir = Folder::new();
    let walk = dir.file("world07.csv", &world("07", "07_01"));
    let running = dir.file("world09.csv", &world("09", "09_06"));
    let out = dir.name("takes");
    let small = [
        "takes",
        "-q",
        "--gaps",
        "4",
        "--lengths",
        "0.2,end",
        "--points",
        "1,3",
        "--noise",
        "0,1",
        "-o",
        &out,
    ];
    let said = run("evaluate", &[&small[..], &[&walk, &running]].concat(), "");
    let csv = dir.read("takes/takes.csv");
    // Four methods in four cells of gaps, three at three levels of noise.
    assert_eq!(csv.lines().count(), 1 + 16 + 9);
    let rms = |row: &str| -> f64 {
        let line = csv.lines().find(|l| l.starts_with(row));
        line.unwrap().split(',').nth(8).unwrap().parse().unwrap()
    };
    for points in ["1", "3"] {
        let error = |method: &str| rms(&format!("gaps,0.2,{points},,,{method},"));
        assert!(error("posing") < error("linear"), "{said}");
    }
    assert!(
        rms("noise,,,0,1,posing,") < 0.05 && rms("noise,,,1,1,posing,") < 0.6,
        "{said}"
    );
    let page = dir.read("takes/report.html");
    assert!(page.contains("<polyline") && page.contains("models of the other subjects"));
    for outside in ["http:", "https:", "src=", "@import", "{{"] {
        assert!(!page.contains(outside), "{outside}");
    }
    let alone = |threads: &str| {
        let flags = [
            "takes",
            "-q",
            "--self",
            "--gaps",
            "2",
            "--lengths",
            "0.2",
            "--threads",
            threads,
        ];
        run("evaluate", &[&flags[..], &[&walk, &running]].concat(), "")
    };
    assert_eq!(alone("1"), alone("3"));
    let said = fails("evaluate", &["takes", &walk], b"", 2);
    assert!(said.contains("--self"), "{said}");
}
