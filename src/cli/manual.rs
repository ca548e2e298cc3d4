//! Pages of the manual and completions, made from the flags.

use clap::Command;
use clap_complete::Shell;
use std::io::Write;
use std::process::ExitCode;

/// The hidden first argument that makes every command print its page of the manual.
pub const MAN: &str = "--print-man-page";
/// The hidden first argument that makes every command print its completions for the shell named next.
pub const COMPLETIONS: &str = "--print-completions";

/// Answers the two hidden requests; `None` when the arguments are no such request.
pub fn on_request(command: &Command) -> Option<ExitCode> {
    let mut args = std::env::args().skip(1);
    let bytes = match args.next().as_deref() {
        Some(MAN) => man_page(command.clone()),
        Some(COMPLETIONS) => completions(command.clone(), args.next()?.parse().ok()?),
        _ => return None,
    };
    Some(match std::io::stdout().write_all(&bytes) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => ExitCode::from(1),
        _ => ExitCode::SUCCESS,
    })
}

/// The page as roff. The width of a terminal does not matter: nothing is wrapped.
pub fn man_page(command: Command) -> Vec<u8> {
    let name = command.get_name().to_string();
    let title = name.to_uppercase();
    let man = clap_mangen::Man::new(command.disable_help_subcommand(true))
        .title(title)
        .section("1")
        .source(format!("posing {}", env!("CARGO_PKG_VERSION")))
        .manual("posing");
    let mut out = Vec::new();
    // Writing to memory cannot fail.
    let _ = man.render(&mut out);
    out.extend_from_slice(b".SH \"SEE ALSO\"\n");
    let see = if name == "posing" {
        "posing\\-table(5)"
    } else {
        "posing(1), posing\\-table(5)"
    };
    let _ = writeln!(out, "{see}");
    out
}

/// A completion script.
pub fn completions(mut command: Command, shell: Shell) -> Vec<u8> {
    let name = command.get_name().to_string();
    let mut out = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut out);
    out
}
