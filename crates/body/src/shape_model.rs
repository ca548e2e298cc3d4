//! How bodies differ between people: a matrix S for each triangle, by principal components.
//!
//! The edges of triangle k of a person are R S_k Q_k v̂_kj. With A the smoothed matrices of the
//! person's mesh (see [`Decomposer`]) and Q those of the pose model at the person's own rotations,
//! S minimizes |S Q - A|² + λ |S - I|²: the closed form is as good as solving for S again, and
//! stays bounded where Q is nearly singular.
//!
//! The principal components are orthogonal in the VERTICES that the S give to the template's pose,
//! not in the S themselves (as Anguelov et al. have it, [`Metric::Matrices`]): the error of five
//! components falls from 6 mm to 4.

use super::decomposition::{Decomposer, synthesize};
use super::pose_model::PoseModel;
use super::template::Template;
use crate::Result;
use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::parallel;
use crate::numeric::product::product;
use glam::{DMat3, DVec3};
use ndarray::{Array2, Axis};

/// The weight λ that draws S to the identity.
const TOWARD_IDENTITY: f64 = 1e-4;
/// Components whose variance is below this share of the first are noise.
const LEAST_VARIANCE: f64 = 1e-9;

/// In what the principal components are orthogonal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Metric {
    /// The vertices that the matrices give in the template's pose.
    #[default]
    Vertices,
    /// The numbers of the matrices (Anguelov et al.).
    Matrices,
}

/// The S of all triangles as an affine function of a few numbers β of mean 0 and variance 1 over
/// the people.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeModel {
    /// S at β = 0 (P, 9), by columns.
    pub mean: Array2<f32>,
    /// What each β adds (K, 9 P), largest variance first.
    pub components: Array2<f32>,
}

impl ShapeModel {
    /// The template's own shape, and no other.
    pub(crate) fn of_template(template: &Template) -> ShapeModel {
        let identity = DMat3::IDENTITY.to_cols_array().map(|v| v as f32);
        ShapeModel {
            mean: Array2::from_shape_fn((template.faces.len(), 9), |(_, e)| identity[e]),
            components: Array2::zeros((0, 9 * template.faces.len())),
        }
    }

    /// Learns from the matrices of people (n, 9 P), at most `count` components.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: there is no one, or the matrices are not finite.
    pub(crate) fn learn(
        template: &Template,
        people: &Array2<f32>,
        count: usize,
        metric: Metric,
    ) -> Result<ShapeModel> {
        let n = people.nrows();
        let mean = people
            .mean_axis(Axis(0))
            .ok_or("shapes are learned from one person or more; none is given")?;
        let spread = match metric {
            Metric::Matrices => (people - &mean).mapv(f64::from),
            Metric::Vertices => vertices_of_people(template, people),
        };
        let gram = product(spread.view(), spread.t());
        let (values, vectors) =
            symmetric_eigen(&gram).ok_or("the meshes of people are not finite")?;
        let largest = values[n - 1].max(f64::MIN_POSITIVE);
        let kept = (0..n).rev().take(count);
        let kept: Vec<usize> = kept
            .take_while(|k| values[*k] > LEAST_VARIANCE * largest)
            .collect();
        // Scores of unit variance are √n times an eigenvector; a component is the mean of the
        // matrices by their scores.
        let scores = Array2::from_shape_fn((kept.len(), n), |(c, i)| {
            (vectors[[i, kept[c]]] / (n as f64).sqrt()) as f32
        });
        let mean_matrices = mean.to_shape((template.faces.len(), 9));
        Ok(ShapeModel {
            components: scores.dot(&(people - &mean)),
            mean: mean_matrices.map_err(|e| e.to_string())?.to_owned(),
        })
    }

    /// The number of components K.
    pub fn len(&self) -> usize {
        self.components.nrows()
    }

    /// Whether all bodies have one shape.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The S of each triangle; numbers that `shape` lacks are 0.
    pub fn matrices(&self, shape: &[f64]) -> Vec<DMat3> {
        let parts = parallel::map_chunks(self.mean.nrows(), 2048, |range| {
            let numbers = 9 * range.start..9 * range.end;
            let mut sums: Vec<f64> = (range.clone())
                .flat_map(|k| (0..9).map(move |e| f64::from(self.mean[[k, e]])))
                .collect();
            for (row, beta) in self.components.rows().into_iter().zip(shape) {
                let row = row.slice(ndarray::s![numbers.clone()]);
                for (sum, v) in sums.iter_mut().zip(row) {
                    *sum += beta * f64::from(*v);
                }
            }
            let matrix = |s: &[f64]| DMat3::from_cols_array(&std::array::from_fn(|e| s[e]));
            sums.chunks_exact(9).map(matrix).collect::<Vec<_>>()
        });
        parts.concat()
    }

    /// What multiplies 1 and each β in the S of triangle `k`.
    pub(crate) fn terms(&self, k: usize) -> impl Iterator<Item = DMat3> + '_ {
        let mean = std::iter::once(matrix(|e| self.mean[[k, e]]));
        let component = move |c: usize| matrix(|e| self.components[[c, 9 * k + e]]);
        mean.chain((0..self.len()).map(component))
    }
}

fn matrix(entry: impl Fn(usize) -> f32) -> DMat3 {
    DMat3::from_cols_array(&std::array::from_fn(|e| f64::from(entry(e))))
}

/// The S of each triangle of a person (9 P), given the rotations of the parts.
pub(crate) fn matrices_of_person(
    decomposer: &Decomposer<'_>,
    pose: &PoseModel,
    template: &Template,
    vertices: &[DVec3],
    rotations: &[DMat3],
) -> Vec<f32> {
    let a = decomposer.deformations(vertices, rotations);
    let q = pose.deformations(template, rotations);
    let identity = DMat3::IDENTITY * TOWARD_IDENTITY;
    (a.iter().zip(&q))
        .flat_map(|(a, q)| {
            let back = q.transpose();
            let s = (*a * back + identity) * (*q * back + identity).inverse();
            s.to_cols_array().map(|v| v as f32)
        })
        .collect()
}

/// The vertices (n, 3 V) that the matrices of people (n, 9 P) give in the template's pose, less
/// their mean.
fn vertices_of_people(template: &Template, people: &Array2<f32>) -> Array2<f64> {
    let upright = vec![DMat3::IDENTITY; template.parts()];
    let mut rows = Array2::zeros((people.nrows(), 3 * template.vertices.len()));
    for (person, mut row) in people.rows().into_iter().zip(rows.rows_mut()) {
        let matrices: Vec<DMat3> = (0..template.faces.len())
            .map(|k| matrix(|e| person[9 * k + e]))
            .collect();
        let vertices = synthesize(template, &upright, &matrices);
        let numbers = vertices.iter().flat_map(|v| v.to_array());
        row.iter_mut().zip(numbers).for_each(|(to, v)| *to = v);
    }
    if let Some(mean) = rows.mean_axis(Axis(0)) {
        rows -= &mean;
    }
    rows
}
