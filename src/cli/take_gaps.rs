//! Gaps in the takes of a table that is read row by row: one take is held at a time.

use super::args::InputArgs;
use super::input::RowStream;
use super::messages;
use crate::evaluate::gap_injection::{GapInjection, frames_in};
use crate::io::{Row, TableWriter};
use crate::pose::Poses;
use crate::{Error, Place, Result};
use ndarray::Array2;

/// The gaps of each take, and the take that is being read.
pub struct TakeGaps<'a> {
    /// Gaps in each take.
    pub count: usize,
    /// Length of a gap, seconds.
    pub seconds: f64,
    /// Points in a gap.
    pub points: usize,
    /// Seed of the random choice.
    pub seed: u64,
    /// The flags that give the rate.
    pub input: &'a InputArgs,
    /// What was read of the last take.
    pub take: TakeBuffer,
}

/// A take that is not written yet, and counts of the takes before it.
#[derive(Default)]
pub struct TakeBuffer {
    /// Its frames as they were read.
    rows: Vec<Row>,
    /// Their coordinates with noise and hidden points, frame by frame.
    xyz: Vec<f64>,
    /// Takes written.
    count: u64,
    /// Takes written without a gap, because they are shorter than one.
    too_short: u64,
}

impl TakeGaps<'_> {
    /// Adds a frame; writes the take before it where the frame starts another.
    ///
    /// # Errors
    /// When the gaps do not fit, or a row cannot be written.
    pub fn push(
        &mut self,
        row: &Row,
        xyz: Vec<f64>,
        table: &RowStream,
        sink: &mut TableWriter,
    ) -> Result<()> {
        let last = self.take.rows.last();
        if last.is_some_and(|last| last.take != row.take) {
            self.write_take(table, sink)?;
        }
        self.take.xyz.extend(xyz);
        self.take.rows.push(row.clone());
        Ok(())
    }

    /// Writes the last take.
    ///
    /// # Errors
    /// As [`push`](Self::push), and when no take is as long as a gap.
    pub fn finish(&mut self, table: &RowStream, sink: &mut TableWriter) -> Result<()> {
        self.write_take(table, sink)?;
        if self.take.count > 0 && self.take.too_short == self.take.count {
            let what = "no take is as long as a gap; use a shorter --length";
            return Err(Error::data(Place::file(table.name()), what));
        }
        Ok(())
    }

    /// Cuts the gaps into the take and writes it.
    fn write_take(&mut self, table: &RowStream, sink: &mut TableWriter) -> Result<()> {
        let rows = std::mem::take(&mut self.take.rows);
        let Some(take) = rows.first().map(|row| row.take.clone()) else {
            return Ok(());
        };
        let mut poses = Poses {
            points: table.columns().points.clone(),
            xyz: Array2::from_shape_vec(
                (rows.len(), table.columns().width()),
                std::mem::take(&mut self.take.xyz),
            )
            .unwrap_or_default(),
            time: rows.iter().map(|row| row.time).collect(),
            take: None,
        };
        let take = take.map_or("the table".into(), |take| format!("take \"{take}\""));
        let short =
            |why: String| messages::info(&format!("{}: {take} gets no gap: {why}", table.name()));
        let index = self.take.count;
        self.take.count += 1;
        if let Some(rate) = self.input.rate(&poses)? {
            let gaps = GapInjection {
                count: self.count,
                frames: frames_in(self.seconds, rate)?,
                points: self.points,
                seed: self.seed,
            };
            let laid = gaps.inject(&mut poses, index)?;
            let (fit, frames) = (laid.gaps.len(), gaps.frames);
            if laid.longest < frames {
                self.take.too_short += 1;
                let longest = laid.longest;
                short(format!(
                    "its longest run has {longest} frames, a gap has {frames}"
                ));
            } else if fit < self.count {
                let what = format!(
                    "{take}: only {fit} of {} gaps of {frames} frames in {} points fit; use fewer --gaps, a shorter --length or fewer --points",
                    self.count, self.points
                );
                return Err(Error::data(Place::file(table.name()), what));
            }
        } else {
            self.take.too_short += 1;
            short("its times give no frame rate".into());
        }
        for (row, xyz) in rows.iter().zip(poses.xyz.rows()) {
            sink.write(row, &xyz.to_vec(), &[])?;
        }
        Ok(())
    }
}
