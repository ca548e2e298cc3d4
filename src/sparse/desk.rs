//! Poses of a batch shared among threads, each with a desk of its own.

use super::fit::Fit;
use super::group::Group;
use super::scan::Leaves;
use super::tile::{POSES, Tile};
use super::{Codes, Dictionary, Pursuit};
use crate::{Error, Place, Result, par};
use ndarray::{ArrayView2, Axis};

/// Poses that a desk is given at once: many share what is made ready for them, but their fits should stay in the cache.
const CHUNK: usize = 512;
/// But at least so many, whole groups.
const LEAST: usize = 64;
/// Chunks a thread at least, where there are poses enough: threads are not equally fast.
const CHUNKS: usize = 8;
/// Tiles that a desk is given at once.
const TILES: usize = 32;

/// Poses that are coded with one dictionary.
pub(super) struct Batch<'a> {
    pub dictionary: &'a Dictionary,
    pub pursuit: Pursuit,
    /// The atoms, where they are searched by bounds.
    pub leaves: Option<&'a Leaves>,
    /// (m, D)
    pub poses: ArrayView2<'a, f32>,
    pub weights: Option<ArrayView2<'a, f32>>,
}

impl<'a> Batch<'a> {
    /// Codes the poses of some rows, none of them with weights that differ, by bounds. Gives the rows of which bounds tell too
    /// little.
    pub fn by_bounds(&self, rows: &[u32], codes: &mut Codes) -> Result<Vec<u32>> {
        let places = self.share(rows, LEAST, CHUNK, |desk, rows| desk.places(rows))?;
        let mut order: Vec<(u32, u32)> = places.into_iter().flatten().zip(rows.to_vec()).collect();
        // Neighbouring poses look into the same leaves.
        order.sort_unstable();
        let order: Vec<u32> = order.into_iter().map(|(_, row)| row).collect();
        let parts = self.share(&order, LEAST, CHUNK, |desk, rows| desk.by_bounds(rows))?;
        let mut left = Vec::new();
        let mut from = 0;
        for (part, unpruned) in parts {
            codes.put(&order[from..from + part.len()], &part);
            from += part.len();
            left.extend(unpruned);
        }
        left.sort_unstable();
        Ok(left)
    }

    /// Codes the poses of some rows by scans.
    pub fn by_scans(&self, rows: &[u32], codes: &mut Codes) -> Result<()> {
        // Several tiles share what is made ready for them.
        let parts = self.share(rows, POSES, POSES * TILES, |desk, rows| desk.by_scans(rows))?;
        let mut from = 0;
        for part in parts {
            codes.put(&rows[from..from + part.len()], &part);
            from += part.len();
        }
        Ok(())
    }

    /// Shares rows among threads: `least` to `most` of them at a time, a multiple of the former.
    fn share<T: Send>(
        &self,
        rows: &[u32],
        least: usize,
        most: usize,
        work: impl Fn(&mut Desk<'_, 'a>, &[u32]) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let share = rows.len() / (CHUNKS * rayon::current_num_threads());
        let chunk = (share - share % least).clamp(least, most.max(least));
        let desk = || Desk::new(self);
        let work = |desk: &mut Desk<'_, 'a>, part: std::ops::Range<usize>| work(desk, &rows[part]);
        par::map_chunks_at(rows.len(), chunk, desk, work)
            .into_iter()
            .collect()
    }
}

/// What one thread codes with, made once for many chunks.
struct Desk<'b, 'a> {
    batch: &'b Batch<'a>,
    /// Made where poses are sought for by bounds.
    group: Option<Group<'a>>,
    /// Made where poses are scanned.
    tile: Option<Tile<'a>>,
    fits: Vec<Fit>,
}

impl<'b, 'a> Desk<'b, 'a> {
    fn new(batch: &'b Batch<'a>) -> Self {
        Desk {
            batch,
            group: (batch.leaves)
                .map(|leaves| Group::new(batch.dictionary, leaves, batch.pursuit.rule)),
            tile: None,
            fits: Vec::new(),
        }
    }

    /// Starts on the poses of some rows.
    fn start(&mut self, rows: &[u32]) -> Result<()> {
        let Batch {
            dictionary,
            pursuit,
            poses,
            weights,
            ..
        } = self.batch;
        let new = || Fit::new(pursuit.capacity(dictionary), dictionary.width());
        self.fits.resize_with(rows.len(), new);
        for (row, fit) in rows.iter().zip(&mut self.fits) {
            let i = *row as usize;
            let weights = weights.as_ref().map(|w| w.index_axis(Axis(0), i));
            fit.start(poses.row(i), weights, pursuit.tolerance)
                .map_err(|what| Error::data(Place::line("poses", i as u64 + 1), what))?;
        }
        Ok(())
    }

    /// Where each pose of some rows is among the atoms.
    fn places(&mut self, rows: &[u32]) -> Result<Vec<u32>> {
        self.start(rows)?;
        Ok(match &mut self.group {
            Some(group) => group.places(&self.fits),
            None => vec![0; rows.len()],
        })
    }

    fn by_bounds(&mut self, rows: &[u32]) -> Result<(Codes, Vec<u32>)> {
        self.start(rows)?;
        let mut unpruned = Vec::new();
        match &mut self.group {
            Some(group) => group.code(&mut self.fits, self.batch.pursuit.sparsity, &mut unpruned),
            None => unpruned.extend(0..rows.len()),
        }
        let k = self.batch.pursuit.capacity(self.batch.dictionary);
        let (mut codes, mut x) = (Codes::empty(rows.len(), k), vec![0.0; k]);
        for (i, fit) in self.fits.iter().enumerate() {
            codes.set(i, fit, &mut x);
        }
        Ok((codes, unpruned.into_iter().map(|i| rows[i]).collect()))
    }

    fn by_scans(&mut self, rows: &[u32]) -> Result<Codes> {
        let Batch {
            dictionary,
            pursuit,
            ..
        } = self.batch;
        let room = POSES.min(rows.len());
        if self.tile.as_ref().is_none_or(|t| t.poses() < room) {
            self.tile = Some(Tile::new(dictionary, pursuit.rule, room));
        }
        let k = pursuit.capacity(dictionary);
        let (mut codes, mut x) = (Codes::empty(rows.len(), k), vec![0.0; k]);
        let mut i = 0;
        for few in rows.chunks(room.max(1)) {
            self.start(few)?;
            if let Some(tile) = &mut self.tile {
                tile.code(&mut self.fits, pursuit.sparsity);
            }
            for fit in &self.fits {
                codes.set(i, fit, &mut x);
                i += 1;
            }
        }
        Ok(codes)
    }
}
