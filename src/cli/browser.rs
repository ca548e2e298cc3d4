//! Opening a page in the browser.

use crate::cli::messages;
use crate::io::output::TemporaryFile;
use std::env;
use std::process::{Command, Stdio};

/// Opens an address in the default browser, if there is one. The address is secret and arguments
/// are not, so the browser is given a file that leads there, which others cannot read. The file
/// goes when it is dropped.
pub fn open(address: &str) -> Option<TemporaryFile> {
    let (opener, arguments): (_, &[&str]) = match env::consts::OS {
        "windows" => ("cmd", &["/C", "start", ""]),
        "macos" => ("open", &[]),
        // Without a display, xdg-open would start a browser in the terminal.
        _ if !has_display() => return None,
        _ => ("xdg-open", &[]),
    };
    let file = redirecting(address).ok()?;
    let mut command = Command::new(opener);
    command.args(arguments).arg(file.path());
    command.stdin(Stdio::null());
    command.stdout(Stdio::null()).stderr(Stdio::null());
    // Else ctrl-C, meant for this program, would end a browser that it has started.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn().ok()?;
    // The opener may itself become the browser, and run for long.
    std::thread::spawn(move || {
        if !child.wait().is_ok_and(|status| status.success()) {
            messages::info("no browser has opened; open the printed address");
        }
    });
    Some(file)
}

fn has_display() -> bool {
    let is_set = |name| env::var_os(name).is_some_and(|v| !v.is_empty());
    is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

/// A page for the user's eyes only that leads to an address.
fn redirecting(address: &str) -> std::io::Result<TemporaryFile> {
    let meta = format!("<meta http-equiv=\"refresh\" content=\"0;url={address}\">");
    let page = format!(
        "<!doctype html><meta charset=\"utf-8\"><meta name=\"referrer\" \
         content=\"no-referrer\">{meta}<title>posing</title><a href=\"{address}\">posing \
         edit</a>\n"
    );
    TemporaryFile::new(".html", page.as_bytes())
}
