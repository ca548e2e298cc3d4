//! Files of a command that makes one file of each: several, or those of folders.

use super::input::TakeNames;
use super::json_report::JsonArgs;
use super::paths::command_files;
use super::{Outcome, messages, streams};
pub use crate::io::motion_folder::EXTENSIONS;
use crate::io::motion_folder::{MotionFolder, is_results_folder, is_special, name_of, unpacked};
use crate::{Error, Place, Result};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// A file and its result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BatchJob {
    /// The file; `-` is standard input.
    pub input: PathBuf,
    /// Its result; `None` is standard output.
    pub output: Option<PathBuf>,
}

/// Does each job; one that fails is told and stops no other, unless it is the only one. The outcome
/// is the worst of all.
///
/// # Errors
/// Fails as the only job does.
pub fn each(
    jobs: &[BatchJob],
    mut work: impl FnMut(&BatchJob) -> Result<Outcome>,
) -> Result<Outcome> {
    if let [one] = jobs {
        return work(one);
    }
    let mut outcome = Outcome::Done;
    for job in jobs {
        match streams::together(|| work(job)) {
            Ok(Outcome::Done) => {}
            Ok(found) if outcome == Outcome::Done => outcome = found,
            Ok(_) => {}
            Err(e) => {
                messages::error(&e.to_string());
                outcome = Outcome::Failed;
            }
        }
    }
    Ok(outcome)
}

/// Does each job as [`each`]; then writes an object of `files`, what was done to each or its
/// `error`.
///
/// # Errors
/// Those of [`each`]; writing fails.
pub fn each_told<R: Serialize>(
    jobs: &[BatchJob],
    json: &JsonArgs,
    mut work: impl FnMut(&BatchJob) -> Result<(Outcome, R)>,
) -> Result<Outcome> {
    let mut files = Vec::new();
    let outcome = each(jobs, |job| {
        let done = work(job);
        let (report, error) = match &done {
            Ok((_, report)) => (serde_json::to_value(report).ok(), None),
            Err(e) => (None, Some(messages::option_names().in_text(&e.to_string()))),
        };
        let file = job.input.display().to_string();
        files.push(FileReport {
            file,
            error,
            report,
        });
        done.map(|(outcome, _)| outcome)
    })?;
    json.write(json!({ "files": files }))?;
    Ok(outcome)
}

/// What was done to a file.
#[derive(Serialize)]
struct FileReport {
    file: String,
    error: Option<String>,
    #[serde(flatten)]
    report: Option<Value>,
}

/// The files, and those of folders whose names end in one of `extensions`, each with its result: of
/// one file `output` itself, else below `output` under the file's name with the ending
/// `extension`, or its own; the files of a folder keep their paths within it. Results that would
/// be one are named apart as takes are ([`TakeNames`]), which is said.
///
/// # Errors
/// [`Error::Usage`]: a result would replace a file, a file is given twice, or several files have no
/// folder for theirs. [`Error::Data`]: there are no files. [`Error::Io`]: a folder cannot be read.
pub fn batch(
    inputs: &[PathBuf],
    output: Option<&Path>,
    extensions: &[&str],
    extension: Option<&str>,
) -> Result<Vec<BatchJob>> {
    let is_one = inputs.len() == 1 && !inputs[0].is_dir();
    let folder = output.filter(|path| !is_one || is_results_folder(path, &inputs[0]));
    let mut jobs = match (is_one, folder) {
        (true, None) => vec![BatchJob {
            input: inputs[0].clone(),
            output: output.map(Path::to_path_buf),
        }],
        (_, Some(folder)) => in_folder(inputs, folder, extensions, extension)?,
        (false, None) => {
            let what = "several files need a folder for their results; give it with -o DIR";
            return Err(Error::usage(what));
        }
    };
    make_distinct(&mut jobs)?;
    if folder.is_some() {
        check(&jobs)?;
    }
    Ok(jobs)
}

fn in_folder(
    inputs: &[PathBuf],
    folder: &Path,
    extensions: &[&str],
    extension: Option<&str>,
) -> Result<Vec<BatchJob>> {
    let results = folder.canonicalize().ok();
    let mut jobs = Vec::new();
    for input in inputs {
        let is_wanted = |path: &Path| {
            let path = unpacked(path);
            let own = path.extension();
            own.is_some_and(|own| extensions.iter().any(|e| own.eq_ignore_ascii_case(e)))
        };
        let files = if input.is_dir() {
            // Results of an earlier run are no input, but a folder may be its own result's.
            let but = results
                .clone()
                .filter(|r| input.canonicalize().ok().as_ref() != Some(r));
            let found = MotionFolder::search(input, but.as_deref(), is_wanted);
            if let Some((.., error)) = found.unreadable.into_iter().next() {
                return Err(error);
            }
            found.files
        } else {
            vec![(input.clone(), name_of(input))]
        };
        jobs.extend(files.into_iter().map(|(input, within)| {
            let own = folder.join(unpacked(&within));
            let output = extension.map(|extension| own.with_extension(extension));
            BatchJob {
                input,
                output: Some(output.unwrap_or(own)),
            }
        }));
    }
    if jobs.is_empty() {
        let names: Vec<String> = inputs.iter().map(|p| p.display().to_string()).collect();
        let what = format!("no files in it ({})", extensions.join(", "));
        return Err(Error::data(Place::file(names.join(", ")), what));
    }
    Ok(jobs)
}

/// Gives each file a result of its own: takes of one name come from several folders, or in several
/// formats.
fn make_distinct(jobs: &mut [BatchJob]) -> Result<()> {
    let (mut names, mut given) = (TakeNames::default(), HashSet::new());
    for BatchJob { input, output } in jobs {
        let Some(output) = output.as_mut().filter(|path| !is_special(path)) else {
            continue;
        };
        if !given.insert((output.clone(), canonical(input))) {
            let what = format!("{}: is given twice", input.display());
            return Err(Error::usage(what));
        }
        let own = output.with_extension("").to_string_lossy().into_owned();
        let name = names.distinct(own.clone());
        let marks = &name[own.len()..];
        if marks.is_empty() {
            continue;
        }
        let mut name = output.file_stem().unwrap_or_default().to_os_string();
        name.push(marks);
        let extension = output.extension().unwrap_or_default();
        let other = output.with_file_name(name).with_added_extension(extension);
        messages::info(&format!(
            "{}: becomes {}, as another file becomes {}",
            input.display(),
            other.display(),
            output.display()
        ));
        *output = other;
    }
    Ok(())
}

/// Fails where a result in a folder would replace a file that is read, or another result.
fn check(jobs: &[BatchJob]) -> Result<()> {
    let mut files = command_files();
    for BatchJob { input, .. } in jobs {
        files.read(format!("the input {}", input.display()), input)?;
    }
    let mut outputs = jobs.iter().filter_map(|job| job.output.as_deref());
    outputs.try_for_each(|path| files.write(path.display().to_string(), path))
}

/// The path without links, where it exists.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or(path.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn results_keep_their_paths_and_replace_nothing() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("in/deep"))?;
        for name in ["in/a.bvh", "in/deep/b.amc.gz", "in/c.csv", "d.bvh"] {
            fs::write(at(name), "x")?;
        }
        let of = |inputs: &[&str], output: &str| {
            let inputs: Vec<PathBuf> = inputs.iter().map(|i| at(i)).collect();
            batch(&inputs, Some(&at(output)), &["bvh", "amc"], Some("bvh"))
        };
        let outputs = |jobs: Vec<BatchJob>| -> Vec<PathBuf> {
            jobs.into_iter().filter_map(|job| job.output).collect()
        };
        let all = outputs(of(&["in", "d.bvh"], "out").unwrap());
        assert_eq!(all, ["out/a.bvh", "out/deep/b.bvh", "out/d.bvh"].map(&at));
        assert_eq!(outputs(of(&["d.bvh"], "e.bvh").unwrap()), [at("e.bvh")]);
        assert_eq!(outputs(of(&["d.bvh"], "in").unwrap()), [at("in/d.bvh")]);
        for (inputs, output) in [
            (&["in"][..], "in"),
            (&["in/a.bvh"], "in"),
            (&["in", "in/a.bvh"], "out"),
            (&["in/deep"], "in/deep/none/"),
        ] {
            let is_good = output.ends_with("none/");
            assert_eq!(of(inputs, output).is_ok(), is_good, "{inputs:?} {output}");
        }
        // Takes of one name, from other folders and in another format.
        for name in ["in/deep/a.bvh", "in/deep/a.amc", "in/a'.bvh"] {
            fs::write(at(name), "x")?;
        }
        let same = of(
            &["in/a.bvh", "in/deep/a.bvh", "in/a'.bvh", "in/deep/a.amc"],
            "out",
        );
        let names = ["out/a.bvh", "out/a'.bvh", "out/a''.bvh", "out/a'''.bvh"];
        assert_eq!(outputs(same.unwrap()), names.map(&at));
        fs::create_dir(at("empty"))?;
        assert!(of(&["empty"], "out").is_err());
        assert!(batch(&[at("in")], None, &["bvh"], Some("bvh")).is_err());
        Ok(())
    }
}
