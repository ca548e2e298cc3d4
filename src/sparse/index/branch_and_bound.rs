//! The best atoms of a few poses by bounds: of most atoms a few numbers tell that they cannot be it.
//!
//! 1. BallTree that are likely good give a key that the best atom has at least.
//! 2. Of each leaf, and of each several leaves, the centre's c and e tell whether any atom within the radius can reach that key.
//!    In the space that is left beside the directions taken, a ball of radius ρ about m is seen from 0 within the angle
//!    asin(ρ / |m|), and no atom in it has a larger c²/e than a vector that much nearer to the residual than m:
//!    (|<m, r>| + ρ √(|r|² − key))² < key (|m|² − ρ²) rules the ball out.
//! 3. Of each atom of the leaves that are left a head, then a longer one, bound c and e from both sides. Where it is likely the
//!    best so far its whole tells more.
//! 4. The leaves that may still hold the best are met as a scan meets them: the same sums in the same order, the same key.
//!
//! Every bound allows for the rounding of the scan, so the atom is the one that the scan finds, always.
//!
//! Several poses that are alike go through this together: what one reads is in the cache for the others, and their products are
//! summed side by side.

use super::super::SelectionRule;
use super::ball_bound::Measured;
use super::ball_tree::{BallTree, Balls, LEAF};
use super::exact_score;
use super::micro_gemm::{self, AT_ONCE, Few};
use super::pca_projection::Projected;
use super::query::OmpQuery;
use super::single_search::{Kept, Sweep};
use crate::numeric::simd;
use pulp::{Simd, WithSimd};

/// Directions of a pose, its residual's too, that a search can do with; beyond, a scan costs less.
pub const DIRECTIONS: usize = 4;
/// Poses that are sought for together, at most: bits of a mask.
pub const TOGETHER: usize = 16;

/// Searches of one dictionary: room that is made once.
pub struct BranchAndBound<'a> {
    leaves: &'a BallTree,
    /// Room for the leaves that may hold a pose's best atom.
    kept: Vec<Vec<Kept>>,
}

/// What is sought of a pose.
#[derive(Clone, Copy)]
pub struct Query<'a> {
    pub path: &'a OmpQuery,
    pub rule: SelectionRule,
    /// Atoms that are not to be taken.
    pub taken: &'a [u32],
}

impl Query<'_> {
    /// Whether what is left of atoms counts: before any is taken it is 1 of all.
    pub fn is_optimised(&self) -> bool {
        self.rule == SelectionRule::Oomp && self.path.heads.len() > 1
    }
}

/// What is found: the best atom of all that are not taken, the first of equals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchResult {
    Atom(u32),
    /// Nothing is along any atom.
    Nothing,
    /// The bounds tell too little of this pose: it is to be coded by scans, from its first atom on.
    Unpruned,
}

impl<'a> BranchAndBound<'a> {
    /// Room for searches.
    pub fn new(leaves: &'a BallTree) -> Self {
        BranchAndBound {
            leaves,
            kept: Vec::new(),
        }
    }

    /// The best atoms of at most [`TOGETHER`] poses that have taken equally many.
    pub fn best(&mut self, sought: &[Query<'_>], found: &mut Vec<SearchResult>) {
        debug_assert!(sought.len() <= TOGETHER);
        self.kept.resize_with(sought.len(), Vec::new);
        found.clear();
        simd::dispatch8_job(Search {
            leaves: self.leaves,
            kept: &mut self.kept,
            sought,
            task: Task::Best(found),
        });
    }

    /// The leaves whose centres are most along poses without atoms.
    pub fn nearest(&mut self, sought: &[Query<'_>], nearest: &mut Vec<usize>) {
        debug_assert!(sought.len() <= TOGETHER);
        self.kept.resize_with(sought.len(), Vec::new);
        nearest.clear();
        simd::dispatch8_job(Search {
            leaves: self.leaves,
            kept: &mut self.kept,
            sought,
            task: Task::Nearest(nearest),
        });
    }
}

/// What is asked for.
enum Task<'s> {
    Best(&'s mut Vec<SearchResult>),
    Nearest(&'s mut Vec<usize>),
}

struct Search<'s> {
    leaves: &'s BallTree,
    kept: &'s mut [Vec<Kept>],
    sought: &'s [Query<'s>],
    task: Task<'s>,
}

impl WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // So many vectors hold a leaf's lanes.
        match S::F32_LANES {
            8 => self.of_directions::<S, 1>(simd),
            4 => self.of_directions::<S, 2>(simd),
            _ => self.of_directions::<S, LEAF>(simd),
        }
    }
}

impl Search<'_> {
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
        let leaves = self.leaves;
        let mut sweeps: Vec<Sweep<'_, S, N, V>> = Vec::with_capacity(self.sought.len());
        for (sought, kept) in self.sought.iter().zip(&mut *self.kept) {
            sweeps.push(Sweep::new(simd, leaves, *sought, std::mem::take(kept)));
        }
        let top = top(simd, leaves, &mut sweeps);
        let of_poses = sweeps.iter_mut().zip(top.chunks_exact(leaves.top().len()));
        match self.task {
            Task::Nearest(nearest) => {
                for (sweep, top) in of_poses {
                    nearest.push(sweep.likely(top)[0].unwrap_or(0));
                }
            }
            Task::Best(found) => {
                let mut before = None;
                for (sweep, top) in of_poses {
                    // What is good for the pose before is likely good.
                    sweep.start(top, before);
                    before = sweep.leader;
                }
                look_around(simd, leaves, &mut sweeps, &top);
                for sweep in &mut sweeps {
                    let best = exact_score::best(sweep);
                    found.push(sweep.found(best));
                }
                let (count, spent) = (sweeps.len(), sweeps.iter().map(|s| s.spent()).sum());
                (leaves.tally).searches(count, spent, count * leaves.scan());
            }
        }
        for (sweep, kept) in sweeps.into_iter().zip(self.kept) {
            *kept = sweep.kept;
        }
    }
}

/// What all poses measure of the top, pose by pose.
#[inline(always)]
fn top<S: Simd, const N: usize, const V: usize>(
    simd: S,
    leaves: &BallTree,
    sweeps: &mut [Sweep<'_, S, N, V>],
) -> Vec<Measured<S, V>> {
    let groups = leaves.top().len();
    let mut top = vec![Measured::none(simd); groups * sweeps.len()];
    for (group, balls) in leaves.top().iter().enumerate() {
        let mut poses = all(sweeps.len());
        while let Some(few) = Few::of(&mut poses) {
            let sums = micro_gemm::products(simd, &balls.heads, &heads(sweeps, &few), few.count);
            for k in 0..few.count {
                let pose = few.poses[k];
                top[pose * groups + group] = sweeps[pose].measured(balls, &sums[k]);
            }
        }
    }
    top
}

/// Balls that may hold the best atoms of some poses.
struct Open {
    layer: usize,
    /// Which eight of the layer, or which leaf.
    group: usize,
    poses: [u16; LEAF],
}

/// All poses look into the leaves that may hold their best atoms. A leaf is looked into by all poses that may want it, while it
/// is in the cache nearest.
#[inline(always)]
fn look_around<S: Simd, const N: usize, const V: usize>(
    simd: S,
    leaves: &BallTree,
    sweeps: &mut [Sweep<'_, S, N, V>],
    top: &[Measured<S, V>],
) {
    let groups = leaves.top().len();
    let mut open: Vec<Open> = Vec::with_capacity(leaves.layers.len());
    for (group, balls) in leaves.top().iter().enumerate() {
        let mut poses = [0; LEAF];
        for (pose, sweep) in sweeps.iter().enumerate() {
            sweep.open(balls, &top[pose * groups + group], 1 << pose, &mut poses);
        }
        let layer = leaves.layers.len() - 1;
        open.push(Open {
            layer,
            group,
            poses,
        });
        while let Some(last) = open.last_mut() {
            let Some(lane) = last.poses.iter().position(|poses| *poses != 0) else {
                open.pop();
                continue;
            };
            let (layer, group) = (last.layer, last.group * LEAF + lane);
            let poses = std::mem::take(&mut last.poses[lane]);
            match layer {
                0 => look_into(simd, leaves, sweeps, (group, poses)),
                _ => {
                    let balls = &leaves.layers[layer - 1][group];
                    open.push(Open {
                        layer: layer - 1,
                        group,
                        poses: look_at(simd, balls, sweeps, poses),
                    });
                }
            }
        }
    }
}

/// Some poses look at eight balls: gives which of them each ball is open to.
#[inline(always)]
fn look_at<S: Simd, const N: usize, const V: usize>(
    simd: S,
    balls: &Balls,
    sweeps: &mut [Sweep<'_, S, N, V>],
    mut poses: u16,
) -> [u16; LEAF] {
    let mut open = [0; LEAF];
    while let Some(few) = Few::of(&mut poses) {
        let sums = micro_gemm::products(simd, &balls.heads, &heads(sweeps, &few), few.count);
        for k in 0..few.count {
            let sweep = &mut sweeps[few.poses[k]];
            let measured = sweep.measured(balls, &sums[k]);
            sweep.open(balls, &measured, 1 << few.poses[k], &mut open);
        }
    }
    open
}

/// Some poses look into a leaf.
#[inline(always)]
fn look_into<S: Simd, const N: usize, const V: usize>(
    simd: S,
    leaves: &BallTree,
    sweeps: &mut [Sweep<'_, S, N, V>],
    (leaf, mut poses): (usize, u16),
) {
    let parts = leaves.leaves[leaf].first_parts();
    while let Some(few) = Few::of(&mut poses) {
        let sums = micro_gemm::products(simd, parts, &heads(sweeps, &few), few.count);
        for k in 0..few.count {
            sweeps[few.poses[k]].judge(leaf, &sums[k]);
        }
    }
}

#[inline(always)]
fn heads<'s, S: Simd, const N: usize, const V: usize>(
    sweeps: &[Sweep<'s, S, N, V>],
    few: &Few,
) -> [&'s [Projected; N]; AT_ONCE] {
    let mut heads = [sweeps[few.poses[0]].heads; AT_ONCE];
    for k in 1..AT_ONCE {
        heads[k] = sweeps[few.poses[k]].heads;
    }
    heads
}

/// A mask of so many poses.
fn all(poses: usize) -> u16 {
    u16::MAX >> (TOGETHER - poses)
}

#[cfg(test)]
mod tests {
    use super::super::super::active_set::ActiveSet;
    use super::super::super::testdata::random;
    use super::super::super::{Dictionary, Tolerance, code};
    use super::*;
    use ndarray::ArrayView1;
    use pulp::{Scalar, Scalar128b, Scalar256b};

    fn on<S: Simd>(simd: S, leaves: &BallTree, sought: &[Query<'_>]) -> Vec<SearchResult> {
        let mut kept = vec![Vec::new(); sought.len()];
        let mut found = Vec::new();
        Search {
            leaves,
            kept: &mut kept,
            sought,
            task: Task::Best(&mut found),
        }
        .with_simd(simd);
        found
    }

    #[test]
    fn vectors_of_any_width_find_the_same() {
        // Two layers of balls, the last of each not full.
        let atoms = random(1_100, 12, 1);
        let dictionary = Dictionary::from_rows(atoms.view()).unwrap();
        let leaves = &BallTree::new(dictionary.atoms());
        assert_eq!(leaves.layers.len(), 2);
        let poses = random(TOGETHER, 12, 2);
        let mut fits: Vec<ActiveSet> = Vec::new();
        let mut paths: Vec<OmpQuery> = Vec::new();
        for pose in poses.outer_iter() {
            let (mut fit, mut path) = (ActiveSet::new(3, 12), OmpQuery::new(12));
            let weights = None::<ArrayView1<'_, f32>>;
            fit.start(pose, weights, Tolerance::Never).unwrap();
            path.begin(&leaves.basis, &fit);
            fits.push(fit);
            paths.push(path);
        }
        for _ in 0..3 {
            let sought: Vec<Query<'_>> = (paths.iter().zip(&fits))
                .map(|(path, fit)| Query {
                    path,
                    rule: SelectionRule::Oomp,
                    taken: &fit.support,
                })
                .collect();
            let mut found = Vec::new();
            BranchAndBound::new(leaves).best(&sought, &mut found);
            assert!(found.iter().all(|f| matches!(f, SearchResult::Atom(_))));
            assert_eq!(on(Scalar, leaves, &sought), found);
            assert_eq!(on(Scalar128b, leaves, &sought), found);
            assert_eq!(on(Scalar256b, leaves, &sought), found);
            for ((fit, path), found) in fits.iter_mut().zip(&mut paths).zip(found) {
                if let SearchResult::Atom(atom) = found {
                    assert!(fit.push(atom, code::row(&dictionary, atom)));
                    path.take(&leaves.basis, fit);
                }
            }
        }
    }
}
