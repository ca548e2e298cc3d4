//! Which files are cleaned, and where each result goes.

use super::earlier_result::EarlierResult;
use super::files_beside;
use super::record::record_path;
use super::skeleton::{SkeletonSettings, all_called, is_skeleton, stem};
use crate::io::command_files::CommandFiles;
use crate::io::keypoint_files::is_frame_folder;
use crate::io::motion_folder::{
    EXTENSIONS, MotionFolder, is_results_folder, is_special, name_of, unpacked,
};
use crate::io::{MotionFormat, TableFormat};
use crate::{Error, Place, Result};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Other formats that somebody may ask for.
const OTHERS: [&str; 4] = ["glb", "gltf", "json", "html"];

/// The formats that a result can have instead of the file's own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputFormat {
    /// C3D, millimeters, z up
    C3d,
    /// TRC, millimeters, y up
    Trc,
    /// A pose table as CSV
    Csv,
    /// A pose table as NPY, which holds coordinates only
    Npy,
}

names!(OutputFormat {
    C3d = "c3d",
    Trc = "trc",
    Csv = "csv",
    Npy = "npy",
});

impl OutputFormat {
    /// The table that it is, if it is one.
    pub(crate) fn table(self) -> Option<TableFormat> {
        match self {
            OutputFormat::Csv => Some(TableFormat::Csv),
            OutputFormat::Npy => Some(TableFormat::Npy),
            OutputFormat::C3d | OutputFormat::Trc => None,
        }
    }

    /// Whether a file of this format is of it already.
    pub(crate) fn is(self, format: MotionFormat) -> bool {
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
pub(crate) struct Job {
    /// The name in tables: without the path of the folder that was given.
    pub name: String,
    /// The capture.
    pub input: PathBuf,
    /// The result.
    pub output: PathBuf,
    /// What a skeleton beside it is called after.
    pub named: PathBuf,
    /// Results and skeletons of other files that one of a person of this may be called as.
    pub others: Vec<PathBuf>,
    /// The format of the result, by the flag or its name; `None`: that of the capture.
    pub to: Option<OutputFormat>,
}

impl Job {
    /// The format of the result, where it is another than that of the capture.
    pub(crate) fn other_format(&self, format: MotionFormat) -> Option<OutputFormat> {
        self.to.filter(|to| !to.is(format))
    }

    /// Whether the result holds rotations or columns, as the capture does, and no positions.
    pub(crate) fn keeps_rotations(&self, format: MotionFormat) -> bool {
        is_of_rotations(format) && self.to.is_none()
    }
}

/// Whether files of a format hold rotations or columns, and no positions.
pub(crate) fn is_of_rotations(format: MotionFormat) -> bool {
    matches!(
        format,
        MotionFormat::Bvh | MotionFormat::Fbx | MotionFormat::Amc | MotionFormat::OpenSim
    )
}

/// The files to clean, in order.
#[derive(Debug, Default)]
pub(crate) struct Jobs {
    /// The files.
    pub jobs: Vec<Job>,
    /// The folder of the results, where there is one.
    pub folder: Option<PathBuf>,
    /// Folders that cannot be read, by their names in tables.
    pub unreadable: Vec<(String, Error)>,
    /// The number of files of folders that are none of motion, or results of an earlier run.
    pub left_out: usize,
}

/// The files and those of folders, with the paths of their results: `output` itself of one file,
/// else below `output`, where the files of a folder keep their paths within it.
///
/// # Errors
/// [`Error::Usage`]: a result would have a format that it cannot have.
/// [`Error::Data`]: there is nothing to clean.
pub(crate) fn jobs(inputs: &[PathBuf], output: &Path, to: Option<OutputFormat>) -> Result<Jobs> {
    let is_stream = |path: &Path| path == Path::new("-") || is_special(path);
    if inputs.iter().any(|p| is_stream(p)) || is_stream(output) {
        let what = "clean reads and writes files, since a record stands beside each result";
        return Err(Error::usage(what));
    }
    let is_output =
        |p: &&PathBuf| p.is_dir() && p.canonicalize().ok() == output.canonicalize().ok();
    if let Some(folder) = inputs.iter().find(is_output) {
        let what = format!(
            "{}: is the folder of the captures; results need one of their own",
            folder.display()
        );
        return Err(Error::usage(what));
    }
    let is_take =
        |path: &Path| !path.is_dir() || output.extension().is_some() && is_frame_folder(path);
    let is_one = inputs.len() == 1 && is_take(&inputs[0]) && !is_results_folder(output, &inputs[0]);
    let mut out = if is_one {
        Jobs::one(&inputs[0], output, to)?
    } else {
        Jobs::into_folder(inputs, output, to)
    };
    out.tell_names_apart();
    if out.jobs.is_empty() && out.unreadable.is_empty() {
        let folders: Vec<String> = inputs.iter().map(|p| p.display().to_string()).collect();
        let what = format!(
            "no files of motion in it ({}, keypoints as json)",
            EXTENSIONS.join(", ")
        );
        return Err(Error::data(Place::file(folders.join(", ")), what));
    }
    Ok(out)
}

impl Jobs {
    fn one(input: &Path, output: &Path, to: Option<OutputFormat>) -> Result<Jobs> {
        let job = Job {
            name: input.display().to_string(),
            input: input.to_path_buf(),
            output: output.to_path_buf(),
            named: stem(output),
            others: Vec::new(),
            to: match to {
                Some(to) => Some(to),
                None => by_extension(input, output)?,
            },
        };
        Ok(Jobs {
            jobs: vec![job],
            ..Jobs::default()
        })
    }

    fn into_folder(inputs: &[PathBuf], folder: &Path, to: Option<OutputFormat>) -> Jobs {
        let mut out = Jobs {
            folder: Some(folder.to_path_buf()),
            ..Jobs::default()
        };
        let results = folder.canonicalize().ok();
        let mut all = Vec::new();
        for input in inputs {
            if input.is_dir() {
                all.extend(out.files_of(input, results.as_deref()));
            } else {
                all.push((input.clone(), name_of(input)));
            }
        }
        let outputs = outputs(&all, folder, to);
        let jobs = all.into_iter().zip(outputs);
        let jobs = jobs.map(|((input, within), output)| Job {
            name: within.display().to_string(),
            input,
            named: stem(&output),
            others: Vec::new(),
            output,
            to,
        });
        out.jobs = jobs.collect();
        out
    }

    /// Where results differ in their endings alone, or one is called as a skeleton would be, the
    /// skeletons are called after the whole names.
    fn tell_names_apart(&mut self) {
        // A whole name may be as the stem of another.
        for _ in 0..2 {
            self.call_by_whole_names();
        }
        let called = |job: &Job| [vec![job.output.clone()], all_called(&job.named).to_vec()];
        let all: Vec<PathBuf> = self.jobs.iter().flat_map(called).flatten().collect();
        for job in &mut self.jobs {
            let start = format!("{}-", job.named.display());
            let is_met = |path: &&PathBuf| path.display().to_string().starts_with(&start);
            job.others = all.iter().filter(is_met).cloned().collect();
        }
    }

    /// Calls the skeletons by whole names where two would be called alike, or one as a result.
    fn call_by_whole_names(&mut self) {
        let mut names: HashMap<PathBuf, usize> = HashMap::new();
        for job in &self.jobs {
            *names.entry(job.named.clone()).or_default() += 1;
        }
        let outputs: HashSet<PathBuf> = self.jobs.iter().map(|job| job.output.clone()).collect();
        for job in &mut self.jobs {
            let is_taken = all_called(&job.named)
                .iter()
                .any(|path| outputs.contains(path));
            if is_taken || names[&job.named] > 1 {
                job.named.clone_from(&job.output);
            }
        }
    }

    /// The files of motion below a folder but not below `results`, with their paths within it.
    fn files_of(&mut self, folder: &Path, results: Option<&Path>) -> Vec<(PathBuf, PathBuf)> {
        let found = MotionFolder::with_keypoints(folder, results, |path| !is_result(path));
        let unreadable = found.unreadable.into_iter();
        let named = unreadable.map(|(_, name, error)| (name.display().to_string(), error));
        self.unreadable.extend(named);
        self.left_out += found.left_out;
        found.files
    }

    /// Adds the captures to `files`, and the results with what stands beside them; a result of one
    /// file alone is there already.
    ///
    /// # Errors
    /// [`Error::Usage`]: one would be written over a file that is read, or over another.
    pub(super) fn check(
        &self,
        files: &mut CommandFiles,
        skeletons: Option<&SkeletonSettings>,
    ) -> Result<()> {
        for Job { input, .. } in &self.jobs {
            files.read(format!("the capture {}", input.display()), input)?;
        }
        for job in &self.jobs {
            let Job {
                input,
                output,
                named,
                ..
            } = job;
            let called = format!("{}, the result of {},", output.display(), input.display());
            match self.folder {
                Some(_) => files.write(called, output)?,
                None => files.check_not_read(&called, output)?,
            }
            let skeleton = skeletons.map(|settings| settings.path(named));
            for path in files_beside(output).into_iter().chain(skeleton) {
                files.write(path.display().to_string(), &path)?;
            }
        }
        Ok(())
    }

    /// Fails where the page would be written over a capture, a result, or a file that is no such
    /// page, as `is_page` says.
    pub(crate) fn check_page(&self, page: &Path, is_page: bool) -> Result<()> {
        let own = canonical(page);
        let is_of = |job: &Job| {
            let paths = [&job.input, &job.output, &record_path(&job.output)];
            paths.iter().any(|path| canonical(path) == own)
        };
        if page.exists() && !is_page || self.jobs.iter().any(is_of) {
            let what = "is there and is no page or list of clean; give another place with the \
                        option `page`";
            return Err(Error::data(Place::file(page.display().to_string()), what));
        }
        Ok(())
    }
}

/// The path without links, where it exists.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or(path.to_path_buf())
}

/// Whether a file was made by `clean`.
fn is_result(path: &Path) -> bool {
    record_path(path).exists() && EarlierResult::read(path).may_be_replaced(false).is_ok()
        || is_skeleton(path)
}

/// The format that the name of a result asks for, where it is another than that of the capture's
/// name.
fn by_extension(input: &Path, output: &Path) -> Result<Option<OutputFormat>> {
    let (own, asked) = (ending_of_input(input), ending(&unpacked(output)));
    if let Some(other) = becomes(&asked) {
        let [read, made] = [&asked, other].map(str::to_uppercase);
        let what =
            format!("{read} is read and not written; the result is {made}, so call it .{other}");
        return Err(Error::data(Place::file(output.display().to_string()), what));
    }
    if asked.is_empty() || asked == own || becomes(&own) == Some(&asked) {
        return Ok(None);
    }
    let format = OutputFormat::of_name(&asked);
    let is_other = EXTENSIONS.contains(&asked.as_str()) || OTHERS.contains(&asked.as_str());
    match format {
        None if is_other => Err(Error::usage(format!(
            "{}: clean writes a file in its own format, or as c3d, trc, csv or npy; write a table \
             (.csv) and convert that",
            output.display()
        ))),
        format => Ok(format),
    }
}

/// The ending of a path, in small letters.
fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_ascii_lowercase()
}

/// The ending of a capture; a folder with a frame a file is JSON.
fn ending_of_input(path: &Path) -> String {
    if path.is_dir() {
        return "json".to_string();
    }
    ending(&unpacked(path))
}

/// The ending of what a file becomes whose ending, `own`, is that of a format which is not written.
fn becomes(own: &str) -> Option<&'static str> {
    match own {
        "fbx" => Some("bvh"),
        "json" => Some("csv"),
        _ => None,
    }
}

/// The paths of the results below `folder` of files, each with its path within a folder. Exports of
/// one take in two formats that would meet keep their own endings too: all but the one that has
/// that name itself, or else the first by name, in whatever order they are given.
fn outputs(files: &[(PathBuf, PathBuf)], folder: &Path, to: Option<OutputFormat>) -> Vec<PathBuf> {
    let other = |input: &Path| {
        let becomes = || becomes(&ending_of_input(input));
        to.map(OutputFormat::name).or_else(becomes)
    };
    let output = |(input, within): &(PathBuf, PathBuf)| match other(input) {
        // A folder has no ending.
        Some(other) if input.is_dir() => folder.join(format!("{}.{other}", within.display())),
        Some(other) => folder.join(unpacked(within).with_extension(other)),
        None => folder.join(within),
    };
    let mut outputs: Vec<PathBuf> = files.iter().map(output).collect();
    let mut order: Vec<usize> = (0..files.len()).collect();
    order.sort_by_key(|k| {
        let (input, within) = &files[*k];
        (outputs[*k] != folder.join(within), within, input)
    });
    let mut taken: HashSet<PathBuf> = HashSet::new();
    for k in order {
        let (input, within) = &files[k];
        let mut name = name_of(within).display().to_string();
        while let (Some(other), true) = (other(input), taken.contains(&outputs[k])) {
            name = format!("{name}.{other}");
            outputs[k].set_file_name(&name);
        }
        taken.insert(outputs[k].clone());
    }
    outputs
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_of_folders_keep_their_paths() -> std::io::Result<()> {
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
        let checked = |inputs: &[PathBuf], output: &str| {
            let jobs = super::jobs(inputs, &at(output), None)?;
            jobs.check(
                &mut CommandFiles::default(),
                Some(&SkeletonSettings::default()),
            )?;
            Ok::<_, Error>(jobs)
        };
        let one = |input: &str, output: &str| checked(&[at(input)], output);
        assert_eq!(
            one("in/b.C3D", "x.csv").unwrap().jobs[0].to,
            Some(OutputFormat::Csv)
        );
        assert_eq!(one("in/b.C3D", "x.c3d").unwrap().jobs[0].to, None);
        assert_eq!(
            one("in/b.C3D", "in/out").unwrap().jobs[0].output,
            at("in/out/b.C3D")
        );
        assert!(one("in/b.C3D", "in/b.C3D").is_err());
        let twice = [at("in/b.C3D"), at("in/out/b.C3D")];
        assert!(checked(&twice, "o/").is_err());
        let to = super::jobs(&[at("in")], &at("o"), Some(OutputFormat::Csv)).unwrap();
        assert_eq!(to.jobs[1].output, at("o/deep/a.csv"));
        // The order of files changes no name; a file that has a name itself keeps it.
        let names = ["walk.json", "walk.csv", "walk.FBX", "walk.bvh"];
        let names = names.map(|name| at(&format!("in/{name}")));
        let outputs = |files: &[PathBuf]| {
            let jobs = super::jobs(files, &at("o/"), None).unwrap().jobs;
            let mut all: Vec<_> = jobs
                .into_iter()
                .map(|job| (job.input, job.output))
                .collect();
            all.sort();
            all
        };
        let mut turned = names.clone();
        turned.reverse();
        assert_eq!(outputs(&names), outputs(&turned));
        let want = ["walk.FBX.bvh", "walk.bvh", "walk.csv", "walk.json.csv"];
        let want = want.map(|name| at(&format!("o/{name}")));
        let found = outputs(&names).into_iter().map(|(_, output)| output);
        assert_eq!(found.collect::<Vec<_>>(), want);
        let to_csv = super::jobs(&names, &at("o/"), Some(OutputFormat::Csv)).unwrap();
        assert_eq!(to_csv.jobs[1].output, at("o/walk.csv"));
        // A whole name may be taken too, and folders have no endings.
        fs::create_dir_all(at("f/walk"))?;
        fs::create_dir_all(at("f/2024.05.01"))?;
        let frame = format!(
            r#"{{"people":[{{"pose_keypoints_3d":[{}0]}}]}}"#,
            "0,".repeat(99)
        );
        for name in ["walk/a_0.json", "2024.05.01/a_0.json", "walk.json"] {
            fs::write(at(&format!("f/{name}")), &frame)?;
        }
        for name in ["walk.csv", "walk.json.csv"] {
            fs::write(at(&format!("f/{name}")), "x")?;
        }
        let want = [
            ("2024.05.01", "2024.05.01.csv"),
            ("walk", "walk.csv.csv"),
            ("walk.csv", "walk.csv"),
            ("walk.json", "walk.json.csv.csv"),
            ("walk.json.csv", "walk.json.csv"),
        ];
        let want =
            want.map(|(input, output)| (at(&format!("f/{input}")), at(&format!("o/{output}"))));
        let mut found = outputs(&[at("f")]);
        found.sort();
        assert_eq!(found, want);
        // Skeletons are called after results, whole names where they would not differ.
        let named = |inputs: &[PathBuf]| {
            let jobs = super::jobs(inputs, &at("o/"), None)?.jobs;
            Ok::<Vec<PathBuf>, Error>(jobs.into_iter().map(|job| job.named).collect())
        };
        let files = [
            "b.C3D",
            "c.csv",
            "c.trc.gz",
            "d.bvh",
            "e.c3d",
            "e.trc",
            "e.c3d.csv",
        ];
        let files = files.map(|name| at(&format!("in/{name}")));
        let want = [
            "b",
            "c.csv",
            "c.trc.gz",
            "d.bvh",
            "e.c3d",
            "e.trc",
            "e.c3d.csv",
        ];
        let want = want.map(|name| at(&format!("o/{name}")));
        assert_eq!(named(&files).unwrap(), want);
        Ok(())
    }
}
