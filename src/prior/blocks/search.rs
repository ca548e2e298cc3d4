//! Which blocks explain an observation.

use super::explained::{Explained, Hypothesis, NEGLIGIBLE, Seen};
use super::leaves::Opened;
use super::near::Nearest;
use super::part::{Active, Part, Sight, View};
use super::scales::{Room, Scales};
use crate::numeric::simd::padded;
use crate::numeric::small_linalg::LogSum;

/// So many blocks answer.
const KEPT: usize = 96;
/// So many cells of a level are looked at.
const NEAR: usize = 5;
/// So many cells are usually looked at in all.
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
        let leaves = !self.of_leaves().is_empty();
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
    near: Nearest,
    far: Vec<f32>,
    off: Vec<f32>,
    z: Vec<f32>,
    each: Vec<f64>,
    state: Residual,
    room: Room,
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
        cells.distances(&self.short, &view.nearness[index], &mut desk.far);
        desk.near.clear();
        for (far, log) in desk.far.iter().zip(&cells.log_shares) {
            desk.near.push(far - 2.0 * *log as f32);
        }
        for (cell, fading) in desk.near.few(NEAR) {
            let sight = view.sight(part, index, cell);
            let means = self.y.iter().zip(cells.mean(cell));
            let rest = desk.off.iter_mut().zip(means);
            rest.for_each(|(o, (y, m))| *o = (y - m) as f32);
            sight.lens.project(&desk.off, &mut desk.z);
            (sight.scales).logs(&desk.z, &mut desk.room, &mut desk.each);
            let share = cells.log_shares[cell] + fading;
            let seen = self.found.seen.len();
            let mut most = f64::NEG_INFINITY;
            for log in &desk.each {
                most = most.max(log + share);
            }
            for level in levels {
                self.add(
                    level,
                    Hypothesis {
                        log: desk.each[level.at] + share,
                        seen,
                        leaf: None,
                        at: level.at,
                    },
                );
            }
            self.found.seen.push(Seen {
                index,
                cell,
                most,
                start: self.found.zs.len(),
            });
            self.found.zs.extend_from_slice(&desk.z);
            // A finest cell may be looked at for its leaves' sake alone.
            if !levels.is_empty() {
                self.top = self.top.max(most);
            }
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
        let levels = part.of_leaves();
        if levels.is_empty() {
            return;
        }
        let cells = self.likely();
        let near = self.near(&cells, desk);
        let share = -(part.leaves.len() as f64).ln();
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
                scales.logs_of_leaf((&state.z, &state.step), levels, &mut desk.room, each);
                for (at, (level, log)) in levels.iter().zip(each).enumerate() {
                    let block = Hypothesis {
                        log: share + fading + *log,
                        seen,
                        leaf: Some(leaf),
                        at,
                    };
                    best = best.max(self.add(level, block));
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
        desk.near.clear();
        for cell in cells {
            cell.opened.distances(&self.short, nearness, &mut desk.far);
            desk.far.iter().for_each(|far| desk.near.push(*far));
            starts.push(desk.near.len());
        }
        let of = |(place, fading): (usize, f64)| {
            let of = starts.partition_point(|s| *s <= place) - 1;
            Near {
                fading,
                leaf: place - starts[of],
                of,
            }
        };
        desk.near.few(WEIGHED).map(of).collect()
    }

    /// Counts a block of a level, whose log evidence is told, and keeps it if it is among the best; gives the log of its
    /// weight times its evidence.
    fn add(&mut self, level: &Active, block: Hypothesis) -> f64 {
        self.sums[level.level].add(block.log);
        let log = block.log + self.part.log_weights[level.level];
        self.best = self.best.max(log);
        if log > self.worst.max(self.best - NEGLIGIBLE) {
            self.found.best.push(Hypothesis { log, ..block });
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
