//! Sets `POSING_VERSION`, which `posing --version` prints: the package's version and, in a checkout, the short hash of its
//! commit.

use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let version = std::env::var("CARGO_PKG_VERSION").expect("cargo sets it");
    let version = match commit() {
        Some(commit) => format!("{version} ({commit})"),
        None => version,
    };
    println!("cargo::rustc-env=POSING_VERSION={version}");
}

/// The short hash of the commit; `None` outside a checkout and without git.
fn commit() -> Option<String> {
    // In a published package, git would find a repository that the sources merely lie in.
    if !Path::new(".git").exists() {
        return None;
    }
    let commit = git(&["rev-parse", "--short=7", "HEAD"])?;
    let branch = git(&["symbolic-ref", "--quiet", "HEAD"]);
    for name in std::iter::once("HEAD").chain(branch.as_deref()) {
        let path = PathBuf::from(git(&["rev-parse", "--git-path", name])?);
        // A packed branch gets a file at its next commit. Cargo would run this every time for a file that is missing.
        let watched = path.ancestors().find(|path| path.exists())?;
        println!("cargo::rerun-if-changed={}", watched.display());
    }
    Some(commit)
}

/// What git prints in the package's folder, in which Cargo runs this; `None` if it fails.
fn git(args: &[&str]) -> Option<String> {
    let mut git = Command::new("git");
    // Set where a hook of git builds.
    git.env_remove("GIT_DIR").env_remove("GIT_WORK_TREE");
    let out = git.args(args).output().ok()?;
    let text = String::from_utf8(out.stdout).ok()?;
    (out.status.success() && !text.trim().is_empty()).then(|| text.trim().to_string())
}
