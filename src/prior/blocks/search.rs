//! Which blocks explain an observation.

use super::cells::Cells;
use super::leaves::Opened;
use super::part::{Active, Part, Sight, View};
use super::scales::Scales;
use crate::prior::small::LogSum;
use crate::simd::padded;

/// One block that may explain an observation.
#[derive(Debug, Clone, Copy)]
pub struct Hypothesis {
    /// The log of its weight times its evidence.
    pub log: f64,
    /// Its cell: which of [`Explained::seen`].
    pub seen: usize,
    /// The leaf among the cell's, where it is one.
    pub leaf: Option<usize>,
    /// Which of the levels that are looked at, of the cell or of the leaves.
    pub at: usize,
}

impl Hypothesis {
    fn new(seen: usize, leaf: Option<usize>, at: usize) -> Hypothesis {
        Hypothesis {
            log: f64::NEG_INFINITY,
            seen,
            leaf,
            at,
        }
    }
}

/// A cell that was looked at.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Which level of cells.
    pub index: usize,
    /// Which cell of it.
    pub cell: usize,
    /// The best log evidence of its scales.
    most: f64,
    /// Where its z begins.
    start: usize,
}

/// The blocks that explain an observation best, and how well all of them together do.
#[derive(Debug, Clone, Default)]
pub struct Explained {
    /// log Σ over the levels and blocks.
    pub evidence: f64,
    /// log Σ over the blocks of each level, without the level's weight.
    pub levels: Vec<f64>,
    /// The best, in no order.
    pub best: Vec<Hypothesis>,
    /// The cells that were looked at.
    pub seen: Vec<Seen>,
    /// The observation less each one's mean, in its directions.
    zs: Vec<f32>,
}

impl Explained {
    /// Of a part that is not looked at.
    pub fn nothing() -> Explained {
        Explained {
            evidence: f64::NEG_INFINITY,
            ..Explained::default()
        }
    }

    /// Each block's share, in the order of [`best`](Explained::best). Less what the least of them weighs: blocks come and go
    /// without a jump.
    pub fn shares(&self) -> Vec<f64> {
        let logs = self.best.iter().map(|h| h.log);
        let top = logs.fold(f64::NEG_INFINITY, f64::max);
        let least = (-NEGLIGIBLE).exp();
        let weights = self.best.iter().map(|h| (h.log - top).exp() - least);
        let mut weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= total);
        weights
    }

    /// The observation less a cell's mean, in its directions.
    pub fn z(&self, seen: usize, sight: &Sight) -> &[f32] {
        let start = self.seen[seen].start;
        &self.zs[start..start + sight.lens.stride()]
    }
}

/// So many blocks answer.
const KEPT: usize = 96;
/// Blocks this much less likely (nats) than the best do not answer.
const NEGLIGIBLE: f64 = 6.0;
/// So many cells are usually looked at.
const USUAL: usize = 20;
/// The leaves of cells this much less likely (nats) than the best are not looked at.
const OPENED: f64 = 6.0;
/// Where most is seen no further cell is looked at after the first that is this much less likely (nats) than the best.
const CLOSED: f64 = 10.0;
/// So many of the nearest leaves are weighed at most.
const WEIGHED: usize = 128;
/// So many of them at a time; where all of these are this much less likely (nats) than the best block, no further ones are.
const TOGETHER: usize = 8;
const HOPELESS: f64 = 9.0;

impl Part {
    /// How well the cells explain `y` (d; read where observed): the leaves of some are to be looked at.
    pub fn search<'a>(&'a self, view: &'a View, y: &'a [f64], desk: &mut Desk) -> Search<'a> {
        let leaves = !self.active(self.cells.len()).is_empty();
        self.search_by(view, y, leaves, desk)
    }

    /// How well the cells alone do: good enough to place a pose.
    pub fn explain_by_cells(&self, view: &View, y: &[f64]) -> Explained {
        self.search_by(view, y, false, &mut Desk::default()).end()
    }

    fn search_by<'a>(
        &'a self,
        view: &'a View,
        y: &'a [f64],
        leaves: bool,
        desk: &mut Desk,
    ) -> Search<'a> {
        let mut search = Search::new(self, view, y);
        if !view.sees() {
            // Nothing observed: the prior itself, by its coarsest cell.
            return search;
        }
        // The finest first: what they explain much better needs no other.
        for index in (0..self.cells.len()).rev() {
            let finest = leaves && index + 1 == self.cells.len();
            if finest || !self.active(index).is_empty() {
                search.cells(index, desk);
            }
        }
        search
    }
}

/// What searches work with, kept from one to the next.
#[derive(Default)]
pub struct Desk {
    keys: Vec<u64>,
    far: Vec<f32>,
    /// The nearest cells, each with what its log is to be added.
    near: Vec<(usize, f64)>,
    off: Vec<f32>,
    z: Vec<f32>,
    each: Vec<f64>,
    state: Residual,
}

/// The best blocks so far.
pub struct Search<'a> {
    part: &'a Part,
    view: &'a View,
    y: &'a [f64],
    short: Vec<f32>,
    found: Explained,
    /// Of the blocks of each level.
    sums: Vec<LogSum>,
    /// The log that a block must reach.
    worst: f64,
    /// The best log of a cell.
    top: f64,
    /// The best log of a block, its level's weight included.
    best: f64,
}

/// A finest cell whose leaves are looked at.
#[derive(Clone, Copy)]
struct Likely<'a> {
    seen: usize,
    sight: &'a Sight,
    opened: &'a Opened,
    scales: &'a Scales,
}

/// One of the nearest leaves.
struct Near {
    /// What its log is to be added.
    fading: f64,
    /// Which of the likely cells.
    of: usize,
    leaf: usize,
}

impl<'a> Search<'a> {
    fn new(part: &'a Part, view: &'a View, y: &'a [f64]) -> Search<'a> {
        Search {
            found: Explained {
                best: Vec::with_capacity(KEPT),
                seen: Vec::with_capacity(USUAL),
                zs: Vec::with_capacity(USUAL * padded(part.coordinates.len())),
                ..Explained::default()
            },
            sums: vec![LogSum::default(); part.levels.len()],
            worst: f64::NEG_INFINITY,
            top: f64::NEG_INFINITY,
            best: f64::NEG_INFINITY,
            part,
            view,
            y,
            short: view.short(y),
        }
    }

    /// Evaluates the nearest cells of one level at all its scales.
    fn cells(&mut self, index: usize, desk: &mut Desk) {
        let (part, view) = (self.part, self.view);
        let cells = &part.cells[index];
        let levels = part.active(index);
        desk.off.clear();
        desk.off.resize(self.short.len(), 0.0);
        desk.nearest(cells, &self.short, &view.nearness[index]);
        for &(cell, fading) in &desk.near {
            let sight = view.sight(part, index, cell);
            let means = self.y.iter().zip(cells.mean(cell));
            let rest = desk.off.iter_mut().zip(means);
            rest.for_each(|(o, (y, m))| *o = (y - m) as f32);
            sight.lens.project(&desk.off, &mut desk.z);
            sight.scales.logs(&desk.z, &mut desk.each);
            let share = cells.log_shares[cell] + fading;
            let seen = self.found.seen.len();
            let mut most = f64::NEG_INFINITY;
            for (at, log) in desk.each.iter().enumerate() {
                most = most.max(log + share);
                // A finest cell may be looked at for its leaves' sake alone.
                if let Some(level) = levels.get(at) {
                    let of = Hypothesis::new(seen, None, at);
                    self.add(log + share, level, of);
                }
            }
            self.found.seen.push(Seen {
                index,
                cell,
                most,
                start: self.found.zs.len(),
            });
            self.found.zs.extend_from_slice(&desk.z);
            self.top = self.top.max(most);
            // Further ones are farther off; but where much is missing, being near says too little.
            if view.sees_most() && most < self.top - CLOSED {
                break;
            }
        }
    }

    /// log Σ over the levels and blocks that were looked at.
    pub fn evidence(&self) -> f64 {
        if !self.view.sees() {
            return 0.0;
        }
        let mut all = LogSum::default();
        for (level, weight) in self.sums.iter().zip(&self.part.log_weights) {
            all.add(level.log() + weight);
        }
        all.log()
    }

    /// Evaluates the nearest leaves of the cells that may hold the pose.
    pub fn open(&mut self, desk: &mut Desk) {
        let part = self.part;
        let levels = part.active(part.cells.len());
        let cells = self.likely();
        let near = self.near(&cells, desk);
        let share = -(part.leaves.rows.len() as f64).ln();
        for some in near.chunks(TOGETHER) {
            let mut best = f64::NEG_INFINITY;
            for &Near { fading, of, leaf } in some {
                let Likely {
                    seen,
                    sight,
                    opened,
                    scales,
                } = cells[of];
                let (state, each) = (&mut desk.state, &mut desk.each);
                state.of_leaf(sight, self.found.z(seen, sight), opened, &self.short, leaf);
                scales.logs_of_leaf(&state.z, &state.step, levels, each);
                for (at, (level, log)) in levels.iter().zip(each).enumerate() {
                    let of = Hypothesis::new(seen, Some(leaf), at);
                    best = best.max(self.add(share + fading + *log, level, of));
                }
            }
            // Further ones are farther off.
            if best < self.best - HOPELESS {
                break;
            }
        }
    }

    /// The cells whose leaves are looked at.
    fn likely(&self) -> Vec<Likely<'a>> {
        let (part, view) = (self.part, self.view);
        let finest = part.cells.len() - 1;
        let seen = self.found.seen.iter().enumerate();
        let seen: Vec<(f64, usize)> = seen
            .filter(|(_, s)| s.index == finest)
            .map(|(i, s)| (s.most, i))
            .collect();
        let most = seen.iter().fold(f64::NEG_INFINITY, |a, s| a.max(s.0));
        let likely = seen.into_iter().filter(|s| s.0 >= most - OPENED);
        let of = |(_, seen): (f64, usize)| {
            let cell = self.found.seen[seen].cell;
            Likely {
                seen,
                sight: view.sight(part, finest, cell),
                opened: part.opened(cell),
                scales: view.leaves(part, cell),
            }
        };
        likely.map(of).collect()
    }

    /// The nearest leaves of some cells, the nearest first.
    fn near(&self, cells: &[Likely<'_>], desk: &mut Desk) -> Vec<Near> {
        let nearness = &self.view.nearness[self.part.cells.len() - 1];
        let mut starts = vec![0];
        desk.keys.clear();
        for cell in cells {
            cell.opened.distances(&self.short, nearness, &mut desk.far);
            for far in &desk.far {
                desk.keys.push(key(*far, desk.keys.len()));
            }
            starts.push(desk.keys.len());
        }
        let last = nearest_keys(&mut desk.keys, WEIGHED);
        let of = |&key: &u64| {
            let (far, place) = unlocked(key);
            let of = starts.partition_point(|s| *s <= place) - 1;
            Near {
                fading: last.map_or(0.0, |last| fading(far, last)),
                leaf: place - starts[of],
                of,
            }
        };
        desk.keys.iter().map(of).collect()
    }

    /// Counts a block, and keeps it if it is among the best; gives the log of its weight times its evidence.
    fn add(&mut self, log: f64, level: &Active, hypothesis: Hypothesis) -> f64 {
        self.sums[level.level].add(log);
        let log = log + self.part.log_weights[level.level];
        self.best = self.best.max(log);
        if log > self.worst.max(self.best - NEGLIGIBLE) {
            self.found.best.push(Hypothesis { log, ..hypothesis });
            if self.found.best.len() == 4 * KEPT {
                self.trim();
            }
        }
        log
    }

    /// Leaves the best few, in no order.
    fn trim(&mut self) {
        let best = &mut self.found.best;
        if best.len() > KEPT {
            let place = |h: &Hypothesis| (h.seen, h.leaf, h.at);
            let order = |a: &Hypothesis, b: &Hypothesis| {
                let logs = b.log.total_cmp(&a.log);
                logs.then_with(|| place(a).cmp(&place(b)))
            };
            best.select_nth_unstable_by(KEPT - 1, order);
            best.truncate(KEPT);
            self.worst = best[KEPT - 1].log;
        }
    }

    /// What was found.
    pub fn end(mut self) -> Explained {
        self.found.evidence = self.evidence();
        let sees = self.view.sees();
        let levels = self.sums.iter().map(|s| if sees { s.log() } else { 0.0 });
        self.found.levels = levels.collect();
        self.trim();
        let logs = self.found.best.iter().map(|h| h.log);
        let top = logs.fold(f64::NEG_INFINITY, f64::max);
        self.found.best.retain(|h| h.log >= top - NEGLIGIBLE);
        self.found
    }
}

/// So many cells of a level are looked at.
const NEAR: usize = 5;

impl Desk {
    /// The few cells that may hold a pose (d, padded; of any value where `weights` is 0), nearest first, each with what its
    /// log evidence is to be added: less the nearer it is to being left out, so that cells come and go without a jump.
    fn nearest(&mut self, cells: &Cells, y: &[f32], weights: &[f32]) {
        cells.distances(y, weights, &mut self.far);
        self.keys.clear();
        let far = self.far.iter().zip(&cells.log_shares).enumerate();
        let far = far.map(|(cell, (far, log))| key(far - 2.0 * *log as f32, cell));
        self.keys.extend(far);
        let last = nearest_keys(&mut self.keys, NEAR);
        self.near.clear();
        self.near.extend(self.keys.iter().map(|key| {
            let (far, cell) = unlocked(*key);
            (cell, last.map_or(0.0, |last| fading(far, last)))
        }));
    }
}

/// A distance (at least 0) and whose it is in one number; their order is that of the distances.
fn key(far: f32, place: usize) -> u64 {
    u64::from(far.to_bits()) << 32 | place as u64
}

/// The distance and whose it is.
fn unlocked(key: u64) -> (f32, usize) {
    (f32::from_bits((key >> 32) as u32), key as u32 as usize)
}

/// Leaves the nearest few, the nearest first; gives the distance of the first that is left out.
fn nearest_keys(keys: &mut Vec<u64>, few: usize) -> Option<f32> {
    let mut last = None;
    if keys.len() > few {
        last = Some(unlocked(*keys.select_nth_unstable(few).1).0);
        keys.truncate(few);
    }
    keys.sort_unstable();
    last
}

/// What the log evidence of a block that is so far off is to be added where the first that is left out is at `last`.
fn fading(far: f32, last: f32) -> f64 {
    let left = -(-0.5 * f64::from(last - far)).exp_m1();
    left.max(1e-9).ln()
}

/// What is left of an observation beside a leaf, in the directions of a lens.
#[derive(Default)]
pub struct Residual {
    /// Of the observation less the leaf's pose.
    pub z: Vec<f32>,
    /// Of the leaf's step.
    pub step: Vec<f32>,
    off: Vec<f32>,
}

impl Residual {
    /// Of one of a finest cell's leaves; `of_cell` is what is left beside the cell's mean, `y` (padded) the observation.
    pub fn of_leaf(
        &mut self,
        sight: &Sight,
        of_cell: &[f32],
        opened: &Opened,
        y: &[f32],
        leaf: usize,
    ) {
        let (lens, pose) = (&sight.lens, opened.pose(leaf));
        if lens.is_own() {
            // A coordinate that is missing counts as the cell's mean here: what stands there makes no difference.
            lens.shift(of_cell, opened.code(leaf), y, pose, &mut self.z);
            lens.turn(opened.turn(leaf), &mut self.step);
        } else {
            self.off.clear();
            self.off.extend(y.iter().zip(pose).map(|(y, x)| y - x));
            lens.project(&self.off, &mut self.z);
            lens.project(opened.step(leaf), &mut self.step);
        }
    }
}
