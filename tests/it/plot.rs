//! The command `plot` from outside.

use assert_cmd::Command;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::{Value, json};
use std::fs;

const TABLE: &str = "take,time,root.x,root.y,root.z,lfemur.x,lfemur.y,lfemur.z,lfemur.status\n\
    w,0,0,90,0,5,50,0,observed\nw,0.1,1,90,0,6,50,0,inferred\nw,0.2,2,90,0,,,,unknown\n";

fn plot(args: &[&str], input: &str) -> assert_cmd::assert::Assert {
    let mut command = Command::new(crate::common::bin().join("plot"));
    command.args(args).write_stdin(input).assert()
}

#[test]
fn a_table_becomes_a_picture_or_a_page() {
    let svg = plot(&["--to", "svg", "--frames", "0,2"], TABLE).success();
    svg.stdout(
        contains("<svg")
            .and(contains("frame 2"))
            .and(contains("frame 1").not()),
    );
    let page = plot(
        &["--to", "html", "--title", "A <walk>", "--credit", "owed"],
        TABLE,
    )
    .success();
    page.stdout(
        contains("A &lt;walk&gt;")
            .and(contains("owed"))
            .and(contains("\"every\":1")),
    );
    let dir = tempfile::tempdir().unwrap();
    for (name, with) in [("x.svg", "<svg"), ("x.HTML", "<!doctype html>")] {
        let path = dir.path().join(name);
        plot(&["-o", path.to_str().unwrap()], TABLE)
            .success()
            .stdout("");
        assert!(
            fs::read_to_string(path)
                .unwrap()
                .to_lowercase()
                .contains(with)
        );
    }
}

#[test]
fn tables_drawn_together_must_fit() {
    let dir = tempfile::tempdir().unwrap();
    let truth = dir.path().join("truth.csv");
    fs::write(&truth, TABLE).unwrap();
    let truth = truth.to_str().unwrap();
    let args = ["--to", "svg", truth, "-"];
    let swapped =
        "lfemur.x,lfemur.y,lfemur.z,root.x,root.y,root.z\n1,2,3,4,5,6\n1,2,3,4,5,6\n1,2,3,4,5,6\n";
    plot(&args, swapped)
        .success()
        .stdout(contains("truth").and(contains("standard input")));
    for (other, said) in [
        (
            "root.x,root.y,root.z\n1,2,3\n1,2,3\n1,2,3\n",
            "no point \"lfemur\"",
        ),
        (
            "lfemur.x,lfemur.y,lfemur.z,root.x,root.y,root.z\n1,2,3,4,5,6\n",
            "1 frames",
        ),
        (&TABLE.replace("w,0.2", "v,0.2"), "take v in frame"),
        (&TABLE.replace("w,0.2", "w,0.25"), "time 0.25 in frame"),
        (
            &TABLE.replace("unknown", "lost"),
            "\"lost\" is not a status",
        ),
        ("root.x,root.y,root.z\n", "no frames"),
    ] {
        plot(&args, other).code(1).stderr(contains(said));
    }
}

#[test]
fn nothing_is_guessed_and_no_flag_passed_over() {
    let timeless = "root.x,root.y,root.z\n1,2,3\n";
    plot(&["--to", "svg"], timeless)
        .code(2)
        .stderr(contains("--fps"));
    plot(&["--to", "svg", "--fps", "60"], timeless)
        .success()
        .stderr(contains("--bones"));
    plot(&[], TABLE).code(2).stderr(contains("--to svg|html"));
    plot(&["--to", "html", "--frames", "0"], TABLE)
        .code(2)
        .stderr(contains("--frames is for an SVG"));
    plot(&["--to", "svg", "--frames", "3"], TABLE)
        .code(2)
        .stderr(contains("there are 3"));
    plot(&["--to", "svg", "--every", "0"], TABLE).code(2);
    plot(&["--to", "html", "--every", "0"], TABLE).code(2);
    plot(&["--to", "svg", "--names", "a,b"], TABLE)
        .code(2)
        .stderr(contains("2 names for 1"));
    plot(&["--to", "svg", "--bones", "root-x"], TABLE)
        .code(2)
        .stderr(contains("root-x"));
}

#[test]
fn a_table_of_text_is_shown_as_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scores.csv");
    fs::write(&path, ",error\nwalk,1.50\n").unwrap();
    let args = [
        "--to",
        "html",
        "--table",
        path.to_str().unwrap(),
        "--caption",
        "Scores",
    ];
    plot(&args, TABLE)
        .success()
        .stdout(contains(">1.50</td>").and(contains("Scores")));
    fs::write(&path, "a\n1,2\n").unwrap();
    plot(&args, TABLE).code(1).stderr(contains("scores.csv"));
}

#[test]
fn a_bvh_file_is_drawn_with_its_own_bones() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.bvh");
    let bvh = "HIERARCHY\nROOT a\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n JOINT b\n {\n OFFSET 0 40 0\n CHANNELS 3 Zrotation Xrotation Yrotation\n End Site\n {\n OFFSET 0 10 0\n }\n }\n}\nMOTION\nFrames: 2\nFrame Time: 0.01\n0 0 0 0 0 0 0 0 0\n1 0 0 0 0 0 90 0 0\n";
    fs::write(&path, bvh).unwrap();
    let page = plot(&["--to", "html", path.to_str().unwrap()], "").success();
    // Three points, of which the second is joined to the first and the third to the second.
    page.stdout(contains("\"bones\":[[0,1],[1,2]]").and(contains("b_end")));
    // As a table of a skeleton that a shipped map knows.
    let names = [
        "Hips",
        "LeftUpLeg",
        "LeftLeg",
        "LeftFoot",
        "LeftToeBase",
        "LeftArm",
        "LeftForeArm",
        "LeftHand",
    ];
    let right = names[1..].iter().map(|n| n.replace("Left", "Right"));
    let names: Vec<String> = names.iter().map(|n| n.to_string()).chain(right).collect();
    let head: Vec<String> = names.iter().map(|n| format!("{n}.x,{n}.y,{n}.z")).collect();
    let row: Vec<String> = (0..45).map(|v| v.to_string()).collect();
    let table = format!(
        "time,{}\n0,{row}\n0.1,{row}\n",
        head.join(","),
        row = row.join(",")
    );
    let page = plot(&["--to", "html"], &table).success();
    page.stderr(contains("no bones").not());
}

const STATUS_TABLE: &str = "time,a.x,a.y,a.z,a.status,a.sd,a.method,b.x,b.y,b.z\n\
    0,0,90,0,observed,0.01,,1,2,3\n0.1,1,90,0,inferred,0.5,pchip,1,2,3\n\
    0.2,2,90,0,inferred,0.25,pchip,1,2,3\n0.3,,,,unknown,,,1,2,3\n";

/// The first figure of the page of a table.
fn embedded(args: &[&str], table: &str) -> Value {
    let args = [&["--to", "html", "-q"], args].concat();
    let page = plot(&args, table).success().get_output().stdout.clone();
    let page = String::from_utf8(page).unwrap();
    assert!(page.contains("<section class=\"curves\""));
    let (_, after) = page
        .split_once("<script type=\"application/json\">")
        .unwrap();
    let mut scene: Value = serde_json::from_str(after.split("</script").next().unwrap()).unwrap();
    scene["figures"][0].take()
}

#[test]
fn a_page_knows_how_gaps_were_filled() {
    let figure = embedded(&[], STATUS_TABLE);
    // Pairs of a code and a number of frames, for each point.
    assert_eq!(figure["status"], json!([[0, 1, 2, 2, 4, 1], [0, 4]]));
    assert_eq!(figure["method"], json!([[0, 1, 2, 2, 0, 1], [0, 4]]));
    // Frames without and with one in turn; that of a measured point is left out. Then 500 and 250
    // thousandths.
    let sd = json!({ "runs": [[1, 2, 1], [4]], "data": "9AH6AA==" });
    assert_eq!(figure["sd"], sd);
    // Read in meters, told in centimeters.
    let meters = embedded(&["--units", "m"], &STATUS_TABLE.replace("0.5,", "0.005,"));
    assert_eq!(meters["sd"]["data"], "9AGoYQ==");
}

#[test]
fn a_page_needs_no_status() {
    let figure = embedded(
        &[],
        "time,a.x,a.y,a.z,a.sd,a.method\n0,1,2,3,wide,mine\n1,,,,,\n",
    );
    for unknown in ["status", "sd", "method"] {
        assert_eq!(figure[unknown], Value::Null);
    }
    for (other, said) in [
        ("0.5,guess", "\"guess\" is not a method"),
        ("wide,pchip", "\"wide\" is not a standard deviation"),
        ("-1,pchip", "\"-1\" is not a standard deviation"),
    ] {
        let table = STATUS_TABLE.replace("0.5,pchip", other);
        let fails = plot(&["--to", "html"], &table).code(1);
        fails.stderr(contains(said).and(contains("input:3")));
    }
}
