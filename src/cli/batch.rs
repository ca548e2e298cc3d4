//! Files of a command that makes one file of each: several, or those of folders.

use crate::io::motion_folder::{MotionFolder, is_special, name_of, unpacked};
use crate::{Error, Place, Result};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A file and its result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BatchJob {
    /// The file; `-` is standard input.
    pub input: PathBuf,
    /// Its result; `None` is standard output.
    pub output: Option<PathBuf>,
}

/// The files, and those of folders whose names end in one of `extensions`, each with its result: of
/// one file `output` itself, else below `output` under the file's name with the ending
/// `extension`; the files of a folder keep their places within it. `kept` are files that no result
/// may replace.
///
/// # Errors
/// [`Error::Usage`]: a result would replace a file or another result, or several files have no
/// folder for theirs. [`Error::Data`]: there are no files. [`Error::Io`]: a folder cannot be read.
pub fn batch(
    inputs: &[PathBuf],
    output: Option<&Path>,
    extensions: &[&str],
    extension: &str,
    kept: &[&Path],
) -> Result<Vec<BatchJob>> {
    let is_one = inputs.len() == 1 && !inputs[0].is_dir();
    let ends_in_slash = |path: &Path| path.as_os_str().to_string_lossy().ends_with(['/', '\\']);
    let folder = output.filter(|path| !is_one || path.is_dir() || ends_in_slash(path));
    let jobs = match (is_one, folder) {
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
    check(&jobs, kept)?;
    Ok(jobs)
}

fn in_folder(
    inputs: &[PathBuf],
    folder: &Path,
    extensions: &[&str],
    extension: &str,
) -> Result<Vec<BatchJob>> {
    let results = folder.canonicalize().ok();
    let mut jobs = Vec::new();
    for input in inputs {
        let is_wanted = |path: &Path| {
            let path = unpacked(path);
            let own = path.extension();
            own.is_some_and(|own| extensions.iter().any(|e| own.eq_ignore_ascii_case(e)))
        };
        let files = match input.is_dir() {
            true => {
                // Results of an earlier run are no input, but a folder may be its own result's.
                let but = results
                    .clone()
                    .filter(|r| input.canonicalize().ok().as_ref() != Some(r));
                let found = MotionFolder::search(input, but.as_deref(), is_wanted);
                if let Some((.., error)) = found.unreadable.into_iter().next() {
                    return Err(error);
                }
                found.files
            }
            false => vec![(input.clone(), name_of(input))],
        };
        jobs.extend(files.into_iter().map(|(input, within)| BatchJob {
            input,
            output: Some(folder.join(unpacked(&within)).with_extension(extension)),
        }));
    }
    if jobs.is_empty() {
        let names: Vec<String> = inputs.iter().map(|p| p.display().to_string()).collect();
        let what = format!("no files in it ({})", extensions.join(", "));
        return Err(Error::data(Place::file(names.join(", ")), what));
    }
    Ok(jobs)
}

/// Fails where a result would replace a file that is read or another result.
fn check(jobs: &[BatchJob], kept: &[&Path]) -> Result<()> {
    let canonical = |path: &Path| path.canonicalize().unwrap_or(path.to_path_buf());
    let read = jobs.iter().map(|job| job.input.as_path());
    let read: Vec<PathBuf> = read.chain(kept.iter().copied()).map(canonical).collect();
    let mut results: HashMap<&Path, &Path> = HashMap::new();
    for job in jobs {
        let Some(output) = job.output.as_deref().filter(|path| !is_special(path)) else {
            continue;
        };
        if read.contains(&canonical(output)) {
            return Err(Error::usage(format!(
                "{}: is read and would be replaced; give another place with -o",
                output.display()
            )));
        }
        if let Some(other) = results.insert(output, &job.input) {
            return Err(Error::usage(format!(
                "{} and {} would both become {}",
                other.display(),
                job.input.display(),
                output.display()
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn results_keep_their_places_and_replace_nothing() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("in/deep"))?;
        for name in ["in/a.bvh", "in/deep/b.amc.gz", "in/c.csv", "d.bvh"] {
            fs::write(at(name), "x")?;
        }
        let of = |inputs: &[&str], output: &str, kept: &[&Path]| {
            let inputs: Vec<PathBuf> = inputs.iter().map(|i| at(i)).collect();
            batch(&inputs, Some(&at(output)), &["bvh", "amc"], "bvh", kept)
        };
        let outputs = |jobs: Vec<BatchJob>| -> Vec<PathBuf> {
            jobs.into_iter().filter_map(|job| job.output).collect()
        };
        let all = outputs(of(&["in", "d.bvh"], "out", &[]).unwrap());
        assert_eq!(all, ["out/a.bvh", "out/deep/b.bvh", "out/d.bvh"].map(&at));
        assert_eq!(
            outputs(of(&["d.bvh"], "e.bvh", &[]).unwrap()),
            [at("e.bvh")]
        );
        assert_eq!(
            outputs(of(&["d.bvh"], "in", &[]).unwrap()),
            [at("in/d.bvh")]
        );
        for (inputs, output, kept) in [
            (&["in"][..], "in", None),
            (&["d.bvh"], "d.bvh", None),
            (&["d.bvh"], "rig.bvh", Some(at("rig.bvh"))),
            (&["in", "in/a.bvh"], "out", None),
            (&["in/deep"], "in/deep/none/", None),
        ] {
            let kept: Vec<&Path> = kept.iter().map(PathBuf::as_path).collect();
            let is_good = output.ends_with("none/");
            assert_eq!(
                of(inputs, output, &kept).is_ok(),
                is_good,
                "{inputs:?} {output}"
            );
        }
        fs::create_dir(at("empty"))?;
        assert!(of(&["empty"], "out", &[]).is_err());
        assert!(batch(&[at("in")], None, &["bvh"], "bvh", &[]).is_err());
        Ok(())
    }
}
