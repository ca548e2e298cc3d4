//! Small evaluations: a folder with takes cut from the two that lie in testdata.

use super::run;
use std::fs;
use std::path::{Path, PathBuf};

/// The takes of a subject: its one take of testdata cut into `parts`, named SUBJECT_a, SUBJECT_b,
/// ...
pub fn takes(subject: &str, take: &str, parts: usize) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("testdata/cmu")
        .join(subject);
    let asf = folder.join(format!("{subject}.asf"));
    let amc = folder.join(format!("{take}.amc"));
    let (asf, amc) = (asf.to_str().unwrap(), amc.to_str().unwrap());
    let table = run(
        "amc2xyz",
        &["--asf", asf, "--fps", "120", "--space", "body", amc],
        "",
    );
    let mut lines = table.lines();
    let mut out = lines.next().unwrap().to_string() + "\n";
    let rows: Vec<&str> = lines.collect();
    for (i, row) in rows.iter().enumerate() {
        let part = b'a' + (i * parts / rows.len()) as u8;
        let (_, rest) = row.split_once(',').unwrap();
        out.push_str(&format!("{subject}_{},{rest}\n", part as char));
    }
    out
}

/// A folder that goes when it is dropped.
pub struct Folder(pub tempfile::TempDir);

impl Folder {
    /// With walk.csv (07, four takes) and run.csv (09, three takes).
    pub fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.file("walk.csv", &takes("07", "07_01", 4));
        folder.file("run.csv", &takes("09", "09_06", 3));
        folder
    }
    /// A file of it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    /// The same as text.
    pub fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_string()
    }
    /// Writes a file; its name.
    pub fn file(&self, name: &str, text: &str) -> String {
        fs::write(self.path(name), text).unwrap();
        self.name(name)
    }
    /// Reads one.
    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }
    /// The arguments of a small evaluation into a folder.
    pub fn small(&self, out: &str) -> Vec<String> {
        let mut args: Vec<String> = [
            "--models",
            "sparse:n=20,ksvd:n=20",
            "--seeds",
            "2",
            "--frames",
            "30",
            "-o",
        ]
        .map(String::from)
        .to_vec();
        args.extend([self.name(out), self.name("walk.csv"), self.name("run.csv")]);
        args
    }
}
/// The lines of a table of one take.
pub fn of_take<'t>(table: &'t str, take: &str) -> Vec<&'t str> {
    let start = format!("{take},");
    table.lines().filter(|l| l.starts_with(&start)).collect()
}
