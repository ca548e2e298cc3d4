//! The blocks of one part of the body: cells at many levels, and every training pose a leaf.

use super::cells::Cells;
use super::leaves::{Leaves, Opened, Poses};
use super::lens::{Lens, Pattern, Scaled};
use crate::pose::PoseMap;
use crate::prior::small::dot;
use ndarray::Array2;
use std::sync::{Arc, OnceLock};

/// One level: which blocks, at which scale of their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Level {
    /// The cells of `Part::cells[index]`, their covariance times `scale`.
    Cells {
        /// Which cells.
        index: usize,
        /// Of their covariance.
        scale: f64,
    },
    /// The leaves, the finest cell's covariance times `scale`, and the step's own variance times `along`.
    Leaves {
        /// Of the finest cell's covariance.
        scale: f64,
        /// Of the outer product of the step.
        along: f64,
    },
}

/// The blocks of one part.
#[derive(Debug, Clone)]
pub struct Part {
    /// Which of the pose's 3 J coordinates: d of them.
    pub coordinates: Vec<usize>,
    /// From the coarsest to the finest.
    pub cells: Vec<Cells>,
    /// The training poses.
    pub leaves: Leaves,
    /// All levels.
    pub levels: Vec<Level>,
    /// The log weight of each level.
    pub log_weights: Vec<f64>,
    /// The levels that weigh enough to be looked at: of each level of cells, then of the leaves.
    active: Vec<Vec<Active>>,
}

/// A level that is looked at.
#[derive(Debug, Clone, Copy)]
struct Active {
    level: usize,
    scale: f64,
    along: f64,
}

/// What one noise pattern makes of a part's blocks; each is looked at when first needed.
#[derive(Debug)]
pub struct View {
    /// The noise variance of each coordinate, cm².
    noise: Vec<f64>,
    pattern: Pattern,
    /// 1 / (variance within a level's cells + noise), 0 where nothing is seen: by level.
    nearness: Vec<Vec<f32>>,
    sights: Vec<Vec<OnceLock<Sight>>>,
}

/// One cell seen through the noise, at all its scales.
#[derive(Debug)]
pub struct Sight {
    pub lens: Lens,
    /// At the scales of the cell's levels, in their order.
    pub scales: Vec<Scaled>,
    /// At the scales of the leaves' levels, in their order; where they were asked for.
    leaves: OnceLock<Vec<Scaled>>,
}

impl View {
    /// Nothing looked at yet; `noise` is that of the part's coordinates.
    pub fn new(part: &Part, noise: Vec<f64>) -> View {
        let near = |c: &Cells| {
            let weight = |(v, n): (&f64, &f64)| (1.0 / (v + n)) as f32;
            c.within.iter().zip(&noise).map(weight).collect()
        };
        let none = |c: &Cells| (0..c.len()).map(|_| OnceLock::new()).collect();
        View {
            nearness: part.cells.iter().map(near).collect(),
            pattern: Pattern::of(&noise),
            sights: part.cells.iter().map(none).collect(),
            noise,
        }
    }

    /// Whether any coordinate is observed.
    pub fn sees(&self) -> bool {
        self.pattern != Pattern::Nothing
    }

    /// A cell through this noise.
    pub fn sight(&self, part: &Part, index: usize, cell: usize) -> &Sight {
        self.sights[index][cell].get_or_init(|| {
            let basis = part.cells[index].basis(cell, &part.coordinates);
            let lens = Lens::new(&basis, &self.noise, &self.pattern);
            let scales = part.active[index].iter().map(|a| lens.at(a.scale));
            Sight {
                scales: scales.collect(),
                leaves: OnceLock::new(),
                lens,
            }
        })
    }
}

impl Sight {
    /// At the scales of the leaves' levels.
    pub fn leaves(&self, part: &Part) -> &[Scaled] {
        self.leaves.get_or_init(|| {
            let levels = part.active.last().into_iter().flatten();
            levels.map(|a| self.lens.at(a.scale)).collect()
        })
    }
}

/// One block that may explain an observation.
#[derive(Debug, Clone, Copy)]
pub struct Hypothesis {
    /// The log of its weight times its evidence.
    pub log: f64,
    /// Which of the levels of cells; one more: the leaves.
    pub index: usize,
    /// Which of its levels that are looked at.
    pub at: usize,
    /// Which cell.
    pub cell: usize,
    /// The leaf among its cell's, where it is one.
    pub leaf: usize,
}

/// The blocks that explain an observation best, and how well all of them together do.
#[derive(Debug, Clone)]
pub struct Explained {
    /// log Σ over the levels and blocks.
    pub evidence: f64,
    /// log Σ over the blocks of each level, without the level's weight.
    pub levels: Vec<f64>,
    /// The best, in falling order.
    pub best: Vec<Hypothesis>,
}

impl Explained {
    /// Of a part that is not looked at.
    pub fn nothing() -> Explained {
        Explained {
            evidence: f64::NEG_INFINITY,
            levels: Vec::new(),
            best: Vec::new(),
        }
    }
}

/// So many blocks answer.
const KEPT: usize = 96;
/// Blocks this much less likely (nats) than the best do not answer.
const NEGLIGIBLE: f64 = 6.0;
/// Levels of less weight are not looked at.
const LEAST_WEIGHT: f64 = 5e-4;
/// The leaves of so many cells are looked at.
const OPENED: usize = 8;
/// Cells this much less likely than the best are not opened.
const CLOSED: f64 = 20.0;
/// So many of the nearest leaves are weighed.
const WEIGHED: usize = 128;

impl Part {
    /// Puts a part together: `labels` gives the finest cell of each training pose.
    pub fn new(
        coordinates: Vec<usize>,
        cells: Vec<Cells>,
        poses: Arc<Poses>,
        labels: &[usize],
        levels: Vec<Level>,
    ) -> Part {
        let finest = cells.last().map_or(0, Cells::len);
        let even = vec![-(levels.len() as f64).ln(); levels.len()];
        let mut part = Part {
            leaves: Leaves::new(poses, labels, finest),
            log_weights: Vec::new(),
            active: Vec::new(),
            levels,
            cells,
            coordinates,
        };
        part.weigh(even);
        part
    }

    /// Gives the levels their log weights. Those of next to none are not looked at, the coarsest apart: it knows of
    /// every pose.
    pub fn weigh(&mut self, log_weights: Vec<f64>) {
        let mut active = vec![Vec::new(); self.cells.len() + 1];
        for (level, (&what, log)) in self.levels.iter().zip(&log_weights).enumerate() {
            let (index, scale, along) = match what {
                Level::Cells { index, scale } => (index, scale, 0.0),
                Level::Leaves { scale, along } => (self.cells.len(), scale, along),
            };
            if index == 0 || log.exp() >= LEAST_WEIGHT {
                active[index].push(Active {
                    level,
                    scale,
                    along,
                });
            }
        }
        self.active = active;
        self.log_weights = log_weights;
    }

    /// The same part of poses that went through `map` and are now `poses`.
    pub fn mapped(&self, map: &Arc<PoseMap>, poses: &Arc<Poses>) -> Part {
        let cells = self.cells.iter().map(|c| c.mapped(map, &self.coordinates));
        Part {
            cells: cells.collect(),
            leaves: self.leaves.mapped(poses.clone()),
            ..self.clone()
        }
    }

    /// How far a level of the leaves reaches along their steps.
    pub fn along(&self, at: usize) -> f64 {
        self.active[self.cells.len()][at].along
    }

    /// The leaves of a finest cell.
    pub fn opened(&self, cell: usize) -> &Opened {
        let finest = self.finest();
        let basis = finest.basis(cell, &self.coordinates);
        self.leaves
            .open(cell, &self.coordinates, finest.means.row(cell), &basis)
    }

    /// The finest cells.
    pub fn finest(&self) -> &Cells {
        &self.cells[self.cells.len() - 1]
    }

    /// How well the blocks explain `y` (d; read where observed).
    pub fn explain(&self, view: &View, y: &[f64]) -> Explained {
        let mut found = Search::new(self);
        if !view.sees() {
            // Nothing observed: the prior itself, by its coarsest cell.
            found.levels.fill(0.0);
            found.add(0.0, 0, (0, 0), 0, 0);
            return found.end(0.0);
        }
        let short: Vec<f32> = (y.iter().zip(&view.noise))
            .map(|(y, n)| if n.is_finite() { *y as f32 } else { 0.0 })
            .collect();
        let mut finest = Vec::new();
        let leaves = self.active.last().is_some_and(|a| !a.is_empty());
        for index in 0..self.cells.len() {
            let wanted = leaves && index + 1 == self.cells.len();
            if wanted || !self.active[index].is_empty() {
                finest = self.cells_of(view, y, &short, index, &mut found);
            }
        }
        if leaves {
            self.open(view, y, &short, &mut finest, &mut found);
        }
        let levels = found.levels.iter().zip(&self.log_weights);
        let all: Vec<f64> = levels.map(|(l, w)| l + w).collect();
        let evidence = log_sum(&all);
        found.end(evidence)
    }

    /// Evaluates the nearest cells of one level at all its scales; gives each one's best log evidence.
    fn cells_of(
        &self,
        view: &View,
        y: &[f64],
        short: &[f32],
        index: usize,
        found: &mut Search<'_>,
    ) -> Vec<(f64, usize)> {
        let cells = &self.cells[index];
        let levels = &self.active[index];
        let mut logs = vec![Vec::new(); levels.len()];
        let mut z = Vec::new();
        let mut best = Vec::new();
        for cell in cells.nearest(short, &view.nearness[index]) {
            let sight = view.sight(self, index, cell);
            let mean = cells.means.row(cell);
            sight.lens.project(|i| y[i] - mean[i], &mut z);
            let mut most = f64::NEG_INFINITY;
            for (at, (level, logs)) in levels.iter().zip(&mut logs).enumerate() {
                let log = cells.log_shares[cell] + sight.scales[at].log(&z);
                logs.push(log);
                most = most.max(log);
                found.add(log, level.level, (index, at), cell, 0);
            }
            if levels.is_empty() {
                // Only to find which leaves to look at.
                most = cells.log_shares[cell] + sight.lens.at(1.0).log(&z);
            }
            best.push((most, cell));
        }
        for (level, logs) in levels.iter().zip(&logs) {
            found.levels[level.level] = log_sum(logs);
        }
        best
    }

    /// Evaluates the nearest leaves of the cells that may hold the pose.
    fn open(
        &self,
        view: &View,
        y: &[f64],
        short: &[f32],
        cells: &mut [(f64, usize)],
        found: &mut Search<'_>,
    ) {
        let levels = &self.active[self.cells.len()];
        cells.sort_by(|a, b| b.0.total_cmp(&a.0));
        let closed = cells[0].0 - CLOSED;
        let likely = cells.iter().take(OPENED).filter(|c| c.0 >= closed);
        let mut near: Vec<(f32, usize, usize)> = Vec::new();
        for &(_, cell) in likely {
            let all = self
                .opened(cell)
                .distances(short, &view.nearness[self.cells.len() - 1]);
            near.extend(all.map(|(leaf, far)| (far, cell, leaf)));
        }
        let order = |a: &(f32, usize, usize), b: &(f32, usize, usize)| {
            a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2)))
        };
        if near.len() > WEIGHED {
            near.select_nth_unstable_by(WEIGHED, order);
            near.truncate(WEIGHED);
        }
        near.sort_by_key(|n| (n.1, n.2));
        let share = -(self.leaves.rows.len() as f64).ln();
        let mut logs = vec![Vec::with_capacity(near.len()); levels.len()];
        let mut state = Residual::default();
        for group in near.chunk_by(|a, b| a.1 == b.1) {
            let cell = group[0].1;
            let sight = view.sight(self, self.cells.len() - 1, cell);
            let opened = self.opened(cell);
            state.of_cell(self, sight, y, cell);
            for &(_, _, leaf) in group {
                state.of_leaf(sight, opened, y, leaf);
                let scales = sight.leaves(self).iter().zip(&mut logs);
                for (at, (scaled, logs)) in scales.enumerate() {
                    let (level, along) = (levels[at].level, levels[at].along);
                    let mut log = scaled.log(&state.z);
                    if along > 0.0 {
                        let w = scaled.solve(&state.step);
                        let (vv, vz) = (along * dot(&w, &state.step), dot(&w, &state.z));
                        log += 0.5 * along * vz * vz / (1.0 + vv) - 0.5 * vv.ln_1p();
                    }
                    let log = share + log;
                    logs.push(log);
                    found.add(log, level, (self.cells.len(), at), cell, leaf);
                }
            }
        }
        for (level, logs) in levels.iter().zip(&logs) {
            found.levels[level.level] = log_sum(logs);
        }
    }
}

/// What is left of an observation beside a leaf, in the directions of a lens.
#[derive(Default)]
pub struct Residual {
    cell: Vec<f64>,
    /// Of the observation less the leaf's pose.
    pub z: Vec<f64>,
    /// Of the leaf's step.
    pub step: Vec<f64>,
}

impl Residual {
    /// Of a finest cell: what its leaves' are made from.
    pub fn of_cell(&mut self, part: &Part, sight: &Sight, y: &[f64], cell: usize) {
        let mean = part.finest().means.row(cell);
        if sight.lens.is_own() {
            sight.lens.project(|i| y[i] - mean[i], &mut self.cell);
        }
    }

    /// Of one of the cell's leaves.
    pub fn of_leaf(&mut self, sight: &Sight, opened: &Opened, y: &[f64], leaf: usize) {
        if sight.lens.is_own() {
            // A coordinate that is missing counts as the cell's mean here: what stands there makes no difference.
            let codes = self.cell.iter().zip(opened.code(leaf));
            self.z.clear();
            self.z.extend(codes.map(|(z, c)| z - f64::from(*c)));
            self.step.clear();
            self.step
                .extend(opened.turn(leaf).iter().map(|v| f64::from(*v)));
        } else {
            let (pose, step) = (opened.pose(leaf), opened.step(leaf));
            sight
                .lens
                .project(|i| y[i] - f64::from(pose[i]), &mut self.z);
            sight.lens.project(|i| f64::from(step[i]), &mut self.step);
        }
    }
}

pub fn add_outer(to: &mut Array2<f64>, weight: f64, x: &[f64]) {
    for (mut row, a) in to.rows_mut().into_iter().zip(x) {
        let scale = weight * a;
        row.iter_mut().zip(x).for_each(|(t, b)| *t += scale * b);
    }
}

/// log Σ exp.
pub fn log_sum(logs: &[f64]) -> f64 {
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY {
        return top;
    }
    top + logs.iter().map(|l| (l - top).exp()).sum::<f64>().ln()
}

/// The best blocks so far.
struct Search<'a> {
    part: &'a Part,
    levels: Vec<f64>,
    best: Vec<Hypothesis>,
    worst: f64,
}

impl<'a> Search<'a> {
    fn new(part: &'a Part) -> Search<'a> {
        Search {
            part,
            levels: vec![f64::NEG_INFINITY; part.levels.len()],
            best: Vec::with_capacity(4 * KEPT),
            worst: f64::NEG_INFINITY,
        }
    }

    fn add(
        &mut self,
        log: f64,
        level: usize,
        (index, at): (usize, usize),
        cell: usize,
        leaf: usize,
    ) {
        let log = log + self.part.log_weights[level];
        if log > self.worst {
            self.best.push(Hypothesis {
                log,
                index,
                at,
                cell,
                leaf,
            });
            if self.best.len() == 4 * KEPT {
                self.trim();
            }
        }
    }

    fn trim(&mut self) {
        self.best.sort_by(|a, b| b.log.total_cmp(&a.log));
        self.best.truncate(KEPT);
        if self.best.len() == KEPT {
            self.worst = self.best[KEPT - 1].log;
        }
    }

    fn end(mut self, evidence: f64) -> Explained {
        self.trim();
        let top = self.best.first().map_or(0.0, |h| h.log);
        self.best.retain(|h| h.log >= top - NEGLIGIBLE);
        Explained {
            evidence,
            levels: self.levels,
            best: self.best,
        }
    }
}
