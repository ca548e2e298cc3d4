//! Poses of a batch shared among threads, each with a desk of its own.

use super::active_set::ActiveSet;
use super::index::{BallTree, TOGETHER};
use super::omp_dense::{DenseOmp, POSES};
use super::omp_indexed::{IndexedOmp, Places};
use super::{Dictionary, Omp, SparseCodes};
use crate::numeric::parallel::{self, ScratchPool};
use crate::{Error, Place, Result};
use ndarray::{ArrayView2, Axis};

/// Poses that a desk is given at once: many share what is made ready for them, but their fits should stay in the cache.
const CHUNK: usize = 512;
/// But at least so many, whole groups.
const LEAST: usize = 64;
/// Chunks a thread at least, where there are poses enough: threads are not equally fast.
const CHUNKS: usize = 8;
/// Tiles that a desk is given at once.
const TILES: usize = 32;

/// What codes many batches of poses with one dictionary: room that is large is made once a thread. The codes are those of
/// [`Omp::code_batch`], whatever was coded before.
pub struct Encoder<'a> {
    pub(super) dictionary: &'a Dictionary,
    pub(super) pursuit: Omp,
    tiles: ScratchPool<(DenseOmp<'a>, Vec<ActiveSet>)>,
    groups: ScratchPool<(IndexedOmp<'a>, Vec<ActiveSet>)>,
}

impl<'a> Encoder<'a> {
    /// For some parameters, which were checked.
    pub(super) fn new(dictionary: &'a Dictionary, pursuit: Omp) -> Self {
        Encoder {
            dictionary,
            pursuit,
            tiles: ScratchPool::default(),
            groups: ScratchPool::default(),
        }
    }
}

/// A batch of them.
pub(super) struct Batch<'b, 'a> {
    pub coder: &'b Encoder<'a>,
    /// (m, D)
    pub poses: ArrayView2<'b, f32>,
    pub weights: Option<ArrayView2<'b, f32>>,
}

impl<'a> Batch<'_, 'a> {
    /// SparseCodes the poses of some rows, none of them with weights that differ, by bounds. Gives the rows of which bounds tell too
    /// little.
    pub fn by_bounds(
        &self,
        tree: &'a BallTree,
        rows: &[u32],
        codes: &mut SparseCodes,
    ) -> Result<Vec<u32>> {
        let Encoder {
            dictionary,
            pursuit,
            ref groups,
            ..
        } = *self.coder;
        let order = &self.in_order(tree, rows)?[..];
        let room = TOGETHER.min(rows.len());
        let desk = || {
            let group = IndexedOmp::new(dictionary, tree, pursuit.rule, room);
            (group, Vec::new())
        };
        // Room for few poses is not kept for many.
        let few = ScratchPool::default();
        let desks = if room == TOGETHER {
            groups
        } else {
            &few
        };
        let parts = share(order, LEAST, CHUNK, |rows| {
            desks.with(desk, |(group, fits)| {
                self.start(fits, rows)?;
                let mut unpruned = Vec::new();
                group.code(fits, pursuit.sparsity, &mut unpruned);
                let unpruned: Vec<u32> = unpruned.into_iter().map(|i| rows[i]).collect();
                Ok((self.codes(fits), unpruned))
            })
        })?;
        let (parts, left): (Vec<SparseCodes>, Vec<Vec<u32>>) = parts.into_iter().unzip();
        codes.put_parts(order, &parts);
        let mut left = left.concat();
        left.sort_unstable();
        Ok(left)
    }

    /// Puts rows in an order in which neighbouring poses look into the same leaves.
    fn in_order(&self, leaves: &BallTree, rows: &[u32]) -> Result<Vec<u32>> {
        let desks = ScratchPool::default();
        let desk = || (Places::new(leaves), Vec::new());
        let places = share(rows, LEAST, CHUNK, |rows| {
            desks.with(desk, |(places, fits)| {
                self.start(fits, rows)?;
                Ok(places.of(fits))
            })
        })?;
        let mut order: Vec<(u32, u32)> = (places.into_iter().flatten().zip(rows))
            .map(|(place, row)| (place, *row))
            .collect();
        order.sort_unstable();
        Ok(order.into_iter().map(|(_, row)| row).collect())
    }

    /// SparseCodes the poses of some rows by scans.
    pub fn by_scans(&self, rows: &[u32], codes: &mut SparseCodes) -> Result<()> {
        let Encoder {
            dictionary,
            pursuit,
            ref tiles,
            ..
        } = *self.coder;
        let room = POSES.min(rows.len());
        let desk = || (DenseOmp::new(dictionary, pursuit.rule, room), Vec::new());
        // Room for few poses is not kept for many.
        let few = ScratchPool::default();
        let desks = if room == POSES { tiles } else { &few };
        // Several tiles share what is made ready for them.
        let parts = share(rows, POSES, POSES * TILES, |rows| {
            desks.with(desk, |(tile, fits)| {
                let tiles = rows.chunks(room).map(|few| {
                    self.start(fits, few)?;
                    tile.code(fits, pursuit.sparsity);
                    Ok(self.codes(fits))
                });
                tiles.collect::<Result<Vec<SparseCodes>>>()
            })
        })?;
        codes.put_parts(rows, &parts.concat());
        Ok(())
    }

    /// Starts on the poses of some rows.
    fn start(&self, fits: &mut Vec<ActiveSet>, rows: &[u32]) -> Result<()> {
        let (dictionary, pursuit) = (self.coder.dictionary, &self.coder.pursuit);
        let new = || ActiveSet::new(pursuit.capacity(dictionary), dictionary.width());
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
    fn codes(&self, fits: &[ActiveSet]) -> SparseCodes {
        let k = self.coder.pursuit.capacity(self.coder.dictionary);
        let (mut codes, mut x) = (SparseCodes::empty(fits.len(), k), vec![0.0; k]);
        for (i, fit) in fits.iter().enumerate() {
            codes.set(i, fit, &mut x);
        }
        codes
    }
}

/// Shares rows among threads, `least` to `most` rows at a time, a multiple of the former.
fn share<T: Send>(
    rows: &[u32],
    least: usize,
    most: usize,
    work: impl Fn(&[u32]) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let share = rows.len() / (CHUNKS * rayon::current_num_threads());
    let chunk = (share - share % least).clamp(least, most);
    let parts = parallel::map_chunks(rows.len(), chunk, |part| work(&rows[part]));
    parts.into_iter().collect()
}
