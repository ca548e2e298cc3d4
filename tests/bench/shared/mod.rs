//! What the benches share: takes to measure with, and medians.
#![allow(dead_code)] // Every bench uses a part of it.

use ndarray::Array2;
use posing::io::TableOptions;
use posing::io::{Input, Table};
use posing::numeric::parallel;
use posing::sparse::Dictionary;
use rand::Rng;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// A take in body space.
pub struct Take {
    /// The names of the points.
    pub points: Vec<String>,
    /// (frames, 3 x points), cm.
    pub xyz: Array2<f32>,
}

/// The files of a folder that end so, in order.
pub fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries
        .map(|e| e.path())
        .filter(|p| p.extension().is_some_and(|e| e == ending))
        .collect();
    files.sort();
    files
}

/// The CMU takes at `../shared/data/cmu`, a folder a subject; none where they are not at hand.
pub fn takes() -> Vec<Take> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/cmu");
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten();
    let mut subjects: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| p.is_dir()).collect();
    subjects.sort();
    let of = |subject: &PathBuf| -> Vec<Take> {
        let (asf, amc) = (files(subject, "asf"), files(subject, "amc"));
        let asf = asf.first().into_iter();
        asf.flat_map(|asf| amc.iter().map(move |amc| take(asf, amc)))
            .collect()
    };
    subjects.iter().flat_map(of).collect()
}

/// A command of the project.
pub fn command(name: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_posing"));
    command.arg(name);
    command
}

fn take(asf: &Path, amc: &Path) -> Take {
    let done = command("amc2xyz")
        .args(["-q", "--fps", "120", "--space", "body", "--asf"])
        .args([asf, amc])
        .output()
        .expect("amc2xyz runs");
    assert!(done.status.success(), "{}: no take", amc.display());
    let input = Input::new("a take", std::io::Cursor::new(done.stdout)).expect("a table");
    let table = Table::read(input, &TableOptions::default()).expect("a table of poses");
    Take {
        xyz: table.poses.xyz.mapv(|v| v as f32),
        points: table.columns.points,
    }
}

/// The median of the seconds of so many runs.
pub fn median(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let began = Instant::now();
            work();
            began.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

/// So many atoms of frames that are not coded, and beyond that of frames between two of them that
/// are near in time.
pub fn atoms(takes: &Array2<f32>, frames: &[usize], n: usize) -> Dictionary {
    let mut chance = parallel::rng(0, n as u64);
    let mut rows = Array2::zeros((n, takes.ncols()));
    for mut row in rows.outer_iter_mut() {
        let i = chance.random_range(0..frames.len());
        let near = (i + chance.random_range(0..12)).min(frames.len() - 1);
        let share: f32 = chance.random();
        row.scaled_add(1.0 - share, &takes.row(frames[i]));
        row.scaled_add(share, &takes.row(frames[near]));
    }
    Dictionary::from_rows(rows.view()).expect("poses are not zero")
}
