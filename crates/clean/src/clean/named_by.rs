//! By what the tracks of a capture got their names.

use serde::Serialize;

/// By what the tracks of a capture got their names.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct NamedBy {
    /// The files of labeled takes, or a marker set; `None`: nothing fits.
    pub by: Option<String>,
    /// The files of labeled takes, all of them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub takes: Vec<String>,
    /// How well labels and tracks fit each other, 0 to 1.
    pub fit: f64,
    /// Why nothing names them, where it is not that nothing fits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Labeled takes that were passed over, and why.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub passed_over: Vec<String>,
}

impl NamedBy {
    /// What to say where nothing names the tracks.
    pub(super) fn nothing(&self) -> Option<String> {
        self.by.is_none().then(|| match &self.why {
            Some(why) => format!("its tracks have no names: {why}"),
            None => {
                "its tracks have no names, and no labeled take beside it, marker set or built-in \
                 set fits them: put a labeled take of the person in its folder, such as a static \
                 one, or give one with the option `like`"
                    .to_string()
            }
        })
    }
}
