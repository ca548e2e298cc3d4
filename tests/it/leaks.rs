//! The command `evaluate` from outside: nothing is tested that was learned from.

use crate::common::evaluations::{Folder, of_take};
use crate::common::{command, fails, run};
use serde_json::Value;

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
                said.contains(&format!("was trained on take {take}")),
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
                if name.ends_with(".x") {
                    format!("{}", -cells[from].parse::<f64>().unwrap())
                } else {
                    cells[from].to_string()
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
        said.contains("take 55_copy, a copy of take 07_a,"),
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
