//! Which blocks explain an observation.

use super::cells::fading;
use super::leaves::Opened;
use super::part::{Active, Part, Sight, View};
use crate::prior::small::log_sum;

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

/// A cell that was looked at.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Which level of cells.
    pub index: usize,
    /// Which cell of it.
    pub cell: usize,
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
/// The leaves of so many cells are looked at.
const OPENED: usize = 8;
/// Cells this much less likely (nats) than the best are not opened, and where all is seen no further one is looked at after
/// the first of them.
const CLOSED: f64 = 10.0;
/// So many of the nearest leaves are weighed.
const WEIGHED: usize = 96;

impl Part {
    /// How well the cells and leaves explain `y` (d; read where observed).
    pub fn explain(&self, view: &View, y: &[f64]) -> Explained {
        self.explain_by(view, y, !self.active(self.cells.len()).is_empty())
    }

    /// How well the cells do: some twenty times as fast, and good enough to place a pose.
    pub fn explain_by_cells(&self, view: &View, y: &[f64]) -> Explained {
        self.explain_by(view, y, false)
    }

    fn explain_by(&self, view: &View, y: &[f64], leaves: bool) -> Explained {
        let mut search = Search::new(self, view, y);
        if !view.sees() {
            // Nothing observed: the prior itself, by its coarsest cell.
            search.found.levels.fill(0.0);
            return search.end(0.0);
        }
        let mut finest = Vec::new();
        // The finest first: what they explain much better needs no other.
        for index in (0..self.cells.len()).rev() {
            let wanted = leaves && index + 1 == self.cells.len();
            if wanted {
                finest = search.cells(index);
            } else if !self.active(index).is_empty() {
                search.cells(index);
            }
        }
        if leaves {
            search.open(&mut finest);
        }
        let levels = search.found.levels.iter().zip(&self.log_weights);
        let all: Vec<f64> = levels.map(|(l, w)| l + w).collect();
        search.end(log_sum(&all))
    }
}

/// The best blocks so far.
struct Search<'a> {
    part: &'a Part,
    view: &'a View,
    y: &'a [f64],
    short: Vec<f32>,
    found: Explained,
    /// The log that a block must reach.
    worst: f64,
    /// The best log of a cell.
    top: f64,
}

impl<'a> Search<'a> {
    fn new(part: &'a Part, view: &'a View, y: &'a [f64]) -> Search<'a> {
        Search {
            found: Explained {
                levels: vec![f64::NEG_INFINITY; part.levels.len()],
                best: Vec::with_capacity(4 * KEPT),
                ..Explained::default()
            },
            worst: f64::NEG_INFINITY,
            top: f64::NEG_INFINITY,
            part,
            view,
            y,
            short: view.short(y),
        }
    }

    /// Evaluates the nearest cells of one level at all its scales; gives the best log evidence and the place among those
    /// seen of each.
    fn cells(&mut self, index: usize) -> Vec<(f64, usize)> {
        let (part, view) = (self.part, self.view);
        let cells = &part.cells[index];
        let levels = part.active(index);
        let mut logs = vec![Vec::new(); levels.len()];
        let (mut z, mut each) = (Vec::new(), Vec::new());
        let mut off = vec![0.0; self.short.len()];
        let mut best = Vec::new();
        for (cell, fading) in cells.nearest(&self.short, &view.nearness[index]) {
            let sight = view.sight(part, index, cell);
            let means = self.y.iter().zip(cells.mean(cell));
            let rest = off.iter_mut().zip(means);
            rest.for_each(|(o, (y, m))| *o = (y - m) as f32);
            sight.lens.project(&off, &mut z);
            sight.scales.logs(&z, &mut each);
            let share = cells.log_shares[cell] + fading;
            each.iter_mut().for_each(|l| *l += share);
            let seen = self.found.seen.len();
            self.found.seen.push(Seen {
                index,
                cell,
                start: self.found.zs.len(),
            });
            self.found.zs.extend_from_slice(&z);
            for (at, (level, logs)) in levels.iter().zip(&mut logs).enumerate() {
                logs.push(each[at]);
                let leaf = None;
                self.add(
                    each[at],
                    level,
                    Hypothesis {
                        log: 0.0,
                        seen,
                        leaf,
                        at,
                    },
                );
            }
            let most = each.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            best.push((most, seen));
            self.top = self.top.max(most);
            // Further ones are farther off; but where much is missing, being near says too little.
            if view.sees_all() && most < self.top - CLOSED {
                break;
            }
        }
        self.sum(levels, &logs);
        best
    }

    /// Evaluates the nearest leaves of the cells that may hold the pose.
    fn open(&mut self, cells: &mut [(f64, usize)]) {
        let (part, view) = (self.part, self.view);
        let levels = part.active(part.cells.len());
        cells.sort_by(|a, b| b.0.total_cmp(&a.0));
        let closed = cells[0].0 - CLOSED;
        let likely: Vec<usize> = (cells.iter().take(OPENED))
            .filter(|c| c.0 >= closed)
            .map(|c| c.1)
            .collect();
        let near = self.near(&likely);
        let share = -(part.leaves.rows.len() as f64).ln();
        let mut logs = vec![Vec::with_capacity(near.len()); levels.len()];
        let mut state = Residual::default();
        let (mut each, mut cross, mut along) = (Vec::new(), Vec::new(), Vec::new());
        let reaches = levels.iter().any(|l| l.along > 0.0);
        for group in near.chunk_by(|a, b| a.1 == b.1) {
            let (seen, cell) = (group[0].1, self.found.seen[group[0].1].cell);
            let sight = view.sight(part, part.cells.len() - 1, cell);
            let opened = part.opened(cell);
            let scales = view.leaves(part, cell);
            for &(fading, _, leaf) in group {
                state.of_leaf(sight, self.found.z(seen, sight), opened, &self.short, leaf);
                scales.logs(&state.z, &mut each);
                if reaches {
                    scales.forms(&state.step, &state.z, &mut cross);
                    scales.forms(&state.step, &state.step, &mut along);
                }
                for (at, (level, logs)) in levels.iter().zip(&mut logs).enumerate() {
                    let mut log = share + f64::from(fading) + each[at];
                    if level.along > 0.0 {
                        let (vv, vz) = (level.along * along[at], cross[at]);
                        log += 0.5 * level.along * vz * vz / (1.0 + vv) - 0.5 * vv.ln_1p();
                    }
                    logs.push(log);
                    let leaf = Some(leaf);
                    self.add(
                        log,
                        level,
                        Hypothesis {
                            log: 0.0,
                            seen,
                            leaf,
                            at,
                        },
                    );
                }
            }
        }
        self.sum(levels, &logs);
    }

    /// The nearest leaves of some cells, cell by cell: (what its log is to be added, which of those seen, leaf).
    fn near(&self, cells: &[usize]) -> Vec<(f32, usize, usize)> {
        let nearness = &self.view.nearness[self.part.cells.len() - 1];
        let mut near: Vec<(f32, usize, usize)> = Vec::new();
        let mut far = Vec::new();
        for &seen in cells {
            let opened = self.part.opened(self.found.seen[seen].cell);
            opened.distances(&self.short, nearness, &mut far);
            near.extend(far.iter().enumerate().map(|(leaf, far)| (*far, seen, leaf)));
        }
        let order = |a: &(f32, usize, usize), b: &(f32, usize, usize)| {
            a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2)))
        };
        if near.len() > WEIGHED {
            near.select_nth_unstable_by(WEIGHED, order);
            let last = near[WEIGHED].0;
            near.truncate(WEIGHED);
            near.iter_mut().for_each(|n| n.0 = fading(n.0, last) as f32);
        } else {
            near.iter_mut().for_each(|n| n.0 = 0.0);
        }
        near.sort_unstable_by_key(|n| (n.1, n.2));
        near
    }

    /// The levels' evidences, by those of their blocks.
    fn sum(&mut self, levels: &[Active], logs: &[Vec<f64>]) {
        for (level, logs) in levels.iter().zip(logs) {
            self.found.levels[level.level] = log_sum(logs);
        }
    }

    fn add(&mut self, log: f64, level: &Active, hypothesis: Hypothesis) {
        let log = log + self.part.log_weights[level.level];
        if log > self.worst {
            self.found.best.push(Hypothesis { log, ..hypothesis });
            if self.found.best.len() == 4 * KEPT {
                self.trim();
            }
        }
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

    fn end(mut self, evidence: f64) -> Explained {
        self.trim();
        let logs = self.found.best.iter().map(|h| h.log);
        let top = logs.fold(f64::NEG_INFINITY, f64::max);
        self.found.best.retain(|h| h.log >= top - NEGLIGIBLE);
        self.found.evidence = evidence;
        self.found
    }
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
