//! What the list of the last run says of its files: by that it is known what is new.

use crate::{Error, Place, Result};
use serde::Deserialize;
use std::collections::HashMap;
use std::path::Path;

/// What the list of an earlier run says of its files.
#[derive(Debug, Default)]
pub(crate) struct EarlierList(HashMap<String, EarlierRow>);

#[derive(Debug, Deserialize)]
struct EarlierRow {
    command: String,
    file: String,
    /// The digest of the capture: what was reported of another one is not known of this.
    #[serde(default)]
    sha256: Option<String>,
    findings: Vec<String>,
    error: Option<String>,
}

impl EarlierList {
    /// The list that is there; none is empty.
    ///
    /// # Errors
    /// [`Error::Data`]: a file is there that is no such list.
    pub(crate) fn read(path: &Path) -> Result<EarlierList> {
        if path.symlink_metadata().is_err() {
            return Ok(EarlierList::default());
        }
        let text = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        let rows: Option<Vec<EarlierRow>> = serde_json::from_slice(&text).ok();
        let rows = rows.filter(|rows| rows.iter().all(|row| row.command == "clean"));
        let rows = rows.ok_or_else(|| {
            let what = "is there and is no list of clean; move it, or give another place with the \
                        option `page`";
            Error::data(Place::file(path.display().to_string()), what)
        })?;
        let named = rows.into_iter().map(|row| (row.file.clone(), row));
        Ok(EarlierList(named.collect()))
    }

    /// Whether a capture had this finding.
    pub(crate) fn has(&self, file: &str, sha256: Option<&str>, finding: &str) -> bool {
        let row = self.row(file, sha256);
        row.is_some_and(|row| row.findings.iter().any(|f| f == finding))
    }

    /// Whether a capture failed in the same way.
    pub(crate) fn has_failure(&self, file: &str, sha256: Option<&str>, error: &str) -> bool {
        let row = self.row(file, sha256);
        row.is_some_and(|row| row.error.as_deref() == Some(error))
    }

    fn row(&self, file: &str, sha256: Option<&str>) -> Option<&EarlierRow> {
        let row = self.0.get(file)?;
        (row.sha256.as_deref() == sha256).then_some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_somebody_else_is_refused() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("clean.json");
        assert!(EarlierList::read(&path).is_ok());
        for other in [
            "{}",
            "[1]",
            "x",
            "[{\"command\": \"rm\", \"file\": \"a\", \"findings\": []}]",
        ] {
            std::fs::write(&path, other)?;
            assert!(EarlierList::read(&path).is_err(), "{other}");
        }
        let own = "[{\"command\": \"clean\", \"file\": \"a.csv\", \"sha256\": \"1f\", \
                   \"findings\": [\"x\"], \"error\": null}]";
        std::fs::write(&path, own)?;
        let list = EarlierList::read(&path).unwrap();
        let has = |file, sha256, finding| list.has(file, Some(sha256), finding);
        assert!(has("a.csv", "1f", "x") && !has("a.csv", "1f", "y") && !has("b.csv", "1f", "x"));
        assert!(!has("a.csv", "20", "x") && !list.has("a.csv", None, "x"));
        assert!(!list.has_failure("a.csv", Some("1f"), "x"));
        Ok(())
    }
}
