//! Says what is wrong in takes, and changes nothing.

use clap::Parser;
use posing::Result;
use posing::audit::{FileAudit, FileAuditor, TakePages, files_to_audit, page};
use posing::cli::input::{check_single_stdin, open, or_stdin};
use posing::cli::json_report::JsonArgs;
use posing::cli::label_args::LikeArgs;
use posing::cli::limit_args::LimitArgs;
use posing::cli::paths::{OutputPath, check_read};
use posing::cli::read_args::ReadArgs;
use posing::cli::{Outcome, messages};
use posing::io::motion_file::LARGEST_MOTION_FILE;
use posing::label::LabelSettings;
use std::path::PathBuf;

/// Find what is wrong in takes: rate, unit, gaps, swaps, jumps
///
/// Reads takes of any format (C3D, TRC, Motive CSV, Qualisys TSV, BVH, AMC, pose tables, keypoints
/// as JSON) and
/// reports, take by take: rate, size, what is missing by point and how long, and what is not as it
/// should be. A rate or a unit by which people would move faster or be larger than they are; a body
/// that lies; zeros that mean missing; points that jump off their path, hold their last value,
/// stand far off, or have fallen off; distances that drift; angles that flip; what label would put
/// right. Labels that are exchanged in every frame show beside labeled takes (--like), and mostly
/// by how the sides of the body differ. Nothing is changed. A folder is searched for such files. A
/// page gets pages of the takes beside it, in a folder of its name with _takes, which play what was
/// found. Exit code 3 if anything was found; 1 if a file could not be read, the others are read all
/// the same.
#[derive(Parser)]
#[command(
    name = "audit",
    version,
    after_help = "Examples:\
        \n  posing audit walk.csv || echo look at it\
        \n  posing audit -o audit.html walk.bvh gait.c3d || echo see audit.html\
        \n  posing audit -o audit.html captures/ || echo see audit.html\
        \n  posing audit --like old.c3d --same-person gait.c3d || echo look at it\
        \n  posing audit --json -o audit.json a.csv b.csv || echo see audit.json\
        \n  posing c3d2xyz gait.c3d | posing audit --max-gap 0.2 || echo look at it"
)]
pub struct Args {
    /// Files of motion, of any format, and folders that are searched for them; - or nothing:
    /// standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    like: LikeArgs,
    #[command(flatten)]
    limits: LimitArgs,
    /// Write to FILE instead of standard output, as a page where it ends in .html; FILE appears
    /// only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
}

pub fn work(args: &Args) -> Result<Outcome> {
    let has_json = args.json.prepare_report();
    check_single_stdin(&args.files)?;
    let (files, unreadable) = files_to_audit(&or_stdin(&args.files));
    check_read(&files)?;
    let page_path = (args.output.as_deref()).filter(|path| {
        !has_json
            && path
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("html"))
    });
    let read = args.read.rules()?;
    let auditor = FileAuditor {
        labels: LabelSettings {
            like: args.like.templates(&read)?,
            option_names: messages::option_names(),
            ..LabelSettings::default()
        },
        read,
        limits: args.limits.limits(),
        pages: page_path.map(TakePages::beside),
        named: or_stdin(&args.files),
    };
    let one = |(i, path): (usize, &PathBuf)| {
        let bytes = open(path).and_then(|input| input.read_all(LARGEST_MOTION_FILE));
        let audit = auditor.audit(path, bytes, i + 1)?;
        let said = |note: &String| messages::info(&format!("{}: {note}", audit.file));
        audit.notes.iter().for_each(said);
        Ok(audit)
    };
    let audits = files.iter().enumerate().map(one);
    let mut audits = audits.collect::<Result<Vec<FileAudit>>>()?;
    audits.extend(unreadable);
    if args.like.like.is_empty() && audits.iter().any(|audit| audit.has_markers) {
        messages::info(
            "labels that are wrong in every frame: only how the sides of the body differ was \
             looked at; give labeled takes with --like",
        );
    }
    let failed = audits.iter().filter_map(|audit| audit.error.as_ref());
    failed.for_each(|error| messages::error(error));
    let text = || {
        if page_path.is_some() {
            page(&audits)
        } else {
            audits.iter().map(FileAudit::text).collect()
        }
    };
    let output = args.output.as_deref();
    args.json.write_value(output, text, &audits)?;
    Ok(if audits.iter().any(|audit| audit.error.is_some()) {
        Outcome::Failed
    } else {
        Outcome::of(audits.iter().any(FileAudit::has_findings))
    })
}
