//! The best atom of one pose by bounds: of most atoms a few numbers tell that they cannot be it.
//!
//! 1. Atoms that are likely good give a key that the best has at least.
//! 2. Of each leaf the centre's c and e tell whether any atom within the radius can reach that key. In the space that is
//!    left beside the directions taken, a ball of radius ρ about m is seen from 0 within the angle asin(ρ / |m|), and no atom
//!    in it has a larger c²/e than a vector that much nearer to the residual than m:
//!    (|<m, r>| + ρ √(|r|² − key))² < key (|m|² − ρ²) rules the ball out.
//! 3. Of each atom of the leaves that are left a head, then a longer one, bound c from above and e from below.
//! 4. Where an atom is left its leaf is met as a scan meets it: the same sums in the same order, the same key.
//!
//! Every bound allows for the rounding of the scan, so the atom is the one that the scan finds, always.

use super::super::Rule;
use super::leaves::{LEAF, Leaves, NO_ATOM};
use super::path::Path;
use super::sweep::{Measured, Sweep};
use crate::simd;
use pulp::{Simd, WithSimd};

/// Directions of a pose, its residual's too, that a search can do with; beyond, a scan costs less.
pub const DIRECTIONS: usize = 4;
/// Poses that are sought for together, at most: bits of a mask.
pub const TOGETHER: usize = 16;

/// Searches of one dictionary: room that is made once.
pub struct Pruned<'a> {
    leaves: &'a Leaves,
    /// Of each leaf, which poses look into it.
    open: Vec<[u16; LEAF]>,
}

/// What is sought of a pose.
#[derive(Clone, Copy)]
pub struct Sought<'a> {
    pub path: &'a Path,
    pub rule: Rule,
    /// Atoms that are not to be taken.
    pub taken: &'a [u32],
}

/// What is found: the best atom of all that are not taken, the first of equals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    Atom(u32),
    /// Nothing is along any atom.
    Nothing,
    /// The bounds tell too little of this pose: it is to be coded by scans, from its first atom on.
    Unpruned,
}

impl<'a> Pruned<'a> {
    /// Room for searches.
    pub fn new(leaves: &'a Leaves) -> Self {
        Pruned {
            leaves,
            open: vec![[0; LEAF]; leaves.balls.len()],
        }
    }

    /// The best atoms of at most [`TOGETHER`] poses that have taken equally many.
    pub fn best(&mut self, sought: &[Sought<'_>], found: &mut Vec<Found>) {
        debug_assert!(sought.len() <= TOGETHER);
        found.clear();
        simd::widest(Search {
            room: self,
            sought,
            likely: None,
            found,
        });
    }

    /// The leaf whose centre is most along a pose.
    pub fn nearest(&mut self, path: &Path, rule: Rule) -> usize {
        let mut nearest = 0;
        simd::widest(Search {
            room: self,
            sought: &[Sought {
                path,
                rule,
                taken: &[],
            }],
            likely: Some(&mut nearest),
            found: &mut Vec::new(),
        });
        nearest
    }
}

struct Search<'s, 'a> {
    room: &'s mut Pruned<'a>,
    sought: &'s [Sought<'s>],
    /// Only this is asked for.
    likely: Option<&'s mut usize>,
    found: &'s mut Vec<Found>,
}

impl WithSimd for Search<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // So many vectors hold a leaf's lanes.
        match S::F32_LANES {
            16 => self.of_directions::<S, 1>(simd),
            8 => self.of_directions::<S, 2>(simd),
            4 => self.of_directions::<S, 4>(simd),
            _ => self.of_directions::<S, LEAF>(simd),
        }
    }
}

impl Search<'_, '_> {
    #[inline(always)]
    fn of_directions<S: Simd, const V: usize>(self, simd: S) {
        match self.sought.first().map_or(0, |s| s.path.heads.len()) {
            1 => self.go::<S, 1, V>(simd),
            2 => self.go::<S, 2, V>(simd),
            3 => self.go::<S, 3, V>(simd),
            4 => self.go::<S, 4, V>(simd),
            _ => {}
        }
    }

    #[inline(always)]
    fn go<S: Simd, const N: usize, const V: usize>(self, simd: S) {
        let room = self.room;
        let mut branches = vec![Measured::none(simd); room.leaves.branches.len()];
        let mut sweeps: Vec<Sweep<'_, S, N, V>> = Vec::with_capacity(self.sought.len());
        for sought in self.sought {
            let mut sweep = Sweep::new(simd, room.leaves, *sought);
            if let Some(likely) = self.likely {
                *likely = sweep.likely(&mut branches)[0].unwrap_or(0);
                return;
            }
            // What is good for the pose before is likely good.
            let before = sweeps.last().map(|s| s.best).filter(|a| *a != NO_ATOM);
            sweep.start(&mut branches, before);
            sweep.open(&branches, &mut room.open, 1 << sweeps.len());
            sweeps.push(sweep);
        }
        let mut looks = 0;
        // A leaf is looked into by all poses that may want it, while it is in the cache nearest.
        for (i, masks) in room.open.iter_mut().enumerate() {
            if *masks == [0; LEAF] {
                continue;
            }
            for (lane, mask) in masks.iter_mut().enumerate() {
                looks += mask.count_ones() as usize;
                while *mask != 0 {
                    sweeps[mask.trailing_zeros() as usize].look_into(i * LEAF + lane);
                    *mask &= *mask - 1;
                }
            }
        }
        for sweep in &sweeps {
            self.found.push(sweep.found());
            let looks = looks / sweeps.len();
            room.leaves
                .tally
                .search(sweep.spent(looks), room.leaves.scan());
        }
    }
}
