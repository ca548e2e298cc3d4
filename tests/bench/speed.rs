//! How fast the commands are, as whole processes: `make bench`.
//!
//! Every figure is the median of five runs on this machine, beside `cat` of the same bytes;
//! absolute times on another machine mean little, the ratios more.

mod shared;

use shared::files;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const RUNS: usize = 5;

macro_rules! bin {
    ($name:literal) => {
        shared::command($name)
    };
}

fn main() {
    let work = tempfile::tempdir().expect("a temporary folder");
    let (asf, takes) = takes();
    println!("takes: {} files of {}", takes.len(), asf.display());
    let bytes = |paths: &[PathBuf]| {
        paths
            .iter()
            .map(|p| fs::metadata(p).map_or(0, |m| m.len()))
            .sum::<u64>() as f64
    };
    let cat = |paths: &[PathBuf]| rate(bytes(paths), Command::new("cat").args(paths));
    println!(
        "{:<34} {:>9} {:>9} {:>9}",
        "bytes in", "MB/s", "cat MB/s", "ratio"
    );
    let line = |what: &str, ours: f64, cat: f64| {
        println!("{what:<34} {ours:>9.0} {cat:>9.0} {:>9.3}", ours / cat)
    };
    let amc2xyz = || {
        let mut command = bin!("amc2xyz");
        command
            .arg("--asf")
            .arg(&asf)
            .args(["--fps", "120", "--space", "body"]);
        command
    };
    let amc = bytes(&takes);
    line(
        "amc2xyz, AMC to CSV",
        rate(amc, amc2xyz().args(&takes)),
        cat(&takes),
    );
    line(
        "amc2xyz, AMC to NPY",
        rate(amc, amc2xyz().args(["--to", "npy"]).args(&takes)),
        cat(&takes),
    );
    let (csv, npy) = (work.path().join("a.csv"), work.path().join("a.npy"));
    for out in [&csv, &npy] {
        assert!(
            amc2xyz()
                .arg("-o")
                .arg(out)
                .args(&takes)
                .status()
                .is_ok_and(|s| s.success())
        );
    }
    for (what, file, to) in [
        ("CSV to CSV (nothing changed)", &csv, "csv"),
        ("CSV to NPY", &csv, "npy"),
        ("NPY to CSV", &npy, "csv"),
        ("NPY to NPY", &npy, "npy"),
    ] {
        let files = [file.clone()];
        let ours = rate(
            bytes(&files),
            bin!("corrupt").args(["--dense", "0", "--to", to]).arg(file),
        );
        line(what, ours, cat(&files));
    }
    let one = work.path().join("one.npy");
    assert!(
        amc2xyz()
            .arg("-o")
            .arg(&one)
            .arg(&takes[0])
            .status()
            .is_ok_and(|s| s.success())
    );
    one_frame(work.path(), &asf, &takes[0]);
    learning(work.path(), &npy, &one);
}

/// A whole process that completes one frame of which six points are there.
fn one_frame(work: &Path, asf: &Path, take: &Path) {
    let whole = bin!("amc2xyz")
        .args(["--fps", "120", "--asf"])
        .args([asf, take])
        .output();
    let whole = whole.expect("amc2xyz runs").stdout;
    let ends = whole.iter().enumerate().filter(|(_, b)| **b == b'\n');
    let end = ends.map(|(at, _)| at + 1).nth(1).expect("a frame");
    let [one, gaps] = ["one.csv", "gaps.csv"].map(|name| work.join(name));
    fs::write(&one, &whole[..end]).expect("room for a frame");
    let six = "root,lfoot,rfoot,lwrist,rwrist,head";
    let status = bin!("corrupt")
        .args(["--keep", six, "-o"])
        .args([&gaps, &one])
        .status();
    assert!(status.is_ok_and(|s| s.success()));
    let seconds = shared::median(31, || {
        let status = bin!("complete").arg("-q").arg(&gaps).output();
        assert!(status.is_ok_and(|o| o.status.success()));
    });
    println!(
        "\none frame from six points, a whole process: {:.1} ms",
        1e3 * seconds
    );
}

/// K-SVD over all takes, and denoising the first with what it learned.
fn learning(work: &Path, npy: &Path, one: &Path) {
    println!(
        "\n{:<34} {:>12} {:>14}",
        "atoms", "s/iteration", "denoise /s"
    );
    for atoms in ["1000", "5000"] {
        let (log, model) = (work.join("log"), work.join("m.npz"));
        let status = bin!("ksvd-train")
            .args([
                "-q",
                "-n",
                atoms,
                "--iterations",
                "5",
                "--space",
                "body",
                "--log",
            ])
            .arg(&log)
            .arg("-o")
            .arg(&model)
            .arg(npy)
            .status();
        assert!(status.is_ok_and(|s| s.success()));
        let seconds: Vec<f64> = fs::read_to_string(&log)
            .unwrap_or_default()
            .lines()
            .filter_map(|l| {
                serde_json::from_str::<serde_json::Value>(l)
                    .ok()?
                    .get("seconds")?
                    .as_f64()
            })
            .collect();
        let mut steps: Vec<f64> = seconds.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        let frames = (fs::metadata(one).map_or(0, |m| m.len()) / (69 * 8)) as f64;
        let per_second = rate(
            frames * 1e6,
            bin!("denoise")
                .args([
                    "-q",
                    "--per-frame",
                    "--space",
                    "body",
                    "--noise",
                    "1asf",
                    "--to",
                    "npy",
                    "-m",
                ])
                .arg(&model)
                .arg(one),
        );
        println!(
            "{atoms:<34} {:>12.3} {per_second:>14.0}",
            steps[steps.len() / 2]
        );
    }
}

/// Megabytes a second: the median of some runs, the output thrown away.
fn rate(bytes: f64, command: &mut Command) -> f64 {
    let seconds = shared::median(RUNS, || {
        let status = command.stdin(Stdio::null()).stdout(Stdio::null()).status();
        assert!(status.is_ok_and(|s| s.success()), "{command:?}");
    });
    bytes / 1e6 / seconds
}

/// A subject with many takes where one is at hand, else the take in testdata.
fn takes() -> (PathBuf, Vec<PathBuf>) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shared = here.join("../shared/data/cmu/01");
    let folder = if shared.is_dir() {
        shared
    } else {
        here.join("testdata/cmu/07")
    };
    (files(&folder, "asf").remove(0), files(&folder, "amc"))
}
