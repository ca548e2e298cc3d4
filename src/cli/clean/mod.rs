//! `clean` around the library: files and folders of any format in, the same out, a record beside each.

mod findings;
mod one_file;
mod record;
mod replaced;
mod report;
mod sources;

pub use one_file::{CleanSettings, Fate};
pub use sources::OutputFormat;

use self::report::CleanReport;
use self::sources::Job;
use super::Outcome;
use super::messages;
use super::progress::Progress;
use crate::Result;
use crate::io::output::write_file;
use std::path::PathBuf;
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
    /// The page of all; `None`: in the folder of the results, if it is one.
    pub page: Option<PathBuf>,
}

/// Cleans files, and those of folders, and writes a table of what became of them to standard output.
///
/// # Errors
/// [`crate::Error::Usage`] and [`crate::Error::Io`] of what is asked for altogether; of one file alone, its own error. One of several
/// that cannot be cleaned stops no other: it is a finding.
pub fn clean(
    inputs: &[PathBuf],
    output: &CleanOutput,
    settings: &CleanSettings,
) -> Result<Outcome> {
    let jobs = sources::jobs(inputs, &output.path, output.to)?;
    let page = output.page.clone();
    let page = page.or_else(|| Some(jobs.folder.as_ref()?.join(PAGE)));
    if let Some(page) = &page {
        jobs.check_page(page, report::is_page(page))?;
    }
    let mut fates = clean_all(&jobs.jobs, jobs.to, settings);
    if jobs.folder.is_none() && matches!(fates[..], [Fate::Failed { .. }]) {
        let error = fates.pop().and_then(Fate::into_error);
        return error.map_or(Ok(Outcome::Done), Err);
    }
    let mut names: Vec<String> = jobs.jobs.iter().map(|job| job.name.clone()).collect();
    for (name, error) in jobs.unreadable {
        names.push(name);
        fates.push(Fate::Failed {
            error,
            old_result: false,
        });
    }
    let report = CleanReport::new(names, &fates, jobs.left_out);
    report.tell_failures();
    if let ([Fate::Cleaned(summary)], None) = (&fates[..], &jobs.folder) {
        summary.notes.iter().for_each(|note| messages::info(note));
    }
    if let Some(page) = page {
        record::make_folder_of(&page)?;
        write_file(&page, report.html().as_bytes())?;
    }
    super::streams::write_bytes(None, report.text().as_bytes(), false)?;
    Ok(match report.has_findings() {
        true => Outcome::Findings,
        false => Outcome::Done,
    })
}

/// What became of each file. Threads of their own take a file each: the pool's are for the work within a file, which waits for them.
fn clean_all(jobs: &[Job], to: Option<OutputFormat>, settings: &CleanSettings) -> Vec<Fate> {
    let bar = Progress::new("cleaning", jobs.len() as u64);
    let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let fates: Vec<Mutex<Option<Fate>>> = jobs.iter().map(|_| Mutex::new(None)).collect();
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
