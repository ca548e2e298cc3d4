//! The input of commands: files or standard input, tables row by row or whole, models.

use super::args::InputArgs;
use super::messages;
use crate::io::input::take_name;
use crate::io::{Columns, PosesBuilder, Row, RowReader, Table, deviations};
use crate::io::{Input, Model};
use crate::numeric::statistics::span;
use crate::pose::units::Units;
use crate::prior::builtin_model;
use crate::{Error, Place, Result};
use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The remedy of commands that read centimeters alone.
pub(crate) const IN_CENTIMETERS: &str =
    "this command reads centimeters (posing trim converts: --units m --out-units cm)";

/// Opens a file, or standard input for `-`.
pub fn open(path: &Path) -> Result<Input> {
    if path == Path::new("-") {
        Input::new("standard input", io::stdin())
    } else {
        Input::open(path)
    }
}

/// Reads a model from a file or, for `-`, from standard input.
pub fn open_model(path: &Path) -> Result<Model> {
    Model::read(open(path)?)
}

/// Reads the model that is named, else the built-in one; with its name in messages.
pub fn open_model_or_builtin(path: Option<&Path>) -> Result<(Model, String)> {
    Ok(match path {
        Some(path) => (open_model(path)?, path.display().to_string()),
        None => (builtin_model()?, "the built-in model".to_string()),
    })
}

/// Fails if two of the paths are standard input (`-`).
pub fn check_single_stdin<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<()> {
    match paths.into_iter().filter(|p| *p == Path::new("-")).count() {
        0 | 1 => Ok(()),
        _ => Err(Error::usage(
            "standard input (-) is needed more than once; use files for the others",
        )),
    }
}

/// Fails if a table and another file would both be read from standard input, the input of a table
/// without files.
pub fn check_single_stdin_with<'a>(
    table: &'a InputArgs,
    others: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<()> {
    let mut paths = or_stdin(&table.files);
    paths.extend(others.into_iter().cloned());
    check_single_stdin(&paths)
}

/// Rows of several tables with the same columns, one after another.
pub struct RowStream<'a> {
    flags: &'a InputArgs,
    planar: bool,
    cells: bool,
    rest: std::vec::IntoIter<PathBuf>,
    /// The take's name of the file being read.
    take: Arc<str>,
    takes: TakeNames,
    reader: RowReader,
    columns: Columns,
    /// The unit and the axis of the file being read.
    units: Units,
    /// Whether the size of its first whole frame is still to be looked at.
    is_unmeasured: bool,
}

impl<'a> RowStream<'a> {
    /// Opens the first of the files (standard input when there is none).
    pub fn open(flags: &'a InputArgs, planar: bool, cells: bool) -> Result<RowStream<'a>> {
        check_single_stdin(&flags.files)?;
        let first = or_stdin(&flags.files).into_iter().next();
        let first = open(&first.unwrap_or_default())?;
        RowStream::beginning_with(first, flags, planar, cells)
    }

    /// Reads the first of the files, which is opened, and then the others.
    fn beginning_with(
        input: Input,
        flags: &'a InputArgs,
        planar: bool,
        cells: bool,
    ) -> Result<RowStream<'a>> {
        let mut rest = or_stdin(&flags.files).into_iter();
        let first = rest.next().unwrap_or_default();
        let mut takes = TakeNames::default();
        let take = takes.next(&first);
        let reader = RowReader::new(input, &flags.options(planar, cells)?)?;
        let columns = reader.columns().clone();
        Ok(RowStream {
            units: units_of(&reader, flags),
            is_unmeasured: is_without_unit(&reader, flags),
            flags,
            planar,
            cells,
            rest,
            take,
            takes,
            reader,
            columns,
        })
    }

    /// The columns of the tables.
    pub fn columns(&self) -> &Columns {
        &self.columns
    }

    /// The name of the file being read.
    pub fn name(&self) -> &str {
        self.reader.name()
    }

    /// Says once where a frame in centimeters would be a body of no size.
    fn check_size(&mut self, xyz: &[f64]) {
        let Some(size) = extent(xyz).filter(|_| self.is_unmeasured) else {
            return;
        };
        self.is_unmeasured = false;
        if size > 0.0 && size < SMALL_BODY {
            messages::info(&format!(
                "{}: its points span {size:.2} cm, as its unit is not known; if it is meters, \
                 give --units m, or convert it with posing trim",
                self.name()
            ));
        }
    }

    /// The next frame, in centimeters, y up; `false` at the end of the last file.
    pub fn read(&mut self, row: &mut Row) -> Result<bool> {
        while !self.reader.read(row)? {
            let Some(next) = self.rest.next() else {
                return Ok(false);
            };
            self.take = self.takes.next(&next);
            self.reader =
                RowReader::new(open(&next)?, &self.flags.options(self.planar, self.cells)?)?;
            self.units = units_of(&self.reader, self.flags);
            self.is_unmeasured = is_without_unit(&self.reader, self.flags);
            if self.reader.columns() != &self.columns {
                let what = format!("has other columns than {}", self.flags.files[0].display());
                return Err(Error::data(Place::file(self.reader.name()), what));
            }
        }
        if self.is_unmeasured {
            self.check_size(&row.xyz);
        }
        self.units.read(&mut row.xyz);
        Ok(true)
    }
}

/// The unit and the axis of a table: the flags', else those of an archive that has them by custom
/// (AMASS), else centimeters, y up.
fn units_of(reader: &RowReader, flags: &InputArgs) -> Units {
    let given = flags.table_units();
    let Some(take) = reader.take() else {
        return given;
    };
    let said = |note: &String| messages::info(&format!("{}: {note}", take.name));
    take.notes.iter().for_each(said);
    Units {
        unit: flags.units.or(take.unit()).unwrap_or(given.unit),
        up: flags.axes.or(take.up_axis().unwrap_or(given.up)),
    }
}

/// Whether it is an array whose unit nothing says: a body in meters would become one of 1.8 cm.
fn is_without_unit(reader: &RowReader, flags: &InputArgs) -> bool {
    let says_none = match reader {
        RowReader::Csv(_) => false,
        RowReader::Npy(_) => true,
        RowReader::Npz(_) => reader.take().is_some_and(|take| take.units.is_none()),
    };
    says_none && flags.units.is_none() && reader.columns().points.len() >= FEW_POINTS
}

/// Fewer points are no body.
const FEW_POINTS: usize = 5;
/// A body smaller than this, cm, is not in centimeters.
const SMALL_BODY: f64 = 5.0;

/// The largest extent of a frame; `None` where a value is missing.
fn extent(xyz: &[f64]) -> Option<f64> {
    let along = |axis: usize| span(xyz.iter().skip(axis).step_by(3).copied());
    let is_whole = xyz.iter().all(|v| v.is_finite());
    is_whole.then(|| (0..3).map(along).fold(0.0, f64::max))
}

/// The files, or standard input (`-`) if there are none.
pub fn or_stdin(files: &[PathBuf]) -> Vec<PathBuf> {
    match files {
        [] => vec![PathBuf::from("-")],
        files => files.to_vec(),
    }
}

/// A name has at most so many `'`; then it is numbered.
const MOST_QUOTES: usize = 8;

/// The names of several files as takes: files of one name in several folders are several takes.
#[derive(Debug, Default)]
pub struct TakeNames {
    taken: HashSet<Arc<str>>,
    /// How many files of a name there were before.
    before: HashMap<String, usize>,
}

impl TakeNames {
    /// The name of the next file: [`take_name`], with a `'` for each file before that has it; after
    /// more than eight, with their number.
    pub fn next(&mut self, file: &Path) -> Arc<str> {
        self.distinct(take_name(file))
    }

    /// A name, made distinct likewise.
    pub(super) fn distinct(&mut self, own: String) -> Arc<str> {
        let before = self.before.entry(own.clone()).or_default();
        loop {
            let name: Arc<str> = match *before {
                n @ 0..=MOST_QUOTES => format!("{own}{}", "'".repeat(n)),
                n => format!("{own}'{n}"),
            }
            .into();
            *before += 1;
            if self.taken.insert(name.clone()) {
                return name;
            }
        }
    }
}

/// Reads whole tables, one after another, into one.
pub fn read_table(flags: &InputArgs, planar: bool, cells: bool) -> Result<Table> {
    whole_table(RowStream::open(flags, planar, cells)?, flags, cells)
}

/// Reads whole tables into one, of which the first is opened.
pub fn read_opened_table(input: Input, flags: &InputArgs) -> Result<Table> {
    let stream = RowStream::beginning_with(input, flags, false, false)?;
    whole_table(stream, flags, false)
}

fn whole_table(mut stream: RowStream<'_>, flags: &InputArgs, cells: bool) -> Result<Table> {
    let columns = stream.columns().clone();
    let name = stream.name().to_string();
    let (mut builder, mut kept, mut row) =
        (PosesBuilder::new(&columns), Vec::new(), Row::default());
    // Without takes and times, each of several files is a take.
    let has_takes = columns.take.is_some() || columns.time.is_some() || flags.files.len() < 2;
    let mut files: Vec<Arc<str>> = Vec::new();
    while stream.read(&mut row)? {
        if !has_takes {
            files.push(stream.take.clone());
        }
        builder.push(&row);
        if cells {
            kept.push(std::mem::take(&mut row.cells));
        }
    }
    let mut poses = builder.finish();
    if !has_takes {
        poses.take = Some(files);
    }
    let centimeters = flags.table_units().unit.centimeters();
    Ok(Table {
        name,
        sd: deviations(&columns, &kept, centimeters),
        columns,
        poses,
        cells: kept,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_one_name_are_several_takes() {
        let mut names = TakeNames::default();
        let mut next = |file: &str| names.next(Path::new(file)).to_string();
        let files = [
            "a/walk.csv",
            "b/walk.csv",
            "walk'.csv",
            "c/walk.amc",
            "run.csv",
        ];
        let walks = files.map(&mut next);
        assert_eq!(walks, ["walk", "walk'", "walk''", "walk'''", "run"]);
        // Names of many takes do not grow.
        let many: HashSet<String> = (0..20_000).map(|_| next("walk.csv")).collect();
        assert_eq!(many.len(), 20_000);
        assert!(
            many.iter()
                .all(|name| name.len() <= "walk".len() + MOST_QUOTES)
        );
        assert!(many.contains("walk'20000"));
    }
}
