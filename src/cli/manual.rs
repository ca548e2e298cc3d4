//! Manual pages, made from the flags.

use super::completions::Outline;
use super::{commands, streams};
use crate::Result;
use clap::Command;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};

/// The hidden first argument on which every command prints its manual page.
pub const MAN: &str = "--print-man-page";
/// The hidden first argument on which every command prints its [`Outline`] as JSON.
pub const OUTLINE: &str = "--print-outline";

/// Answers the two hidden requests; `None` when the first argument is neither.
pub fn answer_request(command: &Command) -> Option<Result<()>> {
    let bytes = match std::env::args().nth(1)?.as_str() {
        MAN => page(command.clone()),
        OUTLINE => serde_json::to_vec(&Outline::of(&built(command.clone()))).unwrap_or_default(),
        _ => return None,
    };
    Some(streams::write_bytes(None, &bytes, false))
}

/// The command as a user types it: `posing NAME`, where NAME is listed.
pub fn typed(command: Command) -> Command {
    let name = command.get_name().to_string();
    match commands::find(&name) {
        Some(_) => command.bin_name(format!("posing {name}")),
        None => command,
    }
}

/// The command with the help and version flags that clap adds, and without its `help` subcommand.
fn built(mut command: Command) -> Command {
    command = command.disable_help_subcommand(true);
    command.build();
    command
}

/// The page as roff, called `posing-NAME(1)` for the command NAME.
pub fn page(command: Command) -> Vec<u8> {
    let command = built(typed(command));
    let title = match commands::find(command.get_name()) {
        Some(entry) => format!("posing-{}", entry.name),
        None => command.get_name().to_string(),
    };
    let version = format!("posing {}", env!("CARGO_PKG_VERSION"));
    let man = |command: &Command| {
        Man::new(command.clone())
            .title(title.to_uppercase())
            .section("1")
            .source(version.clone())
            .manual("posing")
    };
    let mut out = Vec::new();
    // Writing to memory cannot fail.
    let head = man(&command.clone().display_name(title.clone()));
    let _ = head.render_title(&mut out);
    let _ = head.render_name_section(&mut out);
    let _ = section("SYNOPSIS", &usage(&command)).to_writer(&mut out);
    let _ = head.render_description_section(&mut out);
    let _ = head.render_options_section(&mut out);
    if command.has_subcommands() {
        let _ = Roff::new().control("SH", ["COMMANDS"]).to_writer(&mut out);
    }
    let mut subs: Vec<_> = command
        .get_subcommands()
        .filter(|sub| !sub.is_hide_set())
        .collect();
    subs.sort_by_key(|sub| !has_page(&command, sub));
    for sub in subs {
        let _ = subcommand(&command, sub).to_writer(&mut out);
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

/// Whether `sub` is a command of the family in the launcher's list.
fn has_page(command: &Command, sub: &Command) -> bool {
    command.get_name() == "posing" && commands::find(sub.get_name()).is_some()
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
        roff.text([roman(line)]);
    }
    roff
}

/// One entry below COMMANDS: a command with a page of its own, or a form of this one with its arguments.
fn subcommand(command: &Command, sub: &Command) -> Roff {
    let mut roff = Roff::new();
    let has_page = has_page(command, sub);
    let head = match has_page {
        true => format!("posing-{}(1)", sub.get_name()),
        false => usage(sub),
    };
    roff.control("TP", []);
    roff.text([bold(head)]);
    roff.text([roman(
        sub.get_about().map(ToString::to_string).unwrap_or_default(),
    )]);
    for arg in sub
        .get_arguments()
        .filter(|a| !has_page && !a.is_hide_set())
    {
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
        "posing" => "posing-table(5), posing-formats(7), posing-scale(7)".to_string(),
        _ => "posing(1), posing-table(5), posing-formats(7), posing-scale(7)".to_string(),
    }
}
