//! The sound twin of what is mended: takes in which nothing is wrong come out as the same bytes and
//! without a finding, at any rate, also where frames are held. Each method that changes values adds
//! what it must leave.

use crate::common::{command, run, text};
use std::fs;
use std::path::Path;

/// The walk of the test data at 120 frames a second divided by `step`, each frame `times` times,
/// from behind frame 22, in which its left foot is off by 2 cm.
fn walk(step: usize, times: usize) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let (asf, amc) = (folder.join("07.asf"), folder.join("07_01.amc"));
    let asf_and_rate = ["-q", "--asf", text(&asf), "--fps", "120"];
    let all = run("amc2xyz", &[&asf_and_rate[..], &[text(&amc)]].concat(), "");
    let (head, rows) = all.split_once('\n').unwrap();
    let shown = rows
        .lines()
        .skip(100)
        .step_by(step)
        .flat_map(|row| vec![row; times]);
    let rate = 120.0 * times as f64 / step as f64;
    let row = |(t, row): (usize, &str)| {
        let (take, rest) = row.split_once(',').unwrap();
        let (_, places) = rest.split_once(',').unwrap();
        format!("{take},{},{places}\n", t as f64 / rate)
    };
    assert!(head.starts_with("take,time,"));
    format!("{head}\n") + &shown.enumerate().map(row).collect::<String>()
}

/// A BVH file with each frame so many times.
fn held(motion: &str, times: usize) -> String {
    let (head, rest) = motion.split_once("Frames: ").unwrap();
    let lines: Vec<&str> = rest.lines().collect();
    let frames: usize = lines[0].parse().unwrap();
    let seconds: f64 = lines[1]
        .strip_prefix("Frame Time: ")
        .unwrap()
        .parse()
        .unwrap();
    let rows = lines[2..].iter().flat_map(|row| vec![*row; times]);
    let (frames, seconds) = (frames * times, seconds / times as f64);
    let rows: Vec<&str> = rows.collect();
    format!(
        "{head}Frames: {frames}\nFrame Time: {seconds:.9}\n{}\n",
        rows.join("\n")
    )
}

/// What `command` makes of a sound file: its bytes, its exit code and what it says.
fn of(name: &str, args: &[&str], file: &Path) -> (Vec<u8>, i32, String) {
    let ending = file.extension().unwrap().to_str().unwrap();
    let out = file.with_file_name(format!("{name}.{ending}"));
    let done = command(name)
        .args(args)
        .args(["-o", text(&out), text(file)])
        .output()
        .unwrap();
    let said = [done.stdout, done.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    (fs::read(&out).unwrap(), done.status.code().unwrap(), said)
}

#[test]
fn sound_takes_stay_at_any_rate_and_held_frames_are_only_told() {
    let folder = tempfile::tempdir().unwrap();
    for (step, times) in [
        (1, 1),
        (2, 1),
        (4, 1),
        (8, 1),
        (12, 1),
        (4, 2),
        (8, 3),
        (30, 6),
    ] {
        let table = walk(step, times);
        let motion = held(&run("xyz2bvh", &["-q"], &walk(step, 1)), times);
        let at = folder.path().join(format!("{step}-{times}"));
        fs::create_dir(&at).unwrap();
        for (name, bytes) in [("take.csv", table), ("take.bvh", motion)] {
            let file = at.join(name);
            fs::write(&file, &bytes).unwrap();
            let (cleaned, code, said) = of("clean", &[], &file);
            assert!(cleaned == bytes.as_bytes(), "{step} {times} {name}: {said}");
            assert_eq!(code, if times > 1 { 3 } else { 0 }, "{said}");
            assert_eq!(said.contains("held frames"), times > 1, "{said}");
        }
        let file = at.join("take.csv");
        for name in ["label", "complete"] {
            let (bytes, code, said) = of(name, &["-q"], &file);
            assert!(
                bytes == fs::read(&file).unwrap(),
                "{name} {step} {times}: {said}"
            );
            assert_eq!(code, 0, "{name}: {said}");
        }
    }
}

#[test]
fn frames_in_place_of_dropped_ones_are_only_told() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("take.csv");
    for every in [20, 5] {
        let walk = walk(1, 1);
        let rows: Vec<&str> = walk.lines().collect();
        let row = |t: usize| {
            let places = |t: usize| rows[t].splitn(3, ',').nth(2).unwrap();
            let at = |t: usize| rows[t].strip_suffix(places(t)).unwrap();
            match t % every {
                3 if t > 3 => format!("{}{}\n", at(t), places(t - 1)),
                _ => format!("{}\n", rows[t]),
            }
        };
        let table: String = (0..rows.len()).map(row).collect();
        fs::write(&file, &table).unwrap();
        let (cleaned, code, said) = of("clean", &[], &file);
        assert!(cleaned == table.as_bytes() && code == 3, "{every}: {said}");
        assert!(said.contains("held frames"), "{said}");
        let (bytes, code, said) = of("label", &["-q"], &file);
        assert!(bytes == table.as_bytes() && code == 0, "{said}");
        let rotations = folder.path().join("take.bvh");
        let motion = run("xyz2bvh", &["-q"], &walk);
        let lines: Vec<&str> = motion.lines().collect();
        let first = 1 + lines
            .iter()
            .position(|line| line.starts_with("Frame Time"))
            .unwrap();
        let line = |n: usize| {
            if n > first && (n - first) % every == 3 {
                format!("{}\n", lines[n - 1])
            } else {
                format!("{}\n", lines[n])
            }
        };
        let motion: String = (0..lines.len()).map(line).collect();
        fs::write(&rotations, &motion).unwrap();
        let (cleaned, code, said) = of("clean", &[], &rotations);
        assert!(cleaned == motion.as_bytes() && code == 3, "{every}: {said}");
        assert!(said.contains("held frames"), "{said}");
    }
}

#[test]
fn bones_that_a_filter_shortens_stay_and_a_point_off_its_bone_is_found() {
    // The left foot nears its tibia twice, by 3 mm for eight frames, and once by `far` for 16.
    let table = |far: f64| {
        let walk = walk(1, 1);
        let (head, rows) = walk.split_once('\n').unwrap();
        let names: Vec<&str> = head.split(',').collect();
        let at = |name: &str| names.iter().position(|n| *n == name).unwrap();
        let (foot, tibia) = (at("lfoot.x"), at("ltibia.x"));
        let row = |(t, row): (usize, &str)| {
            let mut cells: Vec<String> = row.split(',').map(str::to_string).collect();
            let bump = |t: usize, frames: usize| {
                let phase = std::f64::consts::PI * t as f64 / frames as f64;
                phase.sin().powi(2)
            };
            let near = match t {
                30..38 | 150..158 => 0.3 * bump(t % 30, 8),
                70..86 => far * bump(t - 70, 16),
                _ => 0.0,
            };
            let of = |from: usize| [0, 1, 2].map(|c| cells[from + c].parse::<f64>().unwrap());
            let (from, to) = (of(foot), of(tibia));
            let apart = [0, 1, 2].map(|c| to[c] - from[c]);
            let length = apart.iter().map(|d| d * d).sum::<f64>().sqrt();
            if near > 0.0 {
                for c in 0..3 {
                    cells[foot + c] = format!("{:.6}", from[c] + near / length * apart[c]);
                }
            }
            cells.join(",") + "\n"
        };
        let rows: String = rows.lines().enumerate().map(row).collect();
        format!("{head}\n{rows}")
    };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("take.csv");
    for (far, is_sound) in [(0.0, true), (2.0, false)] {
        fs::write(&file, table(far)).unwrap();
        let (cleaned, code, said) = of("clean", &[], &file);
        assert_eq!(cleaned == table(far).as_bytes(), is_sound, "{said}");
        assert_eq!(code, 0, "{said}");
        assert_eq!(said.contains("lfoot in frame"), !is_sound, "{said}");
    }
}
