//! The launcher: `posing NAME` runs the command NAME.

use clap::Parser;
use clap_complete::Shell;
use posing::cli::commands::COMMANDS;
use posing::cli::{Outcome, manual, run, streams};
use posing::{Error, Result};
use std::fmt::Write as _;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

/// Clean, complete, compare and pose human motion
#[derive(Parser)]
#[command(
    name = "posing",
    version,
    about,
    disable_help_subcommand = true,
    override_usage = "posing COMMAND [ARGUMENTS]...\n       posing help [COMMAND]\n       posing man COMMAND\n       posing completions SHELL",
    after_help = "Examples:\n  posing                    list the commands\n  posing help complete      open the page of a command\n  posing completions bash   print completions for all commands"
)]
struct Args {
    /// A command of posing, or help, man, completions
    #[arg(
        value_name = "COMMAND",
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    command: Vec<std::ffi::OsString>,
}

fn main() -> ExitCode {
    // A listed command is handed its arguments untouched: they are its own business.
    let mut words = std::env::args_os().skip(1);
    if let Some(first) = words.next()
        && let Some(listed) = COMMANDS.iter().find(|c| *c.name == *first)
        && let Ok(path) = find(listed.name)
    {
        let error = Command::new(&path).args(words).exec();
        posing::cli::messages::set_name("posing");
        posing::cli::messages::error(&format!("{}: {error}", path.display()));
        return ExitCode::from(1);
    }
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    let word = |i: usize| {
        args.command
            .get(i)
            .map(|w| w.to_string_lossy().into_owned())
    };
    match (word(0).as_deref(), word(1)) {
        (None, _) | (Some("help"), None) => list()?,
        (Some("help"), Some(name)) => help(&name)?,
        (Some("man"), Some(name)) => {
            streams::write_bytes(None, &page(&name, &[manual::MAN])?, false)?
        }
        (Some("completions"), Some(shell)) => completions(&shell)?,
        (Some("man"), None) => return Err(Error::usage("man wants a command's name")),
        (Some("completions"), None) => {
            return Err(Error::usage("completions wants bash, zsh or fish"));
        }
        (Some(other), _) => {
            find(other)?;
            let what = format!("posing {other} runs it, with nothing before its name");
            return Err(Error::usage(what));
        }
    }
    Ok(Outcome::Done)
}

fn list() -> Result<()> {
    let mut text = String::from("posing COMMAND [ARGUMENTS]...\n\n");
    for command in COMMANDS {
        let _ = writeln!(text, "  {:<12} {}", command.name, command.about);
    }
    text.push_str(
        "\nposing help COMMAND opens its manual page; posing COMMAND --help prints its flags and examples.\n",
    );
    streams::write_bytes(None, text.as_bytes(), false)
}

/// The command's binary: beside this one, or in libexec.
fn find(name: &str) -> Result<PathBuf> {
    if !COMMANDS.iter().any(|c| c.name == name) {
        return Err(Error::usage(format!(
            "no command \"{name}\"; posing alone lists them"
        )));
    }
    let here = std::env::current_exe().map_err(|e| Error::io("posing", e))?;
    // An installed launcher may be reached by a link.
    let here = here.canonicalize().unwrap_or(here);
    let folder = here.parent().map(PathBuf::from).unwrap_or_default();
    [
        folder.join(name),
        folder.join("../libexec/posing").join(name),
    ]
    .into_iter()
    .find(|p| p.is_file())
    .ok_or_else(|| {
        Error::io(
            folder.join(name),
            std::io::Error::from(std::io::ErrorKind::NotFound),
        )
    })
}

/// What a command prints when asked for a page.
fn page(name: &str, request: &[&str]) -> Result<Vec<u8>> {
    let path = if name == "posing" {
        std::env::current_exe().map_err(|e| Error::io("posing", e))?
    } else {
        find(name)?
    };
    let out = Command::new(&path)
        .args(request)
        .stdin(Stdio::null())
        .output()
        .map_err(|e| Error::io(&path, e))?;
    Ok(out.stdout)
}

/// Opens the page in man where man is there, else prints the long help.
fn help(name: &str) -> Result<()> {
    let roff = page(name, &[manual::MAN])?;
    let file = tempfile::Builder::new()
        .prefix(name)
        .suffix(".1")
        .tempfile()
        .map_err(|e| Error::io(name, e))?;
    std::fs::write(file.path(), roff).map_err(|e| Error::io(file.path(), e))?;
    match Command::new("man").arg("-l").arg(file.path()).status() {
        Ok(status) if status.success() => Ok(()),
        _ => streams::write_bytes(None, &page(name, &["--help"])?, false),
    }
}

fn completions(shell: &str) -> Result<()> {
    let known: Shell = shell.parse().map_err(|_| {
        Error::usage(format!(
            "no completions for \"{shell}\"; use bash, zsh or fish"
        ))
    })?;
    let shell = known.to_string();
    let mut out = page("posing", &[manual::COMPLETIONS, &shell])?;
    for command in COMMANDS {
        out.extend(page(command.name, &[manual::COMPLETIONS, &shell])?);
    }
    streams::write_bytes(None, &out, false)
}
