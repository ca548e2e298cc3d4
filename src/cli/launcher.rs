//! The launcher's access to the other commands: their binaries, manual pages and outlines.

use super::completions::Outline;
use super::{commands, manual, streams};
use crate::io::output::TemporaryFile;
use crate::{Error, Place, Result};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// The binary of a command: beside this one, or in libexec.
pub fn binary(name: &str) -> Result<PathBuf> {
    let here = std::env::current_exe().map_err(|e| Error::io("posing", e))?;
    if name == "posing" {
        return Ok(here);
    }
    if commands::find(name).is_none() {
        let what = format!("no command \"{name}\"; posing without arguments lists the commands");
        return Err(Error::usage(what));
    }
    // An installed launcher may be reached through a link.
    let here = here.canonicalize().unwrap_or(here);
    let folder = here.parent().map(PathBuf::from).unwrap_or_default();
    let places = [
        folder.join(name),
        folder.join("../libexec/posing").join(name),
    ];
    let missing = || {
        let what = "is not there: the program of each command belongs beside posing (make install puts them there)";
        Error::data(Place::file(places[0].display().to_string()), what)
    };
    places
        .iter()
        .find(|path| path.is_file())
        .cloned()
        .ok_or_else(missing)
}

/// What a command prints with one argument.
pub fn output_of(name: &str, argument: &str) -> Result<Vec<u8>> {
    let path = binary(name)?;
    let out = Command::new(&path)
        .arg(argument)
        .stdin(Stdio::null())
        .output();
    Ok(out.map_err(|e| Error::io(&path, e))?.stdout)
}

/// The outline of a command, as its binary prints it.
pub fn outline(name: &str) -> Result<Outline> {
    let json = output_of(name, manual::OUTLINE)?;
    serde_json::from_slice(&json).map_err(|e| Error::data(Place::file(name), e.to_string()))
}

/// Opens a page in man where man is there, else prints the long help.
pub fn open_page(name: &str) -> Result<()> {
    let page = output_of(name, manual::MAN)?;
    let file = TemporaryFile::new(".1", &page).map_err(|e| Error::io(name, e))?;
    match Command::new("man").arg("-l").arg(file.path()).status() {
        Ok(status) if status.success() => {}
        _ => streams::write_bytes(None, &output_of(name, "--help")?, false)?,
    }
    Ok(())
}
