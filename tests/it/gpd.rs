//! The command `gpd` from outside.

use crate::common::{fails, run};
use std::fs;
use std::path::Path;

/// A walk of CMU, from testdata.
fn walk() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let (asf, amc) = (folder.join("07.asf"), folder.join("07_01.amc"));
    let files = [
        "--asf",
        asf.to_str().unwrap(),
        "--fps",
        "120",
        amc.to_str().unwrap(),
    ];
    run("amc2xyz", &files, "")
}

/// The names of the features, and their values a frame.
fn features(csv: &str) -> (Vec<&str>, Vec<Vec<f64>>) {
    let mut lines = csv.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(head[..2], ["take", "time"]);
    let number = |cell: &str| cell.parse().unwrap_or(f64::NAN);
    let values = lines.map(|l| l.split(',').skip(2).map(number).collect());
    (head[2..].to_vec(), values.collect())
}

#[test]
fn a_walk_has_1683_finite_features_a_frame() {
    let table = walk();
    let csv = run("gpd", &[], &table);
    let (names, values) = features(&csv);
    assert_eq!(
        (names.len(), values.len()),
        (1683, table.lines().count() - 1)
    );
    assert!(
        values
            .iter()
            .all(|row| row.len() == 1683 && row.iter().all(|v| v.is_finite()))
    );
    let of_a_frame = run("gpd", &["--static"], &table);
    assert_eq!(features(&of_a_frame).0, names[..1591]);
    let some = run("gpd", &["--features", "PP_a,JJ_d"], &table);
    let (few, _) = features(&some);
    assert_eq!(few.len(), 130);
    assert!(few[0].starts_with("JJ_d(") && few[129].starts_with("PP_a("));
}

#[test]
fn npy_holds_the_same_numbers_as_csv() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("features.npy");
    let table = walk();
    run("gpd", &["--static", "-o", path.to_str().unwrap()], &table);
    let csv = run("gpd", &["--static"], &table);
    let (_, values) = features(&csv);
    let bytes = fs::read(path).unwrap();
    let (numbers, _) = bytes[bytes.len() - 4 * 1591 * values.len()..].as_chunks::<4>();
    let from_csv = values.iter().flatten().map(|v| *v as f32);
    assert!(numbers.iter().map(|b| f32::from_le_bytes(*b)).eq(from_csv));
}

#[test]
fn what_is_missing_is_named() {
    let table = walk();
    let said = fails("gpd", &[], table.replace("lwrist.", "paw.").as_bytes(), 1);
    assert!(
        said.contains("\"lwrist\" (LHand)") && said.contains("--map"),
        "{said}"
    );
    let lines: Vec<&str> = table.lines().collect();
    let untimed: Vec<&str> = lines
        .iter()
        .map(|l| l.splitn(3, ',').nth(2).unwrap())
        .collect();
    let untimed = untimed.join("\n");
    let said = fails("gpd", &[], untimed.as_bytes(), 2);
    assert!(
        said.contains("--fps") && said.contains("--static"),
        "{said}"
    );
    assert_eq!(features(&run("gpd", &["--static"], &untimed)).0.len(), 1591);
}

#[test]
fn shipped_maps_of_names_serve_too() {
    // The walk with Mixamo's names.
    let map = posing::pose::NameMap::find("mixamo").unwrap();
    let table = walk();
    let (head, rows) = table.split_once('\n').unwrap();
    let trunk = [
        ("thorax", "Spine2"),
        ("lowerneck", "Neck"),
        ("head", "HeadTop_End"),
    ];
    let joints = map.joints.iter().map(|(a, b)| (a.as_str(), b.as_str()));
    let names: std::collections::HashMap<&str, &str> = joints.chain(trunk).collect();
    let renamed = |cell: &str| match cell.rsplit_once('.') {
        Some((point, axis)) => {
            let name = names
                .get(point)
                .map_or(point.to_string(), |n| format!("mixamorig:{n}"));
            format!("{name}.{axis}")
        }
        None => cell.to_string(),
    };
    let head: Vec<String> = head.split(',').map(renamed).collect();
    let theirs = format!("{}\n{rows}", head.join(","));
    assert_eq!(
        run("gpd", &["--map", "mixamo"], &theirs),
        run("gpd", &[], &table)
    );
    let said = fails("gpd", &["--map", "nosuch"], theirs.as_bytes(), 2);
    assert!(said.contains("mixamo"), "{said}");
}
