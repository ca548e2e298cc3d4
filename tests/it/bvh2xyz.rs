//! bvh2xyz: BVH files of any exporter as a pose table.

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;

const FILE: &str = "HIERARCHY\nROOT hips\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n JOINT leg\n {\n OFFSET 0 -40 0\n CHANNELS 3 Zrotation Xrotation Yrotation\n End Site\n {\n OFFSET 0 -10 0\n }\n }\n JOINT arm\n {\n OFFSET 20 30 0\n CHANNELS 3 Zrotation Xrotation Yrotation\n End Site\n {\n OFFSET 15 0 0\n }\n }\n}\nMOTION\nFrames: 2\nFrame Time: 0.008333\n1 2 3 90 0 0 0 0 0 0 0 0\n1 2 3 0 0 0 0 90 0 0 0 0\n";

fn run(flags: &[&str], input: &str) -> assert_cmd::assert::Assert {
    Command::new(crate::common::bin().join("bvh2xyz"))
        .args(flags)
        .write_stdin(input)
        .assert()
}

fn text(run: assert_cmd::assert::Assert) -> String {
    String::from_utf8(run.success().get_output().stdout.clone()).unwrap()
}

/// A point's coordinates in a row of a table.
fn at(table: &str, row: usize, point: &str) -> [f64; 3] {
    let head: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let cells: Vec<&str> = table.lines().nth(row + 1).unwrap().split(',').collect();
    let first = head
        .iter()
        .position(|h| *h == format!("{point}.x"))
        .expect(point);
    [0, 1, 2].map(|a| cells[first + a].parse().unwrap())
}

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9)
}

#[test]
fn joints_end_sites_and_exact_times_are_written() {
    let table = text(run(&[], FILE));
    let head = table.lines().next().unwrap();
    assert!(
        head.starts_with("take,time,hips.x,hips.y,hips.z,leg.x"),
        "{head}"
    );
    assert!(near(at(&table, 0, "hips"), [1., 2., 3.]));
    assert!(near(at(&table, 0, "leg"), [41., 2., 3.]));
    assert!(near(at(&table, 0, "arm_end"), [-29., 37., 3.]));
    assert!(near(at(&table, 1, "leg_end"), [1., -38., -7.]));
    // 0.008333 stands for 120 frames a second.
    assert!(
        table.lines().nth(2).unwrap().starts_with("standard input,")
            || table.lines().nth(2).unwrap().starts_with("-,")
    );
    assert!(
        table
            .lines()
            .nth(2)
            .unwrap()
            .contains(",0.008333333333333333,")
    );
}

#[test]
fn ends_stand_under_the_bones_own_names() {
    let table = text(run(&["--ends"], FILE));
    assert!(!table.contains("_end"));
    assert!(near(at(&table, 0, "hips"), [1., 2., 3.]));
    assert!(near(at(&table, 0, "arm"), [-29., 37., 3.]));
}

#[test]
fn the_custom_is_stated_once_and_units_and_axes_are_turned() {
    run(&[], FILE)
        .success()
        .stderr(contains("assuming cm and y up").count(1));
    run(&["-q"], FILE)
        .success()
        .stderr(predicate::str::is_empty());
    let run = run(&["--units", "m", "--up", "z"], FILE)
        .success()
        .stderr(predicate::str::is_empty());
    let table = String::from_utf8(run.get_output().stdout.clone()).unwrap();
    assert!(near(at(&table, 0, "hips"), [100., 300., -200.]));
}

#[test]
fn faults_are_one_line_with_place_and_remedy() {
    let fails = |flags: &[&str], input: String, part: &str| {
        let run = run(flags, &input)
            .code(1)
            .stderr(contains(part))
            .stdout(predicate::str::is_empty());
        let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        let faults = said.lines().filter(|l| !l.contains("assuming"));
        assert_eq!(faults.count(), 1, "{said}");
    };
    fails(&[], String::new(), "is empty");
    fails(&[], FILE[..FILE.len() - 9].into(), "--keep-whole");
    fails(
        &[],
        FILE.replace("40 0", "40 x"),
        "standard input:8: expected a number",
    );
    fails(&[], FILE.replace("0.008333", "0"), "--fps");
    run(&["--fps", "60"], FILE)
        .code(2)
        .stderr(contains("contradicts"));
    run(&["--fps", "60"], &FILE.replace("0.008333", "0")).success();
    run(&["--keep-whole"], &FILE[..FILE.len() - 9]).success();
    run(&[], &FILE.replace("Frames: 2", "Frames: 7"))
        .success()
        .stderr(contains("announces 7 frames but has 2"));
}

/// Every joint has another order of channels, every End Site another spelling, and the count of
/// frames is one too high.
const MIXED: &str = "HIERARCHY\nROOT a\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n JOINT b\n {\n OFFSET 0 10 0\n CHANNELS 3 Xrotation Yrotation Zrotation\n End Site\n {\n OFFSET 0 0 5\n }\n }\n JOINT c\n {\n OFFSET 10 0 0\n CHANNELS 3 Yrotation Xrotation Zrotation\n EndSite\n {\n OFFSET 0 0 5\n }\n }\n JOINT d\n {\n OFFSET -10 0 0\n CHANNELS 3 zrotation xrotation yrotation\n End site tip\n {\n OFFSET 0 0 5\n }\n }\n}\nMOTION\nFrames: 2\nFrame Time: 0.01\n0 90 0 0 0 0 90 90 0 90 90 0 90 90 0\n";

#[test]
fn impossible_frame_times_and_cut_files_are_told() {
    let file = |time: &str| {
        format!(
            "HIERARCHY\nROOT a\n{{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}}\nMOTION\nFrames: 2\nFrame Time: {time}\n1 2 3\n4 5 6\n"
        )
    };
    for time in ["18446744073709551615", "-0.01", "0", "0.00000001"] {
        run(&[], &file(time))
            .code(1)
            .stderr(contains("Frame Time").and(contains("--fps")));
        run(&["--fps", "30"], &file(time)).success();
    }
    for (cut, said) in [
        ("HIERARCHY\n".to_string(), "ends after its first line"),
        (file("1")[..40].to_string(), "the file is cut off"),
        (
            file("1").trim_end_matches(" 6\n").to_string(),
            "--keep-whole",
        ),
    ] {
        run(&[], &cut).code(1).stderr(contains(said));
    }
}

#[test]
fn each_joint_has_its_own_order_of_channels() {
    let done = run(&[], MIXED)
        .success()
        .stderr(contains("announces 2 frames but has 1").count(1));
    let table = String::from_utf8(done.get_output().stdout.clone()).unwrap();
    // Quarter turns of z, by hand: the last channel turns first.
    assert!(near(at(&table, 0, "b_end"), [5., 100., 0.]));
    assert!(near(at(&table, 0, "c_end"), [10., 85., 0.]));
    assert!(near(at(&table, 0, "d_end"), [-5., 90., 0.]));
}

#[test]
fn files_of_many_exporters_are_read_whole() {
    let Some(folder) = crate::common::shared("data/formats/bvh") else {
        return;
    };
    let files = [
        ("11_01", 598, 57),
        ("AV_8Walk_Meredith_HVHA_Rep1", 1064, 30),
        ("Swagger", 581, 27),
        ("TARZAN", 391, 38),
        ("dataset-2_run_normal_042", 90, 27),
        ("example", 278, 38),
        ("full_precision_frame_time", 3, 3),
        ("kick", 61, 7),
        ("oneFrame", 1, 5),
        ("rotation_first_root", 4, 6),
        ("standard_skeleton", 1, 29),
        ("test_freebvh", 69, 70),
        ("test_mocapbank", 455, 24),
    ];
    for (name, frames, points) in files {
        let path = folder.join(format!("{name}.bvh"));
        let table = text(run(&["-q", path.to_str().unwrap()], ""));
        assert_eq!(table.lines().count(), frames + 1, "{name}");
        for (i, line) in table.lines().enumerate() {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), 2 + 3 * points, "{name}");
            if i > 0 {
                assert_eq!(cells[0], name);
                let far = cells[2..]
                    .iter()
                    .map(|c| c.parse::<f64>().unwrap().abs())
                    .fold(0.0, f64::max);
                assert!(far <= 500.0, "{name}: {far}");
            }
        }
    }
}
