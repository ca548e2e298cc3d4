//! Which files are cleaned, and where each result goes.

use super::super::args::Format;
use crate::io::MotionFormat;
use crate::{Error, Place, Result};
use clap::ValueEnum;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The names of files that a folder is searched for.
const EXTENSIONS: [&str; 7] = ["c3d", "trc", "bvh", "amc", "csv", "tsv", "npy"];

/// The formats that a result can have instead of the file's own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OutputFormat {
    /// C3D, millimetres, z up
    C3d,
    /// TRC, millimetres, y up
    Trc,
    /// A pose table as CSV
    Csv,
    /// A pose table as NPY, which holds coordinates only
    Npy,
}

impl OutputFormat {
    /// Its extension.
    pub fn extension(self) -> &'static str {
        match self {
            OutputFormat::C3d => "c3d",
            OutputFormat::Trc => "trc",
            OutputFormat::Csv => "csv",
            OutputFormat::Npy => "npy",
        }
    }

    /// The table that it is, if it is one.
    pub fn table(self) -> Option<Format> {
        match self {
            OutputFormat::Csv => Some(Format::Csv),
            OutputFormat::Npy => Some(Format::Npy),
            OutputFormat::C3d | OutputFormat::Trc => None,
        }
    }

    /// Whether a file of this format is of it already.
    pub fn is(self, format: MotionFormat) -> bool {
        matches!(
            (self, format),
            (OutputFormat::C3d, MotionFormat::C3d)
                | (OutputFormat::Trc, MotionFormat::Trc)
                | (OutputFormat::Csv, MotionFormat::Csv)
                | (OutputFormat::Npy, MotionFormat::Npy)
        )
    }
}

/// A file to clean.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Its name in tables: without the path of the folder that was given.
    pub name: String,
    /// The capture.
    pub input: PathBuf,
    /// The result.
    pub output: PathBuf,
}

/// The files to clean, in order.
#[derive(Debug, Default)]
pub struct Jobs {
    /// The files.
    pub jobs: Vec<Job>,
    /// The folder of the results, where there is one.
    pub folder: Option<PathBuf>,
    /// The number of files of folders that were left out by their names.
    pub left_out: usize,
    /// The format of all results, by the flag or the name of the result.
    pub to: Option<OutputFormat>,
}

/// The files and those of folders, with the places of their results: `output` itself of one file, else below `output`, where the files of
/// a folder keep their places within it.
///
/// # Errors
/// [`Error::Io`]: a folder cannot be read. [`Error::Usage`]: two results would be one file, or a result would overwrite a capture.
pub fn jobs(inputs: &[PathBuf], output: &Path, to: Option<OutputFormat>) -> Result<Jobs> {
    let ends_in_slash = output.as_os_str().to_string_lossy().ends_with(['/', '\\']);
    let is_one = inputs.len() == 1 && !inputs[0].is_dir() && !output.is_dir() && !ends_in_slash;
    let mut out = Jobs {
        to,
        folder: (!is_one).then(|| output.to_path_buf()),
        ..Jobs::default()
    };
    if is_one {
        out.to = to.or(by_extension(&inputs[0], output));
        out.jobs.push(Job {
            name: inputs[0].display().to_string(),
            input: inputs[0].clone(),
            output: output.to_path_buf(),
        });
    } else {
        let results = output.canonicalize().ok();
        for input in inputs {
            let mut files = vec![(input.clone(), name_of(input))];
            if input.is_dir() {
                files = out.files_of(input, results.as_deref())?;
            }
            for (input, within) in files {
                let output = renamed(&output.join(&within), to);
                let name = within.display().to_string();
                out.jobs.push(Job {
                    name,
                    input,
                    output,
                });
            }
        }
    }
    check(&out.jobs)?;
    Ok(out)
}

impl Jobs {
    /// The files of motion below a folder but not below `results`, with their paths within it, in the order of their names.
    fn files_of(
        &mut self,
        folder: &Path,
        results: Option<&Path>,
    ) -> Result<Vec<(PathBuf, PathBuf)>> {
        let mut out = Vec::new();
        let mut folders = vec![folder.to_path_buf()];
        while let Some(next) = folders.pop() {
            if results.is_some() && next.canonicalize().ok().as_deref() == results {
                continue;
            }
            let entries = std::fs::read_dir(&next).map_err(|e| Error::io(&next, e))?;
            for entry in entries {
                let path = entry.map_err(|e| Error::io(&next, e))?.path();
                let is_hidden = name_of(&path).to_string_lossy().starts_with('.');
                // A link to a folder may lead back here.
                if path.is_dir() && !path.is_symlink() && !is_hidden {
                    folders.push(path);
                } else if path.is_file() && !is_hidden && is_motion(&path) {
                    let within = path.strip_prefix(folder).unwrap_or(&path).to_path_buf();
                    out.push((path, within));
                } else if path.is_file() {
                    self.left_out += 1;
                }
            }
        }
        out.sort();
        Ok(out)
    }
}

/// The last part of a path.
fn name_of(path: &Path) -> PathBuf {
    PathBuf::from(path.file_name().unwrap_or_default())
}

/// The name of a file without the ending of a packed one.
fn unpacked(path: &Path) -> PathBuf {
    match path.extension() {
        Some(e) if e.eq_ignore_ascii_case("gz") || e.eq_ignore_ascii_case("zst") => {
            path.with_extension("")
        }
        _ => path.to_path_buf(),
    }
}

fn is_motion(path: &Path) -> bool {
    let path = unpacked(path);
    let is = |e: &std::ffi::OsStr| EXTENSIONS.iter().any(|x| e.eq_ignore_ascii_case(x));
    path.extension().is_some_and(is)
}

/// The format that the name of a result asks for, where it is another than that of the capture's name.
fn by_extension(input: &Path, output: &Path) -> Option<OutputFormat> {
    let (input, output) = (unpacked(input), unpacked(output));
    let extension = output.extension()?.to_string_lossy().to_ascii_lowercase();
    let own = input
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase());
    let formats = OutputFormat::value_variants().iter().copied();
    let mut asked = formats.filter(|f| f.extension() == extension);
    asked.next().filter(|_| own.as_deref() != Some(&extension))
}

/// The path of a result of another format.
fn renamed(path: &Path, to: Option<OutputFormat>) -> PathBuf {
    match to {
        Some(to) => unpacked(path).with_extension(to.extension()),
        None => path.to_path_buf(),
    }
}

/// Fails where two results would be one file, or a result would overwrite a capture.
fn check(jobs: &[Job]) -> Result<()> {
    let mut results: HashMap<&Path, &Path> = HashMap::new();
    for job in jobs {
        if let Some(other) = results.insert(&job.output, &job.input) {
            let what = format!(
                "{} and {} would both become {}; clean them into two folders",
                other.display(),
                job.input.display(),
                job.output.display()
            );
            return Err(Error::usage(what));
        }
    }
    let same = |job: &&Job| {
        let output = job.output.canonicalize().ok();
        output.is_some() && output == job.input.canonicalize().ok()
    };
    match jobs.iter().find(same) {
        Some(job) => {
            let what = "would be overwritten by its result; give another place with -o";
            Err(Error::data(
                Place::file(job.input.display().to_string()),
                what,
            ))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_of_folders_keep_their_places() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("in/deep"))?;
        fs::create_dir_all(at("in/out"))?;
        for name in [
            "in/b.C3D",
            "in/deep/a.trc.gz",
            "in/notes.txt",
            "in/out/b.C3D",
            "in/.x.csv",
        ] {
            fs::write(at(name), "x")?;
        }
        let jobs = jobs(&[at("in")], &at("in/out"), None).unwrap();
        let outputs: Vec<PathBuf> = jobs.jobs.iter().map(|j| j.output.clone()).collect();
        assert_eq!(outputs, [at("in/out/b.C3D"), at("in/out/deep/a.trc.gz")]);
        assert_eq!(jobs.left_out, 2);
        let one = |input: &str, output: &str| super::jobs(&[at(input)], &at(output), None);
        assert_eq!(
            one("in/b.C3D", "x.csv").unwrap().to,
            Some(OutputFormat::Csv)
        );
        assert_eq!(one("in/b.C3D", "x.c3d").unwrap().to, None);
        assert_eq!(
            one("in/b.C3D", "in/out").unwrap().jobs[0].output,
            at("in/out/b.C3D")
        );
        assert!(one("in/b.C3D", "in/b.C3D").is_err());
        let twice = [at("in/b.C3D"), at("in/out/b.C3D")];
        assert!(super::jobs(&twice, &at("o/"), None).is_err());
        let to = super::jobs(&[at("in")], &at("o"), Some(OutputFormat::Csv)).unwrap();
        assert_eq!(to.jobs[1].output, at("o/deep/a.csv"));
        Ok(())
    }
}
