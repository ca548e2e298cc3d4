//! Completion scripts for bash, zsh and fish.
//!
//! Flags are declared in each command's binary, and the launcher does not link those. A command therefore prints its
//! [`Outline`] as JSON on a hidden request, and the launcher builds one clap command from all outlines.

use clap::{Arg, ArgAction, Command, ValueEnum, ValueHint};
use serde::{Deserialize, Serialize};

/// The shells that completions are written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shell {
    /// GNU Bash
    Bash,
    /// Z shell
    Zsh,
    /// Friendly interactive shell
    Fish,
}

/// The parts of a command that a completion script needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outline {
    /// The command's name.
    pub name: String,
    /// Its purpose in one line.
    pub about: String,
    flags: Vec<Flag>,
    subcommands: Vec<Outline>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Flag {
    id: String,
    short: Option<char>,
    long: Option<String>,
    help: String,
    takes_value: bool,
    takes_file: bool,
    repeats: bool,
    choices: Vec<String>,
}

impl Outline {
    /// The outline of a command, without hidden arguments.
    pub fn of(command: &Command) -> Outline {
        let flags = command.get_arguments().filter(|arg| !arg.is_hide_set());
        Outline {
            name: command.get_name().to_string(),
            about: command
                .get_about()
                .map(ToString::to_string)
                .unwrap_or_default(),
            flags: flags.map(Flag::of).collect(),
            subcommands: (command.get_subcommands())
                .filter(|sub| !sub.is_hide_set())
                .map(Outline::of)
                .collect(),
        }
    }

    /// A clap command with the same flags, which parses nothing but serves the script generators.
    fn command(&self) -> Command {
        Command::new(self.name.clone())
            .about(self.about.clone())
            .disable_help_subcommand(true)
            .disable_help_flag(true)
            .args(self.flags.iter().map(Flag::arg))
            .subcommands(self.subcommands.iter().map(Outline::command))
    }
}

impl Flag {
    fn of(arg: &Arg) -> Flag {
        let choices = arg.get_possible_values();
        let choices = choices.iter().filter(|choice| !choice.is_hide_set());
        Flag {
            id: arg.get_id().to_string(),
            short: arg.get_short(),
            long: arg.get_long().map(String::from),
            help: arg.get_help().map(ToString::to_string).unwrap_or_default(),
            takes_value: arg.get_action().takes_values(),
            repeats: matches!(arg.get_action(), ArgAction::Append),
            takes_file: arg.get_value_hint() == ValueHint::AnyPath,
            choices: choices.map(|c| c.get_name().to_string()).collect(),
        }
    }

    fn arg(&self) -> Arg {
        let mut arg = Arg::new(self.id.clone()).help(self.help.clone());
        if let Some(short) = self.short {
            arg = arg.short(short);
        }
        if let Some(long) = &self.long {
            arg = arg.long(long.clone());
        }
        if !self.takes_value {
            return arg.action(ArgAction::SetTrue);
        }
        if self.takes_file {
            arg = arg.value_hint(ValueHint::AnyPath);
        }
        if !self.choices.is_empty() {
            arg = arg.value_parser(self.choices.clone());
        }
        arg.action(match self.repeats {
            true => ArgAction::Append,
            false => ArgAction::Set,
        })
    }
}

/// The script that completes `outline` in `shell`.
pub fn script(outline: &Outline, shell: Shell) -> String {
    let generator = match shell {
        Shell::Bash => clap_complete::Shell::Bash,
        Shell::Zsh => clap_complete::Shell::Zsh,
        Shell::Fish => clap_complete::Shell::Fish,
    };
    let mut out = Vec::new();
    let name = outline.name.clone();
    clap_complete::generate(generator, &mut outline.command(), name, &mut out);
    let script = String::from_utf8_lossy(&out).into_owned();
    match shell {
        Shell::Bash => files_without_dash(&script),
        Shell::Zsh | Shell::Fish => script,
    }
}

/// clap's script for bash offers a command's flags in place of files until a first letter is typed. Where a command has
/// nothing but flags to offer, they are offered after `-` alone, and files else.
fn files_without_dash(script: &str) -> String {
    let mut only_flags = false;
    let mut out = String::with_capacity(script.len());
    for line in script.lines() {
        if let Some(words) = line.trim().strip_prefix("opts=\"") {
            let words = words.trim_end_matches('"');
            only_flags = words.split(' ').all(|word| word.starts_with('-'));
        }
        let test = line.find(" || ${COMP_CWORD} -eq ").filter(|_| only_flags);
        if let Some(at) = test {
            out += &line[..at];
            out += " ]] ; then\n";
        } else if !(only_flags && line.starts_with("            COMPREPLY=( $(compgen -W")) {
            out += line;
            out.push('\n');
        }
    }
    out
}

/// The outline of the launcher with those of `commands` in place of their names alone.
pub fn launcher(mut outline: Outline, commands: Vec<Outline>) -> Outline {
    let named = |name: &str| commands.iter().any(|command| command.name == name);
    outline.subcommands.retain(|sub| !named(&sub.name));
    outline.subcommands.splice(0..0, commands);
    outline
}
