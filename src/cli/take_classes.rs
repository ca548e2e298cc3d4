//! Files of what is done in takes, and by whom: `take,class,subject`.

use super::input;
use crate::io::csv::csv_fault;
use crate::io::text::excerpt;
use crate::{Error, Place, Result};
use serde::Deserialize;
use std::collections::HashMap;
use std::path::Path;

/// What a take is.
#[derive(Debug, Deserialize)]
pub struct TakeClass {
    take: String,
    /// What is done in it.
    pub class: String,
    #[serde(default)]
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
    let file = input::open(path)?;
    let source = file.name.clone();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(file.into_reader());
    let mut classes: HashMap<String, TakeClass> = HashMap::new();
    let head = reader.headers().cloned();
    let head = head.map_err(|e| csv_fault(&source, &e))?;
    for name in ["take", "class"] {
        if !head.iter().any(|h| h == name) {
            let what = format!("has no column {name}; expected take,class,subject");
            return Err(Error::data(Place::line(&source, 1), what));
        }
    }
    for (k, line) in reader.deserialize().enumerate() {
        let number = k as u64 + 2;
        let line: TakeClass = line.map_err(|e| csv_fault(&source, &e))?;
        let before = classes.get(&line.take).map(|c| c.class.clone());
        if before.is_some_and(|class| class != line.class) {
            let what = format!("gives take \"{}\" a second class", excerpt(&line.take));
            return Err(Error::data(Place::line(&source, number), what));
        }
        classes.insert(line.take.clone(), line);
    }
    Ok(classes)
}
