//! `amc2xyz` against joint positions worked out independently, and its spaces, joints and times.

use crate::common::{Numbers, cmu, run, shared, take, text};
use std::fs;

#[test]
fn positions_are_those_of_an_independent_computation() {
    let Some(folder) = shared("expected") else {
        return;
    };
    let mut seen = 0;
    for file in fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_string();
        let parts: Vec<&str> = name.split('.').collect();
        let [take_name, space, "csv"] = parts[..] else {
            continue;
        };
        let subject = take_name.split('_').next().unwrap();
        let Some(table) = take(subject, take_name, &["--space", space]) else {
            continue;
        };
        let ours = Numbers::read(&table);
        let want = Numbers::read(&fs::read_to_string(&path).unwrap());
        for (cells, row) in want.cells.iter().zip(&want.rows) {
            let frame: usize = cells[0].parse().unwrap();
            for (p, point) in want.points.iter().enumerate() {
                let at = ours.points.iter().position(|q| q == point).unwrap();
                for axis in 0..3 {
                    let far = (ours.rows[frame][3 * at + axis] - row[3 * p + axis]).abs();
                    assert!(far <= 1e-3, "{name}: frame {frame}, {point}: {far} cm");
                }
            }
        }
        seen += 1;
    }
    assert!(seen > 0);
}

fn distance(row: &[f64], a: usize, b: usize) -> f64 {
    (0..3)
        .map(|i| (row[3 * a + i] - row[3 * b + i]).powi(2))
        .sum::<f64>()
        .sqrt()
}

#[test]
fn the_spaces_are_one_pose_moved() {
    let Some(world) = take("07", "07_01", &[]) else {
        return;
    };
    let read = |space| Numbers::read(&take("07", "07_01", &["--space", space]).unwrap());
    let (world, root, body) = (Numbers::read(&world), read("root"), read("body"));
    assert_eq!(world.points.len(), 23);
    assert_eq!(world.points[0], "root");
    let mut turned = 0.0f64;
    for ((w, r), b) in world.rows.iter().zip(&root.rows).zip(&body.rows) {
        for (i, v) in w.iter().enumerate() {
            // Shifted and nothing else.
            assert!((v - w[i % 3] - r[i]).abs() <= 1e-9);
        }
        assert!(b[..3].iter().all(|v| v.abs() <= 1e-12));
        for p in 1..23 {
            assert!((distance(w, 0, p) - distance(b, 0, p)).abs() <= 1e-9);
        }
        turned = turned.max((r[3] - b[3]).abs());
    }
    // The walk is turned in root space, and not in body space.
    assert!(turned > 0.5, "{turned}");
}

#[test]
fn joints_are_chosen_by_name() {
    let Some(all) = take("07", "07_01", &["--joints", "all"]) else {
        return;
    };
    let all = Numbers::read(&all);
    let some = Numbers::read(&take("07", "07_01", &["--joints", "rwrist,root"]).unwrap());
    let paper = Numbers::read(&take("07", "07_01", &[]).unwrap());
    assert_eq!(all.points.len(), 31);
    assert_eq!(some.points, ["rwrist", "root"]);
    for (part, whole) in [(&some, &all), (&paper, &all)] {
        for (p, point) in part.points.iter().enumerate() {
            let at = whole.points.iter().position(|q| q == point).unwrap();
            assert!(
                part.rows
                    .iter()
                    .zip(&whole.rows)
                    .all(|(a, b)| a[3 * p..3 * p + 3] == b[3 * at..3 * at + 3])
            );
        }
    }
    let asf = cmu("07/07.asf").unwrap();
    let amc = cmu("07/07_01.amc").unwrap();
    let args = [
        "--asf",
        text(&asf),
        "--fps",
        "120",
        "--joints",
        "tail",
        text(&amc),
    ];
    let said = crate::common::fails("amc2xyz", &args, b"", 1);
    assert!(said.contains("no bone \"tail\""), "{said}");
}

#[test]
fn time_is_the_number_of_the_frame_less_one() {
    let (Some(asf), Some(amc)) = (cmu("07/07.asf"), cmu("07/07_03.amc")) else {
        return;
    };
    let lines = fs::read_to_string(&amc).unwrap();
    let number = lines
        .lines()
        .map(str::trim)
        .find(|l| l.starts_with(|c: char| c.is_ascii_digit()));
    let first: f64 = number.unwrap().parse().unwrap();
    for fps in [120.0, 59.94] {
        let args = ["--asf", text(&asf), "--fps", &fps.to_string(), text(&amc)];
        let table = Numbers::read(&run("amc2xyz", &args, ""));
        for (i, t) in table.time.iter().enumerate() {
            assert_eq!(*t, (first - 1.0 + i as f64) / fps);
        }
        assert_eq!(table.cells[0][0], "07_03");
    }
}

#[test]
fn several_takes_are_one_table() {
    let (Some(a), Some(b)) = (take("07", "07_01", &[]), take("07", "07_02", &[])) else {
        return;
    };
    let [asf, one, two] = ["07/07.asf", "07/07_01.amc", "07/07_02.amc"].map(|f| cmu(f).unwrap());
    let args = ["--asf", text(&asf), "--fps", "120", text(&one), text(&two)];
    let rows = b.split_once('\n').unwrap().1;
    assert_eq!(run("amc2xyz", &args, ""), a + rows);
}
