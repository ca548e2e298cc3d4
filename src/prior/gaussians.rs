//! Weighted Gaussians over poses: what the parametric rivals have in common.
//!
//! ```text
//! p(x) = Σ_j w_j N(x; m_j, C_j),   y = x + noise of variances R
//! w_j|y ∝ w_j N(y_o; m_jo, C_j,oo + R_o)
//! m_j|y = m_j + C_j,:o (C_j,oo + R_o)⁻¹ (y_o − m_jo)                   C_j|y = C_j − C_j,:o (C_j,oo + R_o)⁻¹ C_j,o:
//! ```
//!
//! The answer is the average over j, with the covariance within and between; or, as clustered Gaussians are published,
//! the most likely j's alone. A model that explains a pose but in part (PCA) has a second variance, U_j, that counts
//! as noise of what is observed and is never estimated.
//!
//! Cost of an answer: K D² and, for each new pattern of noise, K D³ once; a few patterns are remembered.

use super::conditional::Conditional;
use super::met::Met;
use super::train::Training;
use super::training::TrainingPoses;
use super::tuning::{Grid, Learnt, Tasked, Tuned, tune};
use super::{Belief, Choice, EXACT, Fit, Posterior, Prior};
use crate::io::Model;
use crate::linalg::symmetric_eigen;
use crate::pose::PoseMap;
use crate::{Error, Place, Result, par};
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, s};
use std::sync::Arc;

/// Frames that one task answers.
const CHUNK: usize = 32;
/// So many conditionings are remembered in all (about 110 kB each).
const MOST_MET: usize = 640;
/// A component with less weight has no say.
const NO_SAY: f64 = 1e-9;

/// How the components make an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// The average by evidence.
    Average,
    /// The most likely component's alone.
    Best,
}

/// How a kind uses its Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Style {
    /// How the components make an answer.
    pub answer: Answer,
    /// Whether what the factors leave is estimated, too, or stays the mean.
    pub estimates_rest: bool,
}

/// Gaussians as they are stored: C_j = F_jᵀ F_j + diag(rest_j), whatever the kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// (K), above 0, adding up to 1.
    pub weights: Vec<f64>,
    /// (K, D), cm.
    pub means: Array2<f64>,
    /// (K q, D), cm: q rows a component, one after the other.
    pub factors: Array2<f64>,
    /// (K, D), cm², at least 0.
    pub rest: Array2<f64>,
}

impl Parts {
    /// From full covariances (D, D) of which the factors are the scaled eigenvectors: exact, and sound in f32.
    pub fn of_covariances(
        weights: Vec<f64>,
        means: Array2<f64>,
        covariances: &[Array2<f64>],
    ) -> Parts {
        let (k, d) = means.dim();
        let mut factors = Array2::zeros((k * d, d));
        for (j, covariance) in covariances.iter().enumerate() {
            let rows = s![j * d..(j + 1) * d, ..];
            factors.slice_mut(rows).assign(&roots(covariance));
        }
        Parts {
            weights,
            rest: Array2::zeros(means.dim()),
            means,
            factors,
        }
    }

    /// How many Gaussians there are.
    pub fn len(&self) -> usize {
        self.weights.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }

    /// F_jᵀ F_j.
    pub fn explained(&self, j: usize) -> Array2<f64> {
        let q = self.factors.nrows() / self.len().max(1);
        let f = self.factors.slice(s![j * q..(j + 1) * q, ..]);
        f.t().dot(&f)
    }

    /// C_j.
    pub fn covariance(&self, j: usize) -> Array2<f64> {
        let mut c = self.explained(j);
        c.diag_mut().zip_mut_with(&self.rest.row(j), |c, r| *c += r);
        c
    }

    /// Stores them as the arrays `weights` (K, 1), `means`, `factors` and `rest`.
    pub fn write(&self, model: &mut Model) {
        let weights = Array2::from_shape_fn((self.len(), 1), |(j, _)| self.weights[j]);
        for (name, array) in [
            ("weights", &weights),
            ("means", &self.means),
            ("factors", &self.factors),
            ("rest", &self.rest),
        ] {
            model.arrays.insert(name.into(), array.mapv(|v| v as f32));
        }
    }

    /// Reads what [`Parts::write`] left.
    ///
    /// # Errors
    /// Data: arrays that are not there, do not fit together, or hold what is not finite or out of range.
    pub fn read(model: &Model, source: &str) -> Result<Parts> {
        let d = 3 * model.meta.points.len();
        let wrong = |name: &str, what: String| Error::data(Place::file(source).part(name), what);
        let array = |name: &str| -> Result<Array2<f64>> {
            let array = model.array(name, source)?;
            match array.iter().all(|v| v.is_finite()) {
                true => Ok(array.mapv(f64::from)),
                false => Err(wrong(name, "holds a value that is not finite".into())),
            }
        };
        let (weights, means) = (array("weights")?, array("means")?);
        let (factors, rest) = (array("factors")?, array("rest")?);
        let k = weights.len();
        if k == 0 || weights.iter().any(|w| *w < 0.0) || !(weights.sum() > 0.0) {
            return Err(wrong(
                "weights",
                "are not at least one positive number".into(),
            ));
        }
        for (name, a, fits) in [
            ("means", &means, means.nrows() == k),
            (
                "factors",
                &factors,
                factors.nrows().is_multiple_of(k) && factors.nrows() <= k * d,
            ),
            (
                "rest",
                &rest,
                rest.nrows() == k && rest.iter().all(|v| *v >= 0.0),
            ),
        ] {
            if a.ncols() != d || !fits {
                let (n, m) = a.dim();
                let what = format!("({n}, {m}) does not fit {k} Gaussians of {d} coordinates");
                return Err(wrong(name, what));
            }
        }
        let sum = weights.sum();
        Ok(Parts {
            weights: weights.iter().map(|w| w / sum).collect(),
            means,
            factors,
            rest,
        })
    }
}

/// The rows whose products make up a covariance: √λ_i v_iᵀ, the largest first.
pub fn roots(covariance: &Array2<f64>) -> Array2<f64> {
    let d = covariance.nrows();
    let mut out = Array2::zeros((d, d));
    // LAPACK gives up on no symmetric matrix of finite numbers.
    if let Some((values, vectors)) = symmetric_eigen(covariance) {
        for i in 0..d {
            let scale = values[i].max(0.0).sqrt();
            out.row_mut(d - 1 - i).assign(&(&vectors.column(i) * scale));
        }
    }
    out
}

#[derive(Debug, Clone)]
struct Component {
    log_weight: f64,
    mean: Vec<f64>,
    /// C_j, or what of it is estimated.
    covariance: Array2<f64>,
    /// U_j: what is not.
    unexplained: Vec<f64>,
}

/// The prior: Gaussians at one inflation.
#[derive(Debug, Clone)]
pub struct Gaussians {
    components: Vec<Component>,
    answer: Answer,
    variance: Vec<f64>,
    typical: Array2<f64>,
    /// One a component.
    conditionals: Met<Vec<Conditional>>,
}

impl Gaussians {
    /// The Gaussians with their covariances `inflation` times as large; `typical` (t, D).
    pub fn new(
        parts: &Parts,
        style: Style,
        inflation: f64,
        typical: ArrayView2<'_, f64>,
    ) -> Gaussians {
        let component = |j: usize| {
            let (covariance, unexplained) = if style.estimates_rest {
                (parts.covariance(j), vec![0.0; parts.means.ncols()])
            } else {
                (parts.explained(j), parts.rest.row(j).to_vec())
            };
            Component {
                log_weight: parts.weights[j].ln(),
                mean: parts.means.row(j).to_vec(),
                covariance: covariance * inflation,
                unexplained,
            }
        };
        let components = (0..parts.len()).map(component).collect();
        Gaussians::of(components, style.answer, typical.to_owned())
    }

    fn of(components: Vec<Component>, answer: Answer, typical: Array2<f64>) -> Gaussians {
        Gaussians {
            variance: alone(&components),
            components,
            answer,
            typical,
            conditionals: Met::default(),
        }
    }

    fn conditionals(&self, noise: &[f64]) -> Arc<Vec<Conditional>> {
        let condition = |c: &Component| {
            let terms = noise.iter().zip(&c.unexplained);
            let noise: Vec<f64> = terms.map(|(n, u)| n.max(EXACT) + u).collect();
            Conditional::new(c.covariance.view(), &noise)
        };
        let all = || self.components.iter().map(condition).collect();
        let most = (MOST_MET / self.components.len().max(1)).max(1);
        self.conditionals.get(noise, most, all)
    }

    /// The components that have a say, each with its weight and its mean; and the log evidence.
    fn said(&self, y: &[f64], conditionals: &[Conditional]) -> (Vec<(usize, f64, Vec<f64>)>, f64) {
        let rest =
            |c: &Component| -> Vec<f64> { y.iter().zip(&c.mean).map(|(y, m)| y - m).collect() };
        let all = || self.components.iter().zip(conditionals);
        let logs: Vec<f64> = all()
            .map(|(c, given)| c.log_weight + given.log_density(&rest(c)))
            .collect();
        let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = logs.iter().map(|l| (l - best).exp()).sum();
        let winner = logs.iter().position(|l| *l == best).unwrap_or(0);
        let weight = |j: usize| match self.answer {
            Answer::Average => (logs[j] - best).exp() / sum,
            Answer::Best => f64::from(u8::from(j == winner)),
        };
        let said = all()
            .enumerate()
            .filter(|(j, _)| weight(*j) > NO_SAY || *j == winner);
        let said = said.map(|(j, (c, given))| {
            let told = given.mean(&rest(c));
            let mean = c.mean.iter().zip(told).map(|(m, t)| m + t).collect();
            (j, weight(j), mean)
        });
        (said.collect(), best + sum.ln())
    }

    fn by_rows<T: Send>(
        &self,
        y: ArrayView2<'_, f64>,
        noise: ArrayView2<'_, f64>,
        answer: impl Fn(&[f64], &[f64]) -> T + Sync,
    ) -> Vec<T> {
        let chunks = par::map_chunks(y.nrows(), CHUNK, |rows| {
            let row = |t: usize| answer(&y.row(t).to_vec(), &noise.row(t).to_vec());
            rows.map(row).collect::<Vec<T>>()
        });
        chunks.into_iter().flatten().collect()
    }
}

/// The weighted mean of what was said.
fn average(said: &[(usize, f64, Vec<f64>)], width: usize) -> Vec<f64> {
    let mut out = vec![0.0; width];
    let sum: f64 = said.iter().map(|(_, w, _)| w).sum();
    for (_, w, mean) in said {
        out.iter_mut()
            .zip(mean)
            .for_each(|(o, m)| *o += w / sum * m);
    }
    out
}

/// The variance of each coordinate where all the others are known, and what is not explained: Σ w_j / (C_j⁻¹)_ii + U_j.
fn alone(components: &[Component]) -> Vec<f64> {
    let mut out = vec![0.0; components.first().map_or(0, |c| c.mean.len())];
    for c in components {
        let weight = c.log_weight.exp();
        let Some((values, vectors)) = symmetric_eigen(&c.covariance) else {
            continue;
        };
        for (i, row) in vectors.rows().into_iter().enumerate() {
            let terms = row.iter().zip(&values);
            let precision: f64 = terms.map(|(v, l)| v * v / l.max(EXACT)).sum();
            out[i] += weight * (1.0 / precision + c.unexplained[i]);
        }
    }
    out
}

impl Prior for Gaussians {
    fn width(&self) -> usize {
        self.variance.len()
    }

    fn variance(&self) -> &[f64] {
        &self.variance
    }

    fn believe(&self, y: &[f64], noise: &[f64]) -> Belief {
        let conditionals = self.conditionals(noise);
        let (said, evidence) = self.said(y, &conditionals);
        let d = self.width();
        let mean = average(&said, d);
        let mut covariance = Array2::zeros((d, d));
        let sum: f64 = said.iter().map(|(_, w, _)| w).sum();
        for (j, w, own) in &said {
            let c = &self.components[*j];
            covariance.scaled_add(w / sum, &conditionals[*j].covariance(c.covariance.view()));
            let away: Vec<f64> = own.iter().zip(&mean).map(|(o, m)| o - m).collect();
            for (i, a) in away.iter().enumerate() {
                let away = ArrayView1::from(&away);
                covariance.row_mut(i).scaled_add(w / sum * a, &away);
                covariance[[i, i]] += w / sum * c.unexplained[i];
            }
        }
        Belief {
            mean,
            covariance,
            evidence,
        }
    }

    fn mean(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        average(&self.said(y, &self.conditionals(noise)).0, self.width())
    }

    fn believe_all(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Vec<Belief> {
        self.by_rows(y, noise, |y, noise| self.believe(y, noise))
    }

    fn means(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = Array2::zeros(y.dim());
        let means = self.by_rows(y, noise, |y, noise| self.mean(y, noise));
        for (mut row, mean) in out.rows_mut().into_iter().zip(means) {
            row.assign(&ArrayView1::from(&mean));
        }
        out
    }

    fn posterior(&self, y: &[f64], noise: &[f64], _fit: &Fit) -> Posterior {
        let conditionals = self.conditionals(noise);
        let (said, _) = self.said(y, &conditionals);
        let mean = average(&said, self.width());
        let sum: f64 = said.iter().map(|(_, w, _)| w).sum();
        let mut variance = vec![0.0; mean.len()];
        for (j, w, own) in &said {
            let unexplained = &self.components[*j].unexplained;
            for (i, v) in variance.iter_mut().enumerate() {
                let away = own[i] - mean[i];
                *v += w / sum * (conditionals[*j].variance[i] + unexplained[i] + away * away);
            }
        }
        Posterior { mean, variance }
    }

    fn typical(&self) -> ArrayView2<'_, f64> {
        self.typical.view()
    }

    fn mapped(&self, map: &PoseMap) -> Box<dyn Prior> {
        if map.is_identity() {
            return Box::new(self.clone());
        }
        let carried = |c: &Component| {
            let mut mean = c.mean.clone();
            map.apply(&c.mean, &mut mean);
            let unexplained = Array2::from_diag(&ArrayView1::from(&c.unexplained));
            Component {
                log_weight: c.log_weight,
                mean,
                covariance: map.apply_covariance(c.covariance.view()),
                unexplained: map.apply_covariance(unexplained.view()).diag().to_vec(),
            }
        };
        let components = self.components.iter().map(carried).collect();
        let typical = map.apply_rows(self.typical.view());
        Box::new(Gaussians::of(components, self.answer, typical))
    }
}

/// Trains a kind whose model is [`Parts`]: tuned on a part of the poses, then learnt from all of them.
pub(super) fn train(
    kind: &str,
    style: Style,
    training: &Training<'_>,
    learn: &dyn Fn(&TrainingPoses) -> Result<Parts>,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    let mut model = training.model(kind)?;
    let typical = model.arrays["typical"].mapv(f64::from);
    let tried = |part: &TrainingPoses| -> Result<Learnt<'_>> {
        let (parts, typical) = (learn(part)?, typical.view());
        Ok(Box::new(move |setting| {
            Box::new(Gaussians::new(&parts, style, setting.inflation, typical))
        }))
    };
    tune(training, &Grid::default(), &tried, report)?.write(&mut model);
    report("learns from all poses");
    learn(training.poses)?.write(&mut model);
    Ok(model)
}

/// Opens a model of such a kind, at its settings.
pub(super) fn open(model: &Model, choice: &Choice, source: &str, style: Style) -> Result<Tasked> {
    let parts = Parts::read(model, source)?;
    let typical = typical(model, &parts, source)?;
    let tuned = Tuned::read(model, source)?;
    let learnt: Learnt<'_> = Box::new(|setting| {
        Box::new(Gaussians::new(
            &parts,
            style,
            setting.inflation,
            typical.view(),
        ))
    });
    Ok(Tasked::new(tuned, choice.task, &learnt))
}

/// A model's typical poses; the means where it has none.
fn typical(model: &Model, parts: &Parts, source: &str) -> Result<Array2<f64>> {
    let Some(found) = model
        .arrays
        .get("typical")
        .filter(|t| t.len_of(Axis(0)) > 0)
    else {
        return Ok(parts.means.clone());
    };
    if found.ncols() != parts.means.ncols() || found.iter().any(|v| !v.is_finite()) {
        let what = "holds a value that is not finite, or poses of another width than the model's";
        return Err(Error::data(Place::file(source).part("typical"), what));
    }
    Ok(found.mapv(f64::from))
}
