//! The parts that commands share: the wrapper around `main`, flags, input and output, progress,
//! manual pages.

pub mod args;
pub mod batch;
pub mod body;
pub mod body_output;
pub mod browser;
pub mod choice;
pub(crate) mod closed_stdout;
pub mod completions;
pub(crate) mod csv_file;
pub mod endings;
#[cfg(feature = "fbx")]
pub mod fbx_args;
pub mod fbx_choice;
pub mod feature_table;
pub mod ik;
pub mod input;
pub mod json_report;
pub mod label_args;
pub mod limit_args;
pub mod manual;
pub mod marker_files;
pub mod marker_set;
mod memory_limit;
pub mod messages;
pub mod metric_takes;
pub mod motion_library;
pub mod name_maps;
pub mod number_table;
pub mod one_take_args;
pub mod pair_file;
pub mod paths;
pub mod progress;
pub mod read_args;
pub mod registration_points;
pub mod restoring;
pub mod signals;
pub mod streams;
mod summary;
pub mod take_classes;
pub mod toml_file;
pub mod training;
pub mod usage_json;

use crate::Result;
use crate::error::{OptionName, OptionNames};
use args::CommonArgs;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, Args, Command, CommandFactory, FromArgMatches};
use std::ffi::OsString;
use std::process::ExitCode;

/// What is said of what papers compare with, where it is left out.
pub const NO_PAPERS: &str = "is not in this build: it comes with the feature `papers`, which \
                             cargo install builds";

/// How a command ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Done: exit 0.
    Done,
    /// Done, with findings that somebody has to look at: exit 3.
    Findings,
    /// Done, but for some of the files, which failed: exit 1.
    Failed,
}

impl Outcome {
    /// The outcome of work that was done, with findings or without.
    pub fn of(has_findings: bool) -> Outcome {
        if has_findings {
            Outcome::Findings
        } else {
            Outcome::Done
        }
    }
}

impl From<()> for Outcome {
    fn from((): ()) -> Outcome {
        Outcome::Done
    }
}

/// The parser of a command, with the flags that all have. Subcommands that stand in place of its
/// arguments have them too.
pub fn command<A: CommandFactory>() -> Command {
    let command = CommonArgs::augment_args(A::command());
    if command.is_args_conflicts_with_subcommands_set() {
        command.mut_subcommands(CommonArgs::augment_args)
    } else {
        command
    }
}

/// Sets what the flags that all commands have say; the program itself has none.
fn apply_common(command: &Command, matches: &ArgMatches) -> Result<()> {
    let below = matches.subcommand().map(|(_, below)| below);
    let below = below.filter(|_| command.is_args_conflicts_with_subcommands_set());
    let own = below.unwrap_or(matches);
    match own
        .try_contains_id("threads")
        .map(|_| CommonArgs::from_arg_matches(own))
    {
        Ok(Ok(common)) => common.apply(),
        _ => Ok(()),
    }
}

/// Parses `words`, the command's name and its arguments, by `command`, runs `work` and returns the
/// exit code: 0 done (a reader that closes the pipe included), 1 bad data (also of some files of
/// several), 2 wrong usage, 3 done with findings. `version` is what `--version` says.
pub fn run<A: FromArgMatches, O: Into<Outcome>>(
    command: Command,
    words: Vec<OsString>,
    version: String,
    work: impl FnOnce(&A) -> Result<O>,
) -> ExitCode {
    let mut command = manual::typed(command).version(version);
    let typed = command.get_bin_name().unwrap_or(command.get_name());
    let typed = typed.to_string();
    messages::set_name(command.get_name());
    let is_joints = |arg: &clap::Arg| arg.get_long() == Some("joints");
    let has_joints = command.get_arguments().any(is_joints);
    messages::set_option_names(OptionNames::new(if has_joints {
        flag
    } else {
        flag_or_trim
    }));
    if let Err(e) = memory_limit::prepare() {
        return exit_code(Err::<Outcome, _>(e));
    }
    signals::watch();
    #[cfg(target_os = "linux")]
    signals::end_with_parent();
    let parsed = command
        .try_get_matches_from_mut(words)
        .and_then(|matches| Ok((A::from_arg_matches(&matches)?, matches)));
    match parsed {
        Ok((args, matches)) => exit_code(paths::check(&command, &matches).and_then(|()| {
            streams::together(|| {
                apply_common(&command, &matches)?;
                work(&args)
            })
        })),
        Err(e) => parse_failure(&typed, &e),
    }
}

/// The flag of an option of the library, with its value if it has one: `--max-gap 2` of `max_gap
/// 2`.
fn flag(option: OptionName<'_>) -> String {
    let value = option.value.unwrap_or_default();
    let flag = format!("--{} {value}", option.name.replace('_', "-"));
    flag.trim_end().to_string()
}

/// [`flag`] of a command that reads tables with names: trim gives an array names.
fn flag_or_trim(option: OptionName<'_>) -> String {
    if option.name == "joints" {
        format!("posing trim {}", flag(option))
    } else {
        flag(option)
    }
}

/// The exit code of a command that ended; an error is told.
fn exit_code(ended: Result<impl Into<Outcome>>) -> ExitCode {
    match ended.map(Into::into) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Findings) => ExitCode::from(3),
        Ok(Outcome::Failed) => ExitCode::from(1),
        Err(e) if e.is_closed_pipe() => ExitCode::SUCCESS,
        Err(e) => {
            messages::error(&e.to_string());
            ExitCode::from(e.exit_code())
        }
    }
}

/// Prints help and version on standard output, and a wrong usage as one line on standard error.
fn parse_failure(command: &str, error: &clap::Error) -> ExitCode {
    let text = error.render().to_string();
    if !error.use_stderr() {
        return exit_code(streams::write_bytes(None, text.as_bytes(), false));
    }
    if let Some(flag) = unknown_conversion(error) {
        let what = format!("has no {flag}; posing trim {flag} converts tables");
        messages::error(&format!("{what}; see {command} --help"));
        return ExitCode::from(2);
    }
    // clap writes several lines: the fault, hints, the usage. The hint to pass a flag as a file's
    // name misleads, and a value that is like the one given makes the list of all needless.
    let has_similar = error.get(ContextKind::SuggestedValue).is_some();
    let is_shown = |line: &&str| {
        let dropped = ["For more information", "tip: to pass"];
        let is_needless = has_similar && line.starts_with("[possible values:");
        !line.is_empty() && !is_needless && !dropped.iter().any(|start| line.starts_with(start))
    };
    let lines = text.lines().map(str::trim);
    let lines = lines.take_while(|line| !line.starts_with("Usage:"));
    let fault = lines.filter(is_shown).collect::<Vec<_>>().join(" ");
    let fault = fault.replace(" tip: ", "; ");
    let fault = fault.strip_prefix("error: ").unwrap_or(&fault);
    messages::error(&format!("{fault}; see {command} --help"));
    ExitCode::from(2)
}

/// A flag that converts tables, where the command has none such.
fn unknown_conversion(error: &clap::Error) -> Option<&'static str> {
    let converting = "--fps --joints --units --up --out-units --out-up";
    match error.get(ContextKind::InvalidArg)? {
        ContextValue::String(flag) if error.kind() == ErrorKind::UnknownArgument => {
            converting.split(' ').find(|known| known == flag)
        }
        _ => None,
    }
}
