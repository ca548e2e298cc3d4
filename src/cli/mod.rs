//! What every command shares: the wrapper around `main`, flags, streams, progress, pages of the manual.

pub mod aligned_tables;
pub mod args;
pub mod arrays;
mod behind;
pub mod benchmark;
pub mod commands;
pub mod ik;
pub mod input;
pub mod manual;
pub mod messages;
pub mod plot;
pub mod printing;
pub mod progress;
pub mod restoring;
mod signals;
pub mod streams;
mod summary;
pub mod training;

use crate::Result;
use clap::{CommandFactory, FromArgMatches};
use std::io::Write;
use std::process::ExitCode;

/// How a command that did not fail ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything is done (exit 0).
    Done,
    /// Done, with findings the caller should know of (exit 3).
    Findings,
}

/// Parses the arguments, runs `work` and turns what came of it into an exit code: 0 done (a closed standard output
/// included), 1 bad data, 2 wrong usage, 3 finished with findings.
pub fn run<A: CommandFactory + FromArgMatches>(
    work: impl FnOnce(A) -> Result<Outcome>,
) -> ExitCode {
    let command = A::command();
    let name = command.get_name().to_string();
    messages::set_name(&name);
    if let Some(code) = manual::on_request(&command) {
        return code;
    }
    let args = match command
        .try_get_matches()
        .and_then(|m| A::from_arg_matches(&m))
    {
        Ok(args) => args,
        Err(e) => return parse_failure(&name, &e),
    };
    match work(args) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Findings) => ExitCode::from(3),
        Err(e) if e.is_closed_pipe() => ExitCode::SUCCESS,
        Err(e) => {
            messages::error(&e.to_string());
            ExitCode::from(e.exit_code())
        }
    }
}

/// Help and version go to standard output; everything else is one line on standard error.
fn parse_failure(name: &str, error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        let text = error.render().to_string();
        return match std::io::stdout().write_all(text.as_bytes()) {
            Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => ExitCode::from(1),
            _ => ExitCode::SUCCESS,
        };
    }
    let text = error.render().to_string();
    // clap's message runs over several lines: what is wrong, hints, the usage. One line carries the first two, but for the hint
    // to take a flag for a file's name.
    let is_said = |l: &&str| {
        let beside = ["For more information", "tip: to pass"];
        !l.is_empty() && !beside.iter().any(|b| l.starts_with(b))
    };
    let told: Vec<&str> = text
        .lines()
        .map(str::trim)
        .take_while(|l| !l.starts_with("Usage:"))
        .filter(is_said)
        .collect();
    let told = told.join(" ").replace(" tip: ", "; ");
    let told = told.strip_prefix("error: ").unwrap_or(&told);
    messages::error(&format!("{told}; see {name} --help"));
    ExitCode::from(2)
}
