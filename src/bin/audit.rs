//! Says what is wrong in takes, and changes nothing.

use clap::Parser;
use posing::audit::audit;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::audit::{FileAudit, LimitArgs};
use posing::cli::input::{check_single_stdin, or_stdin, read_table};
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, run};
use posing::{Error, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Find what is wrong in takes: rate, unit, gaps, swaps, jumps
///
/// Reads takes and reports, take by take: rate, size, what is missing by point and how long, and what is not as it should be.
/// A rate or a unit by which people would move faster or be larger than they are; a body that lies; zeros that mean missing;
/// points that change places, jump off their path, hold their last value, or have fallen off; distances that drift. Nothing is
/// changed. Exit code 3 if anything was found, or a file could not be read; the others are read all the same.
#[derive(Parser)]
#[command(
    name = "audit",
    version,
    after_help = "Examples:\n  posing audit walk.csv || echo look at it\n  posing audit --json -o audit.json a.csv b.csv || echo see audit.json\n  posing c3d2xyz gait.c3d | posing audit --max-gap 0.2 || echo look at it"
)]
struct Args {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    limits: LimitArgs,
    /// Write JSON: a list of files, each with its takes
    #[arg(long, help_heading = "Output")]
    json: bool,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    check_single_stdin(&args.input.files)?;
    let files = or_stdin(&args.input.files);
    let audits = files.iter().map(|path| audit_file(args, path));
    let audits = audits.collect::<Result<Vec<FileAudit>>>()?;
    let text = if args.json {
        let json = serde_json::to_string_pretty(&audits);
        json.map_err(|e| Error::usage(e.to_string()))? + "\n"
    } else {
        audits.iter().map(FileAudit::text).collect()
    };
    write_bytes(args.output.as_deref(), text.as_bytes(), false)?;
    Ok(match audits.iter().any(FileAudit::has_findings) {
        true => Outcome::Findings,
        false => Outcome::Done,
    })
}

/// The audit of a file; one that cannot be read stops no other.
fn audit_file(args: &Args, path: &Path) -> Result<FileAudit> {
    let input = args.input.with_files(vec![path.to_path_buf()]);
    let takes = read_table(&input, false, false).and_then(|table| {
        let rate = input.rate(&table.poses)?;
        Ok(audit(&table.poses, rate, &args.limits.limits()))
    });
    let file = match path == Path::new("-") {
        true => "standard input".to_string(),
        false => path.display().to_string(),
    };
    match takes {
        Ok(takes) => Ok(FileAudit {
            file,
            error: None,
            takes,
        }),
        Err(wrong @ Error::Usage(_)) => Err(wrong),
        Err(e) => Ok(FileAudit {
            file,
            error: Some(e.to_string()),
            takes: Vec::new(),
        }),
    }
}
