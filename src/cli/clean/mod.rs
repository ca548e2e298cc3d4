//! `clean` around the library: files and folders of any format in, the same out, a record beside each.

mod earlier_list;
mod findings;
mod list;
mod one_file;
mod page;
mod places;
mod record;
mod redo;
mod replaced;
mod report;
mod row;
mod sources;

pub use one_file::{CleanSettings, FileOutcome};
pub use redo::Stretch;
pub use sources::OutputFormat;

use self::earlier_list::EarlierList;
use self::list::{list, list_path};
use self::report::CleanReport;
use self::row::Row;
use self::sources::Job;
use super::Outcome;
use super::messages;
use super::progress::Progress;
use crate::io::output::write_file;
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
    /// The page of all; `None`: in the folder of the results, if it is one. A list for programs stands beside it.
    pub page: Option<PathBuf>,
    /// Whether only that is told which the last run did not tell.
    pub only_new: bool,
}

/// Cleans files, and those of folders, and writes a table of what became of them to standard output.
///
/// # Errors
/// [`crate::Error::Usage`] and [`crate::Error::Io`] of what is asked for altogether; of one file alone, its own error. One of several
/// that cannot be cleaned stops no other: the outcome says so.
pub fn clean(
    inputs: &[PathBuf],
    output: &CleanOutput,
    settings: &CleanSettings,
) -> Result<Outcome> {
    let jobs = sources::jobs(inputs, &output.path, output.to)?;
    if jobs.jobs.len() != 1 && !settings.redo.is_empty() {
        let what = "--redo is for a stretch of one take; give that file alone";
        return Err(Error::usage(what));
    }
    if output.only_new && jobs.folder.is_none() && output.page.is_none() {
        let what = "--new-only compares with the list of the last run, which a folder of results has; one file has it with --page";
        return Err(Error::usage(what));
    }
    let page = output.page.clone();
    let page = page.or_else(|| Some(jobs.folder.as_ref()?.join(PAGE)));
    let mut last = EarlierList::default();
    if let Some(page) = &page {
        if page
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("json"))
        {
            let what = "--page: is a page, beside which the list gets the name with .json; give another name, such as clean.html";
            return Err(Error::usage(what));
        }
        jobs.check_page(page, report::is_page(page))?;
        last = EarlierList::read(&list_path(page))?;
        jobs.check_page(&list_path(page), true)?;
    }
    let mut fates = clean_all(&jobs.jobs, jobs.to, settings);
    if jobs.folder.is_none() && matches!(fates[..], [(FileOutcome::Failed { .. }, _)]) {
        let error = fates.pop().and_then(|(fate, _)| fate.into_error());
        return error.map_or(Ok(Outcome::Done), Err);
    }
    let mut names: Vec<String> = jobs.jobs.iter().map(|job| job.name.clone()).collect();
    for (name, error) in jobs.unreadable {
        names.push(name);
        let fate = FileOutcome::Failed {
            error,
            old_result: false,
        };
        fates.push((fate, None));
    }
    let made = jobs.jobs.iter().map(Some).chain(std::iter::repeat(None));
    let rows = names.into_iter().zip(&fates).zip(made);
    let rows = rows.map(|((name, fate), job)| Row::new(name, fate, job, &last));
    let report = CleanReport::new(rows.collect(), jobs.left_out, output.only_new);
    tell(&report, jobs.folder.is_none(), page.as_deref())?;
    Ok(match (report.has_failures(), report.has_findings()) {
        (true, _) => Outcome::Failed,
        (_, true) => Outcome::Findings,
        _ => Outcome::Done,
    })
}

/// Writes the page, the table and the list. What the list has counts as told, so it comes last; where nobody reads the table any more,
/// nothing new counts as told.
fn tell(report: &CleanReport<'_>, is_alone: bool, page: Option<&Path>) -> Result<()> {
    report.tell_failures();
    if let (true, [row]) = (is_alone, &report.rows[..])
        && let FileOutcome::Cleaned(summary) = row.fate
    {
        summary.notes.iter().for_each(|note| messages::info(note));
    }
    let folder = page.and_then(Path::parent).unwrap_or(Path::new(""));
    if let Some(page) = page {
        record::make_folder_of(page)?;
        write_file(page, report.html(folder).as_bytes())?;
    }
    let told = super::streams::write_bytes(None, report.text().as_bytes(), false);
    let is_closed = told.as_ref().is_err_and(Error::is_closed_pipe);
    if let Some(page) = page
        && (told.is_ok() || is_closed && !report.only_new)
    {
        write_file(list_path(page), list(&report.rows, folder)?.as_bytes())?;
    }
    // The outcome says whether files failed, also where nobody reads the table.
    if is_closed { Ok(()) } else { told }
}

/// What became of a file, with the digest of the capture where it was read.
type CleanedFile = (FileOutcome, Option<String>);

/// What became of each file. Threads of their own take a file each: the pool's are for the work within a file, which waits for them.
fn clean_all(jobs: &[Job], to: Option<OutputFormat>, settings: &CleanSettings) -> Vec<CleanedFile> {
    let bar = Progress::new("cleaning", jobs.len() as u64);
    let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let fates: Vec<Mutex<Option<CleanedFile>>> = jobs.iter().map(|_| Mutex::new(None)).collect();
    let work = || {
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let (Some(job), Some(place)) = (jobs.get(at), fates.get(at)) else {
                break;
            };
            let fate = settings.clean(job, to);
            *place.lock().unwrap_or_else(|e| e.into_inner()) = Some(fate);
            bar.set(1 + finished.fetch_add(1, Ordering::Relaxed) as u64);
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
        .filter_map(|fate| fate.into_inner().unwrap_or_else(|e| e.into_inner()))
        .collect()
}
