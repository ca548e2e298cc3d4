//! Files of what is done in takes, and by whom: `take,class,subject`.

use super::csv_file::CsvFile;
use crate::io::text::excerpt;
use crate::{Error, Place, Result};
use std::collections::HashMap;
use std::path::Path;

/// What a take is.
#[derive(Debug, Clone)]
pub struct TakeClass {
    take: String,
    /// What is done in it.
    pub class: String,
    subject: Option<String>,
}

impl TakeClass {
    /// Who does it: the subject that is given, or the take's name up to the first `_`.
    pub fn subject(&self) -> &str {
        let given = self.subject.as_deref().filter(|s| !s.is_empty());
        given.unwrap_or(self.take.split('_').next().unwrap_or(&self.take))
    }
}

/// Reads what takes are, by their names.
///
/// # Errors
/// [`Error::Data`], with the line: the file cannot be read, a column is missing, or a take has two
/// classes.
pub fn read(path: &Path) -> Result<HashMap<String, TakeClass>> {
    let mut file = CsvFile::open(path)?;
    let source = file.name.clone();
    let needed = |name| file.needed(name, "take,class,subject");
    let (take, class) = (needed("take")?, needed("class")?);
    let subject = file.column("subject");
    let mut classes: HashMap<String, TakeClass> = HashMap::new();
    for row in file.rows() {
        let (line, row) = row?;
        let own = TakeClass {
            take: row[take].to_string(),
            class: row[class].to_string(),
            subject: subject.map(|c| row[c].to_string()),
        };
        let before = classes.insert(own.take.clone(), own.clone());
        if before.is_some_and(|before| before.class != own.class) {
            let what = format!("gives take \"{}\" a second class", excerpt(&own.take));
            return Err(Error::data(Place::line(&source, line), what));
        }
    }
    Ok(classes)
}
