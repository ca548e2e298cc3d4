//! The cells of one level of the hierarchy: a mean, a covariance and a share of the training poses each.

use super::basis::{Basis, add_diagonal};
use crate::io::model::Matrix;
use crate::numeric::simd::{self, distances};
use crate::pose::PoseMap;
use ndarray::{Array2, Axis};
use std::sync::{Arc, OnceLock};

/// Cells of one part.
#[derive(Debug, Clone)]
pub struct Cells {
    /// The means of whole poses, (K, 3 J), cm: what the part hangs on is needed to carry it to another body.
    pub wholes: Array2<f64>,
    /// The means of the part, (K, d), cm.
    pub means: Array2<f64>,
    /// The same for the search, rows padded.
    short: Vec<f32>,
    /// log(n / N).
    pub log_shares: Vec<f64>,
    /// The variance of each coordinate within the cells, their mean, cm².
    pub within: Vec<f64>,
    bases: Vec<OnceLock<Arc<Basis>>>,
    /// What the bases are made from when they are first asked for.
    origin: Origin,
}

#[derive(Debug, Clone)]
enum Origin {
    /// All are made.
    Made,
    /// As a file keeps them.
    Stored(Arc<Stored>),
    /// The cells as another body has them.
    Mapped(Arc<Cells>, Arc<PoseMap>),
}

/// The sub-dictionaries as a file keeps them: see [`Cells::parts`].
#[derive(Debug)]
pub struct Stored {
    /// (K d, d), one a column.
    pub directions: Matrix,
    /// Along each, cm (K, d).
    pub deviations: Matrix,
}

impl Stored {
    /// The directions (d, d) of a cell, and the deviation (d) along each.
    fn cell(&self, cell: usize) -> (Vec<f32>, Vec<f32>) {
        let d = self.deviations.ncols();
        let (mut directions, mut deviations) = (Vec::with_capacity(d * d), Vec::with_capacity(d));
        (self.directions).extend_with(cell * d..(cell + 1) * d, &mut directions);
        (self.deviations).extend_with(cell..cell + 1, &mut deviations);
        (directions, deviations)
    }

    /// The variance of each coordinate within the cells, their mean.
    fn within(&self, log_shares: &[f64]) -> Vec<f64> {
        let mut within = vec![0.0; self.deviations.ncols()];
        for (cell, log) in log_shares.iter().enumerate() {
            let (directions, deviations) = self.cell(cell);
            add_diagonal(log.exp(), &directions, &deviations, &mut within);
        }
        within
    }
}

impl Cells {
    /// Cells of the means of whole poses (K, 3 J), log(n / N), and directions; `coordinates` are the part's.
    pub fn new(
        wholes: Array2<f64>,
        log_shares: Vec<f64>,
        bases: Vec<Basis>,
        coordinates: &[usize],
    ) -> Cells {
        let mut within = vec![0.0; coordinates.len()];
        for (basis, log) in bases.iter().zip(&log_shares) {
            let share = log.exp();
            let both = within.iter_mut().zip(basis.diagonal());
            both.for_each(|(w, v)| *w += share * v);
        }
        let bases = bases.into_iter().map(|b| OnceLock::from(Arc::new(b)));
        let bases = bases.collect();
        Cells::with(wholes, log_shares, within, bases, Origin::Made, coordinates)
    }

    /// The same of sub-dictionaries in a file, and perhaps the variances within the cells.
    pub fn stored(
        wholes: Array2<f64>,
        log_shares: Vec<f64>,
        stored: Stored,
        within: Option<Vec<f64>>,
        coordinates: &[usize],
    ) -> Cells {
        let within = within.unwrap_or_else(|| stored.within(&log_shares));
        let bases = log_shares.iter().map(|_| OnceLock::new()).collect();
        let origin = Origin::Stored(Arc::new(stored));
        Cells::with(wholes, log_shares, within, bases, origin, coordinates)
    }

    fn with(
        wholes: Array2<f64>,
        log_shares: Vec<f64>,
        within: Vec<f64>,
        bases: Vec<OnceLock<Arc<Basis>>>,
        origin: Origin,
        coordinates: &[usize],
    ) -> Cells {
        let means = wholes.select(Axis(1), coordinates);
        let means = means.as_standard_layout().into_owned();
        Cells {
            short: simd::rows(&means),
            means,
            wholes,
            log_shares,
            within,
            bases,
            origin,
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.log_shares.len()
    }

    /// The mean of a cell.
    pub fn mean(&self, cell: usize) -> &[f64] {
        let d = self.means.ncols();
        self.means
            .as_slice()
            .map_or(&[], |all| &all[cell * d..(cell + 1) * d])
    }

    /// The directions of a cell.
    pub fn basis(&self, cell: usize, coordinates: &[usize]) -> Arc<Basis> {
        let d = coordinates.len();
        let make = || match &self.origin {
            Origin::Stored(stored) => {
                let (directions, deviations) = stored.cell(cell);
                Basis::from_parts(&directions, &deviations)
            }
            Origin::Mapped(origin, map) => {
                let own = origin.basis(cell, coordinates);
                match &**map {
                    // Directions turn with their poses.
                    PoseMap::Turn(turn) => own.turned(turn),
                    map => {
                        let width = self.wholes.ncols();
                        let own = own.covariance();
                        Basis::of(carried(&own, map, coordinates, width).view())
                    }
                }
            }
            // Never met: those that are made are there.
            Origin::Made => Basis::of(Array2::zeros((d, d)).view()),
        };
        let make = || Arc::new(make());
        self.bases[cell].get_or_init(make).clone()
    }

    /// All sub-dictionaries: the directions (K d, d), one a column, and the deviation along each, cm (K, d).
    pub fn parts(&self, coordinates: &[usize]) -> (Array2<f32>, Array2<f32>) {
        let d = coordinates.len();
        let mut directions = Array2::zeros((self.len() * d, d));
        let mut deviations = Array2::zeros((self.len(), d));
        for cell in 0..self.len() {
            let basis = self.basis(cell, coordinates);
            for i in 0..d {
                let mut row = directions.row_mut(cell * d + i);
                row.iter_mut().zip(basis.row(i)).for_each(|(r, u)| *r = *u);
                deviations[[cell, i]] = basis.values[i].sqrt() as f32;
            }
        }
        (directions, deviations)
    }

    /// The same cells of poses that went through `map`; of the covariance with the rest of the body nothing is known.
    pub fn mapped(&self, map: &Arc<PoseMap>, coordinates: &[usize]) -> Cells {
        Cells::with(
            map.apply_rows(self.wholes.view()),
            self.log_shares.clone(),
            // Good enough for the search; a body's size is nothing beside what poses do.
            self.within.clone(),
            self.bases.iter().map(|_| OnceLock::new()).collect(),
            Origin::Mapped(Arc::new(self.clone()), map.clone()),
            coordinates,
        )
    }

    /// Σ w (y − mean)² of every cell, into `out`; all padded.
    pub fn distances(&self, y: &[f32], w: &[f32], out: &mut Vec<f32>) {
        distances(&self.short, y, w, out);
    }
}

/// The covariance (d, d) of a part of poses that went through `map`.
fn carried(own: &Array2<f64>, map: &PoseMap, coordinates: &[usize], width: usize) -> Array2<f64> {
    let mut whole = Array2::zeros((width, width));
    for (i, &to) in coordinates.iter().enumerate() {
        for (j, &other) in coordinates.iter().enumerate() {
            whole[[to, other]] = own[[i, j]];
        }
    }
    let whole = map.apply_covariance(whole.view());
    whole
        .select(Axis(0), coordinates)
        .select(Axis(1), coordinates)
}
