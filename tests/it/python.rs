//! The Python package, by its own tests.

use crate::common::skipped;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A Python that has what the tests need: that of target/python, which CI makes, or the system's.
fn python() -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../python/bin/python");
    let has_all = |python: &PathBuf| {
        let mut asked = Command::new(python);
        let asked = asked.args(["-c", "import numpy, pytest"]).output();
        asked.is_ok_and(|out| out.status.success())
    };
    [own, "python3".into()].into_iter().find(has_all)
}

#[test]
fn the_package_passes_its_tests() {
    let Some(python) = python() else {
        skipped("no Python with NumPy and pytest");
        return;
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = Command::new(python)
        .args([
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "tests/python",
        ])
        .current_dir(root)
        .env("POSING_BIN", env!("CARGO_BIN_EXE_posing"))
        .env("PYTHONPATH", root.join("python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(
        out.status.success(),
        "{said}\n{}",
        String::from_utf8_lossy(&out.stderr)
    );
}
