//! Whole takes of any format, cleaned: files and folders in, the same out, a record beside each.

mod body_motion;
mod earlier_list;
mod earlier_result;
mod finding_groups;
mod findings;
mod held;
mod joint_skeleton;
mod label_file;
mod labeled_beside;
mod labels;
mod list;
mod name_source;
mod named_by;
mod naming;
mod notes;
mod opened;
mod outcome;
mod page;
mod people;
mod person;
mod places;
mod prepared;
mod record;
mod recorded;
mod redo;
mod replaced;
mod report;
mod report_page;
mod restored;
mod rotations;
mod row;
mod settings;
mod skeleton;
mod solved;
mod sources;
mod summary;
mod written;

pub use label_file::write_labeled;
pub use name_source::NamingSettings;
pub use outcome::FileOutcome;
pub use person::TakePerson;
pub use places::PlaceToSee;
pub use record::Summary;
pub use report::CleanReport;
pub use row::Row;
pub use settings::CleanSettings;
pub use skeleton::SkeletonSettings;
pub use sources::OutputFormat;

use self::earlier_list::EarlierList;
use self::labeled_beside::LabeledBeside;
use self::list::list_path;
use self::record::record_path;
use self::sources::Job;
use crate::draw::take_page::page_beside;
use crate::io::command_files::CommandFiles;
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The page that a folder of results gets.
const PAGE: &str = "clean.html";

/// Where results go.
#[derive(Debug)]
pub struct CleanOutput {
    /// The result of one file, else the folder of the results.
    pub path: PathBuf,
    /// The format of the results; `None`: that of each file, or by the name of the one result.
    pub to: Option<OutputFormat>,
    /// The page of all; `None`: in the folder of the results, if it is one. A list for programs
    /// stands beside it.
    pub page: Option<PathBuf>,
    /// Whether only what the last run did not report counts.
    pub only_new: bool,
    /// Other files that are read, and that somebody else writes: no result replaces them.
    pub files: CommandFiles,
}

/// The files that stand beside a result of [`clean`] and [`write_labeled`]: its record, its page.
///
/// ```
/// use std::path::Path;
///
/// let [record, page] = posing_clean::clean::files_beside(Path::new("clean/walk.c3d"));
/// assert_eq!(record, Path::new("clean/walk.c3d.json"));
/// assert_eq!(page, Path::new("clean/walk.c3d.html"));
/// ```
pub fn files_beside(result: &Path) -> [PathBuf; 2] {
    [record_path(result), page_beside(result)]
}

/// Cleans files, and those of folders; `progress` hears how many are done, and of how many.
///
/// # Errors
/// [`Error::Usage`] and [`Error::Io`] of what is asked for altogether; of one file alone, its own
/// error. One of several that cannot be cleaned stops no other: the report says so.
pub fn clean(
    inputs: &[PathBuf],
    output: &CleanOutput,
    settings: &CleanSettings,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<CleanReport> {
    let jobs = sources::jobs(inputs, &output.path, output.to)?;
    let keeps_labels = settings.labels.as_ref().is_some_and(|l| !l.keep.is_empty());
    for (option, is_given) in [
        ("redo", !settings.redo.is_empty()),
        ("keep_labels", keeps_labels),
    ] {
        if jobs.jobs.len() != 1 && is_given {
            return Err(Error::usage(format!(
                "the option `{option}` is for a stretch of one take; give that file alone"
            )));
        }
    }
    if output.only_new && jobs.folder.is_none() && output.page.is_none() {
        let what = "the option `new_only` compares with the list of the last run, which a folder \
                    of results has; one file has it with the option `page`";
        return Err(Error::usage(what));
    }
    let page = output.page.clone();
    let page = page.or_else(|| Some(jobs.folder.as_ref()?.join(PAGE)));
    let mut files = output.files.clone();
    jobs.check(&mut files, settings.skeletons.as_ref())?;
    let mut last = EarlierList::default();
    if let Some(page) = &page {
        if page
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("json"))
        {
            let what = "the option `page` is for a page, beside which the list gets the name with \
                        .json; give another name, such as clean.html";
            return Err(Error::usage(what));
        }
        if output.page.is_none() {
            files.write(page.display().to_string(), page)?;
        }
        let list = list_path(page);
        files.write(format!("the list {}", list.display()), &list)?;
        jobs.check_page(page, report::is_page(page))?;
        last = EarlierList::read(&list)?;
        jobs.check_page(&list, true)?;
    }
    let mut cleaned = clean_all(&jobs.jobs, settings, progress);
    let is_one = jobs.folder.is_none();
    if is_one
        && matches!(cleaned[..], [(FileOutcome::Failed { .. }, _)])
        && let Some(error) = cleaned.pop().and_then(|(outcome, _)| outcome.into_error())
    {
        return Err(error);
    }
    let files = jobs.jobs.iter().zip(cleaned);
    let files = files.map(|(job, outcome)| Row::new(job.name.clone(), outcome, Some(job), &last));
    let unreadable = jobs.unreadable.into_iter().map(|(name, error)| {
        let old_result = false;
        let outcome = FileOutcome::Failed { error, old_result };
        Row::new(name, (outcome, None), None, &last)
    });
    Ok(CleanReport {
        rows: files.chain(unreadable).collect(),
        left_out: jobs.left_out,
        only_new: output.only_new,
        page,
        is_one,
    })
}

/// What became of a file, with the digest of the capture where it was read.
type CleanedFile = (FileOutcome, Option<String>);

/// What became of each file. Threads of their own take a file each: the pool's are for the work
/// within a file, which waits for them.
fn clean_all(
    jobs: &[Job],
    settings: &CleanSettings,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Vec<CleanedFile> {
    let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let beside = LabeledBeside::default();
    let fates: Vec<Mutex<Option<CleanedFile>>> = jobs.iter().map(|_| Mutex::new(None)).collect();
    let work = || {
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let (Some(job), Some(fate)) = (jobs.get(at), fates.get(at)) else {
                break;
            };
            let outcome = FileOutcome::of(settings, job, &beside);
            *fate.lock().unwrap_or_else(|e| e.into_inner()) = Some(outcome);
            progress(1 + finished.fetch_add(1, Ordering::Relaxed), jobs.len());
        }
    };
    std::thread::scope(|scope| {
        let threads = rayon::current_num_threads().min(jobs.len());
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
    let fates = fates.into_iter();
    fates
        .filter_map(|outcome| outcome.into_inner().unwrap_or_else(|e| e.into_inner()))
        .collect()
}
