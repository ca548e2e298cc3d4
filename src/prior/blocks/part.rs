//! The blocks of one part of the body: cells at many levels, and every training pose a leaf.

use super::cells::Cells;
use super::leaves::{Leaves, Opened, Poses};
use super::lens::{Lens, Pattern};
use super::scales::{Even, Scales};
use crate::numeric::simd::{self, padded};
use crate::numeric::small_linalg::add;
use crate::pose::PoseMap;
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
pub struct Active {
    /// Which of the part's levels.
    pub level: usize,
    /// Of the covariance.
    pub scale: f64,
    /// Which of the index's scales that is, each counted once.
    pub at: usize,
    /// Of the step's own variance.
    pub along: f64,
}

/// What one noise pattern makes of a part's blocks; each is looked at when first needed.
#[derive(Debug)]
pub struct View {
    /// The noise variance of each coordinate, cm².
    pub noise: Vec<f64>,
    pattern: Pattern,
    /// The coordinates that are seen.
    seen: Arc<[usize]>,
    /// The same without what is changed: what does not hang on that is taken from there.
    even: Option<Arc<View>>,
    /// 1 / (variance within a level's cells + noise), 0 where nothing is seen: by level.
    pub nearness: Vec<Vec<f32>>,
    sights: Vec<Vec<OnceLock<Box<Sight>>>>,
}

/// One cell seen through the noise, at all its scales.
#[derive(Debug)]
pub struct Sight {
    pub lens: Lens,
    /// At the scales of the cell's levels, each once.
    pub scales: Scales,
    /// At the scales of the leaves' levels, each once; where they were asked for.
    leaves: OnceLock<Scales>,
    /// What views through changed noise start from: of the cell's levels, and of the leaves'.
    even: [OnceLock<Even>; 2],
}

impl View {
    /// Through noise that is everywhere the same.
    pub fn even(part: &Part, unit: f64) -> View {
        let noise = vec![unit; part.coordinates.len()];
        View::with(part, noise, None)
    }

    /// Nothing looked at yet; `noise` is that of the part's coordinates. `even` gives the view through noise that is
    /// everywhere the same.
    pub fn new(part: &Part, noise: Vec<f64>, even: impl FnOnce(f64) -> Arc<View>) -> View {
        let even = match Pattern::of(&noise) {
            Pattern::Changed { unit, changed } if !changed.is_empty() => Some(even(unit)),
            _ => None,
        };
        View::with(part, noise, even)
    }

    fn with(part: &Part, noise: Vec<f64>, even: Option<Arc<View>>) -> View {
        let near = |c: &Cells| {
            let weight = |(v, n): (&f64, &f64)| (1.0 / (v + n)) as f32;
            let mut near: Vec<f32> = c.within.iter().zip(&noise).map(weight).collect();
            near.resize(padded(near.len()), 0.0);
            near
        };
        let none = |c: &Cells| (0..c.len()).map(|_| OnceLock::new()).collect();
        View {
            nearness: part.cells.iter().map(near).collect(),
            even,
            pattern: Pattern::of(&noise),
            seen: (0..noise.len()).filter(|&i| noise[i].is_finite()).collect(),
            sights: part.cells.iter().map(none).collect(),
            noise,
        }
    }

    /// Whether any coordinate is observed.
    pub fn sees(&self) -> bool {
        self.pattern != Pattern::Nothing
    }

    /// Whether most coordinates are: what is near in them is near.
    pub fn sees_most(&self) -> bool {
        4 * self.seen.len() >= 3 * self.noise.len()
    }

    /// An observation (d) in single precision, padded; 0 where missing.
    pub fn short(&self, y: &[f64]) -> Vec<f32> {
        let seen = y.iter().zip(&self.noise);
        let mut short = Vec::with_capacity(padded(y.len()));
        short.extend(seen.map(|(y, n)| if n.is_finite() { *y as f32 } else { 0.0 }));
        short.resize(padded(short.len()), 0.0);
        short
    }

    /// A cell through this noise.
    pub fn sight(&self, part: &Part, index: usize, cell: usize) -> &Sight {
        self.sights[index][cell].get_or_init(|| {
            let basis = part.cells[index].basis(cell, &part.coordinates);
            let lens = Lens::new(&basis, &self.noise, &self.seen, &self.pattern);
            let scales = match &self.even {
                None => lens.at(&own_scales(part, index)),
                Some(even) => {
                    let even = &even.sight(part, index, cell);
                    let of = even.even[0].get_or_init(|| even.lens.even(&own_scales(part, index)));
                    lens.changed(of, false)
                }
            };
            Box::new(Sight {
                scales,
                leaves: OnceLock::new(),
                lens,
                even: Default::default(),
            })
        })
    }

    /// A finest cell at the scales of the leaves' levels.
    pub fn leaves(&self, part: &Part, cell: usize) -> &Scales {
        let index = part.cells.len() - 1;
        let sight = self.sight(part, index, cell);
        sight.leaves.get_or_init(|| match &self.even {
            None => sight.lens.at(&leaf_scales(part)),
            Some(even) => {
                let even = &even.sight(part, index, cell);
                let of = even.even[1].get_or_init(|| even.lens.even(&leaf_scales(part)));
                sight.lens.changed(of, true)
            }
        })
    }
}

/// The scales of the levels of an index. A finest cell that is no level's is looked at for its leaves' sake.
fn own_scales(part: &Part, index: usize) -> Vec<f64> {
    let own = scales(&part.active[index]);
    if own.is_empty() { vec![1.0] } else { own }
}

/// The scales of the leaves' levels.
fn leaf_scales(part: &Part) -> Vec<f64> {
    scales(part.of_leaves())
}

/// The scales of some levels, each once.
fn scales(levels: &[Active]) -> Vec<f64> {
    let firsts = levels.iter().enumerate().filter(|(i, level)| {
        let before = &levels[..*i];
        before.iter().all(|b| b.scale != level.scale)
    });
    firsts.map(|(_, level)| level.scale).collect()
}

/// Levels of less weight are not looked at.
const LEAST_WEIGHT: f64 = 2e-3;

impl Part {
    /// Puts a part together: `labels` gives the finest cell of each training pose.
    pub fn new(
        coordinates: Vec<usize>,
        cells: Vec<Cells>,
        poses: Arc<Poses>,
        labels: &[u32],
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
                let others = scales(&active[index]);
                let at = others.iter().position(|s| *s == scale);
                active[index].push(Active {
                    level,
                    scale,
                    at: at.unwrap_or(others.len()),
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

    /// The leaves of a finest cell.
    pub fn opened(&self, cell: usize) -> &Opened {
        let finest = self.finest();
        let basis = || finest.basis(cell, &self.coordinates);
        self.leaves
            .open(cell, &self.coordinates, finest.means.row(cell), basis)
    }

    /// The finest cells.
    pub fn finest(&self) -> &Cells {
        &self.cells[self.cells.len() - 1]
    }

    /// The levels of the leaves that are looked at.
    pub fn of_leaves(&self) -> &[Active] {
        &self.active[self.cells.len()]
    }

    /// The levels of the cells of an index that are looked at.
    pub fn active(&self, index: usize) -> &[Active] {
        &self.active[index]
    }
}

/// `to` += `weight` x xᵀ.
pub fn add_outer(to: &mut Array2<f64>, weight: f64, x: &[f64]) {
    // All that is added up here was made by rows.
    debug_assert!(to.is_standard_layout());
    let Some(to) = to.as_slice_mut() else { return };
    simd::dispatch8(
        #[inline(always)]
        || {
            for (row, a) in to.chunks_exact_mut(x.len().max(1)).zip(x) {
                add(row, weight * a, x);
            }
        },
    );
}
