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
    let args = ["--to", "svg", truth, truth, "-"];
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
        let one_line = predicates::function::function(|text: &str| text.lines().count() == 1);
        plot(&args, other)
            .code(1)
            .stderr(contains(said).and(one_line));
    }
}

#[test]
fn two_takes_of_any_formats_become_one_page() {
    let bvh = "testdata/examples/animator/goblin.bvh";
    let (walk, foot) = (
        "testdata/examples/gait/walk.c3d",
        "testdata/cmu/07/07_01.amc",
    );
    for (takes, said) in [
        ([walk, walk], "Both play in seconds"),
        ([walk, bvh], "no differences can be told"),
        ([foot, walk], "Both play in seconds"),
    ] {
        let args = [
            &["--to", "html"],
            &["--fps", "120"][..2 * usize::from(takes[0] == foot)],
            &takes,
        ]
        .concat();
        let page = plot(&args, "").success();
        let page = page.get_output();
        let text = String::from_utf8(page.stdout.clone()).unwrap();
        let scene = scene(&text);
        assert_eq!(scene["pair"]["takes"].as_array().unwrap().len(), 2);
        let is_one = takes[0] == takes[1];
        assert_eq!(scene["pair"]["differences"].is_object(), is_one);
        assert_eq!(text.contains(said), !is_one, "{said}");
    }
}

#[test]
fn the_rate_given_is_that_of_the_take_without_one() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = dir.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_string()
    };
    let timeless = file("a.csv", "root.x,root.y,root.z\n1,2,3\n2,2,3\n3,2,3\n");
    let timed = file(
        "b.csv",
        "time,root.x,root.y,root.z\n0,1,2,3\n0.01,2,2,3\n0.02,3,2,3\n",
    );
    for pair in [[&*timeless, &*timed], [&*timed, &*timeless]] {
        plot(&[&["-q", "--to", "html"], &pair[..]].concat(), "")
            .code(2)
            .stderr(contains(
                "a.csv: the table's times give no frame rate; give it with --fps",
            ));
        let page = plot(&[&["--to", "html", "--fps", "50"], &pair[..]].concat(), "").success();
        page.stderr(contains("a: 3 frames at 50 a second").and(contains("b: 3 frames at 100 a")));
    }
    plot(&["-q", "--to", "html", "--fps", "50", &timed, &timed], "")
        .code(2)
        .stderr(contains("--fps 50 contradicts the table's times"));
}

#[test]
fn an_amc_take_without_its_skeleton_names_a_way_that_exists() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("07_01.amc");
    fs::copy("testdata/cmu/07/07_01.amc", &path).unwrap();
    let args = ["-q", "--to", "html", "--fps", "120", path.to_str().unwrap()];
    let no_asf = "07_01.amc: has no ASF file beside it whose name begins its own: copy";
    plot(&args, "")
        .code(1)
        .stderr(contains(no_asf).and(contains("amc2xyz --asf")));
    fs::copy("testdata/cmu/07/07.asf", dir.path().join("07.asf")).unwrap();
    plot(&args, "").success();
}

#[test]
fn tables_of_other_programs_are_drawn_as_the_pose_table_is() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let pose = path("pose.csv");
    fs::write(&pose, "time,A.x,A.y,A.z\n0,1,2,3\n0.01,2,2,3\n").unwrap();
    let files = [
        ("wide.csv", "time,A_x,A_y,A_z\n0,1,2,3\n0.01,2,2,3\n"),
        ("long.csv", "time,point,x,y,z\n0,A,1,2,3\n0.01,A,2,2,3\n"),
        (
            "vicon.csv",
            "Trajectories\n100\n,,A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n\
             0,0,10,20,30\n1,0,20,20,30\n",
        ),
        (
            "qualisys.tsv",
            "NO_OF_FRAMES\t2\nNO_OF_MARKERS\t1\nFREQUENCY\t100\nMARKER_NAMES\tA\n\
             10\t20\t30\n20\t20\t30\n",
        ),
    ];
    for (name, text) in files {
        fs::write(path(name), text).unwrap();
        let units: &[&str] = match name {
            "vicon.csv" => &[],
            "qualisys.tsv" => &["--units", "mm"],
            _ => &["--units", "cm"],
        };
        let own = path(name);
        let alone = [&["-q", "--to", "html", "--up", "y", "--every", "1"], units].concat();
        let drawn = |file: &str, flags: &[&str]| {
            let page = plot(&[flags, &[file]].concat(), "").success();
            scene(&String::from_utf8(page.get_output().stdout.clone()).unwrap())
        };
        let wanted = drawn(&pose, &["-q", "--to", "html", "--every", "1"]);
        let found = drawn(&own, &alone);
        assert_eq!(
            found["figures"][0]["data"], wanted["figures"][0]["data"],
            "{name}"
        );
        // Nothing is guessed.
        let said = plot(&["-q", "--to", "html", &own], "").code(1);
        said.stderr(contains("give it with --"));
    }
}

#[test]
fn a_take_beside_itself_differs_by_nothing_and_names_tell_the_two_apart() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, TABLE).unwrap();
        path.to_str().unwrap().to_string()
    };
    let [old, new] = [file("old/walk.csv"), file("new/walk.csv")];
    let page = plot(&["-q", "--to", "html", &old, &new], "").success();
    let scene = scene(&String::from_utf8(page.get_output().stdout.clone()).unwrap());
    assert_eq!(
        [0, 1].map(|f| scene["figures"][f]["name"].as_str().unwrap()),
        [&*old, &*new]
    );
    assert_eq!(scene["figures"][0]["data"], scene["figures"][1]["data"]);
    let told = &scene["pair"]["differences"];
    assert_eq!(
        told["frames"],
        json!([[0.0, 0.0, 0], [0.0, 0.0, 0], [0.0, 0.0, 0]])
    );
    assert_eq!(told["points"], json!([[0, 0.0, 0.0, 0], [1, 0.0, 0.0, 0]]));
}

#[test]
fn a_picture_of_two_takes_has_one_over_the_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("walk.csv");
    fs::write(&path, TABLE).unwrap();
    let args = ["-q", "--to", "svg", path.to_str().unwrap(), "-"];
    let panels = |more: &[&str]| {
        let drawn = plot(&[&args[..], more].concat(), TABLE).success();
        let text = String::from_utf8(drawn.get_output().stdout.clone()).unwrap();
        assert!(text.contains("walk") && text.contains("standard input"));
        text.matches("<clipPath").count()
    };
    assert_eq!(panels(&[]), 3);
    assert_eq!(panels(&["--overlaid"]), 3);
    assert_eq!(panels(&["--overlaid=false"]), 6);
    assert_eq!(panels(&["--trail"]), 2);
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
    scene(&page)["figures"][0].take()
}

/// The scene of a page.
fn scene(page: &str) -> Value {
    let (_, after) = page
        .split_once("<script type=\"application/json\">")
        .unwrap();
    serde_json::from_str(after.split("</script").next().unwrap()).unwrap()
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
