//! The launcher: `posing NAME` runs the command NAME.

use clap::builder::PossibleValuesParser;
use clap::{CommandFactory, Parser, Subcommand};
use posing::cli::commands::{self, COMMANDS};
use posing::cli::completions::{self, Shell};
use posing::cli::launcher::{binary, open_page, outline, output_of};
use posing::cli::{closed_stdout, manual, messages, run, streams};
use posing::{Error, Result};
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

/// Clean, complete, compare and pose human motion
#[derive(Parser)]
#[command(
    name = "posing",
    version,
    about,
    disable_help_subcommand = true,
    subcommands = commands::subcommands(),
    after_help = "Examples:\n  posing                    list the commands\n  posing help complete      open the page of a command\n  posing completions bash   print completions for all commands"
)]
struct Args {
    #[command(subcommand)]
    request: Option<Request>,
}

#[derive(Subcommand)]
enum Request {
    /// Open the manual page of a command
    #[command(display_order = 900)]
    Help {
        /// The command (default: posing itself)
        #[arg(value_name = "COMMAND", value_parser = names())]
        command: Option<String>,
    },
    /// Print the manual page of a command as roff
    #[command(display_order = 900)]
    Man {
        /// The command
        #[arg(value_name = "COMMAND", value_parser = names())]
        command: String,
    },
    /// Print a completion script
    #[command(display_order = 900)]
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

/// The commands that have a page.
fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(COMMANDS.iter().map(|c| c.name).chain(["posing"]))
}

fn main() -> ExitCode {
    // A listed command gets its arguments untouched.
    let mut words = std::env::args_os().skip(1);
    if let Some(first) = words.next()
        && let Some(entry) = COMMANDS.iter().find(|entry| *entry.name == *first)
    {
        messages::set_name("posing");
        closed_stdout::pass_on();
        let error = match binary(entry.name) {
            Ok(path) => Error::io(&path, Command::new(&path).args(words).exec()),
            Err(error) => error,
        };
        messages::error(&error.to_string());
        return ExitCode::from(1);
    }
    run(|args: Args| work(args))
}

fn work(args: Args) -> Result<()> {
    let text = match args.request {
        None | Some(Request::Help { command: None }) => {
            Args::command().render_help().to_string().into_bytes()
        }
        Some(Request::Help {
            command: Some(name),
        }) => {
            open_page(&name)?;
            return Ok(());
        }
        Some(Request::Man { command }) => output_of(&command, manual::MAN)?,
        Some(Request::Completions { shell, command }) => {
            let outline = match command {
                Some(name) => outline(&name)?,
                None => {
                    let all: Result<Vec<_>> = COMMANDS.iter().map(|c| outline(c.name)).collect();
                    completions::launcher(outline("posing")?, all?)
                }
            };
            completions::script(&outline, shell).into_bytes()
        }
        Some(Request::List { linked }) => {
            let names = COMMANDS.iter().filter(|entry| entry.linked || !linked);
            names
                .map(|entry| format!("{}\n", entry.name))
                .collect::<String>()
                .into_bytes()
        }
    };
    streams::write_bytes(None, &text, false)
}
