//! The commands with their arguments as JSON, from which wrappers are made: see posing-json(5).

use super::manual::{built, typed};
use super::paths::{FileRole, OutputPath};
use clap::{Arg, ArgAction, Command};
use serde::Serialize;
use std::any::TypeId;
use std::path::PathBuf;

/// The commands of the program.
#[derive(Debug, Serialize)]
pub struct ProgramUsage {
    /// The version of the program.
    posing: &'static str,
    /// What every command has, and no command lists.
    common: Vec<Argument>,
    commands: Vec<CommandUsage>,
}

#[derive(Debug, Serialize)]
struct CommandUsage {
    name: String,
    /// The title of its group in the list of commands; empty for a subcommand.
    #[serde(skip_serializing_if = "String::is_empty")]
    group: String,
    about: String,
    help: String,
    arguments: Vec<Argument>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    commands: Vec<CommandUsage>,
}

/// An argument of a command.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Argument {
    name: String,
    /// `--max-gap`; none of a positional argument.
    flag: Option<String>,
    short: Option<String>,
    /// What its value is called: SECONDS; none of a switch.
    value: Option<String>,
    r#type: &'static str,
    /// Whether the command writes the file that it names.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    written: bool,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    choices: Vec<Choice>,
    default: Option<String>,
    /// Whether the flag may stand alone: a value follows it with =.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    value_is_optional: bool,
    required: bool,
    /// Whether it may be given again, or takes several values.
    repeats: bool,
    /// Whether commas part several values.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    commas: bool,
    heading: Option<String>,
    help: String,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct Choice {
    name: String,
    help: String,
}

impl ProgramUsage {
    /// The usage of commands, each with the title of its group.
    pub fn new(commands: impl IntoIterator<Item = (&'static str, Command)>) -> ProgramUsage {
        let usage = |(group, command)| CommandUsage {
            group: String::from(group),
            ..CommandUsage::of(&built(typed(command)))
        };
        let mut commands: Vec<CommandUsage> = commands.into_iter().map(usage).collect();
        let is_common = |own: &&Argument| commands.iter().all(|c| c.arguments.contains(own));
        let first = commands.iter().take(1).flat_map(|c| &c.arguments);
        let common: Vec<Argument> = first.filter(is_common).cloned().collect();
        for command in &mut commands {
            command.arguments.retain(|own| !common.contains(own));
        }
        ProgramUsage {
            posing: env!("CARGO_PKG_VERSION"),
            common,
            commands,
        }
    }
}

impl CommandUsage {
    fn of(command: &Command) -> CommandUsage {
        let about = command.get_about().map(ToString::to_string);
        let long = command.get_long_about().map(ToString::to_string);
        let arguments = command.get_arguments().filter(|arg| !arg.is_hide_set());
        let about = about.unwrap_or_default();
        CommandUsage {
            name: command.get_name().to_string(),
            group: String::new(),
            help: long.unwrap_or_else(|| about.clone()),
            about,
            arguments: arguments.map(Argument::of).collect(),
            commands: command.get_subcommands().map(CommandUsage::of).collect(),
        }
    }
}

impl Argument {
    fn of(arg: &Arg) -> Argument {
        let takes_values = arg.get_action().takes_values();
        let values = arg.get_value_names().filter(|_| takes_values);
        let choices = arg.get_possible_values();
        let choices = choices
            .iter()
            .filter(|_| takes_values)
            .map(|choice| Choice {
                name: choice.get_name().to_string(),
                help: (choice.get_help().map(ToString::to_string)).unwrap_or_default(),
            });
        let choices: Vec<Choice> = choices.collect();
        let text = |values: &[clap::builder::OsStr]| {
            let values = values.iter().map(|value| value.to_string_lossy());
            let values: Vec<_> = values.collect();
            (!values.is_empty()).then(|| values.join(","))
        };
        let help = arg.get_long_help().or(arg.get_help());
        let most = arg.get_num_args().map_or(1, |range| range.max_values());
        Argument {
            name: arg.get_id().to_string().replace('_', "-"),
            flag: arg.get_long().map(|long| format!("--{long}")),
            short: arg.get_short().map(|short| format!("-{short}")),
            value: values.map(|names| {
                let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
                names.join(" ")
            }),
            r#type: type_of(arg, takes_values, !choices.is_empty()),
            written: FileRole::of(arg) == Some(FileRole::Written),
            choices,
            default: text(arg.get_default_values()).filter(|_| takes_values),
            value_is_optional: takes_values && arg.is_require_equals_set(),
            required: arg.is_required_set(),
            repeats: matches!(arg.get_action(), ArgAction::Append) || most > 1,
            commas: arg.get_value_delimiter() == Some(','),
            heading: arg.get_help_heading().map(String::from),
            help: help.map(ToString::to_string).unwrap_or_default(),
        }
    }
}

/// The type of an argument's values.
fn type_of(arg: &Arg, takes_values: bool, has_choices: bool) -> &'static str {
    let id = arg.get_value_parser().type_id();
    let is = |types: &[TypeId]| types.iter().any(|t| id == *t);
    match () {
        () if !takes_values => "switch",
        () if has_choices => "choice",
        () if is(&[TypeId::of::<f64>()]) => "number",
        () if is(&[
            TypeId::of::<usize>(),
            TypeId::of::<u64>(),
            TypeId::of::<u32>(),
        ]) =>
        {
            "integer"
        }
        () if is(&[TypeId::of::<PathBuf>(), TypeId::of::<OutputPath>()]) => "path",
        () => "text",
    }
}
