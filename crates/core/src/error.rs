//! What can go wrong, and the exit code each kind of failure has.

pub use crate::message::{Message, OptionName, OptionNames, excerpt, is_hidden};
use std::fmt;
use std::io;
use std::path::Path;

/// A shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// A failure, told in one line that names the place, what is wrong there and, where there is one,
/// the remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The input holds something that cannot be used (exit 1).
    #[error("{place}: {what}")]
    Data {
        /// Where in the input.
        place: Place,
        /// What is wrong, and what would mend it.
        what: Message,
    },
    /// What was given cannot be used; the caller knows the place ([`Error::at`]; exit 1).
    #[error("{0}")]
    Unfit(Message),
    /// The arguments do not fit together or are out of range (exit 2).
    #[error("{0}")]
    Usage(Message),
    /// Reading or writing failed (exit 1; a reader that closes the pipe is no failure at all).
    #[error("{place}: {source}")]
    Io {
        /// The file, or `standard input` or `standard output`.
        place: String,
        /// The system's own word on it.
        source: io::Error,
    },
}

/// A place in an input: `walk.csv:118: lwrist.y`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Place {
    /// The file's name as the user gave it, or `standard input`.
    pub file: String,
    /// Line, counted from 1.
    pub line: Option<u64>,
    /// Column, bone or array inside that line or file.
    pub part: Option<String>,
}

impl Place {
    /// A whole file.
    pub fn file(file: impl Into<String>) -> Self {
        Place {
            file: file.into(),
            line: None,
            part: None,
        }
    }
    /// One line of a file, counted from 1.
    pub fn line(file: impl Into<String>, line: u64) -> Self {
        Place {
            file: file.into(),
            line: Some(line),
            part: None,
        }
    }
    /// This place with a column, bone or array named.
    #[must_use]
    pub fn part(mut self, part: impl Into<String>) -> Self {
        self.part = Some(part.into());
        self
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(part) = &self.part {
            write!(f, ": {part}")?;
        }
        Ok(())
    }
}

impl Error {
    /// Unusable data at a place.
    pub fn data(place: Place, what: impl Into<Message>) -> Self {
        Error::Data {
            place,
            what: what.into(),
        }
    }
    /// Something unusable whose place the caller knows. Texts convert into it, too.
    #[doc(hidden)]
    pub fn unfit(what: impl Into<Message>) -> Self {
        Error::Unfit(what.into())
    }
    /// An [`Error::Unfit`] becomes [`Error::Data`] at `place`; others stay as they are.
    #[must_use]
    pub fn at(self, place: Place) -> Self {
        match self {
            Error::Unfit(what) => Error::Data { place, what },
            other => other,
        }
    }
    /// An [`Error::Unfit`] becomes [`Error::Usage`]: what was given are arguments. Others stay as
    /// they are.
    #[must_use]
    pub fn into_usage(self) -> Self {
        match self {
            Error::Unfit(what) => Error::Usage(what),
            other => other,
        }
    }
    /// Arguments that cannot be used.
    pub fn usage(what: impl Into<Message>) -> Self {
        Error::Usage(what.into())
    }
    /// A failed read or write of a file.
    pub fn io(path: impl AsRef<Path>, source: io::Error) -> Self {
        Error::Io {
            place: path.as_ref().display().to_string(),
            source,
        }
    }
    /// What it says of the input or the arguments, without the place; `None` for a failed read or
    /// write.
    pub fn message(&self) -> Option<&Message> {
        match self {
            Error::Data { what, .. } | Error::Unfit(what) | Error::Usage(what) => Some(what),
            Error::Io { .. } => None,
        }
    }
    /// The error with its options called as `names` says.
    #[must_use]
    pub fn with_option_names(self, names: OptionNames) -> Self {
        let called = |what: Message| Message::from(names.in_text(&what.to_string()));
        match self {
            Error::Data { place, what } => Error::Data {
                place,
                what: called(what),
            },
            Error::Unfit(what) => Error::Unfit(called(what)),
            Error::Usage(what) => Error::Usage(called(what)),
            Error::Io { .. } => self,
        }
    }
    /// 2 for wrong usage, 1 for everything else.
    ///
    /// ```
    /// use posing_core::{Error, Place};
    ///
    /// let place = Place::line("walk.csv", 118).part("lwrist.y");
    /// let error = Error::data(place, "is no number");
    /// assert_eq!(error.to_string(), "walk.csv:118: lwrist.y: is no number");
    /// assert_eq!(error.exit_code(), 1);
    /// ```
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Usage(_) => 2,
            _ => 1,
        }
    }
    /// Whether the reader of our output has gone away, which ends a command with success.
    pub fn is_closed_pipe(&self) -> bool {
        matches!(self, Error::Io { source, .. } if source.kind() == io::ErrorKind::BrokenPipe)
    }
}

impl From<String> for Error {
    fn from(what: String) -> Self {
        Error::Unfit(what.into())
    }
}

impl From<&str> for Error {
    fn from(what: &str) -> Self {
        Error::Unfit(what.into())
    }
}
