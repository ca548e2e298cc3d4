//! The blocks of one part of the body: cells at many levels, and every training pose a leaf.

use super::learn::{Material, Settings};
use super::lens::Lens;
use crate::par;
use crate::pose::PoseMap;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis};
use std::sync::{Arc, OnceLock};

/// The cells of one level of the hierarchy: a mean, a covariance and a share of the training poses each.
#[derive(Debug, Clone)]
pub struct Cells {
    /// The means of whole poses, (K, 3 J), cm: what the part hangs on is needed to carry it to another body.
    pub wholes: Array2<f64>,
    /// The means of the part, (K, d), cm.
    pub means: Array2<f64>,
    /// K of (d, d), cm².
    pub covariances: Vec<Array2<f64>>,
    /// log(n / N).
    pub log_shares: Vec<f64>,
}

/// Every training pose as a block of its own, as wide as a share of its cell.
#[derive(Debug, Clone)]
pub struct Leaves {
    /// (N, d), cm, sorted by their cell.
    pub poses: Array2<f32>,
    /// (N, d), cm: half the step from the training pose before to the one after, in the same take.
    pub steps: Array2<f32>,
    /// Which training pose each leaf is.
    pub rows: Vec<usize>,
    /// Where the leaves of each cell of the finest level begin; one more at the end.
    pub starts: Vec<usize>,
}

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
}

/// What one noise pattern makes of a part's covariances; each is looked at when first needed.
#[derive(Debug)]
pub struct View {
    noise: Vec<f64>,
    lenses: Vec<Vec<OnceLock<Arc<Lens>>>>,
}

impl View {
    /// Nothing looked at yet; `noise` is that of the part's coordinates.
    pub fn new(part: &Part, noise: Vec<f64>) -> View {
        let empty = |c: &Cells| (0..c.log_shares.len()).map(|_| OnceLock::new()).collect();
        View {
            lenses: part.cells.iter().map(empty).collect(),
            noise,
        }
    }

    /// Whether any coordinate is observed.
    pub fn sees(&self) -> bool {
        self.noise.iter().any(|n| n.is_finite())
    }

    fn lens(&self, part: &Part, level: usize, cell: usize) -> &Lens {
        self.lenses[level][cell].get_or_init(|| {
            Arc::new(Lens::new(
                part.cells[level].covariances[cell].view(),
                &self.noise,
            ))
        })
    }
}

/// One block that may explain an observation.
#[derive(Debug, Clone, Copy)]
pub struct Hypothesis {
    /// The log of its weight times its evidence.
    pub log: f64,
    level: usize,
    cell: usize,
    /// The leaf, where it is one.
    leaf: usize,
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

/// So many blocks answer.
const KEPT: usize = 24;
/// Blocks this much less likely (nats) than the best do not answer.
const NEGLIGIBLE: f64 = 9.0;
/// The leaves of so many cells are looked at.
const OPENED: usize = 8;
/// Cells this much less likely than the best are not opened.
const CLOSED: f64 = 25.0;

impl Cells {
    /// The same cells of poses that went through `map`; of the covariance with the rest of the body nothing is known.
    fn mapped(&self, map: &PoseMap, coordinates: &[usize]) -> Cells {
        let wholes = map.apply_rows(self.wholes.view());
        let width = wholes.ncols();
        let carry = |c: &Array2<f64>| {
            let mut whole = Array2::zeros((width, width));
            for (i, &to) in coordinates.iter().enumerate() {
                for (j, &other) in coordinates.iter().enumerate() {
                    whole[[to, other]] = c[[i, j]];
                }
            }
            let whole = map.apply_covariance(whole.view());
            whole
                .select(Axis(0), coordinates)
                .select(Axis(1), coordinates)
        };
        let covariances = par::map_chunks(self.covariances.len(), 8, |range| {
            self.covariances[range]
                .iter()
                .map(carry)
                .collect::<Vec<_>>()
        });
        Cells {
            means: wholes.select(Axis(1), coordinates),
            wholes,
            covariances: covariances.into_iter().flatten().collect(),
            log_shares: self.log_shares.clone(),
        }
    }
}

impl Leaves {
    /// The cell of each training pose, in their own order.
    pub fn labels(&self) -> impl Iterator<Item = usize> {
        let mut labels = vec![0; self.rows.len()];
        for (cell, range) in self.starts.windows(2).enumerate() {
            for &row in &self.rows[range[0]..range[1]] {
                labels[row] = cell;
            }
        }
        labels.into_iter()
    }
}

impl Part {
    /// Puts a part together: `labels` gives the finest cell of each pose of the material.
    pub fn new(
        coordinates: Vec<usize>,
        cells: Vec<Cells>,
        material: &Material<'_>,
        steps: &Array2<f32>,
        labels: &[usize],
        settings: &Settings,
    ) -> Part {
        let finest = cells[cells.len() - 1].log_shares.len();
        let mut rows: Vec<usize> = (0..labels.len()).collect();
        rows.sort_by_key(|&i| labels[i]);
        let of =
            |all: ArrayView2<'_, f32>| all.select(Axis(0), &rows).select(Axis(1), &coordinates);
        let levels = settings.levels(cells.len());
        Part {
            leaves: Leaves {
                poses: of(material.xyz),
                steps: of(steps.view()),
                starts: (0..=finest)
                    .map(|c| rows.partition_point(|&i| labels[i] < c))
                    .collect(),
                rows,
            },
            log_weights: vec![-(levels.len() as f64).ln(); levels.len()],
            levels,
            cells,
            coordinates,
        }
    }

    /// The same part of poses that went through `map`; `material` and `steps` are those poses.
    pub fn mapped(&self, map: &PoseMap, material: &Material<'_>, steps: &Array2<f32>) -> Part {
        let of = |all: ArrayView2<'_, f32>| {
            let rows = all.select(Axis(0), &self.leaves.rows);
            rows.select(Axis(1), &self.coordinates)
        };
        let cells = self.cells.iter().map(|c| c.mapped(map, &self.coordinates));
        Part {
            cells: cells.collect(),
            leaves: Leaves {
                poses: of(material.xyz),
                steps: of(steps.view()),
                ..self.leaves.clone()
            },
            ..self.clone()
        }
    }

    /// How well the blocks explain `y` (d; read where observed).
    pub fn explain(&self, view: &View, y: &[f64], temperature: f64) -> Explained {
        let mut found = Search::new(self, temperature);
        if !view.sees() {
            // Nothing observed: the prior itself, by its coarsest cell.
            found.levels.fill(0.0);
            found.add(0, 0, usize::MAX, 0.0);
            return found.end(0.0);
        }
        let mut finest = Vec::new();
        for index in 0..self.cells.len() {
            finest = self.cells_of(view, y, index, &mut found);
        }
        self.open(view, y, &finest, &mut found);
        let all: Vec<f64> = found
            .levels
            .iter()
            .zip(&self.log_weights)
            .map(|(l, w)| l + w)
            .collect();
        let evidence = log_sum(&all);
        found.end(evidence)
    }

    /// Evaluates the cells of one level at all its scales; gives each cell's best log evidence.
    fn cells_of(&self, view: &View, y: &[f64], index: usize, found: &mut Search<'_>) -> Vec<f64> {
        let cells = &self.cells[index];
        let scales: Vec<(usize, f64)> = self.scales_of(index);
        let mut logs = vec![Vec::with_capacity(cells.log_shares.len()); scales.len()];
        let mut z = Vec::new();
        let mut best = Vec::with_capacity(cells.log_shares.len());
        for (cell, share) in cells.log_shares.iter().enumerate() {
            let lens = view.lens(self, index, cell);
            let mean = cells.means.row(cell);
            lens.project(|i| y[i] - mean[i], &mut z);
            let mut most = f64::NEG_INFINITY;
            for (at, &(level, scale)) in scales.iter().enumerate() {
                let shares = lens.shares(scale);
                let log = lens.normaliser(&shares) - 0.5 * weighted(&shares, &z, &z);
                let log = share + found.temperature * log;
                logs[at].push(log);
                most = most.max(log);
                found.add(level, cell, usize::MAX, log);
            }
            best.push(most);
        }
        for (at, &(level, _)) in scales.iter().enumerate() {
            found.levels[level] = log_sum(&logs[at]);
        }
        best
    }

    fn scales_of(&self, wanted: usize) -> Vec<(usize, f64)> {
        let all = self.levels.iter().enumerate();
        all.filter_map(|(at, level)| match level {
            Level::Cells { index, scale } if *index == wanted => Some((at, *scale)),
            _ => None,
        })
        .collect()
    }

    /// Evaluates the leaves of the cells that may hold the pose.
    fn open(&self, view: &View, y: &[f64], cells: &[f64], found: &mut Search<'_>) {
        let levels: Vec<(usize, f64, f64)> = (self.levels.iter().enumerate())
            .filter_map(|(at, level)| match level {
                Level::Leaves { scale, along } => Some((at, *scale, *along)),
                Level::Cells { .. } => None,
            })
            .collect();
        if levels.is_empty() {
            return;
        }
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by(|a, b| cells[*b].total_cmp(&cells[*a]));
        let closed = cells[order[0]] - CLOSED * found.temperature;
        let likely = order.iter().take(OPENED).filter(|&&c| cells[c] >= closed);
        let share = -(self.leaves.poses.nrows() as f64).ln();
        let mut logs = vec![Vec::new(); levels.len()];
        let (mut z, mut step) = (Vec::new(), Vec::new());
        for &cell in likely {
            let lens = view.lens(self, self.cells.len() - 1, cell);
            let shares: Vec<Vec<f64>> = levels.iter().map(|l| lens.shares(l.1)).collect();
            let normalisers: Vec<f64> = shares.iter().map(|s| lens.normaliser(s)).collect();
            for leaf in self.leaves.starts[cell]..self.leaves.starts[cell + 1] {
                let pose = self.leaves.poses.row(leaf);
                let way = self.leaves.steps.row(leaf);
                lens.project(|i| y[i] - f64::from(pose[i]), &mut z);
                lens.project(|i| f64::from(way[i]), &mut step);
                for (at, &(level, _, along)) in levels.iter().enumerate() {
                    let (s, n) = (&shares[at], normalisers[at]);
                    let mut log = n - 0.5 * weighted(s, &z, &z);
                    if along > 0.0 {
                        let (vv, vz) = (along * weighted(s, &step, &step), weighted(s, &step, &z));
                        log += 0.5 * along * vz * vz / (1.0 + vv) - 0.5 * vv.ln_1p();
                    }
                    let log = share + found.temperature * log;
                    logs[at].push(log);
                    found.add(level, cell, leaf, log);
                }
            }
        }
        for (at, &(level, ..)) in levels.iter().enumerate() {
            found.levels[level] = log_sum(&logs[at]);
        }
    }

    /// The mean (d) and covariance (d, d) that the explaining blocks give together.
    pub fn answer(&self, view: &View, y: &[f64], explained: &Explained) -> (Vec<f64>, Array2<f64>) {
        let d = self.coordinates.len();
        let top = explained.best[0].log;
        let weights: Vec<f64> = explained.best.iter().map(|h| (h.log - top).exp()).collect();
        let total: f64 = weights.iter().sum();
        let mut mean = vec![0.0; d];
        let mut covariance = Array2::zeros((d, d));
        let mut points = Vec::with_capacity(weights.len());
        for (h, w) in explained.best.iter().zip(&weights) {
            let w = w / total;
            let (x, c) = self.answer_of(view, y, h);
            mean.iter_mut().zip(&x).for_each(|(m, x)| *m += w * x);
            covariance.scaled_add(w, &c);
            points.push((w, x));
        }
        for (w, x) in points {
            let off: Vec<f64> = x.iter().zip(&mean).map(|(x, m)| x - m).collect();
            add_outer(&mut covariance, w, &off);
        }
        (mean, covariance)
    }

    fn answer_of(&self, view: &View, y: &[f64], h: &Hypothesis) -> (Vec<f64>, Array2<f64>) {
        match self.levels[h.level] {
            Level::Cells { index, scale } => {
                let prior = self.cells[index].covariances[h.cell].view();
                let mut x = self.cells[index].means.row(h.cell).to_vec();
                if !view.sees() {
                    return (x, &prior * scale);
                }
                let lens = view.lens(self, index, h.cell);
                let mut z = Vec::new();
                lens.project(|i| y[i] - x[i], &mut z);
                lens.add_gain(scale, &lens.shares(scale), &z, 1.0, &mut x);
                (x, lens.covariance(prior, scale))
            }
            Level::Leaves { scale, along } => {
                let finest = self.cells.len() - 1;
                let lens = view.lens(self, finest, h.cell);
                let prior = self.cells[finest].covariances[h.cell].view();
                let mut x: Vec<f64> = to_f64(self.leaves.poses.row(h.leaf));
                let way: Vec<f64> = to_f64(self.leaves.steps.row(h.leaf));
                let (mut z, mut step) = (Vec::new(), Vec::new());
                lens.project(|i| y[i] - x[i], &mut z);
                let shares = lens.shares(scale);
                let mut covariance = lens.covariance(prior, scale);
                if along > 0.0 {
                    lens.project(|i| way[i], &mut step);
                    let unsure = along / (1.0 + along * weighted(&shares, &step, &step));
                    let how_far = unsure * weighted(&shares, &step, &z);
                    // Along the step first, then what the cell's covariance makes of the rest.
                    x.iter_mut().zip(&way).for_each(|(x, w)| *x += how_far * w);
                    z.iter_mut().zip(&step).for_each(|(z, s)| *z -= how_far * s);
                    let mut left = way.clone();
                    lens.add_gain(scale, &shares, &step, -1.0, &mut left);
                    add_outer(&mut covariance, unsure, &left);
                }
                lens.add_gain(scale, &shares, &z, 1.0, &mut x);
                (x, covariance)
            }
        }
    }
}

fn to_f64(row: ArrayView1<'_, f32>) -> Vec<f64> {
    row.iter().map(|v| f64::from(*v)).collect()
}

pub fn add_outer(to: &mut Array2<f64>, weight: f64, x: &[f64]) {
    for (mut row, a) in to.rows_mut().into_iter().zip(x) {
        let scale = weight * a;
        row.iter_mut().zip(x).for_each(|(t, b)| *t += scale * b);
    }
}

fn weighted(w: &[f64], a: &[f64], b: &[f64]) -> f64 {
    w.iter().zip(a).zip(b).map(|((w, a), b)| w * a * b).sum()
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
    temperature: f64,
    levels: Vec<f64>,
    best: Vec<Hypothesis>,
    worst: f64,
}

impl<'a> Search<'a> {
    fn new(part: &'a Part, temperature: f64) -> Search<'a> {
        Search {
            part,
            temperature,
            levels: vec![f64::NEG_INFINITY; part.levels.len()],
            best: Vec::with_capacity(4 * KEPT),
            worst: f64::NEG_INFINITY,
        }
    }

    fn add(&mut self, level: usize, cell: usize, leaf: usize, log: f64) {
        let log = log + self.part.log_weights[level];
        if log > self.worst {
            self.best.push(Hypothesis {
                log,
                level,
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
