//! What the tests of the commands share: where the binaries and the takes are, and tables in
//! memory.

pub mod bodies;
pub mod edit_program;
pub mod evaluations;
pub mod examples;
pub mod meshes;
pub mod night;

use assert_cmd::Command;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A folder with a link to the program for each command, and for `posing`.
pub fn bin() -> PathBuf {
    static LINKS: OnceLock<PathBuf> = OnceLock::new();
    let make = || {
        let program = Path::new(env!("CARGO_BIN_EXE_posing"));
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bin");
        std::fs::create_dir_all(&folder).unwrap();
        for name in command_names().into_iter().chain(["posing".to_string()]) {
            let link = folder.join(name);
            if std::fs::read_link(&link).is_ok_and(|to| to == program) {
                continue;
            }
            // Another run of the tests may read the folder.
            let new = folder.join(format!("new-{}", std::process::id()));
            std::os::unix::fs::symlink(program, &new).unwrap();
            std::fs::rename(&new, &link).unwrap();
        }
        folder
    };
    LINKS.get_or_init(make).clone()
}

/// The names of all commands, as `posing list` prints them.
pub fn command_names() -> Vec<String> {
    let program = env!("CARGO_BIN_EXE_posing");
    let listed = Command::new(program).arg("list").output().unwrap();
    let listed = String::from_utf8(listed.stdout).unwrap();
    listed.lines().map(String::from).collect()
}

/// A command of the project.
pub fn command(name: &str) -> Command {
    Command::new(bin().join(name))
}

/// Runs a command that must succeed; its standard output.
pub fn run(name: &str, args: &[&str], input: &str) -> String {
    let done = command(name)
        .args(args)
        .write_stdin(input)
        .assert()
        .success();
    String::from_utf8(done.get_output().stdout.clone()).unwrap()
}

/// Runs a command that must fail with `code` and one line on standard error; that line.
pub fn fails(name: &str, args: &[&str], input: &[u8], code: i32) -> String {
    let done = command(name)
        .args(args)
        .write_stdin(input)
        .assert()
        .code(code);
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.starts_with(&format!("{name}: ")), "{said}");
    said
}

/// Records that the running test, or a part of it, is skipped, and why; `make test` prints the list
/// at its end.
pub fn skipped(why: &str) {
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    let line = format!("{test}: {why}\n");
    eprint!("skipped: {line}");
    let list = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../skipped-tests");
    let file = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(list);
    std::io::Write::write_all(&mut file.unwrap(), line.as_bytes()).unwrap();
}

/// A file of the larger collection beside the repository; `None`, recorded as skipped, where it is
/// absent.
pub fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../shared")
        .join(path);
    if !path.exists() {
        skipped(&format!("no {}", path.display()));
        return None;
    }
    Some(path)
}

/// A file of CMU's takes such as `07/07.asf`: from testdata, else from the larger collection;
/// `None`, recorded as skipped, where neither has it.
pub fn cmu(file: &str) -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("testdata/cmu")
        .join(file);
    if own.exists() {
        return Some(own);
    }
    shared(&format!("data/cmu/{file}"))
}

/// A path as text.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A table long enough to fill every buffer on its way.
pub fn long(frames: usize) -> String {
    let mut out = String::from("take,time,root.x,root.y,root.z,note,lfemur.x,lfemur.y,lfemur.z\n");
    for i in 0..frames {
        let t = i as f64 / 100.0;
        out += &format!("walk,{t},{}.5,80,1e1,\"so, so\",5,4{i},0.125\n", i % 7);
    }
    out
}

/// A take as a table: subject, take, and more flags of amc2xyz.
pub fn take(subject: &str, take: &str, more: &[&str]) -> Option<String> {
    let asf = cmu(&format!("{subject}/{subject}.asf"))?;
    let amc = cmu(&format!("{subject}/{take}.amc"))?;
    let mut args = vec!["--asf", text(&asf), "--fps", "120"];
    args.extend(more);
    args.push(text(&amc));
    Some(run("amc2xyz", &args, ""))
}

/// The header and every `step`th row of the first `rows`.
pub fn thin(table: &str, rows: usize, step: usize) -> String {
    let mut lines = table.lines();
    let mut out = format!("{}\n", lines.next().unwrap());
    for line in lines.take(rows).step_by(step) {
        out += line;
        out.push('\n');
    }
    out
}

/// A table with its numbers.
#[derive(Clone)]
pub struct Numbers {
    /// The points.
    pub points: Vec<String>,
    /// Rows of three numbers a point; NaN is missing.
    pub rows: Vec<Vec<f64>>,
    /// Seconds, where the table tells.
    pub time: Vec<f64>,
    /// The cells as they stand.
    pub cells: Vec<Vec<String>>,
    /// The columns' names.
    pub names: Vec<String>,
}

impl Numbers {
    /// Reads a table.
    pub fn read(table: &str) -> Numbers {
        let mut reader = csv::Reader::from_reader(table.as_bytes());
        let names: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
        let at = |name: &str| names.iter().position(|n| n == name);
        let points: Vec<String> = names
            .iter()
            .filter_map(|n| n.strip_suffix(".x").map(String::from))
            .collect();
        let places: Vec<Option<usize>> = points
            .iter()
            .flat_map(|p| ["x", "y", "z"].map(|a| at(&format!("{p}.{a}"))))
            .collect();
        let (mut rows, mut time, mut cells) = (Vec::new(), Vec::new(), Vec::new());
        for record in reader.records() {
            let record: Vec<String> = record.unwrap().iter().map(String::from).collect();
            let number = |c: Option<usize>| match c.map(|c| record[c].as_str()) {
                None | Some("") => f64::NAN,
                Some(cell) => cell.parse().unwrap(),
            };
            rows.push(places.iter().map(|c| number(*c)).collect());
            time.extend(at("time").map(|c| number(Some(c))));
            cells.push(record);
        }
        Numbers {
            points,
            rows,
            time,
            cells,
            names,
        }
    }

    /// Writes the points and the time, six decimals, empty cells for NaN.
    pub fn write(&self) -> String {
        let mut out = String::new();
        if !self.time.is_empty() {
            out += "time,";
        }
        let names: Vec<String> = self
            .points
            .iter()
            .flat_map(|p| ["x", "y", "z"].map(|a| format!("{p}.{a}")))
            .collect();
        out += &names.join(",");
        out.push('\n');
        for (i, row) in self.rows.iter().enumerate() {
            if let Some(t) = self.time.get(i) {
                out += &format!("{t},");
            }
            let cells: Vec<String> = row
                .iter()
                .map(|v| {
                    if v.is_nan() {
                        String::new()
                    } else {
                        format!("{v:.6}")
                    }
                })
                .collect();
            out += &cells.join(",");
            out.push('\n');
        }
        out
    }

    /// Every point carried by `f`.
    pub fn map(&self, f: impl Fn([f64; 3]) -> [f64; 3]) -> Numbers {
        let mut out = self.clone();
        for row in &mut out.rows {
            for p in row.chunks_exact_mut(3) {
                p.copy_from_slice(&f([p[0], p[1], p[2]]));
            }
        }
        out
    }

    /// Two thirds of the frames lack a leg and the back; of both points beside and of another one
    /// there are one or two numbers.
    pub fn lacking_parts(&self) -> Numbers {
        let mut out = self.clone();
        for (t, row) in out.rows.iter_mut().enumerate().filter(|(t, _)| t % 3 > 0) {
            row[3 * 5 + 2..=3 * 12].fill(f64::NAN);
            row[3 * (14 + t % 9) + t % 3] = f64::NAN;
        }
        out
    }

    /// The largest difference of numbers that are there in both, and how many there are.
    pub fn far(&self, other: &Numbers) -> (f64, usize) {
        assert_eq!(self.rows.len(), other.rows.len());
        assert_eq!(self.points, other.points);
        let pairs = self.rows.iter().flatten().zip(other.rows.iter().flatten());
        let pairs = pairs.filter(|(a, b)| !a.is_nan() && !b.is_nan());
        pairs.fold((0.0, 0), |(far, n), (a, b)| ((a - b).abs().max(far), n + 1))
    }

    /// Root mean square difference of all numbers; NaN if one is missing.
    pub fn rms(&self, other: &Numbers) -> f64 {
        assert_eq!(self.points, other.points);
        assert_eq!(self.rows.len(), other.rows.len());
        let pairs = self.rows.iter().flatten().zip(other.rows.iter().flatten());
        let (sum, n) = pairs.fold((0.0, 0), |(s, n), (a, b)| (s + (a - b).powi(2), n + 1));
        (sum / f64::from(n)).sqrt()
    }

    /// How many numbers are missing.
    pub fn missing(&self) -> usize {
        self.rows.iter().flatten().filter(|v| v.is_nan()).count()
    }
}
