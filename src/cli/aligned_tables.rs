//! Tables of the same frames, read in step.

use super::args::InputArgs;
use super::input::{RowStream, check_single_stdin};
use crate::io::Row;
use crate::pose::{KnownRates, Poses};
use crate::{Error, Place, Result};
use std::collections::HashMap;
use std::sync::Arc;

/// From so many frames of a take its rate is told: tables are read in constant memory.
const RATE_FRAMES: usize = 1024;

/// Times that differ by no more are the same, in seconds: other tools round them.
const SAME_TIME: f64 = 1e-4;

/// Tables with the same frames, one frame of each at a time, in constant memory.
///
/// Points are matched by name: all come in the first table's order. Where two tables tell a frame's take or time, they
/// must agree. A table of 2-D points has no z.
pub struct AlignedTables<'a> {
    tables: Vec<Table<'a>>,
    points: Vec<String>,
    frames: u64,
}

struct Table<'a> {
    stream: RowStream<'a>,
    row: Row,
    /// Where each of the first table's points stands in this one.
    order: Vec<usize>,
}

/// Frames that come one at a time, each given on with the rate of its take.
struct TakeRates<R, P> {
    rate: R,
    put: P,
    met: KnownRates,
    /// The first frames of a take, until its rate is known.
    first: Vec<AlignedFrame>,
    known: Option<Option<f64>>,
    last_take: Option<Option<Arc<str>>>,
}

impl<R: Fn(&Poses) -> Result<Option<f64>>, P: FnMut(&AlignedFrame, Option<f64>)> TakeRates<R, P> {
    /// Meets the rates of the takes that come first, of the longest before those of shorter ones.
    fn learn(&mut self, first: &[AlignedFrame]) -> Result<()> {
        let mut takes: Vec<&[AlignedFrame]> = first.chunk_by(|a, b| a.take == b.take).collect();
        takes.sort_by_key(|take| std::cmp::Reverse(take.len()));
        takes
            .into_iter()
            .try_for_each(|take| self.of(take).map(drop))
    }

    /// The rate of a take with these frames.
    fn of(&mut self, take: &[AlignedFrame]) -> Result<Option<f64>> {
        let clock = Poses::without_points(take.iter().map(|s| (s.time, s.take.clone())));
        let Some(own) = (self.rate)(&clock)? else {
            return Ok(None);
        };
        let allows = |rate| clock.is_consistent_with_rate(0..take.len(), rate);
        Ok(Some(self.met.reconcile(own, allows)))
    }

    fn add(&mut self, step: &AlignedFrame) -> Result<()> {
        if self
            .last_take
            .as_ref()
            .is_some_and(|take| *take != step.take)
        {
            self.tell()?;
            self.known = None;
        }
        self.last_take = Some(step.take.clone());
        match self.known {
            Some(rate) => (self.put)(step, rate),
            None => self.first.push(step.clone()),
        }
        if self.first.len() == RATE_FRAMES {
            self.known = Some(self.tell()?);
        }
        Ok(())
    }

    /// Gives on the first frames of a take; their rate.
    fn tell(&mut self) -> Result<Option<f64>> {
        let first = std::mem::take(&mut self.first);
        let rate = self.of(&first)?;
        first.iter().for_each(|step| (self.put)(step, rate));
        Ok(rate)
    }
}

/// A frame of every table.
#[derive(Debug, Clone, Default)]
pub struct AlignedFrame {
    /// A table each: three numbers a point, NaN is missing.
    pub xyz: Vec<Vec<f64>>,
    /// Seconds, from the first table that tells.
    pub time: Option<f64>,
    /// The take, from the first table that tells.
    pub take: Option<Arc<str>>,
}

impl<'a> AlignedTables<'a> {
    /// Opens the tables (each of one file, or standard input).
    ///
    /// # Errors
    /// When one cannot be read, or lacks a point of the first.
    pub fn open(inputs: &'a [InputArgs]) -> Result<AlignedTables<'a>> {
        check_single_stdin(inputs.iter().flat_map(|t| &t.files))?;
        let mut points = Vec::new();
        let mut tables: Vec<Table> = Vec::new();
        for input in inputs {
            let stream = RowStream::open(input, true, true)?;
            let order = match tables.first() {
                None => {
                    points = stream.columns().points.clone();
                    (0..points.len()).collect()
                }
                Some(first) => order(&points, first.stream.name(), &stream)?,
            };
            tables.push(Table {
                stream,
                row: Row::default(),
                order,
            });
        }
        Ok(AlignedTables {
            tables,
            points,
            frames: 0,
        })
    }

    /// The points, in the first table's order.
    pub fn points(&self) -> &[String] {
        &self.points
    }

    /// For each table its name and how many points it has that the first has not; those are left out.
    pub fn left_out(&self) -> impl Iterator<Item = (&str, usize)> {
        let more = |t: &Table| t.stream.columns().points.len() - self.points.len();
        self.tables.iter().map(move |t| (t.stream.name(), more(t)))
    }

    /// The next frame of every table; `false` when all end here.
    ///
    /// # Errors
    /// When a table cannot be read, ends before another, or tells another take or time.
    pub fn read(&mut self, step: &mut AlignedFrame) -> Result<bool> {
        let mut ended = Vec::new();
        for table in &mut self.tables {
            ended.push(!table.stream.read(&mut table.row)?);
        }
        if ended.contains(&true) {
            return self.end(&ended);
        }
        self.frames += 1;
        step.xyz.resize(self.tables.len(), Vec::new());
        for (table, xyz) in self.tables.iter().zip(&mut step.xyz) {
            xyz.clear();
            for &point in &table.order {
                xyz.extend_from_slice(&table.row.xyz[3 * point..3 * point + 3]);
            }
        }
        step.take = self.agreed(|row| row.take.clone(), |a, b| a == b, "take")?;
        step.time = self.agreed(|r| r.time, |a, b| (a - b).abs() <= SAME_TIME, "time")?;
        Ok(true)
    }

    /// Gives each frame of every table to `put`, with the rate of its take: `rate` tells that by the times of a take's first
    /// frames, of which 1,024 at most are kept. Of few frames rounded times tell a rate badly: where they allow one
    /// that was met, that is theirs.
    ///
    /// # Errors
    /// As [`read`](AlignedTables::read) gives, or `rate`.
    pub fn for_each_with_rate(
        &mut self,
        rate: impl Fn(&Poses) -> Result<Option<f64>>,
        put: impl FnMut(&AlignedFrame, Option<f64>),
    ) -> Result<()> {
        let mut step = AlignedFrame::default();
        let mut first = Vec::new();
        while first.len() < RATE_FRAMES && self.read(&mut step)? {
            first.push(step.clone());
        }
        let has_more = first.len() == RATE_FRAMES;
        let mut rated = TakeRates {
            rate,
            put,
            met: KnownRates::default(),
            first: Vec::new(),
            known: None,
            last_take: None,
        };
        rated.learn(&first)?;
        for step in &first {
            rated.add(step)?;
        }
        while has_more && self.read(&mut step)? {
            rated.add(&step)?;
        }
        rated.tell().map(drop)
    }

    /// All must end together.
    fn end(&self, ended: &[bool]) -> Result<bool> {
        let short = ended.iter().position(|e| *e).unwrap_or(0);
        let Some(long) = ended.iter().position(|e| !*e) else {
            return Ok(false);
        };
        let [short, long] = [short, long].map(|i| self.tables[i].stream.name());
        let frames = self.frames;
        Err(Error::data(
            Place::file(short),
            format!(
                "ends after {frames} frames, before {long}; the tables must have the same frames"
            ),
        ))
    }

    /// What the first table that tells of it says, after asking that the others say the same.
    fn agreed<T: std::fmt::Display>(
        &self,
        of: impl Fn(&Row) -> Option<T>,
        same: impl Fn(&T, &T) -> bool,
        what: &str,
    ) -> Result<Option<T>> {
        let mut told: Option<(&Table, T)> = None;
        for table in &self.tables {
            let Some(value) = of(&table.row) else {
                continue;
            };
            match &told {
                None => told = Some((table, value)),
                Some((first, known)) if !same(known, &value) => {
                    let other = self.place(first);
                    return Err(Error::data(
                        self.place(table).part(what),
                        format!(
                            "is \"{value}\", but \"{known}\" in {other}; the tables must have the same frames"
                        ),
                    ));
                }
                Some(_) => {}
            }
        }
        Ok(told.map(|(_, value)| value))
    }

    /// The line a table was last read at.
    fn place(&self, table: &Table) -> Place {
        let line = table.row.cells.line();
        Place {
            line,
            ..Place::file(table.stream.name())
        }
    }
}

/// Where the points stand in a table.
fn order(points: &[String], first: &str, stream: &RowStream) -> Result<Vec<usize>> {
    let own = stream.columns().points.iter().enumerate();
    let own: HashMap<&str, usize> = own.map(|(i, p)| (p.as_str(), i)).collect();
    let find = |point: &String| {
        own.get(point.as_str()).copied().ok_or_else(|| {
            let what = format!("lacks the point \"{point}\" of {first}");
            Error::data(Place::file(stream.name()), what)
        })
    };
    points.iter().map(find).collect()
}
