//! Branch-and-bound search of the ball tree for the best atoms of a few poses.
//!
//! 1. Leaves with promising centers give a threshold: a score ("key") that the best atom reaches.
//! 2. A ball is visited only if one of its atoms can reach the key. In the orthogonal complement of the chosen directions, a
//!    ball of radius ρ around m subtends the angle asin(ρ / |m|) from the origin. So no atom in it has a larger c²/e than a
//!    vector nearer to the residual than m by that angle, and (|<m, r>| + ρ √(|r|² − key))² < key (|m|² − ρ²) excludes it.
//! 3. In each visited leaf the first PCA coordinates, then more of them, bound c and e from both sides. If an atom is likely
//!    the best so far, its full coordinates raise the key.
//! 4. The remaining leaves are scored as a dense scan scores them, with the same sums in the same order.
//!
//! Every bound allows for the rounding of a dense scan, so the result is always the atom that a dense scan finds.
//!
//! Poses that are near one another are searched together: they share the leaves in the cache, and their products are summed
//! side by side.

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

/// The largest number of vectors of a pose in a search, its residual and the chosen directions. With more, a dense scan costs
/// less.
pub const DIRECTIONS: usize = 4;
/// The largest number of poses in a search: bits of a mask.
pub const TOGETHER: usize = 16;

/// Searches of one tree, with their scratch memory.
pub struct BranchAndBound<'a> {
    leaves: &'a BallTree,
    /// Scratch: the leaves that may hold each pose's best atom.
    kept: Vec<Vec<Kept>>,
}

/// A search for one pose's best atom.
#[derive(Clone, Copy)]
pub struct Query<'a> {
    pub path: &'a OmpQuery,
    pub rule: SelectionRule,
    /// Atoms that are excluded: taken already, or dependent on those taken.
    pub taken: &'a [u32],
}

impl Query<'_> {
    /// Whether e counts: before the first atom it is 1 for all atoms.
    pub fn is_optimised(&self) -> bool {
        self.rule == SelectionRule::Oomp && self.path.heads.len() > 1
    }
}

/// The result of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchResult {
    Atom(u32),
    /// No atom has a score above 0.
    Nothing,
    /// The bounds exclude too few atoms: this pose needs dense scans, from its first atom on.
    Unpruned,
}

impl<'a> BranchAndBound<'a> {
    /// A search of `tree`.
    pub fn new(leaves: &'a BallTree) -> Self {
        BranchAndBound {
            leaves,
            kept: Vec::new(),
        }
    }

    /// Finds the best atoms of at most [`TOGETHER`] poses that have taken equally many atoms.
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

    /// Finds the leaf whose center is most correlated with each pose; the poses have taken no atoms.
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

/// The kind of a search.
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
        // The number of vectors that hold a leaf's lanes.
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
                    // A leaf that is good for the previous pose is likely good for this one.
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

/// The products of all poses with the top layer, (poses, groups).
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

/// Eight balls, or a leaf, that are still to be visited.
struct Open {
    layer: usize,
    /// The index of the group in its layer.
    group: usize,
    poses: [u16; LEAF],
}

/// Visits the leaves that may hold the best atoms, depth first. All poses that need a leaf visit it while it is in the cache.
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

/// Bounds eight balls for some poses. Returns, for each ball, the mask of poses for which it may hold the best atom.
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

/// Bounds the atoms of a leaf for some poses.
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

/// The mask of the first `poses` poses.
fn all(poses: usize) -> u16 {
    u16::MAX >> (TOGETHER - poses)
}

#[cfg(test)]
mod tests {
    use super::super::super::active_set::ActiveSet;
    use super::super::super::testdata::random;
    use super::super::super::{Dictionary, Tolerance};
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
                    assert!(fit.push(atom, dictionary.row(atom)));
                    path.take(&leaves.basis, fit);
                }
            }
        }
    }
}
