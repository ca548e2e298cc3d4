//! Manual pages, made from the flags.

use clap::{Arg, ArgAction, Command, Id};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};

/// Commands that `posing` lists together.
pub struct Group {
    /// What they are for.
    pub title: &'static str,
    /// The commands.
    pub commands: Vec<Command>,
}

/// Flags that `-h` shows at most, with `--help` and `--version`.
const MOST_FIRST: usize = 12;

/// The command as a user types it: `posing NAME`. Its `-h` ends with where all flags are. Examples
/// stand behind what only the long help has, unless it has its own.
pub fn typed(command: Command) -> Command {
    let name = command.get_name().to_string();
    if name == "posing" {
        return command;
    }
    let first = first_flags(&command);
    let examples = command.get_after_help().cloned().unwrap_or_default();
    let long = match command.get_after_long_help().map(ToString::to_string) {
        Some(long) if long.contains("\n\nExamples:") => long,
        Some(files) => format!("{files}\n\n{examples}"),
        None => examples.to_string(),
    };
    command
        .mut_args(|arg| {
            let is_first = arg.is_positional() || first.contains(arg.get_id());
            arg.hide_short_help(!is_first)
        })
        .bin_name(format!("posing {name}"))
        .after_help(format!("{examples}\n\nAll flags: posing {name} --help"))
        .after_long_help(long)
}

/// The flags that `-h` shows: where the result goes and what must be given, then those that a
/// command declares first, but for those of all commands and those that convert tables.
/// (What captures do not say may be given for each format, so such a flag repeats.)
fn first_flags(command: &Command) -> Vec<Id> {
    let is_left_out = |arg: &&Arg| match arg.get_help_heading() {
        Some("Shared") => arg.get_id() != "seed",
        Some("Input") => !matches!(arg.get_action(), ArgAction::Append),
        Some("Output") => arg.get_id() == "to",
        _ => false,
    };
    let is_needed = |arg: &&Arg| arg.is_required_set() || arg.get_id() == "output";
    let flags = command.get_arguments().filter(|arg| !arg.is_positional());
    let (needed, other): (Vec<&Arg>, Vec<&Arg>) = flags.partition(is_needed);
    let other = other.into_iter().filter(|arg| !is_left_out(arg));
    let first = needed.into_iter().chain(other).take(MOST_FIRST - 2);
    first.map(|arg| arg.get_id().clone()).collect()
}

/// The command with the help and version flags that clap adds, and without its `help` subcommand.
pub(crate) fn built(mut command: Command) -> Command {
    command = command.disable_help_subcommand(true);
    command.build();
    command
}

/// The page as roff, called `posing-NAME(1)` for the command NAME; that of `posing` lists the
/// `groups`.
pub fn page(command: Command, groups: &[Group]) -> Vec<u8> {
    // A page has all flags, those that -h leaves out too.
    let command = built(typed(command)).mut_args(|arg| arg.hide_short_help(false));
    let title = match command.get_name() {
        "posing" => "posing".to_string(),
        name => format!("posing-{name}"),
    };
    let head = Man::new(command.clone().display_name(title.clone()))
        .title(title.to_uppercase())
        .section("1")
        .source(format!("posing {}", env!("CARGO_PKG_VERSION")))
        .manual("posing");
    let mut out = Vec::new();
    // Writing to memory cannot fail.
    let _ = head.render_title(&mut out);
    let _ = head.render_name_section(&mut out);
    let _ = section("SYNOPSIS", &usage(&command)).to_writer(&mut out);
    let _ = section("DESCRIPTION", &description(&command)).to_writer(&mut out);
    for group in groups {
        let _ = section(&group.title.to_uppercase(), "").to_writer(&mut out);
        for listed in &group.commands {
            let name = format!("posing-{}(1)", listed.get_name());
            let _ = entry(&name, &about(listed)).to_writer(&mut out);
        }
    }
    let _ = head.render_options_section(&mut out);
    if command.has_subcommands() {
        let _ = section("COMMANDS", "").to_writer(&mut out);
    }
    for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set()) {
        let _ = subcommand(sub).to_writer(&mut out);
    }
    let help = command.get_after_long_help().or(command.get_after_help());
    for (heading, body) in sections(&help.map(ToString::to_string).unwrap_or_default()) {
        let _ = section(&heading, &body).to_writer(&mut out);
    }
    let _ = section("SEE ALSO", &see_also(&title)).to_writer(&mut out);
    let page = String::from_utf8_lossy(&out);
    // Each part was written with roff's preamble.
    let preamble: String = page.split_inclusive('\n').take(2).collect();
    (preamble.clone() + &page.replace(&preamble, "")).into_bytes()
}

/// The paragraphs of the long help below its first line, which the name section holds; that line
/// where there are none.
fn description(command: &Command) -> String {
    let long = command.get_long_about().map(ToString::to_string);
    let below = long.and_then(|text| Some(text.split_once("\n\n")?.1.to_string()));
    below.unwrap_or_else(|| about(command))
}

fn about(command: &Command) -> String {
    command
        .get_about()
        .map(ToString::to_string)
        .unwrap_or_default()
}

/// `posing NAME [OPTIONS] [FILE]...`, a line for each form.
fn usage(command: &Command) -> String {
    let usage = command.clone().render_usage().to_string();
    usage.trim_start_matches("Usage:").trim().to_string()
}

fn section(heading: &str, body: &str) -> Roff {
    let mut roff = Roff::new();
    roff.control("SH", [heading]);
    for line in body.lines() {
        match line {
            "" => roff.control("PP", []),
            _ => roff.text([roman(line)]),
        };
    }
    roff
}

/// An entry of a list.
fn entry(head: &str, text: &str) -> Roff {
    let mut roff = Roff::new();
    roff.control("TP", []);
    roff.text([bold(head)]);
    roff.text([roman(text)]);
    roff
}

/// A form of a command, with its arguments.
fn subcommand(sub: &Command) -> Roff {
    let mut roff = entry(&usage(sub), &about(sub));
    for arg in sub.get_arguments().filter(|a| !a.is_hide_set()) {
        if ["help", "version"].contains(&arg.get_id().as_str()) || arg.is_global_set() {
            continue;
        }
        let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
        roff.control("RS", []);
        roff.control("TP", []);
        roff.text([bold(arg.to_string())]);
        roff.text([roman(help)]);
        roff.control("RE", []);
    }
    roff
}

/// The parts of a text below help: each opens with a line such as `Examples:`.
fn sections(text: &str) -> Vec<(String, String)> {
    let mut sections: Vec<(String, String)> = Vec::new();
    for line in text.lines() {
        match line.strip_suffix(':').filter(|l| !l.contains(' ')) {
            Some(heading) => sections.push((heading.to_uppercase(), String::new())),
            None => {
                if let Some((_, body)) = sections.last_mut().filter(|_| !line.is_empty()) {
                    body.push_str(line);
                    body.push('\n');
                }
            }
        }
    }
    sections
}

fn see_also(title: &str) -> String {
    match title {
        "posing" => {
            "posing-table(5), posing-json(5), posing-formats(7), posing-scale(7)".to_string()
        }
        _ => "posing(1), posing-table(5), posing-json(5), posing-formats(7), posing-scale(7)"
            .to_string(),
    }
}
