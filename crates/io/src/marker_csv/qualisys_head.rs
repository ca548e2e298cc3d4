//! The lines of a name and its values with which Qualisys' TSV files begin.

use std::collections::HashMap;

/// The values of the header by their names, which are of [`KEYS`].
pub(crate) type Head = HashMap<&'static str, Vec<String>>;

/// What is read of the header; other lines are passed over, however many there are.
pub(crate) const KEYS: [&str; 7] = [
    "NO_OF_FRAMES",
    "NO_OF_MARKERS",
    "FREQUENCY",
    "DATA_INCLUDED",
    "MARKER_NAMES",
    "NO_OF_BODIES",
    "BODY_NAMES",
];

/// The first value of a name.
pub(crate) fn value_of<'a>(head: &'a Head, key: &str) -> Option<&'a str> {
    Some(head.get(key)?.first()?.as_str())
}
