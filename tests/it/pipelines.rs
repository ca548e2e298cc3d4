//! The pipelines of the manual, as they are typed.

use crate::common::{bin, cmu};
use std::fs;
use std::path::Path;
use std::process::Command;

/// Runs a line as a user would; its standard output.
fn typed(folder: &Path, line: &str) -> String {
    let path = std::env::var("PATH").unwrap();
    let out = Command::new("bash")
        .args(["-c", &format!("set -o pipefail; {line}")])
        .env("PATH", format!("{}:{path}", bin().display()))
        .current_dir(folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{line}: {said}");
    assert!(!said.contains("panicked"), "{said}");
    String::from_utf8(out.stdout).unwrap()
}

/// A folder with these takes; `None`, with a message, where one is not there.
fn folder(files: &[&str]) -> Option<tempfile::TempDir> {
    let dir = tempfile::tempdir().unwrap();
    for file in files {
        let name = Path::new(file).file_name().unwrap();
        fs::copy(cmu(file)?, dir.path().join(name)).unwrap();
    }
    Some(dir)
}

#[test]
fn a_gappy_walk_becomes_a_bvh() {
    let Some(dir) = folder(&["07/07.asf", "07/07_01.amc"]) else {
        return;
    };
    if !bin().join("xyz2bvh").exists() {
        eprintln!("skipped: xyz2bvh is not built");
        return;
    }
    typed(
        dir.path(),
        "posing amc2xyz --asf 07.asf --fps 120 07_01.amc | posing corrupt --gaps 8 --length 0.4 --points 3 | posing complete | posing xyz2bvh --skeleton 07.asf -o walk.bvh",
    );
    let bvh = fs::read_to_string(dir.path().join("walk.bvh")).unwrap();
    assert!(bvh.starts_with("HIERARCHY") && bvh.contains("Frames: 316"));
}

#[test]
fn parts_are_learned_side_by_side_and_denoise_another_take() {
    let takes = [
        "01/01.asf",
        "01/01_01.amc",
        "01/01_02.amc",
        "07/07.asf",
        "07/07_02.amc",
    ];
    let Some(dir) = folder(&takes) else {
        return;
    };
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples");
    for (name, copy) in [("train.mk", "Makefile"), ("train.sh", "train.sh")] {
        fs::copy(examples.join(name), dir.path().join(copy)).unwrap();
    }
    // Thousands of frames of takes are more than a test needs: the same line on the first of each.
    for name in ["01_01.amc", "01_02.amc", "07_02.amc"] {
        let path = dir.path().join(name);
        let text = fs::read_to_string(&path).unwrap().replace('\r', "");
        let end = text.find("\n401\n").unwrap_or(text.len() - 1);
        fs::write(&path, &text[..=end]).unwrap();
    }
    typed(
        dir.path(),
        "posing amc2xyz --asf 01.asf --fps 120 01_*.amc | posing cluster -k 8 --split parts && make -j2 dict.npz",
    );
    assert!(
        fs::read(dir.path().join("dict.npz"))
            .unwrap()
            .starts_with(b"PK")
    );
    let info = typed(dir.path(), "posing model info dict.npz");
    assert!(info.contains("rigid"), "{info}");
    let score = typed(
        dir.path(),
        "posing amc2xyz --asf 07.asf --fps 120 07_02.amc | posing corrupt --dense 1asf --seed 1 | posing denoise -m dict.npz | posing score --units asf <(posing amc2xyz --asf 07.asf --fps 120 07_02.amc) -",
    );
    let all = score.lines().find(|l| l.starts_with("all ")).unwrap();
    let mse: f64 = all.split_whitespace().nth(2).unwrap().parse().unwrap();
    // The noise alone has an MSE of 1 asf^2.
    assert!(mse <= 0.5, "{score}");
}
