//! The paths among a command's arguments, each of which it reads or writes: a [`PathBuf`] is read,
//! an [`OutputPath`] is written. No result replaces a file that is read, or another result.

use crate::Result;
use crate::io::command_files::CommandFiles;
use clap::builder::{PathBufValueParser, TypedValueParser, ValueParser, ValueParserFactory};
use clap::{Arg, ArgMatches, Command};
use serde::Deserialize;
use std::any::TypeId;
use std::ffi::OsStr;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The value of an argument that names a file or folder to be written.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct OutputPath(PathBuf);

impl ValueParserFactory for OutputPath {
    type Parser = ValueParser;

    fn value_parser() -> ValueParser {
        PathBufValueParser::new().map(OutputPath).into()
    }
}

impl From<PathBuf> for OutputPath {
    fn from(path: PathBuf) -> OutputPath {
        OutputPath(path)
    }
}

impl Deref for OutputPath {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl AsRef<Path> for OutputPath {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

/// What a command does with the file that an argument names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FileRole {
    Read,
    Written,
}

impl FileRole {
    /// The role of an argument's values; `None` of those that name no files.
    pub(crate) fn of(arg: &Arg) -> Option<FileRole> {
        let id = arg.get_value_parser().type_id();
        let names_file = || {
            let mut names = arg.get_value_names().into_iter().flatten();
            names.any(|name| name.contains("FILE"))
        };
        match () {
            () if !arg.get_action().takes_values() => None,
            () if id == TypeId::of::<OutputPath>() => Some(FileRole::Written),
            () if id == TypeId::of::<PathBuf>() => Some(FileRole::Read),
            // A name of something built in, or of a file.
            () if id == TypeId::of::<String>() && names_file() => Some(FileRole::Read),
            () => None,
        }
    }
}

/// The files of the command's arguments.
static FILES: Mutex<Option<CommandFiles>> = Mutex::new(None);

/// Keeps the files that the arguments of a command name.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage): one would be written over one that is read, or over
/// another.
pub(crate) fn check(command: &Command, matches: &ArgMatches) -> Result<()> {
    let mut files = CommandFiles::default();
    // Whether the command reads it or not: nobody gives it a file that is to be replaced.
    files.read("the file of standard input", Path::new("-"))?;
    for (arg, value) in values(command, matches, FileRole::Read) {
        let shown = Path::new(value).display();
        let called = match flag(arg) {
            Some(flag) => format!("the file of {flag}, {shown}"),
            None => format!("the input {shown}"),
        };
        files.read(called, Path::new(value))?;
    }
    for (arg, value) in values(command, matches, FileRole::Written) {
        let shown = Path::new(value).display();
        let called = match flag(arg) {
            Some(flag) if arg.is_require_equals_set() => format!("{flag}={shown}"),
            Some(flag) => format!("{flag} {shown}"),
            None => shown.to_string(),
        };
        files.write(called, Path::new(value))?;
    }
    *FILES.lock().unwrap_or_else(PoisonError::into_inner) = Some(files);
    Ok(())
}

/// The files that the command's arguments name; to these a command adds those that it finds, or
/// writes beside others.
pub fn command_files() -> CommandFiles {
    let files = FILES.lock().unwrap_or_else(PoisonError::into_inner);
    files.clone().unwrap_or_default()
}

/// Fails where a file that a command writes beside those that its arguments name, or into a folder,
/// would replace one that it reads, or be another that it writes.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage): it would.
pub fn check_written(written: impl IntoIterator<Item = impl AsRef<Path>>) -> Result<()> {
    let mut files = command_files();
    let mut written = written.into_iter();
    written.try_for_each(|path| {
        let path = path.as_ref();
        files.write(path.display().to_string(), path)
    })
}

/// Fails where a file that a command reads from a folder, or beside another, is one that it writes.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage): it is.
pub fn check_read(read: impl IntoIterator<Item = impl AsRef<Path>>) -> Result<()> {
    let mut files = command_files();
    read.into_iter().try_for_each(|path| {
        let path = path.as_ref();
        files.read(format!("the input {}", path.display()), path)
    })
}

/// The values of all arguments of a role, those of a subcommand too.
fn values<'a>(
    command: &'a Command,
    matches: &'a ArgMatches,
    role: FileRole,
) -> Vec<(&'a Arg, &'a OsStr)> {
    let own = command
        .get_arguments()
        .filter(|a| FileRole::of(a) == Some(role));
    let own = own.filter_map(|arg| Some((arg, matches.try_get_raw(arg.get_id().as_str()).ok()??)));
    let mut all: Vec<_> = own
        .flat_map(|(arg, values)| values.map(move |value| (arg, value)))
        .collect();
    let below = matches
        .subcommand()
        .and_then(|(name, matches)| Some((command.find_subcommand(name)?, matches)));
    if let Some((command, matches)) = below {
        all.extend(values(command, matches, role));
    }
    all
}

/// The argument's flag, the short one where it has one.
fn flag(arg: &Arg) -> Option<String> {
    let short = arg.get_short().map(|short| format!("-{short}"));
    short.or_else(|| arg.get_long().map(|long| format!("--{long}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory, Parser};

    #[derive(Parser)]
    struct Args {
        inputs: Vec<PathBuf>,
        #[arg(long, value_name = "NAME|FILE")]
        _map: Option<String>,
        #[arg(long)]
        _title: Option<String>,
        #[arg(short, long)]
        output: Option<OutputPath>,
        #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "-")]
        json: Option<OutputPath>,
    }

    #[test]
    fn arguments_that_name_one_file_are_told_with_their_flags() {
        let mut command = Args::command();
        let mut check = |words: &str| {
            let words = ["name"].into_iter().chain(words.split_whitespace());
            let matches = command.try_get_matches_from_mut(words).unwrap();
            check(&command, &matches).map_err(|e| e.to_string())
        };
        for sound in [
            "a b -o c --json=d",
            "a --title c -o c",
            "a -o - --json",
            "a -o /dev/null --json=/dev/null",
            "a a -o b",
        ] {
            assert_eq!(check(sound), Ok(()), "{sound}");
        }
        for (words, told) in [
            (
                "a b -o ./b",
                "-o ./b would be replaced, as it is the input b;",
            ),
            ("a --map m.toml -o m.toml", "the file of --map, m.toml;"),
            ("a --json=./a", "--json=./a would be replaced"),
            ("a -o c --json=./c", "--json=./c and -o c are one file;"),
        ] {
            let said = check(words).unwrap_err();
            assert!(said.contains(told), "{words}: {said}");
        }
    }
}
