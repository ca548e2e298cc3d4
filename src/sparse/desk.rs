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
    /// (m, D)
    pub poses: ArrayView2<'a, f32>,
    pub weights: Option<ArrayView2<'a, f32>>,
}

impl Batch<'_> {
    /// Codes the poses of some rows, none of them with weights that differ, by bounds. Gives the rows of which bounds tell too
    /// little.
    pub fn by_bounds(&self, leaves: &Leaves, rows: &[u32], codes: &mut Codes) -> Result<Vec<u32>> {
        let desk = || {
            let group = Group::new(self.dictionary, leaves, self.pursuit.rule);
            (group, Vec::new())
        };
        let places = share(rows, LEAST, CHUNK, desk, |(group, fits), rows| {
            self.start(fits, rows)?;
            Ok(group.places(fits))
        })?;
        let mut order: Vec<(u32, u32)> = (places.into_iter().flatten().zip(rows))
            .map(|(place, row)| (place, *row))
            .collect();
        // Neighbouring poses look into the same leaves.
        order.sort_unstable();
        let order: Vec<u32> = order.into_iter().map(|(_, row)| row).collect();
        let parts = share(&order, LEAST, CHUNK, desk, |(group, fits), rows| {
            self.start(fits, rows)?;
            let mut unpruned = Vec::new();
            group.code(fits, self.pursuit.sparsity, &mut unpruned);
            let unpruned: Vec<u32> = unpruned.into_iter().map(|i| rows[i]).collect();
            Ok((self.codes(fits), unpruned))
        })?;
        let (parts, left): (Vec<Codes>, Vec<Vec<u32>>) = parts.into_iter().unzip();
        codes.put_parts(&order, &parts);
        let mut left = left.concat();
        left.sort_unstable();
        Ok(left)
    }

    /// Codes the poses of some rows by scans.
    pub fn by_scans(&self, rows: &[u32], codes: &mut Codes) -> Result<()> {
        let room = POSES.min(rows.len());
        let desk = || {
            let tile = Tile::new(self.dictionary, self.pursuit.rule, room);
            (tile, Vec::new())
        };
        // Several tiles share what is made ready for them.
        let parts = share(rows, POSES, POSES * TILES, desk, |(tile, fits), rows| {
            let tiles = rows.chunks(room).map(|few| {
                self.start(fits, few)?;
                tile.code(fits, self.pursuit.sparsity);
                Ok(self.codes(fits))
            });
            tiles.collect::<Result<Vec<Codes>>>()
        })?;
        codes.put_parts(rows, &parts.concat());
        Ok(())
    }

    /// Starts on the poses of some rows.
    fn start(&self, fits: &mut Vec<Fit>, rows: &[u32]) -> Result<()> {
        let (dictionary, pursuit) = (self.dictionary, &self.pursuit);
        let new = || Fit::new(pursuit.capacity(dictionary), dictionary.width());
        fits.resize_with(rows.len(), new);
        for (row, fit) in rows.iter().zip(fits) {
            let i = *row as usize;
            let weights = self.weights.as_ref().map(|w| w.index_axis(Axis(0), i));
            fit.start(self.poses.row(i), weights, pursuit.tolerance)
                .map_err(|what| Error::data(Place::line("poses", i as u64 + 1), what))?;
        }
        Ok(())
    }

    /// What was found for some poses.
    fn codes(&self, fits: &[Fit]) -> Codes {
        let k = self.pursuit.capacity(self.dictionary);
        let (mut codes, mut x) = (Codes::empty(fits.len(), k), vec![0.0; k]);
        for (i, fit) in fits.iter().enumerate() {
            codes.set(i, fit, &mut x);
        }
        codes
    }
}

/// Shares rows among threads, each with a desk of its own: `least` to `most` rows at a time, a multiple of the former.
fn share<D: Send, T: Send>(
    rows: &[u32],
    least: usize,
    most: usize,
    desk: impl Fn() -> D + Sync,
    work: impl Fn(&mut D, &[u32]) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let share = rows.len() / (CHUNKS * rayon::current_num_threads());
    let chunk = (share - share % least).clamp(least, most);
    let parts = par::map_chunks_at(rows.len(), chunk, desk, |desk, part| {
        work(desk, &rows[part])
    });
    parts.into_iter().collect()
}
