//! xyz2amc: a table solved for a skeleton's own degrees of freedom.

use assert_cmd::Command;
use predicates::str::contains;
use std::path::{Path, PathBuf};

/// A root, a thigh that is a ball joint, a shank that is a hinge, toes that no table here shows.
const ASF: &str = ":version 1.10\n:units\n length 0.45\n angle deg\n:root\n order TX TY TZ RX RY RZ\n axis XYZ\n position 0 0 0\n orientation 0 0 0\n:bonedata\n\
    begin\n name lhipjoint\n direction 0.6 -0.7 0.4\n length 2.4\n axis 0 0 0 XYZ\n end\n\
    begin\n name rhipjoint\n direction -0.6 -0.7 0.4\n length 2.4\n axis 0 0 0 XYZ\n end\n\
    begin\n name lfemur\n direction 0.34 -0.94 0\n length 7\n axis 0 0 20 XYZ\n dof rx ry rz\n limits (-160 20)\n (-70 70)\n (-60 70)\n end\n\
    begin\n name ltibia\n direction 0.34 -0.94 0\n length 7\n axis 0 0 20 XYZ\n dof rx\n limits (-10 170)\n end\n\
    begin\n name ltoes\n direction 0 0 1\n length 1\n axis 0 0 0 XYZ\n dof rx\n limits (-10 170)\n end\n\
    :hierarchy\n begin\n root lhipjoint rhipjoint\n lhipjoint lfemur\n lfemur ltibia\n ltibia ltoes\n end\n";

const JOINTS: &str = "root,lhipjoint,rhipjoint,lfemur,ltibia";

fn command(name: &str) -> Command {
    Command::new(crate::common::bin().join(name))
}

fn take(first: usize, frames: usize) -> String {
    let mut text = ":FULLY-SPECIFIED\n:DEGREES\n".to_string();
    for i in 0..frames {
        let t = i as f64 * 0.05;
        text += &format!(
            "{}\nroot {} 17 2 5 {} -3\nlfemur {} {} 8\nltibia {}\nltoes 30\n",
            first + i,
            t,
            400.0 * t,
            -40.0 * t.sin(),
            20.0 * t.cos(),
            30.0 + 29.0 * (2.0 * t).sin()
        );
    }
    text
}

/// The numbers of a table's points, row by row.
fn numbers(table: &[u8]) -> Vec<Vec<f64>> {
    let text = std::str::from_utf8(table).unwrap();
    let row = |line: &str| {
        line.split(',')
            .skip(2)
            .map(|c| c.parse().unwrap())
            .collect()
    };
    text.lines().skip(1).map(row).collect()
}

fn farthest(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .flatten()
        .zip(b.iter().flatten())
        .fold(0.0, |z: f64, (a, b)| z.max((a - b).abs()))
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("s.asf"), ASF).unwrap();
        Folder(dir)
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn xyz(&self, amc: &str, joints: &str) -> Vec<u8> {
        std::fs::write(self.path("t.amc"), amc).unwrap();
        let run = command("amc2xyz")
            .args(["--fps", "120", "--joints", joints, "--asf"])
            .args([self.path("s.asf"), self.path("t.amc")])
            .assert()
            .success();
        run.get_output().stdout.clone()
    }
    fn amc(&self, table: &[u8], flags: &[&str]) -> assert_cmd::assert::Assert {
        command("xyz2amc")
            .arg("--asf")
            .arg(self.path("s.asf"))
            .args(flags)
            .write_stdin(table)
            .assert()
    }
}

#[test]
fn a_take_comes_back_with_its_frame_numbers_and_hidden_bones_at_zero() {
    let dir = Folder::new();
    let table = dir.xyz(&take(7, 60), JOINTS);
    let run = dir.amc(&table, &[]).success().stderr(contains("fit: mean"));
    let text = String::from_utf8(run.get_output().stdout.clone()).unwrap();
    assert_eq!(text.lines().nth(2), Some("7"));
    assert!(text.contains("ltoes 0\n") && !text.contains("ltoes 30"));
    let far = farthest(&numbers(&table), &numbers(&dir.xyz(&text, JOINTS)));
    assert!(far <= 1e-3, "{far}");
}

#[test]
fn missing_points_hold_and_the_count_of_frames_stays() {
    let dir = Folder::new();
    let table = String::from_utf8(dir.xyz(&take(1, 20), JOINTS)).unwrap();
    // Frames 3 to 6 show nothing at all; frames 10 to 12 lack the shank.
    let damaged: Vec<String> = table
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            match i {
                3..=6 => cells[2..].fill(""),
                10..=12 => cells[14..].fill(""),
                _ => {}
            }
            cells.join(",")
        })
        .collect();
    let run = dir
        .amc(damaged.join("\n").as_bytes(), &[])
        .success()
        .stderr(contains("7 frames had missing points"))
        .stderr(contains("4 frames could not place the root"));
    let back = numbers(&dir.xyz(
        std::str::from_utf8(&run.get_output().stdout).unwrap(),
        JOINTS,
    ));
    let want = numbers(table.as_bytes());
    assert_eq!(back.len(), 20);
    assert!(
        farthest(
            &back[2..6],
            &[
                back[1].clone(),
                back[1].clone(),
                back[1].clone(),
                back[1].clone()
            ]
        ) <= 1e-9
    );
    assert!(farthest(&back[12..], &want[12..]) <= 1e-2);
    for i in 9..12 {
        assert!(farthest(&[back[i][..12].to_vec()], &[want[i][..12].to_vec()]) <= 1e-2);
    }
}

#[test]
fn limits_are_kept_when_asked_for() {
    let dir = Folder::new();
    let bent = take(1, 3).replace(" 8\n", " 110\n");
    let table = dir.xyz(&bent, JOINTS);
    let text = |run: assert_cmd::assert::Assert| {
        String::from_utf8(run.get_output().stdout.clone()).unwrap()
    };
    let most = |text: String| {
        let thighs = text.lines().filter_map(|l| l.strip_prefix("lfemur "));
        let aside = thighs.filter_map(|l| l.rsplit(' ').next()?.parse::<f64>().ok());
        aside.fold(f64::NEG_INFINITY, f64::max)
    };
    // The thigh is turned beyond its limit of 70 degrees, so that the fit is a finding.
    assert!(most(text(dir.amc(&table, &["--limits"]).code(3))) <= 70.0 + 1e-6);
    assert!(most(text(dir.amc(&table, &[]).success())) > 100.0);
}

#[test]
fn faults_are_one_line() {
    let dir = Folder::new();
    dir.amc(b"a.x,a.y,a.z\n1,2,3\n", &[])
        .code(1)
        .stderr(contains("no point has the name of a bone"));
    dir.amc(b"", &[]).code(1).stderr(contains("is empty"));
    let two = "take,root.x,root.y,root.z\na,0,0,0\nb,0,0,0\n";
    dir.amc(two.as_bytes(), &[])
        .code(1)
        .stderr(contains("several takes (a, b); choose one with --take"));
    dir.amc(two.as_bytes(), &["--take", "b"]).success();
    dir.amc(b"root.x,root.y,root.z\n,,\n", &[])
        .success()
        .stderr(contains("no point to fit; writing the rest pose"));
    let seen = dir
        .amc(b"root.x,root.y,root.z,z.x,z.y,z.z\n1,2,3,4,5,6\n", &["-q"])
        .success();
    assert!(seen.get_output().stderr.is_empty());
    command("xyz2amc")
        .assert()
        .code(2)
        .stderr(contains("--asf"));
}

#[test]
fn real_takes_come_back() {
    for (subject, name) in [("09", "09_06"), ("02", "02_03"), ("08", "08_04")] {
        let file = |name: String| crate::common::cmu(&format!("{subject}/{name}"));
        let files = (file(format!("{subject}.asf")), file(format!("{name}.amc")));
        let (Some(asf), Some(amc)) = files else {
            continue;
        };
        let xyz = |path: &Path| {
            let run = command("amc2xyz")
                .args(["--fps", "120", "--asf"])
                .arg(&asf)
                .arg(path)
                .assert()
                .success();
            run.get_output().stdout.clone()
        };
        let table = xyz(&amc);
        let dir = Folder::new();
        let back = dir.path("back.amc");
        command("xyz2amc")
            .arg("--asf")
            .arg(&asf)
            .arg("-o")
            .arg(&back)
            .write_stdin(table.clone())
            .assert()
            .success();
        let far = farthest(&numbers(&table), &numbers(&xyz(&back)));
        assert!(far <= 0.01, "{name}: {far}");
    }
}
