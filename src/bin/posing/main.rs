//! The program: it runs the command that it was called as (`complete`, by a link), or that its
//! first word names (`posing complete`).

mod align;
mod amc2xyz;
mod audit;
mod between;
mod body_animate;
mod body_fit;
mod body_scan;
mod body_synth;
mod body_train;
mod bvh2xyz;
mod c3d2forces;
mod c3d2xyz;
mod clean;
mod cluster;
mod commands;
mod complete;
mod corrupt;
mod csv2xyz;
mod decode;
mod demo;
mod denoise;
mod dict_concat;
mod edit;
mod encode;
mod evaluate;
#[cfg(feature = "fbx")]
mod fbx2bvh;
#[cfg(feature = "fbx")]
mod fbx2xyz;
mod gait;
mod gpd;
mod ground;
mod ksvd_train;
mod label;
mod mesh_register;
mod mirror;
mod model;
mod pair_label;
mod plot;
mod pose_distance;
mod prior_train;
mod rdsr_train;
mod retarget;
mod retrieve;
mod rotations_train;
mod score;
mod solve;
mod transition;
mod trc2xyz;
mod trim;
mod xyz2amc;
mod xyz2bvh;
mod xyz2c3d;
mod xyz2glb;
mod xyz2trc;

use clap::builder::PossibleValuesParser;
use clap::{Command, CommandFactory, Parser, Subcommand};
use commands::{Entry, GROUPS, all, find, version};
use posing::cli::completions::{self, Shell};
use posing::cli::manual::{self, Group};
use posing::cli::usage_json::ProgramUsage;
use posing::cli::{run, streams};
use posing::io::output::TemporaryFile;
use posing::{Error, Result};
use std::ffi::{OsStr, OsString};
use std::fmt::Write;
use std::path::Path;
use std::process::ExitCode;

/// That of musl is slow with threads.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Clean, complete, compare and pose human motion
#[derive(Parser)]
#[command(
    name = "posing",
    version,
    disable_help_subcommand = true,
    // Known to be like what is mistyped; they run before these flags are parsed.
    subcommands = all().map(|entry| Command::new(entry.name).hide(true)),
    help_template = overview(),
    after_help = "Examples:\
        \n  posing                    list the commands\
        \n  posing help complete      open the page of a command\
        \n  posing completions bash   print completions for all commands"
)]
struct Args {
    /// Print all commands with their arguments, types, defaults and help as JSON
    #[arg(long)]
    json_usage: bool,
    #[command(subcommand)]
    request: Option<Request>,
}

#[derive(Subcommand)]
enum Request {
    /// Open the manual page of a command
    Help {
        /// The command (default: posing itself)
        #[arg(value_name = "COMMAND", value_parser = names())]
        command: Option<String>,
    },
    /// Print the manual page of a command as roff
    Man {
        /// The command
        #[arg(value_name = "COMMAND", value_parser = names())]
        command: String,
    },
    /// Print a completion script
    Completions {
        /// The shell
        #[arg(value_name = "SHELL", value_enum)]
        shell: Shell,
        /// Complete this command under its own name (default: posing and its commands)
        #[arg(value_name = "COMMAND", value_parser = names())]
        command: Option<String>,
    },
    /// Print the names of the commands
    #[command(hide = true)]
    List {
        /// Only those that are installed under their own names
        #[arg(long)]
        linked: bool,
    },
}

fn main() -> ExitCode {
    #[cfg(feature = "papers")]
    posing::prior::published::register();
    let mut words: Vec<OsString> = std::env::args_os().collect();
    let called = words.first().and_then(|word| Path::new(word).file_name());
    if let Some(entry) = called.and_then(OsStr::to_str).and_then(find) {
        return (entry.run)((entry.command)(), words);
    }
    if let Some(entry) = words.get(1).and_then(|w| w.to_str()).and_then(find) {
        words.remove(0);
        return (entry.run)((entry.command)(), words);
    }
    run(Args::command(), words, version(), work)
}

fn work(args: &Args) -> Result<()> {
    if args.json_usage {
        return streams::write_bytes(None, usage()?.as_bytes(), false);
    }
    let text = match &args.request {
        None | Some(Request::Help { command: None }) => help("posing"),
        Some(Request::Help {
            command: Some(name),
        }) => return open_page(name),
        Some(Request::Man { command }) => page(command),
        Some(Request::Completions { shell, command }) => {
            let command = command.as_deref().map_or_else(whole, parser);
            completions::script(&command, *shell).into_bytes()
        }
        Some(Request::List { linked }) => {
            let names = all().filter(|entry| entry.linked || !linked);
            let lines = names.map(|entry| format!("{}\n", entry.name));
            lines.collect::<String>().into_bytes()
        }
    };
    streams::write_bytes(None, &text, false)
}

/// The words that name a page: those of the commands, and `posing`.
fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(all().map(|c| c.name).chain(["posing"]))
}

/// The parser of a command; of a name that is none, that of `posing` itself.
fn parser(name: &str) -> Command {
    find(name).map_or_else(Args::command, |entry| (entry.command)())
}

/// The parser of `posing` with those of all commands below it.
fn whole() -> Command {
    all().fold(Args::command(), |whole, entry| {
        whole.mut_subcommand(entry.name, |_| (entry.command)())
    })
}

/// The commands with their arguments, as JSON.
fn usage() -> Result<String> {
    let commands = GROUPS.iter().flat_map(|(title, entries)| {
        let command = move |entry: &Entry| (*title, (entry.command)());
        entries.iter().map(command)
    });
    let text = serde_json::to_string_pretty(&ProgramUsage::new(commands));
    Ok(text.map_err(|e| Error::usage(e.to_string()))? + "\n")
}

/// The help that `posing` prints: the commands in groups.
fn overview() -> String {
    let mut text = "{about-with-newline}\n{usage-heading} {usage}\n".to_string();
    for (title, entries) in GROUPS {
        let _ = writeln!(text, "\n{title}:");
        for entry in *entries {
            let about = (entry.command)().get_about().map(ToString::to_string);
            let about = about.unwrap_or_default();
            let _ = writeln!(text, "  {:<14} {about}", entry.name);
        }
    }
    text + "\nPages and shells:\n{subcommands}\n\nOptions:\n{options}\n\n{after-help}"
}

/// The manual page of a command, or of `posing`.
fn page(name: &str) -> Vec<u8> {
    let group = |(title, entries): &(&'static str, &[Entry])| Group {
        title,
        commands: entries.iter().map(|entry| (entry.command)()).collect(),
    };
    match name {
        "posing" => manual::page(
            Args::command(),
            &GROUPS.iter().map(group).collect::<Vec<_>>(),
        ),
        _ => manual::page(parser(name), &[]),
    }
}

/// The long help of a command.
fn help(name: &str) -> Vec<u8> {
    let mut command = manual::typed(parser(name));
    let help = match name {
        "posing" => command.render_help(),
        _ => command.render_long_help(),
    };
    help.to_string().into_bytes()
}

/// Opens a page in man where man is there, else prints the long help.
fn open_page(name: &str) -> Result<()> {
    let file = TemporaryFile::new(".1", &page(name)).map_err(|e| Error::io(name, e))?;
    let man = std::process::Command::new("man")
        .arg("-l")
        .arg(file.path())
        .status();
    match man {
        Ok(status) if status.success() => Ok(()),
        _ => streams::write_bytes(None, &help(name), false),
    }
}
