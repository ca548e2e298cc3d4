//! A folder of raw takes as a night of captures leaves them, made of a walk whose markers are those
//! of the pelvis and the legs.

use super::{Numbers, run, text};
use std::fs;
use std::path::Path;

/// Markers of the walk.
const MARKERS: usize = 15;

/// Writes walk.csv (sound), jumps.csv (each of eight markers jumps once), nameless.csv (no names)
/// and two.csv (Ann, and Bob beside her).
pub fn night(folder: &Path) {
    let walk = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait/walk.c3d");
    let walk = Numbers::read(&run("c3d2xyz", &["-q", text(&walk)], ""));
    let names: Vec<String> = walk.points[..MARKERS].to_vec();
    let rows: Vec<Vec<f64>> = (walk.rows.iter())
        .map(|row| row[..3 * MARKERS].to_vec())
        .collect();
    let put = |file: &str, names: &[String], rows: &[Vec<f64>]| {
        let heads = names
            .iter()
            .map(|n| ["x", "y", "z"].map(|axis| format!(",{n}.{axis}")).concat());
        let mut table = "time".to_string() + &heads.collect::<String>() + "\n";
        for (time, row) in walk.time.iter().zip(rows) {
            let cells: String = row.iter().map(|v| format!(",{v:.3}")).collect();
            table += &format!("{time}{cells}\n");
        }
        fs::write(folder.join(file), table).unwrap();
    };
    put("walk.csv", &names, &rows);
    let mut jumps = rows.clone();
    for p in 0..8 {
        jumps[20 + 25 * p][3 * p] += 6.0 + p as f64 / 10.0;
    }
    put("jumps.csv", &names, &jumps);
    let order = (0..MARKERS).map(|n| (7 * n + 3) % MARKERS);
    let of = |row: &Vec<f64>| {
        let cells = order.clone().flat_map(|p| row[3 * p..3 * p + 3].to_vec());
        cells.collect()
    };
    let numbers: Vec<String> = (0..MARKERS).map(|n| format!("*{n}")).collect();
    put(
        "nameless.csv",
        &numbers,
        &rows.iter().map(of).collect::<Vec<_>>(),
    );
    let people = ["Ann", "Bob"].iter();
    let both: Vec<String> = people
        .flat_map(|who| names.iter().map(move |name| format!("{who}:{name}")))
        .collect();
    let beside = |row: &Vec<f64>| {
        let away = |(c, v): (usize, &f64)| if c % 3 == 0 { v + 150.0 } else { *v };
        let bob: Vec<f64> = row.iter().enumerate().map(away).collect();
        [&row[..], &bob].concat()
    };
    put(
        "two.csv",
        &both,
        &rows.iter().map(beside).collect::<Vec<_>>(),
    );
}
