//! What a failure or a finding says, with the options that it names.

use std::fmt;

/// What begins the name of an option in a text.
const BEGIN: &str = "the option `";

/// A text that may name options of this library, as ``the option `up z` ``: the field `up` of a
/// settings type, with the value `z`. A program that calls options otherwise gives
/// [`OptionNames`].
///
/// ```
/// use posing_core::error::Error;
///
/// let error = Error::usage("does not say its unit; give it with the option `units mm`");
/// let option = error.message().and_then(|what| what.options().next());
/// let option = option.ok_or("none")?;
/// assert_eq!((option.name, option.value), ("units", Some("mm")));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Message(String);

/// An option that a message names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OptionName<'a> {
    /// The field of a settings type.
    pub name: &'a str,
    /// The value that is proposed, if one is.
    pub value: Option<&'a str>,
}

/// What options are called in texts.
#[derive(Debug, Clone, Copy)]
pub struct OptionNames(fn(OptionName<'_>) -> String);

/// How often something is: `once`, or `3 times`.
#[doc(hidden)]
pub fn often(count: usize) -> String {
    match count {
        1 => "once".to_string(),
        n => format!("{n} times"),
    }
}

impl Message {
    /// The options that it names, in order.
    pub fn options(&self) -> impl Iterator<Item = OptionName<'_>> {
        let after = self.0.split(BEGIN).skip(1);
        after.filter_map(|text| Some(OptionName::parse(text.split_once('`')?.0)))
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl From<String> for Message {
    fn from(text: String) -> Self {
        Message(text)
    }
}

impl From<&str> for Message {
    fn from(text: &str) -> Self {
        Message(text.into())
    }
}

impl<'a> OptionName<'a> {
    fn parse(text: &'a str) -> OptionName<'a> {
        match text.split_once(' ') {
            Some((name, value)) => OptionName {
                name,
                value: Some(value),
            },
            None => OptionName {
                name: text,
                value: None,
            },
        }
    }
}

impl OptionNames {
    /// Options are called as `name` says, such as `--up z`.
    pub const fn new(name: fn(OptionName<'_>) -> String) -> OptionNames {
        OptionNames(name)
    }

    /// A text with its options called so.
    pub fn in_text(&self, text: &str) -> String {
        let mut parts = text.split(BEGIN);
        let mut out = parts.next().unwrap_or_default().to_string();
        for part in parts {
            match part.split_once('`') {
                Some((option, rest)) => out += &((self.0)(OptionName::parse(option)) + rest),
                None => {
                    out += BEGIN;
                    out += part;
                }
            }
        }
        out
    }
}

/// The names that messages of this library have.
impl Default for OptionNames {
    fn default() -> Self {
        OptionNames(|OptionName { name, value }| match value {
            Some(value) => format!("{BEGIN}{name} {value}`"),
            None => format!("{BEGIN}{name}`"),
        })
    }
}

/// Whether a character is not seen but changes how others are shown: control characters, which a
/// terminal obeys, and marks that turn the direction of writing or end a line (Unicode Annex 9).
#[doc(hidden)]
pub fn is_hidden(c: char) -> bool {
    let turns = matches!(
        c,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}'
    ) || matches!(c, '\u{2066}'..='\u{2069}');
    c.is_control() || turns || matches!(c, '\u{2028}' | '\u{2029}')
}

/// Text from a file, fit for one line of a message.
#[doc(hidden)]
pub fn excerpt(text: &str) -> String {
    let clean: String = text
        .chars()
        .take(41)
        .map(|c| if is_hidden(c) { '\u{fffd}' } else { c })
        .collect();
    if clean.chars().count() > 40 {
        format!("{}…", clean.chars().take(40).collect::<String>())
    } else {
        clean
    }
}

#[cfg(test)]
mod tests {
    use super::{Message, OptionName, OptionNames};

    #[test]
    fn options_get_the_names_that_a_program_has() {
        let flags = OptionNames::new(|OptionName { name, value }| {
            let name = name.replace('_', "-");
            value.map_or(format!("--{name}"), |value| format!("--{name} {value}"))
        });
        let text = "does not say its unit; give it with the option `units mm` (or cm), or the \
                    option `max_gap`";
        assert_eq!(
            flags.in_text(text),
            "does not say its unit; give it with --units mm (or cm), or --max-gap"
        );
        assert_eq!(OptionNames::default().in_text(text), text);
        let message = Message::from(text);
        let names: Vec<&str> = message.options().map(|option| option.name).collect();
        assert_eq!(names, ["units", "max_gap"]);
        let broken = "a name with the option `of a file";
        assert_eq!(Message::from(broken).options().count(), 0);
        assert_eq!(flags.in_text(broken), broken);
    }
}
