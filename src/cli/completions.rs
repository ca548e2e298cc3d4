//! Completion scripts for bash, zsh and fish.

use super::paths::FileRole;
use clap::{Arg, ArgAction, Command, ValueEnum, ValueHint};

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

/// The command without what is hidden, which parses nothing but serves the script generators.
fn visible(command: &Command) -> Command {
    let flags = command.get_arguments().filter(|arg| !arg.is_hide_set());
    let subcommands = command.get_subcommands().filter(|sub| !sub.is_hide_set());
    Command::new(command.get_name().to_string())
        .about(command.get_about().cloned().unwrap_or_default())
        .disable_help_subcommand(true)
        .disable_help_flag(true)
        .args(flags.map(flag))
        .subcommands(subcommands.map(visible))
}

/// The flag without its conditions.
fn flag(arg: &Arg) -> Arg {
    let mut out = Arg::new(arg.get_id().clone()).help(arg.get_help().cloned().unwrap_or_default());
    if let Some(short) = arg.get_short() {
        out = out.short(short);
    }
    if let Some(long) = arg.get_long() {
        out = out.long(long.to_string());
    }
    if !arg.get_action().takes_values() {
        return out.action(ArgAction::SetTrue);
    }
    if arg.get_value_hint() == ValueHint::AnyPath || FileRole::of(arg) == Some(FileRole::Written) {
        out = out.value_hint(ValueHint::AnyPath);
    }
    let choices = arg.get_possible_values();
    let choices: Vec<_> = choices
        .into_iter()
        .filter(|choice| !choice.is_hide_set())
        .collect();
    if !choices.is_empty() {
        out = out.value_parser(choices);
    }
    out.action(match arg.get_action() {
        ArgAction::Append => ArgAction::Append,
        _ => ArgAction::Set,
    })
}

/// The script that completes `command` in `shell`.
pub fn script(command: &Command, shell: Shell) -> String {
    let generator = match shell {
        Shell::Bash => clap_complete::Shell::Bash,
        Shell::Zsh => clap_complete::Shell::Zsh,
        Shell::Fish => clap_complete::Shell::Fish,
    };
    let mut built = command.clone().disable_help_subcommand(true);
    built.build();
    let (name, mut out) = (command.get_name().to_string(), Vec::new());
    clap_complete::generate(generator, &mut visible(&built), name, &mut out);
    let script = String::from_utf8_lossy(&out).into_owned();
    match shell {
        Shell::Bash => files_without_dash(&script),
        Shell::Zsh | Shell::Fish => script,
    }
}

/// clap's script for bash offers a command's flags in place of files until a first letter is typed.
/// Where a command has nothing but flags to offer, they are offered after `-` alone, and files
/// else.
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
