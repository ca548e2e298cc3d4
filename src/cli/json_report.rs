//! What a command did, as one JSON object: see posing-json(5).

use super::paths::OutputPath;
use super::{messages, streams};
use crate::error::is_hidden;
use crate::io::output::file_descriptor;
use crate::{Error, Result};
use clap::Args;
use serde::Serialize;
use std::path::Path;

/// The flag of commands that report as JSON.
#[derive(Debug, Clone, Args)]
pub struct JsonArgs {
    /// Print what was done as one JSON object (see posing-json(5)): what is written to standard
    /// output otherwise then needs -o. --json=FILE writes the object to FILE
    #[arg(
        long,
        value_name = "FILE",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "-",
        help_heading = "Output"
    )]
    json: Option<OutputPath>,
}

/// The object: what is the same for all commands around the `report` of one.
#[derive(Serialize)]
struct Object<T> {
    command: String,
    /// The version of the program.
    posing: &'static str,
    #[serde(flatten)]
    report: T,
    /// The lines of standard error, also those that --quiet keeps from it.
    notes: Vec<String>,
}

impl JsonArgs {
    /// The flag that writes to `file`.
    pub fn to_file(file: &Path) -> JsonArgs {
        JsonArgs {
            json: Some(file.to_path_buf().into()),
        }
    }

    /// Keeps messages for the object from now on, where it is asked for.
    ///
    /// # Errors
    /// [`Error::Usage`]: it would stand in one stream with the result of the command, `output`.
    pub fn prepare(&self, output: Option<&Path>) -> Result<()> {
        let Some(path) = &self.json else {
            return Ok(());
        };
        if is_stdout(path) && output.is_none_or(is_stdout) {
            return Err(Error::usage(
                "--json prints to standard output, and so would the result: give -o FILE, or \
                 --json=FILE",
            ));
        }
        messages::keep();
        Ok(())
    }

    /// Writes the object, where it is asked for.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub fn write(&self, report: impl Serialize) -> Result<()> {
        match &self.json {
            Some(path) => write_json(Some(path), &Object::of(report)),
            None => Ok(()),
        }
    }

    /// Writes the report of a command that prints nothing else to `output`: the object in the place
    /// of the text, or the text, and the object to its own file.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub fn write_report(
        &self,
        output: Option<&Path>,
        text: impl FnOnce() -> String,
        report: impl Serialize,
    ) -> Result<()> {
        self.write_value(output, text, &Object::of(report))
    }

    /// Like [`JsonArgs::write_report`], of JSON without what is the same for all commands.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub fn write_value(
        &self,
        output: Option<&Path>,
        text: impl FnOnce() -> String,
        value: &impl Serialize,
    ) -> Result<()> {
        let file = match &self.json {
            Some(path) if is_stdout(path) => return write_json(output, value),
            file => file,
        };
        // First: nobody may read the text to its end.
        if let Some(path) = file {
            write_json(Some(path), value)?;
        }
        // Names from files stand in it.
        let is_hidden = |c: char| is_hidden(c) && !matches!(c, '\n' | '\t');
        let text = text().replace(is_hidden, "\u{fffd}");
        streams::write_bytes(output, text.as_bytes(), false)
    }

    /// Whether the object stands in the place of the text; a command that prints nothing else calls
    /// this first, for messages are kept from then on.
    pub fn prepare_report(&self) -> bool {
        if self.json.is_some() {
            messages::keep();
        }
        self.json.as_deref().is_some_and(is_stdout)
    }
}

impl<T> Object<T> {
    fn of(report: T) -> Object<T> {
        Object {
            command: messages::name(),
            posing: env!("CARGO_PKG_VERSION"),
            report,
            notes: messages::kept(),
        }
    }
}

fn write_json(path: Option<&Path>, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value);
    let text = text.map_err(|e| Error::usage(e.to_string()))? + "\n";
    streams::write_bytes(path, text.as_bytes(), false)
}

fn is_stdout(path: &Path) -> bool {
    path == Path::new("-") || file_descriptor(path) == Some(1)
}
